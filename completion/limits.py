# SPDX-License-Identifier: MIT
"""Limits: how far a surface may be continued, from other surfaces and its own straight extent."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from completion.merging import MergedSurface
from completion.observation import Observation
from completion.segmentation.regions import observed_arc
from scenes.checks import BoolArray, FloatArray
from scenes.surfaces import Cylinder, Plane, Surface

Mode = Literal["conservative", "standard", "bold"]

_ENCLOSING_SHARE = 0.88  # of all measured points on the inner side: windows and doors let some lie beyond
_ENCLOSING_PIXELS = 0.02  # of all measured points on the plane itself
_FULL_TURN_ARC = np.radians(90.0)


@dataclass(frozen=True, slots=True, eq=False)
class Limits:
    """Where one surface may be continued.

    Attributes
    ----------
    chart : Surface
        The surface with its chart laid along the directions that bound it.
    cuts : tuple of Plane
        Planes that the surface ends at; it stays on their normals' side.
    own_low, own_high : (2,) float
        The rectangle of the measured part in the chart, metres.
    low, high : (2,) float
        The rectangle that a continuation may fill.
    full_turn : bool
        Whether a cylinder may be closed around its back.
    encloses : bool
        Whether the surface bounds all that was measured, as walls and floors do.
    """

    chart: Surface
    cuts: tuple[Plane, ...]
    own_low: FloatArray
    own_high: FloatArray
    low: FloatArray
    high: FloatArray
    full_turn: bool
    encloses: bool


def find_enclosing(surfaces: Sequence[MergedSurface], cloud: FloatArray, scale: float) -> list[bool]:
    """Tell which planes have nearly all measured points on their inner side: walls, floor, ceiling.

    Parameters
    ----------
    surfaces : sequence of MergedSurface
        All surfaces, working frame.
    cloud : (n, 3) float
        Measured points of all scans, thinned.
    scale : float
        Distance in metres below which a point counts as on the plane.
    """
    total = sum(surface.n_pixels for surface in surfaces)
    result = []
    for surface in surfaces:
        inner = np.mean(surface.fit.surface.distance(cloud) > -3 * max(scale, surface.fit.rms))
        large = surface.n_pixels >= _ENCLOSING_PIXELS * total
        result.append(isinstance(surface.fit.surface, Plane) and large and bool(inner >= _ENCLOSING_SHARE))
    return result


def limit(
    index: int,
    surfaces: Sequence[MergedSurface],
    enclosing: Sequence[bool],
    touching: BoolArray,
    observations: Sequence[Observation],
    cloud: FloatArray,
    mode: Mode,
) -> Limits:
    """Bound the continuation of surface `index`.

    It ends at planes that enclose the room and at planes that it visibly meets in a crease with all of it
    on one side. Within those, a wall or floor may run on to the next enclosing plane, by no more than its
    own length unless `mode` is bold; any other surface
    stays within the rectangle of what was measured of it, its straight edges continued until they meet.
    A cylinder may run along its axis to an enclosing plane, and around its back where at least 90 degrees
    of it were seen.

    Parameters
    ----------
    index : int
        Which surface.
    surfaces, enclosing : sequences
        All surfaces and whether each encloses the room.
    touching : (n, n) bool
        Which surfaces were seen to meet.
    observations : sequence of Observation
        The scans.
    cloud : (n, 3) float
        Measured points of all scans, thinned.
    mode : str
        "conservative" keeps to the measured extent, "bold" lets enclosing surfaces run to their cuts or to
        the limits of all that was measured.
    """
    surface = surfaces[index]
    points = surface.points(observations)
    thinned = points[:: max(1, len(points) // 50_000)]
    cuts = _cuts(index, surfaces, enclosing, touching, thinned)
    full_turn = False
    if isinstance(surface.fit.surface, Cylinder):
        chart: Surface = _facing_chart(surface.fit.surface, thinned)
        arc = observed_arc(surface.fit.surface, thinned)
        known = surface.fit.parameter_deviations()["radius"] < 0.05 * surface.fit.surface.radius
        full_turn = not surface.fit.surface.concave and arc >= _FULL_TURN_ARC and known
    elif isinstance(surface.fit.surface, Plane):
        chart = _aligned_chart(surface.fit.surface, cuts, thinned)
    else:
        raise TypeError(f"no limits are known for a {type(surface.fit.surface).__name__}")
    uv = chart.to_uv(thinned)
    own_low, own_high = np.quantile(uv, 0.002, axis=0), np.quantile(uv, 0.998, axis=0)
    low, high = own_low.copy(), own_high.copy()
    runs_on = enclosing[index] or isinstance(chart, Cylinder)
    if mode != "conservative" and runs_on:
        low, high = _run_to_cuts(
            chart, cuts, low, high, chart.to_uv(cloud), bold=mode == "bold" and enclosing[index]
        )
    return Limits(chart, tuple(cuts), own_low, own_high, low, high, full_turn, enclosing[index])


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
    index: int,
    surfaces: Sequence[MergedSurface],
    enclosing: Sequence[bool],
    touching: BoolArray,
    points: FloatArray,
) -> list[Plane]:
    """Planes that bound the surface, turned so that it lies on their normals' side."""
    own = surfaces[index].fit.surface
    cuts = []
    for other, candidate in enumerate(surfaces):
        plane = candidate.fit.surface
        if other == index or not isinstance(plane, Plane) or not (enclosing[other] or touching[index, other]):
            continue
        parallel = isinstance(own, Plane) and abs(float(own.normal_direction @ plane.normal_direction)) > 0.94
        if parallel and not enclosing[other]:
            continue
        distance = plane.distance(points)
        slack = 3 * candidate.fit.rms + 0.02 * float(np.ptp(distance))
        if np.mean(distance > -slack) >= 0.98:
            cuts.append(plane)
        elif not enclosing[other] and np.mean(distance < slack) >= 0.98:
            cuts.append(plane.flipped())
    return cuts


def _aligned_chart(plane: Plane, cuts: Sequence[Plane], points: FloatArray) -> Plane:
    """The plane with u along its meeting line with the first cut, else along its own longest side."""
    for cut in cuts:
        along = np.cross(plane.normal_direction, cut.normal_direction)
        if np.linalg.norm(along) > 0.5:
            return Plane(plane.point, plane.normal_direction, along)
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


def _run_to_cuts(
    chart: Surface,
    cuts: Sequence[Plane],
    low: FloatArray,
    high: FloatArray,
    cloud_uv: FloatArray,
    *,
    bold: bool,
) -> tuple[FloatArray, FloatArray]:
    """Move each side of the rectangle out to the cut that lies beyond it, within all that was measured.

    Unless `bold`, no further than the diagonal of that rectangle; how well the surface is known across a
    narrow strip is for its predicted standard deviation to say.
    """
    low, high, own_length = low.copy(), high.copy(), float(np.linalg.norm(high - low))
    cloud_low, cloud_high = np.quantile(cloud_uv, 0.001, axis=0), np.quantile(cloud_uv, 0.999, axis=0)
    for axis in (0, 1) if isinstance(chart, Plane) else (1,):
        for sign in (-1.0, 1.0):
            side = high if sign > 0 else low
            ends = []
            for cut in cuts:
                reach = _reach_along(chart, cut, axis, sign, low, high)
                if reach is not None and sign * (reach - side[axis]) >= 0:
                    ends.append(reach)
            furthest = (cloud_high if sign > 0 else cloud_low)[axis]
            if ends:
                nearest = min(ends, key=lambda end: sign * end)
                margin = 0.05 * abs(furthest - side[axis]) + 0.1
                supported = bold or abs(nearest - side[axis]) <= own_length
                if supported and sign * (nearest - furthest) <= margin:
                    side[axis] = nearest
            elif bold and sign * (furthest - side[axis]) > 0:
                side[axis] = furthest
    return low, high


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
