# SPDX-License-Identifier: MIT
"""Bounds: the chart laid along what bounds a surface, and where other surfaces close its sides."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from completion.boundary.boundary_pixels import BoundaryKind, BoundaryPixels
from completion.boundary.curves import Line
from completion.boundary.edges import find_edges
from completion.evidence.evidence import Scans
from completion.evidence.field_of_view import ball_around
from completion.evidence.form import Form, chart_of, form_of, reach_of
from completion.evidence.reach import TILE, Reach, farthest_along
from completion.merging.merged_surface import MergedSurface
from completion.observe.rays import Rays, ray_at
from completion.observe.triple import Triple, dot, minus, plus
from scenes.checks import BoolArray, FloatArray
from scenes.run.mapping import trim
from scenes.surfaces.catalogue import Cylinder, Plane, Surface
from texture.engine.compiled import compiled, inlined

_INNER = 0.98  # of a surface's points that lie on the inner side of what it ends at
_SIDEWAYS = 0.7  # cosine between a plane's normal and the direction whose side it closes
_STRIDE = 2  # rows and columns between the beams that tell how far a surface is hidden
_SLACK = 1e-6  # of lengths that are compared beforehand


def aligned_chart(plane: Plane, cuts: Sequence[Plane], points: FloatArray, boundary: BoundaryPixels) -> Plane:
    """Return the plane with u along the straight boundary that was seen most of, else along its longest side.

    Boundaries are its meeting lines with the planes `cuts` and its own edges, by its boundary pixels in the
    given plane's chart; `points` (n, 3) are its measured ones, metres.
    """
    size = np.linalg.norm(boundary.step, axis=1)
    seen = boundary.only(
        (size > 0) & np.isin(boundary.kind, (BoundaryKind.CONTIGUOUS, BoundaryKind.OWN_EDGE))
    )
    size = np.linalg.norm(seen.step, axis=1)
    at = plane.from_uv(seen.uv)
    directions, supports = [], []
    for cut in cuts:
        along = np.cross(plane.normal_direction, cut.normal_direction)
        if np.linalg.norm(along) > 0.5:
            near = (np.abs(cut.distance(at)) <= size) & (seen.kind == BoundaryKind.CONTIGUOUS)
            directions.append(along)
            supports.append(float(size[near].sum()))
    for edge in find_edges(seen.only(seen.kind == BoundaryKind.OWN_EDGE)):
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


def facing_chart(cylinder: Cylinder, points: FloatArray) -> Cylinder:
    """Return the cylinder with the middle of its measured points (n, 3) at u = 0, the seam at its back."""
    angle = np.sort(cylinder.to_uv(points)[:, 0] / cylinder.radius)
    gaps = np.diff(np.append(angle, angle[0] + 2 * np.pi))
    widest = int(np.argmax(gaps))
    middle = (angle[widest] + gaps[widest] / 2 + np.pi) * cylinder.radius
    outward = cylinder.from_uv(np.array([[middle, 0.0]]))[0] - cylinder.point
    return Cylinder(cylinder.point, cylinder.direction, cylinder.radius, outward, cylinder.concave)


def enclosing_cuts(
    index: int, surfaces: Sequence[MergedSurface], enclosing: BoolArray, points: FloatArray
) -> list[tuple[int, Surface]]:
    """Return the enclosing surfaces, with their indices, that have points (n, 3) of one on their inner side.

    `enclosing` (n_surfaces,) tells which of the surfaces enclose the room.
    """
    cuts = []
    for other, candidate in enumerate(surfaces):
        if other == index or not enclosing[other]:
            continue
        distance = candidate.fit.surface.distance(points)
        slack = 3 * candidate.fit.rms + 0.02 * float(np.ptp(distance))
        if np.abs(distance).max() > 2 * slack and np.mean(distance > -slack) >= _INNER:
            cuts.append((other, candidate.fit.surface))
    return cuts


def closed_sides(
    chart: Surface, cuts: Sequence[Plane], low: FloatArray, high: FloatArray
) -> tuple[FloatArray, NDArray[np.int64]]:
    """Find where planes close the sides of the rectangle from `low` to `high` (2,) of a chart, metres.

    Returns
    -------
    ends : (2, 2) float
        Chart coordinate at which the nearest plane closes the low and the high side (rows) along u and v
        (columns), metres; -inf and inf where none does.
    which : (2, 2) int64
        Its index, -1 for none.
    """
    ends = np.array([[-np.inf, -np.inf], [np.inf, np.inf]])
    which = np.full((2, 2), -1)
    for axis in (0, 1) if isinstance(chart, Plane) else (1,):
        for row, (sign, side) in enumerate(((-1.0, low), (1.0, high))):
            for number, cut in enumerate(cuts):
                end = _end_along(chart, cut, axis=axis, sign=sign, low=low, high=high)
                if end is not None and sign * (end - side[axis]) >= 0 > sign * (end - ends[row, axis]):
                    ends[row, axis], which[row, axis] = end, number
    return ends, which


def _end_along(
    chart: Surface, cut: Plane, axis: int, sign: float, low: FloatArray, high: FloatArray
) -> float | None:
    """Chart coordinate where the cut meets the rectangle's continuation, None if it faces away."""
    centre = (low + high) / 2
    step = np.zeros(2)
    step[axis] = max(float((high - low)[axis]), 1e-3) * 0.5
    here = centre if isinstance(chart, Plane) else np.array([0.0, centre[1]])
    pair = cut.distance(chart.from_uv(np.stack([here - step, here + step])))
    slope = float(pair[1] - pair[0]) / (2 * float(step[axis]))
    if sign * slope > -_SIDEWAYS:
        return None
    corners = np.array([low, high])  # of the side
    corners[:, axis] = (high if sign > 0 else low)[axis]
    ends = corners[:, axis] - cut.distance(chart.from_uv(corners)) / slope
    return float(ends.max() if sign > 0 else ends.min())


def farthest_hidden(
    chart: Plane,
    low: FloatArray,
    high: FloatArray,
    scans: Scans,
) -> FloatArray:
    """Return the places (n, 2) farthest to each side of those where scans could not see a plane, metres.

    They lie behind what was measured, between `low` and `high` (2,) of its chart; every other row and column
    of a scan counts.
    """
    found, form = [np.zeros((0, 2))], form_of(chart)
    corners = chart.from_uv(np.array([low, high]))
    window = ball_around(np.sort(corners, axis=0), (high - low) * _SLACK)
    for number in np.flatnonzero(scans.views.may_see(window)).tolist():
        seen, reach = scans.observations[number], scans.reach[number]
        origin, pixel = seen.scan.origin, _farthest(form, seen.scan.ranges, seen.rays, reach, low, high)
        if (pixel < 0).all():
            continue
        rays = seen.rays_at(pixel[pixel >= 0])
        found.append(chart.to_uv(origin + chart.ray_ranges(origin, rays)[:, None] * rays))
        trim()
    return np.concatenate(found)


@compiled
def _farthest(
    form: Form, ranges: FloatArray, rays: Rays, reach: Reach, low: FloatArray, high: FloatArray
) -> NDArray[np.int64]:
    """Flat pixels (4,) behind whose ranges a surface is hidden farthest to each side, -1 for none.

    Every other pixel counts, if its ray meets the surface between `low` and `high` (2,) of the chart. Tiles
    are left out that see nothing of that part, or nothing farther out than what was found.
    """
    pixel, most, (rows, columns) = np.full(4, -1), np.full(4, -np.inf), ranges.shape
    height = dot(minus(rays.origin, form.point), form.axis)
    if not height > 0.0:
        return pixel
    foot = chart_of(form, rays.origin)
    least = np.array([foot[0] - high[0], low[0] - foot[0], foot[1] - high[1], low[1] - foot[1]])
    for tile_row in range(reach.far.shape[0]):
        for tile_column in range(reach.far.shape[1]):
            if not _may_hide(form, reach, tile_row, tile_column, height, foot, least, most):
                continue
            for i in range(tile_row * TILE, min((tile_row + 1) * TILE, rows), _STRIDE):
                for j in range(tile_column * TILE, min((tile_column + 1) * TILE, columns), _STRIDE):
                    ray = ray_at(rays, i, j)
                    behind = reach_of(form, rays.origin, ray, False)
                    if np.isfinite(behind) and ranges[i, j] < behind:
                        u, v = chart_of(form, plus(rays.origin, behind, ray))
                        if low[0] <= u <= high[0] and low[1] <= v <= high[1]:
                            for side, far in enumerate((-u, u, -v, v)):
                                if far > most[side]:
                                    pixel[side], most[side] = i * columns + j, far
    return pixel


@inlined
def _may_hide(
    form: Form,
    reach: Reach,
    row: int,
    column: int,
    height: float,
    foot: tuple[float, float],
    least: FloatArray,
    most: FloatArray,
) -> bool:
    """Tell whether rays of a tile that end before a plane may meet it in a rectangle and beyond one within.

    `least` (4,) is how far to each side of the sensor's `foot` rays must meet it, and `most` (4,) the place
    beyond which one does that counts.
    """
    far, nowhere = float(reach.far[row, column]), (0.0, 0.0, 0.0)
    nearest = -farthest_along(reach.boxes, row, column, form.axis)
    if far < 0.0 or nearest > height * (1 + _SLACK) + _SLACK * far:
        return False
    is_farther = False
    for side in range(4):
        sign = -1.0 if side % 2 == 0 else 1.0
        outward = plus(nowhere, sign * height, form.first if side < 2 else form.second)
        if not _gets(reach, row, column, plus(outward, least[side], form.axis)):
            return False
        beyond = most[side] - sign * foot[side // 2]
        is_farther |= beyond == -np.inf or _gets(reach, row, column, plus(outward, beyond, form.axis))
    return is_farther


@inlined
def _gets(reach: Reach, row: int, column: int, direction: Triple) -> bool:
    """Tell whether a tile may have points in a direction from the sensor at all."""
    slack = _SLACK * float(reach.far[row, column]) * np.sqrt(dot(direction, direction))
    return bool(farthest_along(reach.boxes, row, column, direction) > -slack)
