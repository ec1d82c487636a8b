# SPDX-License-Identifier: MIT
"""Features on one page: from scans, points or a mesh to objects fitted whole, with what speaks for each."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np
from scipy.spatial import cKDTree

from completion.features.engine.options import KNOWN, OPENINGS
from completion.features.engine.template import (
    Features,
    Given,
    Measurements,
    PixelBeams,
    TemplateFit,
    best_first,
)
from completion.features.holes.patterns import KINDS as HOLES
from completion.features.holes.pipeline import find_holes
from completion.features.junctions.pipeline import find_junctions
from completion.features.limits import FEWEST_POINTS
from completion.features.openings.pipeline import find_openings_of_scans
from completion.features.solids import KINDS as SOLIDS
from completion.features.solids import find_solids
from completion.merging.scan_surfaces import SurfaceOptions, find_surfaces
from completion.observe.range_noise import estimate_noise
from completion.room.pipeline import find_room
from scenes.checks import FloatArray, InputError, IntArray, check_direction, check_points, check_rng
from scenes.inclination import Up
from scenes.run.journal import NO_JOURNAL, Journal
from scenes.run.steps import Progress, Steps
from scenes.scan.range_image import RangeImage

_AROUND = 12  # neighbours that a point's plane is fitted to
_SAMPLE = 4000  # points that tell noise and spacing
_PARAMETERS_OF_A_PLANE = 3


def of_points(
    points: FloatArray, *, faces: IntArray | None = None, noise: float | None = None
) -> Measurements:
    """Return points, or a mesh's vertices with its faces, as material.

    Parameters
    ----------
    points : (n, 3) float
        In any unit.
    faces : (m, 3) int, optional
        Triangles.
    noise : float, optional
        Standard deviation across the surface; when None it is read off how far points lie from planes through
        their neighbours, in the flattest half.

    Raises
    ------
    InputError
        Fewer than 20 points, not finite, or all at one place.
    """
    held = check_points("points", points)
    if len(held) < FEWEST_POINTS:
        raise InputError(f"features need {FEWEST_POINTS} points at least, got {len(held)}")
    _check_extent(held)
    spacing, rough = _spacing_and_noise(held)
    return Measurements(held, rough if noise is None else float(noise), spacing, faces=faces)


def of_scans(scans: Sequence[RangeImage], *, sigma_m: float | None = None) -> Measurements:
    """Return all scans in the world as material: their points in turn, and every beam.

    Raises InputError: scans in which nothing came back.
    """
    origins, directions, ranges, points, noise = [], [], [], [], []
    for scan in scans:
        n = scan.ranges.size
        origins.append(np.broadcast_to(scan.origin, (n, 3)))
        directions.append(scan.rays().reshape(n, 3))
        ranges.append(scan.ranges.ravel())
        points.append(scan.points().reshape(n, 3))
        known = scan.sigma_m if sigma_m is None else sigma_m
        away = np.median(scan.ranges[scan.valid]) if scan.valid.any() else 0.0
        noise.append(float(estimate_noise(scan).sigma(np.array([away]))[0]) if known is None else known)
    beams = PixelBeams(np.concatenate(origins), np.concatenate(directions), np.concatenate(ranges))
    back = np.flatnonzero(np.isfinite(beams.ranges))
    if len(back) < FEWEST_POINTS:
        raise InputError(f"features need {FEWEST_POINTS} points at least, got {len(back)}")
    held = np.concatenate(points)[back]
    _check_extent(held)
    spacing, _ = _spacing_and_noise(held)
    return Measurements(held, float(np.median(noise)), spacing, beams=beams, beam_of_point=back)


def _check_extent(points: FloatArray) -> None:
    if not np.ptp(points, axis=0).any():
        raise InputError(f"all {len(points)} points lie at one place: there is nothing to find")


def _spacing_and_noise(points: FloatArray) -> tuple[float, float]:
    """Median distance to the nearest neighbour, and deviation from planes through neighbours."""
    tree, step = cKDTree(points), max(1, len(points) // _SAMPLE)
    sample = points[::step]
    away, near = tree.query(sample, k=min(_AROUND + 1, len(points)))
    group = points[near] - points[near].mean(axis=1, keepdims=True)
    least = np.linalg.svd(group, compute_uv=False)[:, -1]
    rough = least / np.sqrt(max(near.shape[1] - _PARAMETERS_OF_A_PLANE, 1))
    return float(np.median(away[:, 1])), float(np.quantile(rough, 0.25))


KINDS = tuple(KNOWN)
"""What can be found."""

_BUDGET = 200_000
_FINDERS: dict[str, Callable[..., list[TemplateFit]]] = {
    **dict.fromkeys(HOLES, find_holes),
    **dict.fromkeys(("junction", "elbow"), find_junctions),
    **dict.fromkeys(SOLIDS, find_solids),
}


def find_features(
    material: Sequence[RangeImage] | Measurements,
    kinds: Sequence[str],
    *,
    given: Mapping[str, Given] | None = None,
    evaluations: int = _BUDGET,
    up: Sequence[float] | None = None,
    rng: np.random.Generator | int | None = None,
    n_threads: int | None = None,
    progress: Progress | None = None,
    journal: Journal = NO_JOURNAL,
) -> Features:
    """Find objects of several faces by what is known of them (after Fisher, section 3).

    Each is fitted whole, from whatever fragments show of it. It is accepted where what was measured speaks
    for it, and refused, with the reason, where it speaks against it; what nobody saw of it is said. An
    interrupt, or the end of the budget, leaves the best so far, marked as such.

    Parameters
    ----------
    material : sequence of RangeImage, or Measurements
        Registered scans; or points or a mesh (`material.of_points`). Doorways, windows and niches need scans:
        points do not say where beams went on.
    kinds : sequence of str
        Some of `KINDS`.
    given : mapping, optional
        What a person knows of each kind, by name (`given.KNOWN`). It is held exactly.
    evaluations : int
        Of each search at most.
    up : (3,) float, optional
        The direction that is up, for openings, stairs and columns. When not given it is z of points and
        meshes, and estimated of scans (`find_up`).
    rng : Generator, int or None
        Seed of the searches.
    n_threads, progress, journal
        As in `complete`.

    Raises
    ------
    InputError
        No material, an unknown kind, openings asked of points, fewer than 20 points, no direction that is up.
    """
    _check(material, kinds)
    known, draws = given or {}, check_rng(rng)
    is_whole, features, doubts = True, list[TemplateFit](), list[str]()
    openings = [kind for kind in kinds if kind in OPENINGS]
    others = [kind for kind in kinds if kind not in OPENINGS]
    try:
        # 1. Openings: doorways, windows and niches in every upright plane, by beams that go on or stop.
        upward = check_direction("up", (0.0, 0.0, 1.0) if up is None else up)
        if not isinstance(material, Measurements) and (openings or (up is None and set(kinds) & set(SOLIDS))):
            sizes, pose = [scan.ranges.size for scan in material], material[0].world_from_sensor
            with Steps.over(sizes, n_threads, progress, journal) as steps:
                surfaces = find_surfaces(material, SurfaceOptions(), steps)
                room_up, surfaces = find_room(surfaces, pose, None if up is None else Up(upward))
                upward, doubts = room_up.direction, [room_up.word] if room_up.word else []
                if openings:
                    fits, sentences = find_openings_of_scans(
                        material, surfaces, openings, known, steps=steps, up=upward
                    )
                    features, doubts = [*features, *fits], [*doubts, *sentences]

        elif isinstance(material, Measurements) and up is None and set(kinds) & set(SOLIDS):
            doubts.append("points do not tell what is up: z is taken; --up says otherwise")

        # 2. Others: solids, patterns of holes and junctions, in the points of all scans together.
        if others:
            measured = material if isinstance(material, Measurements) else of_scans(material)
        for done, (kind, *more) in enumerate(_searches(others, known)):
            if progress is not None:
                progress("features", done, len(others))
            search = partial(_FINDERS[kind], up=upward) if kind in SOLIDS else _FINDERS[kind]
            budget = evaluations * (1 + len(more))
            features += search(measured, [kind, *more], known.get(kind, {}), rng=draws, budget=budget)
    except KeyboardInterrupt:
        is_whole = False

    # 3. Order: found, ambiguous, refused, the most evident of each first.
    n_points = (
        len(material.points)
        if isinstance(material, Measurements)
        else sum(int(np.count_nonzero(scan.valid)) for scan in material)
    )
    is_whole = is_whole and all(fit.is_complete for fit in features)
    return Features(tuple(best_first(features)), n_points, is_complete=is_whole, doubts=tuple(doubts))


def _searches(kinds: Sequence[str], known: Mapping[str, Given]) -> list[list[str]]:
    """Return kinds in searches: patterns of holes with the same known values share the survey of plates."""
    searches: list[list[str]] = []
    for kind in kinds:
        same = [
            search for search in searches
            if kind in HOLES and search[0] in HOLES and known.get(kind, {}) == known.get(search[0], {})
        ]  # fmt: skip
        if same:
            same[0].append(kind)
        else:
            searches.append([kind])
    return searches


def _check(material: Sequence[RangeImage] | Measurements, kinds: Sequence[str]) -> None:
    for kind in kinds:
        if kind not in KINDS:
            raise InputError(f"there is no feature called {kind!r}; there are {', '.join(KINDS)}")
    if not kinds:
        raise InputError(f"say what to find: {', '.join(KINDS)}")
    openings = [kind for kind in kinds if kind in OPENINGS]
    if isinstance(material, Measurements):
        if openings:
            raise InputError(
                f"a {openings[0]} is seen by beams that go through it, and points have none: give scans, or "
                "say where points were measured from (--origin X,Y,Z)"
            )
    elif not len(material):
        raise InputError("no scans: give at least one")
