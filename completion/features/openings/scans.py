# SPDX-License-Identifier: MIT
"""Openings of scans: surfaces first, then the openings of all walls, in the world."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from completion.features.engine.feature_set import moved_geometry
from completion.features.engine.template import Given, Status, TemplateFit
from completion.features.openings.decision import LEAST_NICHE_M
from completion.features.openings.scene import find_openings, walls_of
from completion.merging.merged_surface import MergedSurface
from completion.merging.scan_surfaces import SurfaceOptions, find_surfaces
from completion.observe.observation import Observation
from completion.registration.registered import pose_doubts
from scenes.checks import FloatArray
from scenes.run.steps import Steps
from scenes.scan.range_image import RangeImage

_SHALLOW = 3.0  # deviations of the range by which a leaf must lie behind its wall to be told from it


def find_openings_of_scans(
    scans: Sequence[RangeImage], kinds: Sequence[str], given: Mapping[str, Given], steps: Steps
) -> tuple[list[TemplateFit], list[str]]:
    """Return the openings of registered scans, and doubts about poses and recesses; world coordinates.

    Poses that contradict what was measured are corrected as in `complete`, in the world of the poses given.

    Parameters
    ----------
    scans : sequence of RangeImage
        Registered.
    kinds : sequence of str
        Of "doorway", "window", "niche". What nobody saw the foot of may be a doorway or a window.
    given : mapping
        What a person knows of each kind.
    steps : Steps
        Where to run.
    """
    # 1. Surfaces: those of completion.
    found = find_surfaces(scans, SurfaceOptions(), steps)
    surfaces, observations, owners = found.surfaces, found.observations, found.evidence(steps).owners
    world_from_reference = scans[0].world_from_sensor

    # 2. Find: what is known of a kind holds for all that are sought with it.
    up = world_from_reference.matrix[2, :3]
    fits: list[TemplateFit] = []
    for some, known in _alike(kinds, given):

        def each(work: Callable[[int], list[TemplateFit]], numbers: Iterable[int]) -> list[list[TemplateFit]]:
            return steps.each("openings", work, numbers)

        fits += find_openings(surfaces, observations, owners, up, given=known, kinds=some, each=each)

    # 3. World: what was found in the frame of the first scan; points are those that came back, in turn.
    valid = np.concatenate([scan.valid.ravel() for scan in scans])
    pose = world_from_reference
    moved = [
        replace(
            fit,
            geometry=moved_geometry(fit, pose.rotation, pose.translation),
            assignment=fit.assignment[valid],
        )
        for fit in fits
    ]
    is_any = any(fit.status is not Status.NONE for fit in moved)
    doubts = pose_doubts(found.registration)
    return moved, doubts if is_any else [*doubts, _why_none(surfaces, observations, up)]


def _alike(kinds: Sequence[str], given: Mapping[str, Given]) -> list[tuple[list[str], Given]]:
    """Kinds of which the same is known, together."""
    groups: dict[tuple[tuple[str, float], ...], list[str]] = {}
    for kind in kinds:
        groups.setdefault(tuple(sorted(given.get(kind, {}).items())), []).append(kind)
    return [(some, dict(known)) for known, some in groups.items()]


def _why_none(surfaces: Sequence[MergedSurface], observations: Sequence[Observation], up: FloatArray) -> str:
    """What was looked at, and how shallow a recess would not have been told."""
    walls = walls_of(surfaces, up)
    if not walls:
        return "no upright plane was found: openings are sought in walls"
    away = np.concatenate(
        [
            seen.scan.ranges.ravel()[some]
            for _, one in walls
            for seen, some in one.sampled_by(observations, 200)
        ]
    )
    far = float(np.median(away[np.isfinite(away)]))
    sd = float(np.max([seen.noise.deviation(np.array([far]))[0] for seen in observations]))
    shallow = 1000 * max(_SHALLOW * sd, LEAST_NICHE_M)
    return (
        f"no opening was found in {len(walls)} upright planes, at {far:.1f} m in the median; a leaf less "
        f"than {shallow:.0f} mm behind its wall cannot be told from it there, nor a hole from which nothing "
        "came back"
    )
