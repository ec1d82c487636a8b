# SPDX-License-Identifier: MIT
"""The openings of all walls of a scan, each once, however many planes propose it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from completion.features.engine.options import OPENINGS
from completion.features.engine.template import Given, Status, TemplateFit, best_first
from completion.features.openings.decision import DOOR_M
from completion.features.openings.fitting import FLOOR_M
from completion.features.openings.pipeline import SIDEWAYS, find_openings_in
from completion.features.openings.walls import Floor, Wall
from completion.merging.merged_surface import MergedSurface
from completion.observe.observation import Observation
from scenes.checks import FloatArray
from scenes.surfaces.catalogue import Plane

_LEVEL = 0.98  # cosine between a floor's normal and up
_LEAST_POINTS = 500  # of a plane in which openings are sought
_MOST_POINTS = 20_000
_LEVEL_POINTS, _FEW_POINTS = 4000, 200  # of a level plane, that say where it is
_STEP_M = 0.25  # cells of a floor, of which people need three each way
_SHARED = 0.2  # of the smaller of two holes that cannot both be there
_SAME_M = 0.15  # between the middles of what is one opening, beside half its width

Each = Callable[[Callable[[int], list[TemplateFit]], Iterable[int]], list[list[TemplateFit]]]


def find_openings(
    surfaces: Sequence[MergedSurface],
    observations: Sequence[Observation],
    owners: Sequence[NDArray[np.int32]],
    up: FloatArray,
    *,
    given: Given | None = None,
    kinds: Sequence[str] = OPENINGS,
    each: Each | None = None,
    is_assigned: bool = True,
) -> list[TemplateFit]:
    """Return doorways, windows and niches of upright planes, found ones first, refused ones last.

    Parameters
    ----------
    surfaces : sequence of MergedSurface
        All that were found, in the frame of the observations.
    observations : sequence of Observation
        The scans.
    owners : sequence of (rows, columns) int
        Number, from 1, of the surface that each pixel is of; 0 for none.
    up : (3,) float
        What is up in that frame.
    given : mapping, optional
        What a person knows: "width", "height", "depth", metres.
    kinds : sequence of str
        Which are wanted. A hole whose foot nobody saw may be a doorway or a window, whatever it is called.
    each : callable, optional
        Applies a function to all numbers, on threads for example.
    is_assigned : bool
        Whether they say which face each pixel is of: a number for every pixel of every scan.
    """
    walls = {number for number, _ in walls_of(surfaces, up)}
    floors = floors_of(surfaces, observations, up)

    def of_wall(number: int) -> list[TemplateFit]:
        surface = surfaces[number]
        if number not in walls:
            return []
        points = surface.points(observations, _MOST_POINTS)
        wall = Wall(surface.fit, points, number + 1, owners)
        return list(find_openings_in(wall, observations, up, floors, given or {}, is_assigned=is_assigned))

    numbers = range(len(surfaces))
    found = [of_wall(number) for number in numbers] if each is None else each(of_wall, numbers)
    return _each_once([fit for some in found for fit in some if fit.kind in kinds or _may_be(fit, kinds)])


def _may_be(fit: TemplateFit, kinds: Sequence[str]) -> bool:
    return fit.kind != "niche" and "bottom" in fit.unseen and bool({"doorway", "window"} & set(kinds))


def walls_of(surfaces: Sequence[MergedSurface], up: FloatArray) -> list[tuple[int, MergedSurface]]:
    """Return the upright planes that enough points were measured of, with their numbers, from 0.

    `up` (3,) is what is up in their frame.
    """
    return [
        (number, one)
        for number, one in enumerate(surfaces)
        if one.n_pixels >= _LEAST_POINTS
        and isinstance(one.fit.surface, Plane)
        and abs(float(one.fit.surface.normal_direction @ up)) <= SIDEWAYS
    ]


def floors_of(
    surfaces: Sequence[MergedSurface], observations: Sequence[Observation], up: FloatArray
) -> list[Floor]:
    """Return the level planes that people stand on, by `up` (3,).

    What stands on a floor is none: seats, beds and tables lie within the outline of a lower level, less than
    a person's height above it. Neither is what is narrow, as a sill.
    """
    frame = np.linalg.svd(up[None])[2][1:]  # two directions along the ground
    sampled = [(one, one.points(observations, _LEVEL_POINTS)) for one in surfaces if _is_level(one, up)]
    wide = [pair for pair in sampled if _is_wide(pair[1] @ frame.T)]
    points = [some for _, some in wide]
    height = [float(np.median(some @ up)) for some in points]
    plans = [some @ frame.T for some in points]
    few = [plan[:: max(1, len(plan) // _FEW_POINTS)] for plan in plans]

    def stands(k: int) -> bool:
        return any(
            FLOOR_M < height[k] - height[j] < DOOR_M and _share_within(few[k], plans[j]) > 0.5
            for j in range(len(wide))
        )

    return [Floor(one.fit, some) for k, (one, some) in enumerate(wide) if not stands(k)]


def _is_wide(plan: FloatArray) -> bool:
    """Whether places (n, 2) fill a square of three cells somewhere."""
    column, row = np.floor((plan - plan.min(axis=0)) / _STEP_M).astype(np.int64).T
    filled = np.zeros((row.max() + 1, column.max() + 1), dtype=np.bool_)
    filled[row, column] = True
    return bool(ndimage.binary_erosion(filled, np.ones((3, 3))).any())


def _share_within(plan: FloatArray, other: FloatArray) -> float:
    """The share of places (n, 2) that lie within the convex hull of others (m, 2)."""
    hull = cv2.convexHull(other.astype(np.float32))[:, 0].astype(np.float64)
    edge = np.roll(hull, -1, axis=0) - hull
    away = plan[:, None] - hull
    side = edge[:, 0] * away[..., 1] - edge[:, 1] * away[..., 0]
    return float(((side >= 0).all(axis=1) | (side <= 0).all(axis=1)).mean())


def _is_level(surface: MergedSurface, up: FloatArray) -> bool:
    plane = surface.fit.surface
    return isinstance(plane, Plane) and float(plane.normal_direction @ up) > _LEVEL


def _each_once(fits: Sequence[TemplateFit]) -> list[TemplateFit]:
    """The fits, best first, without those of a parallel plane that are the same hole.

    Of refused ones those go whose middle lies in one that is found.
    """
    kept: list[TemplateFit] = []
    for fit in best_first(fits):
        if not any(_is_same(fit, other) for other in kept):
            kept.append(fit)
    return kept


def _is_same(fit: TemplateFit, other: TemplateFit) -> bool:
    """Whether two holes look the same way, near one plane, and share more than a fifth of the smaller one.

    Of a found one and a refused one the middle of the refused one must lie within the other.
    """
    if other.status is Status.NONE and fit.status is not Status.NONE:
        return False
    into, beyond = np.asarray(fit.geometry["into"]), np.asarray(other.geometry["into"])
    if float(into @ beyond) < _LEVEL:
        return False
    own, corners = np.asarray(fit.geometry["corners"]), np.asarray(other.geometry["corners"])
    if abs(float((own.mean(axis=0) - corners.mean(axis=0)) @ beyond)) >= _SAME_M:
        return False
    u, v = corners[1] - corners[0], corners[3] - corners[0]
    at = (own - corners[0]) @ np.column_stack([u / (u @ u), v / (v @ v)])  # in the other's width and height
    if fit.status is Status.NONE:
        return bool((np.abs(at.mean(axis=0) - 0.5) < 0.5).all())
    low, high = at.min(axis=0), at.max(axis=0)
    shared = np.prod(np.clip(np.minimum(high, 1.0) - np.maximum(low, 0.0), 0.0, None))
    return bool(shared > _SHARED * min(1.0, float(np.prod(high - low))))
