# SPDX-License-Identifier: MIT
"""Corners: where fold curves of one surface meet.

Curves on one surface cross well even where the other two surfaces only touch, as a fillet's end does.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from completion.exchange.step.curves.fold_curve import FoldCurve
from scenes.checks import FloatArray

_N_STEPS = 25
_MERGED = 0.35  # sampling distances: corners that are nearer are one
_STEEP = 0.2  # sine of the angle between curves, from which on they cross well
_COINCIDE = 0.05  # sampling distances
_MEET = 0.5  # sampling distances that curves may be apart where they meet


@dataclass(slots=True, eq=False)
class Corner:
    """A point (3,), millimetres, where curves meet: their parameters by place, how far they are off it.

    Or where one ends that meets none (`is_free`).
    """

    point: FloatArray
    at: dict[int, list[float]] = field(default_factory=dict)
    off: float = 0.0
    is_free: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class _Crossing:
    curves: tuple[int, int]
    point: FloatArray
    gap: float
    is_steep: bool

    @property
    def rank(self) -> tuple[bool, float]:
        """The better known first: curves that cross, before those that run side by side and touch."""
        return not self.is_steep, round(self.gap, 9)


def corners_of(curves: Sequence[FoldCurve], spacing: float) -> list[Corner]:
    """Return the corners of curves, millimetres."""
    crossings = [
        one
        for a in range(len(curves))
        for b in range(a + 1, len(curves))
        if set(curves[a].pair) & set(curves[b].pair) and _may_meet(curves[a], curves[b], spacing)
        for one in _crossings(a, b, curves, spacing)
    ]
    found = list[Corner]()
    for group in _groups(crossings, _MERGED * spacing):
        best = min(group, key=lambda one: one.rank)
        alike = [one for one in group if one.is_steep == best.is_steep]
        exact = [one.point for one in alike if one.gap <= max(1e-7, 1.5 * best.gap)]
        near = [point for point in exact if np.linalg.norm(point - best.point) < 1e-3 * spacing]
        corner = Corner(np.mean(near, axis=0))
        for place in sorted({curve for one in group for curve in one.curves}):
            t, off = curves[place].feet(corner.point[None])
            corner.at[place] = [float(t[0])]
            corner.off = max(corner.off, float(off[0]))
        found.append(corner)
    return found


def _may_meet(one: FoldCurve, two: FoldCurve, spacing: float) -> bool:
    low = np.maximum(one.points.min(axis=0), two.points.min(axis=0))
    high = np.minimum(one.points.max(axis=0), two.points.max(axis=0))
    return bool((low <= high + spacing).all())


def _crossings(a: int, b: int, curves: Sequence[FoldCurve], spacing: float) -> Iterator[_Crossing]:
    """Where two curves are nearest to each other, and near enough."""
    one, two = curves[a], curves[b]
    apart, nearest = two.tree.query(one.points)
    if (apart < _COINCIDE * spacing + 1e-9).sum() > max(5, 0.1 * len(apart)):
        return  # one curve twice, between faces of one surface
    step = np.linalg.norm(np.diff(one.points, axis=0), axis=1).max(initial=0.0)
    other = np.linalg.norm(np.diff(two.points, axis=0), axis=1).max(initial=0.0)
    reach = step + other + _MEET * spacing
    before, after = np.roll(apart, 1), np.roll(apart, -1)
    if not one.is_closed:
        before[0] = after[-1] = np.inf
    least = np.flatnonzero((apart <= before) & (apart <= after) & (apart <= reach))
    for place in least:
        t, s, gap = _nearest(one, two, float(one.t[place]), float(two.t[nearest[place]]))
        if gap <= _MEET * spacing:
            point = (one.at(np.array([t]))[0] + two.at(np.array([s]))[0]) / 2
            if np.linalg.norm(point - one.points[place]) <= 2 * reach:
                yield _Crossing((a, b), point, gap, _sine(one, t, two, s) > _STEEP)


def _nearest(one: FoldCurve, two: FoldCurve, t: float, s: float) -> tuple[float, float, float]:
    """Parameters at which two curves are nearest, from near ones on, and the distance there."""
    for _ in range(_N_STEPS):
        p, u = one.slope(t)
        q, v = two.slope(s)
        matrix = np.column_stack([u, -v])
        change = np.linalg.lstsq(matrix, q - p, rcond=1e-6)[0]
        t, s = _kept(one, t + float(change[0])), _kept(two, s + float(change[1]))
        if np.abs(matrix @ change).max() < 1e-12 and np.linalg.norm(u) * abs(change[0]) < 1e-10:
            break
    return t, s, float(np.linalg.norm(one.slope(t)[0] - two.slope(s)[0]))


def _sine(one: FoldCurve, t: float, two: FoldCurve, s: float) -> float:
    """Sine of the angle between two curves at parameters."""
    u, v = one.slope(t)[1], two.slope(s)[1]
    return float(np.linalg.norm(np.cross(u, v)) / max(float(np.linalg.norm(u) * np.linalg.norm(v)), 1e-300))


def _kept(curve: FoldCurve, t: float) -> float:
    return curve.wrapped(t) if curve.is_closed else min(max(t, curve.low), curve.high)


def _groups(crossings: Sequence[_Crossing], near: float) -> list[list[_Crossing]]:
    """Crossings that are one corner: the exact ones first, each with those near it."""
    order = sorted(range(len(crossings)), key=lambda k: (*crossings[k].rank, k))
    heads, groups = list[FloatArray](), list[list[_Crossing]]()
    for k in order:
        one = crossings[k]
        if heads:
            apart = np.linalg.norm(np.array(heads) - one.point, axis=1)
            best = int(apart.argmin())
            if apart[best] <= near:
                groups[best].append(one)
                continue
        heads.append(one.point)
        groups.append([one])
    return groups
