# SPDX-License-Identifier: MIT
"""Parametrisation: where points lie between the four boundaries, before anything is fitted.

The points are seen along their least extent; those beside a cylinder are unrolled about it first. There a
frame is laid along the traces of the surfaces, or, where these have none, along the narrowest rectangle. In
strips across it the points end at four curves: these are the boundaries. Of the eight ways to name them that
one holds whose curves lie nearest to their surfaces.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from itertools import product
from typing import NamedTuple, cast

import numpy as np
from scipy.spatial import ConvexHull

from completion.fitting.limits import CLOSE_RADII, END_SHARE, LEAST_TRACE, NEAREST_SHARE
from completion.fitting.patches.joins import Boundaries
from completion.fitting.patches.spline import SIDES, SideName
from scenes.checks import FloatArray, IntArray
from scenes.surfaces.catalogue import Cylinder

_STRIPS, _DEGREE = 24, 4  # strips across the frame, and the polynomial that their ends are smoothed by
_FOLLOWED = 2  # the same for ends of a patch
_MIRRORS = ((False, False), (False, True), (True, False), (True, True))  # of u and of v


class _PointChart(NamedTuple):
    """Points seen along their least extent."""

    axes: FloatArray  # (k or 1, 3, 3) of each point: directions of the coordinates that the frame is of
    frame: FloatArray  # (3, 3) rows: across what is seen first, the least extent last
    flat: FloatArray  # (k, 2)

    @classmethod
    def of(cls, points: FloatArray, boundaries: Boundaries) -> _PointChart:
        """Return how points (k, 3) are seen, unrolled about the cylinder about which they turn farthest."""
        placed, axes, most = points, np.eye(3)[None], 0.0
        for boundary in boundaries.values():
            if (
                isinstance(boundary.surface, Cylinder)
                and (span := span_about(points, boundary.surface)) > most
            ):
                placed, axes, most = *_unroll(points, boundary.surface), span
        offset = placed - placed.mean(axis=0)
        frame = np.linalg.svd(offset, full_matrices=False)[2]
        return cls(axes, frame, offset @ frame[:2].T)

    def project(self, directions: FloatArray, which: IntArray) -> FloatArray:
        """Return directions (j, 3) at some of the points (j,), as the chart sees them (j, 2)."""
        axes = np.broadcast_to(self.axes if len(self.axes) == 1 else self.axes[which], (len(which), 3, 3))
        return np.asarray(np.einsum("jab,jb->ja", axes, directions) @ self.frame[:2].T)


def span_about(points: FloatArray, tube: Cylinder) -> float:
    """Return the angle, radians, that points (k, 3) take up about an axis; 0 where some lie close to it."""
    angle, reach = _polar(points, tube)
    if reach.min() < CLOSE_RADII * tube.radius:
        return 0.0
    turns = np.sort(angle)
    return float(2 * np.pi - np.diff(np.append(turns, turns[0] + 2 * np.pi)).max())


def _polar(points: FloatArray, tube: Cylinder) -> tuple[FloatArray, FloatArray]:
    offset = points - tube.point
    zero = tube.zero_direction
    x, y = offset @ zero, offset @ np.cross(tube.direction, zero)
    return np.arctan2(y, x), np.hypot(x, y)


def _unroll(points: FloatArray, tube: Cylinder) -> tuple[FloatArray, FloatArray]:
    """Arc, height and distance from the axis of points (k, 3), and these directions at each (k, 3, 3)."""
    angle, reach = _polar(points, tube)
    turns = np.sort(angle)
    gaps = np.diff(np.append(turns, turns[0] + 2 * np.pi))
    cut = turns[int(np.argmax(gaps))] + gaps.max() / 2
    arc = np.mod(angle - cut, 2 * np.pi) * float(reach.mean())
    normal, up = tube.normal(points) * (-1.0 if tube.concave else 1.0), tube.direction
    placed = np.column_stack([arc, (points - tube.point) @ up, reach])
    axes = np.stack([np.cross(up, normal), np.broadcast_to(up, points.shape), normal], axis=1)
    return placed, axes


class Parametrisation(NamedTuple):
    """Parameters of points, and how far each named boundary's points are from its surface (rms)."""

    uv: FloatArray  # (k, 2)
    off: Mapping[SideName, float]


def parametrise(points: FloatArray, boundaries: Boundaries) -> Parametrisation:
    """Return where points (k, 3) lie between their boundaries."""
    chart = _PointChart.of(points, boundaries)
    turn = _turn(points, chart, boundaries)
    seen = chart.flat @ np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    xy = np.column_stack(
        [
            _share_between(boundary_points, _strip_ends(boundary_points, _DEGREE))
            for boundary_points in (seen, seen[:, ::-1])
        ]
    )
    near = {name: _near_side(xy, name) for name in SIDES}
    best, least = xy, np.inf
    off = dict[SideName, float]()
    for swaps, mirrors in product((False, True), _MIRRORS):
        named = _name_sides(swaps, mirrors)
        fitted_places = {
            name: float(np.sqrt(np.mean(boundary.surface.distance(points[near[named[name]]]) ** 2)))
            for name, boundary in boundaries.items()
        }
        turned = xy[:, ::-1] if swaps else xy
        cost = sum(fitted_places.values()) + (0.0 if _is_right_handed(swaps, mirrors) else 1e-9)
        if cost < least:
            best, least, off = np.where(mirrors, 1.0 - turned, turned), cost, fitted_places
    return Parametrisation(np.ascontiguousarray(best), off)


def stretch(uv: FloatArray, ends: Collection[SideName]) -> FloatArray:
    """Return parameters (k, 2) stretched so that the points end at those sides of the patch which are `ends`.

    A side to which nothing holds a patch wanders along it from round to round; so it is taken back.
    """
    uv_stretched = uv.copy()
    for column, letter in enumerate("uv"):
        seen = uv if column == 0 else uv[:, ::-1]
        values = _strip_ends(seen, _FOLLOWED)
        low, high = (
            np.clip(column, *most) for column, most in zip(values.T, ((0.0, 0.3), (0.7, 1.0)), strict=True)
        )
        low = low if f"{letter}0" in ends else np.full(len(uv), END_SHARE)
        high = high if f"{letter}1" in ends else np.full(len(uv), 1 - END_SHARE)
        uv_stretched[:, column] = _share_between(seen, np.column_stack([low, high]))
    return uv_stretched


def _turn(points: FloatArray, chart: _PointChart, boundaries: Boundaries) -> float:
    """The angle by which the frame is turned, radians, by the surfaces' traces, else by the hull."""
    total, weight = 0j, 0.0
    for boundary in boundaries.values():
        away = np.abs(boundary.surface.distance(points))
        nearest = np.argsort(away, kind="stable")[: max(8, int(NEAREST_SHARE * len(points)))]
        across = chart.project(boundary.surface.normal(points[nearest]), nearest).mean(axis=0)
        size = float(np.linalg.norm(across))
        total += size * np.exp(4j * np.arctan2(across[1], across[0]))
        weight += 1.0
    if boundaries and abs(total) > LEAST_TRACE * weight:
        return float(np.angle(total) / 4)
    hull = chart.flat[ConvexHull(chart.flat).vertices]
    sides = np.roll(hull, -1, axis=0) - hull
    turns = np.arctan2(sides[:, 1], sides[:, 0])
    areas = [np.prod(np.ptp(hull @ np.array([[np.cos(t), -np.sin(t)], [np.sin(t), np.cos(t)]]), axis=0))
             for t in turns]  # fmt: skip
    return float(turns[int(np.argmin(areas))])


def _strip_ends(seen: FloatArray, degree: int) -> FloatArray:
    """Where points (k, 2) end along x at the height of each: their ends (k, 2), smoothed over strips of y."""
    x, y = seen.T
    low, high = np.quantile(y, [0.0, 1.0])
    scaled = 2 * (y - low) / max(high - low, 1e-300) - 1
    strip = np.minimum(((scaled + 1) / 2 * _STRIPS).astype(np.int64), _STRIPS - 1)
    middles, ends, sizes = list[float](), list[FloatArray](), list[int]()
    for number in range(_STRIPS):
        is_member = strip == number
        if np.count_nonzero(is_member) >= 3:
            middles.append(float(scaled[is_member].mean()))
            ends.append(np.quantile(x[is_member], [END_SHARE, 1 - END_SHARE]))
            sizes.append(int(np.count_nonzero(is_member)))
    degree = min(degree, max(0, len(middles) - 2))
    weights = np.sqrt(np.array(sizes, dtype=np.float64))
    fitted = np.polynomial.legendre.legfit(np.array(middles), np.array(ends), degree, w=weights)
    return np.asarray(np.polynomial.legendre.legval(scaled, fitted).T)


def _share_between(seen: FloatArray, ends: FloatArray) -> FloatArray:
    """Where points (k, 2) lie along x between ends (k, 2), beyond which a small share of them is."""
    width = np.maximum(ends[:, 1] - ends[:, 0], 0.05 * np.median(ends[:, 1] - ends[:, 0]))
    return np.clip(END_SHARE + (1 - 2 * END_SHARE) * (seen[:, 0] - ends[:, 0]) / width, 0.0, 1.0)


def _near_side(xy: FloatArray, name: SideName) -> IntArray:
    """Numbers of the points (j,) nearest to a side, its corners apart."""
    along, across = (xy[:, 1], xy[:, 0]) if name[0] == "u" else (xy[:, 0], xy[:, 1])
    away = np.where((along > 0.1) & (along < 0.9), np.abs(across - float(name[1])), np.inf)
    return np.argsort(away, kind="stable")[: max(4, int(0.03 * len(xy)))]


def _name_sides(swaps: bool, mirrors: tuple[bool, bool]) -> dict[SideName, SideName]:
    """Which side of the frame each boundary is."""
    held = dict[SideName, SideName]()
    for name in SIDES:
        letter = name[0] if not swaps else ("v" if name[0] == "u" else "u")
        end = int(name[1]) ^ mirrors[0 if name[0] == "u" else 1]
        held[name] = cast(SideName, f"{letter}{end}")
    return held


def _is_right_handed(swaps: bool, mirrors: tuple[bool, bool]) -> bool:
    return (swaps + sum(mirrors)) % 2 == 0
