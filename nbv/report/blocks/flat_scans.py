# SPDX-License-Identifier: MIT
"""Blocks on flattened scans: heights over the planes as the scanner saw them, before and after."""

from __future__ import annotations

from functools import partial

import numpy as np

from completion.result.completion import Completion
from completion.result.flat_scans import whole_flattening
from nbv.report.blocks.flattening_blocks import FlatRow, flattening_blocks
from nbv.report.page.page import Block, Gallery, Section, Text
from nbv.report.pictures.picture import height_colours, picture_of
from nbv.run.wording import count
from scenes.checks import FloatArray
from scenes.run.mapping import trim
from scenes.scan.thumbnail import standing

_MOST_SCANS = 3  # of which pictures are shown
_SHOWN_SD = 3.0  # of the ripple, at which the colours of heights end
_LEAST_M = 1e-6


def flattening_sections(completion: Completion) -> tuple[Section, ...]:
    """Return a section on what flattening did; none where nobody asked."""
    scans = completion.flattened
    if not scans:
        return ()
    told = whole_flattening(scans)
    text = (
        f"{count(told['planes'], 'plane was', 'planes were')} flattened along the rays of their pixels, in "
        f"observed.ply and completed.glb; what is inferred does not depend on it. Ripple fell from "
        f"{1000 * told['ripple_before_m']:.2f} to {1000 * told['ripple_after_m']:.2f} mm rms, "
        f"{count(told['relief_areas'], 'area')} of relief stayed. {told['turned_over']} triangles turned "
        f"over, {told['crossing_anew']} cross others that they did not cross."
    )
    rows = [
        FlatRow(f"{one.label}" + (f", scan {scan}" if len(scans) > 1 else ""), one.label, one)
        for scan, held in enumerate(scans, start=1)
        for one in held.surfaces
    ]
    galleries = [_gallery(completion, scan) for scan in range(min(len(scans), _MOST_SCANS))]
    return (Section("Flattened", (Text(text), *galleries, *flattening_blocks(rows))),)


def _gallery(completion: Completion, scan: int) -> Block:
    """Heights over their planes of the pixels of a scan, from 0, before and after."""
    seen, owner, flat = completion.observations[scan], completion.owners[scan], completion.flattened[scan]
    done = [one for one in flat.surfaces if one.is_flattened]
    most_m = max(_SHOWN_SD * float(np.median([one.ripple_sd_m for one in done])) if done else 0.0, _LEAST_M)
    before, after = (np.full(owner.shape, np.nan) for _ in range(2))
    for one in done:
        pixel = np.flatnonzero(owner == one.label)
        plane, points = completion.patches[one.label - 1].source.fit.surface, seen.points_at(pixel)
        before.ravel()[pixel] = plane.distance(points)
        moved = points + flat.shift_m.ravel()[pixel, None] * seen.rays_at(pixel)
        after.ravel()[pixel] = plane.distance(moved)
        trim()
    pose = completion.world_from_reference @ seen.scan.world_from_sensor
    view = partial(standing, projection=seen.scan.projection, pose=pose)
    name = f"{seen.scan.name}: " if len(completion.flattened) > 1 else ""
    scale = (
        f"{-1000 * most_m:.2g} mm (blue) to {1000 * most_m:.2g} mm (red) over each plane; empty elsewhere."
    )

    def shown(heights: FloatArray) -> FloatArray:
        return height_colours(view(heights), most_m)

    return Gallery(
        (
            picture_of(shown(before), f"{name}as measured", scale),
            picture_of(shown(after), f"{name}flattened", "White is plane; relief keeps its colour."),
        ),
        columns=2,
    )
