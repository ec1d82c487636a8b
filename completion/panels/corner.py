# SPDX-License-Identifier: MIT
"""Corners: folds end where a third surface crosses them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from completion.panels.fold import Fold
from completion.panels.sheet import Sheet
from scenes.checks import FloatArray
from scenes.surfaces.catalogue import Surface

_REACH = 4.0  # cells between a fold's end and the corner that it is moved to
_PRESENT = 3.0  # cells between a corner and the third surface's outline
_STEPS = 32  # in which a crossing is looked for
_HALVINGS = 50
_SAME_M = 1e-4  # that two corners of the same surfaces are apart
_FLATTEST = float(np.sin(np.radians(12.0)))  # volume of three unit normals that meet in a corner


@dataclass(frozen=True, slots=True, eq=False)
class Corner:
    """A point in which three surfaces meet, and folds end or cross."""

    surfaces: tuple[int, int, int]  # numbers, from 1, ascending
    point: FloatArray  # (3,) metres, working frame


def close_corners(folds: Sequence[Fold], sheets: Sequence[Sheet]) -> tuple[list[Fold], list[Corner]]:
    """Move the ends of folds to where a third surface crosses them, within four cells; say which corners.

    An end at which another piece of the same fold goes on stays. A fold is not moved out of being.
    """
    moved, corners = [], list[Corner]()
    fixed = {
        (fold.first, fold.second, end) for fold in folds for end in (fold.start, fold.end)
        if sum(end in (other.start, other.end) for other in folds if _same_pair(fold, other)) > 1
    }  # fmt: skip
    for fold in folds:
        ends = []
        for end in (fold.start, fold.end):
            is_fixed = (fold.first, fold.second, end) in fixed
            found = None if is_fixed else _nearest_crossing(fold, end, sheets)
            ends.append(end if found is None else found[0])
            if found is not None:
                first, second, third = sorted((fold.first, fold.second, found[1]))
                point = fold.curve.at(np.array([found[0]]))[0]
                corners.append(Corner((first, second, third), point))
        start, end = ends
        moved.append(replace(fold, start=start, end=end) if start < end else fold)
    return moved, _distinct(corners)


def _same_pair(one: Fold, other: Fold) -> bool:
    return (one.first, one.second) == (other.first, other.second)


def _nearest_crossing(fold: Fold, end: float, sheets: Sequence[Sheet]) -> tuple[float, int] | None:
    """The parameter nearest to an end of a fold at which a third surface crosses it, and that surface."""
    reach = _REACH * fold.cell_m
    t = np.linspace(end - reach, end + reach, _STEPS + 1)
    points = fold.curve.at(t)
    best: tuple[float, int] | None = None
    for sheet in sheets:
        if sheet.number in (fold.first, fold.second):
            continue
        height = sheet.surface.distance(points)
        for k in np.flatnonzero(np.signbit(height[:-1]) != np.signbit(height[1:])):
            root = _root(fold, sheet.surface, float(t[k]), float(t[k + 1]))
            place = fold.curve.at(np.array([root]))
            if best is not None and abs(root - end) >= abs(best[0] - end):
                continue
            if _volume(fold, sheets, sheet.surface, place) < _FLATTEST:
                continue
            if sheet.is_within(sheet.surface.to_uv(place), _PRESENT * sheet.cell_m)[0]:
                best = (root, sheet.number)
    return best


def _volume(fold: Fold, sheets: Sequence[Sheet], third: Surface, place: FloatArray) -> float:
    """Volume that the unit normals of three surfaces span at a place (1, 3)."""
    own = [sheets[number - 1].surface for number in (fold.first, fold.second)]
    normals = np.stack([surface.normal(place)[0] for surface in (*own, third)])
    return float(abs(np.linalg.det(normals)))


def _root(fold: Fold, surface: Surface, low: float, high: float) -> float:
    """The parameter between two at which a fold goes through a surface, by bisection."""
    below = surface.distance(fold.curve.at(np.array([low])))[0]
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        if np.signbit(surface.distance(fold.curve.at(np.array([middle])))[0]) == np.signbit(below):
            low = middle
        else:
            high = middle
    return (low + high) / 2


def _distinct(corners: Sequence[Corner]) -> list[Corner]:
    """Each corner once, by its surfaces and place."""
    kept: list[Corner] = []
    for one in sorted(corners, key=lambda corner: corner.surfaces):
        same = (other for other in kept if other.surfaces == one.surfaces)
        if not any(float(np.linalg.norm(one.point - other.point)) < _SAME_M for other in same):
            kept.append(one)
    return kept
