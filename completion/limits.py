# SPDX-License-Identifier: MIT
"""Limits: how far a surface may be continued, from other surfaces and its own straight extent."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from completion.edges import Line, find_edges
from completion.merging import MergedSurface
from completion.observation import Observation
from completion.rim import Rim, RimPoints
from completion.segmentation.regions import observed_arc
from scenes.checks import BoolArray, FloatArray
from scenes.surfaces import Cylinder, Plane, Surface

Mode = Literal["conservative", "standard", "bold"]

_STANDING = (0.25, 0.75)  # beta prior that an upright thing reaches a wall or floor: one in four does
_UPRIGHT = 0.1  # sine of the angle
_FULL_TURN_ARC = np.radians(90.0)


@dataclass(frozen=True, slots=True, eq=False)
class Limits:
    """Where one surface may be continued.

    Attributes
    ----------
    chart : Surface
        The surface with its chart laid along the directions that bound it.
    enclosures : tuple of (int, Surface)
        Number, from 1, and shape of every other surface that encloses the room.
    cuts : tuple of Surface
        Enclosing surfaces that this one ends at; it stays on their normals' side.
    neighbours : tuple of Surface
        Other surfaces that it was seen to meet in a crease.
    own_low, own_high : (2,) float
        The rectangle of the measured part in the chart, metres.
    ends : (2, 2) float
        Chart coordinates at which enclosing planes close the low and the high sides, -inf and inf where none
        does, metres.
    reaches : (2, 2) float
        Probability that the surface goes on to each of them.
    full_turn : bool
        Whether a cylinder may be closed around its back.
    encloses : bool
        Whether the surface is a plane that bounds all that was measured, as walls and floors do.
    """

    chart: Surface
    enclosures: tuple[tuple[int, Surface], ...]
    cuts: tuple[Surface, ...]
    neighbours: tuple[Surface, ...]
    own_low: FloatArray
    own_high: FloatArray
    ends: FloatArray
    reaches: FloatArray
    full_turn: bool
    encloses: bool

    def window(self) -> tuple[FloatArray, FloatArray]:
        """Low and high corners (2,) of the rectangle of the chart in which a continuation is considered.

        On each side it reaches to where the surface may end; without such an end, walls and floors may go on
        as far again as they are long, cylinders as far again along their axis, other surfaces no farther.
        """
        size = self.own_high - self.own_low
        further = np.array([0.0, size[1]]) if isinstance(self.chart, Cylinder) else np.zeros(2)
        if self.encloses:
            further = np.full(2, np.linalg.norm(size))
        low = np.where(self.reaches[0] > 0, self.ends[0], self.own_low - further)
        high = np.where(self.reaches[1] > 0, self.ends[1], self.own_high + further)
        return np.maximum(low, self.ends[0]), np.minimum(high, self.ends[1])


def find_standing(
    surfaces: Sequence[MergedSurface],
    rims: Sequence[RimPoints],
    enclosing: Sequence[bool],
    touching: BoolArray,
) -> FloatArray:
    """Probability (n,) that what stands at right angles to an enclosing plane reaches down to it; else 0.

    Of the n surfaces whose end on its side was seen k end on the plane; with a beta prior the next one does
    with probability (k + a) / (n + a + b).

    Parameters
    ----------
    surfaces : sequence of MergedSurface
        All surfaces, working frame.
    rims : sequence of RimPoints
        The rim of each, in its own chart.
    enclosing : sequence of bool
        Which enclose the room.
    touching : (n, n) bool
        Which surfaces were seen to meet.
    """
    standing = np.zeros(len(surfaces))
    for number, base in enumerate(surfaces):
        plane = base.fit.surface
        if not enclosing[number] or not isinstance(plane, Plane):
            continue
        ending = [
            touching[number, other]
            for other in range(len(surfaces))
            if not enclosing[other]
            and _is_upright(surfaces[other].fit.surface, plane)
            and (touching[number, other] or _ends_above(surfaces[other], rims[other], plane))
        ]
        standing[number] = (sum(ending) + _STANDING[0]) / (len(ending) + sum(_STANDING))
    return standing


def _is_upright(surface: Surface, base: Plane) -> bool:
    """Tell whether a surface stands at right angles to a plane, to within six degrees."""
    if isinstance(surface, Plane):
        return abs(float(surface.normal_direction @ base.normal_direction)) < _UPRIGHT
    return (
        isinstance(surface, Cylinder) and 1 - abs(float(surface.direction @ base.normal_direction)) < _UPRIGHT
    )


def _ends_above(surface: MergedSurface, rim: RimPoints, base: Plane) -> bool:
    """Tell whether the rim nearest to a plane is mostly the surface's own edge."""
    height = base.distance(surface.fit.surface.from_uv(rim.uv))
    if not len(height):
        return False
    lowest = rim.kind[height <= height.min() + 0.05 * np.ptp(height)]
    return bool(np.mean(lowest == Rim.OWN_EDGE) > 0.5)


def limit(
    index: int,
    surfaces: Sequence[MergedSurface],
    rims: Sequence[RimPoints],
    enclosing: Sequence[bool],
    standing: FloatArray,
    touching: BoolArray,
    observations: Sequence[Observation],
) -> Limits:
    """Bound the continuation of surface `index`.

    It ends at surfaces that enclose the room. A cylinder may run around its back where at least 90 degrees of
    it were seen, and its radius is known.

    Parameters
    ----------
    index : int
        Which surface.
    surfaces, rims, enclosing : sequences
        All surfaces, their rims, and whether each encloses the room.
    standing : (n,) float
        Probability that what stands on each of them reaches down to it.
    touching : (n, n) bool
        Which surfaces were seen to meet.
    observations : sequence of Observation
        The scans.
    """
    surface = surfaces[index]
    points = surface.points(observations)
    thinned = points[:: max(1, len(points) // 50_000)]
    cuts = _cuts(index, surfaces, enclosing, thinned)
    neighbours = [
        surface.fit.surface
        for other, surface in enumerate(surfaces)
        if touching[index, other] and not enclosing[other]
    ]
    full_turn = False
    if isinstance(surface.fit.surface, Cylinder):
        chart: Surface = _facing_chart(surface.fit.surface, thinned)
        arc = observed_arc(surface.fit.surface, thinned)
        known = surface.fit.parameter_deviations()["radius"] < 0.05 * surface.fit.surface.radius
        full_turn = not surface.fit.surface.concave and arc >= _FULL_TURN_ARC and known
    elif isinstance(surface.fit.surface, Plane):
        plane = surface.fit.surface
        planes = [one for one in (*(cut for _, cut in cuts), *neighbours) if isinstance(one, Plane)]
        chart = _aligned_chart(plane, planes, thinned, rims[index])
    else:
        raise TypeError(f"no limits are known for a {type(surface.fit.surface).__name__}")
    uv = chart.to_uv(thinned)
    own_low, own_high = np.quantile(uv, 0.002, axis=0), np.quantile(uv, 0.998, axis=0)
    ending = [(number, cut) for number, cut in cuts if isinstance(cut, Plane)]
    ends, which = _ends(chart, [plane for _, plane in ending], own_low, own_high)
    stands = [standing[number] * _is_upright(surface.fit.surface, plane) for number, plane in ending]
    runs_on = enclosing[index] or isinstance(chart, Cylinder)
    reaches = np.where(np.isfinite(ends), 1.0 if runs_on else np.array([*stands, 0.0])[which], 0.0)
    enclosures = tuple(
        (number, other.fit.surface)
        for number, other in enumerate(surfaces, start=1)
        if number != index + 1 and enclosing[number - 1]
    )
    return Limits(
        chart,
        enclosures,
        tuple(cut for _, cut in cuts),
        tuple(neighbours),
        own_low,
        own_high,
        ends,
        reaches,
        full_turn,
        enclosing[index] and isinstance(chart, Plane),
    )


def find_touching(
    owners: Sequence[NDArray[np.int32]],
    surfaces: Sequence[MergedSurface],
    observations: Sequence[Observation],
    scales: Sequence[FloatArray],
) -> BoolArray:
    """Tell which pairs of surfaces were seen to meet: neighbouring pixels that lie on both."""
    n = len(surfaces)
    meetings = np.zeros((n + 1, n + 1), np.int64)
    for owner, observation, scale in zip(owners, observations, scales, strict=True):
        for step in ((0, 2), (2, 0)):
            a = owner[: owner.shape[0] - step[0], : owner.shape[1] - step[1]]
            b = owner[step[0] :, step[1] :]
            rows, columns = np.nonzero((a != b) & (a > 0) & (b > 0))
            first, second = a[rows, columns], b[rows, columns]
            p = observation.points[rows, columns]
            q = observation.points[rows + step[0], columns + step[1]]
            reach = 3 * scale[rows, columns] + 2 * np.linalg.norm(p - q, axis=1)
            for i, j in {(int(i), int(j)) for i, j in zip(first, second, strict=True)}:
                pair = (first == i) & (second == j)
                near = np.abs(surfaces[j - 1].fit.surface.distance(p[pair])) <= reach[pair]
                near &= np.abs(surfaces[i - 1].fit.surface.distance(q[pair])) <= reach[pair]
                gap = np.linalg.norm(p[pair] - q[pair], axis=1)
                near &= gap <= np.quantile(gap, 0.9)
                meetings[i, j] += int(near.sum())
    both = meetings + meetings.T
    return np.asarray(both[1:, 1:] >= 8, dtype=np.bool_)


def _cuts(
    index: int, surfaces: Sequence[MergedSurface], enclosing: Sequence[bool], points: FloatArray
) -> list[tuple[int, Surface]]:
    """Enclosing surfaces, with their indices, that have the surface on their inner side."""
    cuts = []
    for other, candidate in enumerate(surfaces):
        if other == index or not enclosing[other]:
            continue
        distance = candidate.fit.surface.distance(points)
        slack = 3 * candidate.fit.rms + 0.02 * float(np.ptp(distance))
        if np.abs(distance).max() > 2 * slack and np.mean(distance > -slack) >= 0.98:
            cuts.append((other, candidate.fit.surface))
    return cuts


def _aligned_chart(plane: Plane, cuts: Sequence[Plane], points: FloatArray, rim: RimPoints) -> Plane:
    """The plane with u along the straight boundary that was seen most of, else along its longest side.

    Boundaries are its meeting lines with the planes `cuts` and its own edges.
    """
    size = np.linalg.norm(rim.step, axis=1)
    seen = rim.only((size > 0) & np.isin(rim.kind, (Rim.CONTIGUOUS, Rim.OWN_EDGE)))
    size = np.linalg.norm(seen.step, axis=1)
    at_rim = plane.from_uv(seen.uv)
    directions, supports = [], []
    for cut in cuts:
        along = np.cross(plane.normal_direction, cut.normal_direction)
        if np.linalg.norm(along) > 0.5:
            near = (np.abs(cut.distance(at_rim)) <= size) & (seen.kind == Rim.CONTIGUOUS)
            directions.append(along)
            supports.append(float(size[near].sum()))
    for edge in find_edges(seen.only(seen.kind == Rim.OWN_EDGE)):
        if isinstance(edge.curve, Line):
            directions.append(plane.from_uv(edge.curve.direction) - plane.point)
            supports.append(float(np.ptp(edge.runs, axis=1).sum()))
    if max(supports, default=0.0) > 0:
        return Plane(plane.point, plane.normal_direction, directions[int(np.argmax(supports))])
    uv = plane.to_uv(points).astype(np.float32)
    (_, _), (width, height), angle_deg = cv2.minAreaRect(uv)
    angle = np.radians(angle_deg if width >= height else angle_deg + 90.0)
    along = np.cos(angle) * plane.u_direction + np.sin(angle) * plane.v_direction
    return Plane(plane.point, plane.normal_direction, along)


def _facing_chart(cylinder: Cylinder, points: FloatArray) -> Cylinder:
    """The cylinder with its zero direction in the middle of the measured arc, the seam at its back."""
    angle = np.sort(cylinder.to_uv(points)[:, 0] / cylinder.radius)
    gaps = np.diff(np.append(angle, angle[0] + 2 * np.pi))
    widest = int(np.argmax(gaps))
    middle = (angle[widest] + gaps[widest] / 2 + np.pi) * cylinder.radius
    outward = cylinder.from_uv(np.array([[middle, 0.0]]))[0] - cylinder.point
    return Cylinder(cylinder.point, cylinder.direction, cylinder.radius, outward, cylinder.concave)


def _ends(
    chart: Surface, cuts: Sequence[Plane], low: FloatArray, high: FloatArray
) -> tuple[FloatArray, NDArray[np.int64]]:
    """Where the nearest cuts close the low and high sides (rows) along u and v (columns), and which do."""
    ends = np.array([[-np.inf, -np.inf], [np.inf, np.inf]])
    which = np.full((2, 2), -1)
    for axis in (0, 1) if isinstance(chart, Plane) else (1,):
        for row, (sign, side) in enumerate(((-1.0, low), (1.0, high))):
            for number, cut in enumerate(cuts):
                end = _reach_along(chart, cut, axis, sign, low, high)
                if end is not None and sign * (end - side[axis]) >= 0 > sign * (end - ends[row, axis]):
                    ends[row, axis], which[row, axis] = end, number
    return ends, which


def _reach_along(
    chart: Surface, cut: Plane, axis: int, sign: float, low: FloatArray, high: FloatArray
) -> float | None:
    """Chart coordinate where the cut meets the rectangle's continuation, None if it faces away."""
    corners = np.array([[low[0], low[1]], [high[0], low[1]], [high[0], high[1]], [low[0], high[1]]])
    centre = (low + high) / 2
    step = np.zeros(2)
    step[axis] = max(float((high - low)[axis]), 1e-3) * 0.5
    here = centre if isinstance(chart, Plane) else np.array([0.0, centre[1]])
    pair = cut.distance(chart.from_uv(np.stack([here - step, here + step])))
    slope = float(pair[1] - pair[0]) / (2 * float(step[axis]))
    if sign * slope > -0.7:  # the cut must close this side, not run along it
        return None
    at_sides = corners[(corners[:, axis] == (high if sign > 0 else low)[axis])]
    height = cut.distance(chart.from_uv(at_sides))
    ends = at_sides[:, axis] - height / slope
    return float(ends.max() if sign > 0 else ends.min())
