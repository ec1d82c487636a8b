# SPDX-License-Identifier: MIT
"""Blocks of reports on flattening: what became of each plane and of its relief."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from completion.flattening.flat import FlatSurface, Region, RegionKind
from completion.result.completion import Completion
from completion.result.flat_scans import whole_flattening
from nbv.report.blocks.page import Block, Cell, Gallery, Section, Table, Text
from nbv.report.pictures.picture import height_colours, picture_of
from nbv.run.wording import count
from scenes.checks import FloatArray
from scenes.run.mapping import trim
from scenes.scan.colour import surface_colour
from scenes.scan.thumbnail import standing

_MOST_ROWS, _MOST_AREAS = 100, 40
_LEAST_P = 1e-6
_LONG = "are too few to tell ripple from relief"
_NOTE = (
    "ripple: distance of the points from their plane, root mean square, without relief. least p flattened: "
    "of the most evident area that was flattened. Areas of fewer than four cells always are, and those no "
    "higher than the steps that a sensor's ranges come in."
)
_NOTE_AREAS = (
    "p: how probably a plane of this size with this ripple and without relief shows an area as evident "
    "anywhere. without ripple: whether its ripple was told from its shape and taken from it too."
)


@dataclass(frozen=True, slots=True)
class FlatRow:
    """A plane in the table: its name, the place of its colour, and what became of it."""

    name: str
    place: int
    surface: FlatSurface


def flattening_blocks(rows: Sequence[FlatRow]) -> tuple[Block, ...]:
    """Return a table with a row for each plane, one with a row for each area of relief, and notes."""
    if not rows:
        return (Text("There is no plane."),)
    columns = (
        "Plane", "#ripple, mm", "#flattened, mm", "#with relief, mm", "#flattened, mm", "#relief, %",
        "#least p flattened", "Left as it was",
    )  # fmt: skip
    told: list[Block] = [Table(columns, tuple(_row(one) for one in rows[:_MOST_ROWS]))]
    if len(rows) > _MOST_ROWS:
        told.append(Text(f"{len(rows) - _MOST_ROWS} others are not shown; the JSON file holds them."))
    told.append(Text(_NOTE, is_note=True))
    areas = [
        (row, region) for row in rows for region in row.surface.regions if region.kind is RegionKind.RELIEF
    ]
    if not areas:
        return (*told, Text("No relief was found."))
    areas.sort(key=lambda pair: -pair[1].area_m2)
    of_areas = ("Relief on", "#height, mm", "#sd, mm", "#area, cm\u00b2", "#p", "Without ripple")
    told.append(Table(of_areas, tuple(_area_row(*one) for one in areas[:_MOST_AREAS])))
    if len(areas) > _MOST_AREAS:
        told.append(
            Text(f"{len(areas) - _MOST_AREAS} smaller areas are not shown; the JSON file holds them.")
        )
    return (*told, Text(_NOTE_AREAS, is_note=True))


def _row(row: FlatRow) -> tuple[Cell, ...]:
    one = row.surface
    gone = [
        region.p
        for region in one.regions
        if region.kind is RegionKind.FLATTENED and region.area_m2 >= 3.5 * one.cell_m**2
    ]
    return (
        Cell(row.name, swatch=surface_colour(row.place)),
        *(Cell(f"{1000 * value:.2f}") for value in (one.ripple_before_m, one.ripple_after_m)),
        *(Cell(f"{1000 * value:.2f}") for value in (one.rms_before_m, one.rms_after_m)),
        Cell(f"{100 * one.n_relief / max(one.n, 1):.1f}"),
        Cell(p_text(min(gone)) if gone else ""),
        Cell(one.reason.replace(_LONG, "too few").partition(";")[0]),
    )


def _area_row(row: FlatRow, region: Region) -> tuple[Cell, ...]:
    return (
        Cell(row.name, swatch=surface_colour(row.place)),
        Cell(f"{1000 * region.height_m:+.1f}"),
        Cell(f"{1000 * region.sd_m:.2f}"),
        Cell(f"{1e4 * region.area_m2:.3g}"),
        Cell(p_text(region.p)),
        Cell("yes" if region.is_cleared else "no"),
    )


def p_text(p: float) -> str:
    """A probability to one digit, and how small it is at most where it is tiny."""
    return f"{p:.1g}" if p >= _LEAST_P else f"<{_LEAST_P:.0e}"


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
