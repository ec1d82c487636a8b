# SPDX-License-Identifier: MIT
"""Free space: the cells of a surface that observed beams went through, in closed form."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from completion.evidence.chart_grid import ChartGrid
from completion.evidence.form import Form, chart_of, form_of, reach_of, slope_at
from completion.evidence.limits import FEWEST_BEAMS, LEAST_COSINE
from completion.evidence.reach import TILE, Reach, farthest_along
from completion.evidence.sight import Eye, ScanSight, Views, along_ray, ball_around
from completion.observe.rays import Noise, Triple, deviation_at, dot, minus, plus, ray_at
from scenes.checks import BoolArray, FloatArray, read_only_view
from scenes.run.mapping import trim
from texture.engine.compiled import compiled, inlined

_SLACK = 1e-6  # of lengths, which are kept in single precision


class Rectangle(NamedTuple):
    """Part of a chart, metres."""

    left: float
    right: float
    low: float
    high: float


@compiled
def crossing_tiles(
    eye: Eye, noise: Noise, form: Form, reach: Reach, part: Rectangle, least_sd: float
) -> BoolArray:
    """Tell which tiles (rows, columns) hold beams that may count as gone through part of a chart.

    `least_sd` is the smallest predicted deviation of the surface there, metres. A no is sure: no beam of the
    tile crosses the part and ends behind it by more than the tolerance.
    """
    if form.is_curved:
        return _across_cylinder(eye, form, reach, part, least_sd)
    return _across_plane(eye, noise, form, reach, part, least_sd)


@inlined
def _least_excess(eye: Eye, sigma: float, sd: float) -> float:
    """How far beams that count end behind a surface at least, along its normal, metres.

    A beam counts that ends behind by more than n sqrt(sigma^2 + (sd^2 + flatness^2) / cos^2) + registration /
    cos along the ray; times cos, that is at least what stands here if `sigma` holds the cosine already. Below
    the least cosine the tolerance no longer grows: there it is either too large for any beam to count, or
    nothing is left out.
    """
    across = sd * sd + eye.flatness_m * eye.flatness_m
    if (eye.n_sigma * np.sqrt(across) + eye.registration_m) / LEAST_COSINE <= eye.max_m * (1 + _SLACK):
        return 0.0
    return float(eye.n_sigma * np.sqrt(sigma * sigma + across) + eye.registration_m)


@inlined
def _across_plane(
    eye: Eye, noise: Noise, form: Form, reach: Reach, part: Rectangle, least_sd: float
) -> BoolArray:
    """Tiles that get to the plane, and between the planes through the sensor and the rectangle's sides."""
    height, foot = dot(minus(eye.origin, form.point), form.axis), chart_of(form, eye.origin)
    far, nowhere = reach.far, (0.0, 0.0, 0.0)
    toward = plus(nowhere, -np.sign(height), form.axis)
    high = abs(height)
    right, left = plus(nowhere, high, form.first), plus(nowhere, -high, form.first)
    up, down = plus(nowhere, high, form.second), plus(nowhere, -high, form.second)
    sides = (
        plus(right, foot[0] - part.left, toward),
        plus(left, part.right - foot[0], toward),
        plus(up, foot[1] - part.low, toward),
        plus(down, part.high - foot[1], toward),
    )
    sigma = deviation_at(noise, high)  # of ranges that get there: it grows with the range
    mask = np.zeros(far.shape, np.bool_)
    for i in range(far.shape[0]):
        for j in range(far.shape[1]):
            if far[i, j] < 0.0:
                continue
            mask[i, j] = True
            if high == 0.0:
                continue
            excess = _least_excess(eye, sigma * min(high / max(far[i, j], high), 1.0), least_sd)
            slack = _SLACK * (high + far[i, j])
            if farthest_along(reach.boxes, i, j, toward) < high + excess - slack:
                mask[i, j] = False
                continue
            for side in sides:
                if farthest_along(reach.boxes, i, j, side) < -_SLACK * far[i, j] * np.sqrt(dot(side, side)):
                    mask[i, j] = False
                    break
    return mask


@inlined
def _across_cylinder(eye: Eye, form: Form, reach: Reach, part: Rectangle, least_sd: float) -> BoolArray:
    """Tiles that no plane parts from the cylinder between two heights, with the sensor on the tiles' side.

    A beam lies between the sensor and its tile's box, so that such a plane parts it from the cylinder too.
    From within, beams cross the cylinder that end farther from the axis than its radius.
    """
    far, boxes = reach.far, reach.boxes
    bottom = plus(minus(form.point, eye.origin), part.low, form.axis)
    top = plus(bottom, part.high - part.low, form.axis)
    away = plus(bottom, -dot(bottom, form.axis), form.axis)  # from the sensor to the axis, the shortest way
    distance, excess = np.sqrt(dot(away, away)), _least_excess(eye, 0.0, least_sd)
    mask = np.zeros(far.shape, np.bool_)
    for i in range(far.shape[0]):
        for j in range(far.shape[1]):
            if far[i, j] < 0.0:
                continue
            middle = boxes[i, j, 0, 0], boxes[i, j, 0, 1], boxes[i, j, 0, 2]
            slack = _SLACK * (distance + form.radius + far[i, j])
            if distance <= form.radius:
                mask[i, j] = _farthest_from_axis(boxes, i, j, form, minus(middle, away)) > (
                    form.radius + excess - slack
                )
                continue
            aside = _cross(form.axis, middle)
            upward = _cross(middle, aside)
            mask[i, j] = not (
                _parts(boxes, i, j, away, bottom, top, form.radius + slack)
                or _parts(boxes, i, j, aside, bottom, top, form.radius + slack)
                or _parts(boxes, i, j, upward, bottom, top, form.radius + slack)
            )
    return mask


@inlined
def _parts(
    boxes: NDArray[np.float32],
    row: int,
    column: int,
    across: Triple,
    bottom: Triple,
    top: Triple,
    radius: float,
) -> bool:
    """Tell whether a plane at right angles to a direction parts a tile and the sensor from a cylinder."""
    length = np.sqrt(dot(across, across))
    if not length > 0.0:
        return False
    sign = 1.0 if dot(across, bottom) + dot(across, top) > 0.0 else -1.0
    toward = plus((0.0, 0.0, 0.0), sign / length, across)
    nearest = min(dot(toward, bottom), dot(toward, top)) - radius
    return nearest > 0.0 and nearest > farthest_along(boxes, row, column, toward)


@inlined
def _farthest_from_axis(
    boxes: NDArray[np.float32], row: int, column: int, form: Form, middle: Triple
) -> float:
    """How far a tile's box gets from an axis at most; its middle is given from a point of the axis."""
    outward = plus(middle, -dot(middle, form.axis), form.axis)
    length = np.sqrt(dot(outward, outward))
    if not length > 0.0:
        return np.inf
    outward = plus((0.0, 0.0, 0.0), 1.0 / length, outward)
    around = _cross(form.axis, outward)
    out, aside = length, 0.0
    for k in range(1, 4):
        arm = boxes[row, column, k, 0], boxes[row, column, k, 1], boxes[row, column, k, 2]
        out, aside = out + abs(dot(arm, outward)), aside + abs(dot(arm, around))
    return float(np.sqrt(out * out + aside * aside))


@inlined
def _cross(a: Triple, b: Triple) -> Triple:
    """Cross product."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


_ROUNDING = 1 - 1e-9  # of lengths that are compared beforehand
_MOST_CELLS = 16 * TILE**2  # that are looked at before the beams of a tile are


def free_cells(
    grid: ChartGrid,
    predicted_sd: FloatArray,
    sights: Sequence[ScanSight],
    reaches: Sequence[Reach],
    views: Views | None = None,
) -> BoolArray:
    """Tell for each cell, flat, whether observed beams of scans went through it.

    Every beam that may get there is intersected with the surface in closed form. Without noise one beam is a
    veto; with noise it takes two in the cell's 3 x 3 neighbourhood, one of them in the cell itself. On a
    curved surface the neighbours of a vetoed cell are vetoed too, since facets lie off the surface by less
    than a cell. A mixed beam counts as far as it is sure to have got. `views` are those of the scans, made
    here when not given.
    """
    if views is None:
        views = Views.of((sight.eye for sight in sights), (float(reach.far.max()) for reach in reaches))
    form, around, count = form_of(grid.surface), _with_margin(grid), np.zeros(grid.shape, np.int32)
    sd = read_only_view(predicted_sd.reshape(grid.shape))
    cells = _Cells(_pair(grid.corner), _pair(grid.cell), grid.wraps, sd, count)
    for number in np.flatnonzero(views.may_reach(ball_around(grid.bounds(), grid.cell))).tolist():
        sight, reach = sights[number], reaches[number]
        crossing = crossing_tiles(sight.eye, sight.noise, form, reach, around, float(sd.min()))
        if crossing.any():
            _count_beams(sight, form, crossing, around, cells)
            trim()
    vetoed = count > 0
    if any(max(sight.noise) > 0 for sight in sights):
        vetoed &= _around(count, grid.wraps) >= FEWEST_BEAMS
    if form.is_curved:
        vetoed = _around(vetoed.astype(np.int32), grid.wraps) > 0
    return np.asarray(vetoed.ravel(), dtype=np.bool_)


class _Cells(NamedTuple):
    """A chart grid and the beams that went through its cells."""

    corner: tuple[float, float]  # of cell (0, 0), metres
    size: tuple[float, float]  # of a cell, metres
    wraps: bool  # whether the last column touches the first
    predicted_sd: FloatArray  # (rows, columns) of the surface along its normal, metres
    beams: NDArray[np.int32]  # (rows, columns) that went through each


def _with_margin(grid: ChartGrid) -> Rectangle:
    """The chart and a cell around it."""
    (left, low), (wide, tall), (rows, columns) = _pair(grid.corner), _pair(grid.cell), grid.shape
    left, low = left - wide, low - tall
    return Rectangle(left, left + (columns + 2) * wide, low, low + (rows + 2) * tall)


def _pair(numbers: FloatArray) -> tuple[float, float]:
    u, v = numbers.tolist()
    return u, v


@compiled
def _count_beams(sight: ScanSight, form: Form, crossing: BoolArray, around: Rectangle, cells: _Cells) -> None:
    """Add to each cell the beams of the `crossing` tiles that went through it."""
    rows, columns = sight.eye.shape
    for i in range(crossing.shape[0]):
        for j in range(crossing.shape[1]):
            if crossing[i, j] and not _is_decided(sight, form, i, j, cells):
                for row in range(i * TILE, min((i + 1) * TILE, rows)):
                    for column in range(j * TILE, min((j + 1) * TILE, columns)):
                        measured = sight.ends[row * columns + column]
                        if np.isfinite(measured):
                            ray = ray_at(sight.rays, row, column)
                            if form.is_curved or _crosses(sight.eye, form, around, ray, measured):
                                _count_beam(sight, form, ray, measured, cells)


@inlined
def _is_decided(sight: ScanSight, form: Form, i: int, j: int, cells: _Cells) -> bool:
    """Tell whether all cells of a plane that beams of a tile may go through are vetoed already, each by two.

    The beams lie between those of the tile's corners, and so do the places where they meet the plane.
    """
    eye, rays = sight.eye, sight.rays
    if form.is_curved or eye.is_spherical or rays.points.shape[0]:
        return False
    height, (rows, columns) = dot(minus(eye.origin, form.point), form.axis), cells.beams.shape
    left, right, low, high = np.inf, -np.inf, np.inf, -np.inf
    for row in (i * TILE, min((i + 1) * TILE, eye.shape[0]) - 1):
        for column in (j * TILE, min((j + 1) * TILE, eye.shape[1]) - 1):
            ray = ray_at(rays, row, column)
            slope = -dot(ray, form.axis)
            if not slope * height > 0.0:
                return False
            u, v = chart_of(form, plus(eye.origin, height / slope, ray))
            left, right, low, high = min(left, u), max(right, u), min(low, v), max(high, v)
    first = max(np.floor((left - cells.corner[0]) / cells.size[0]) - 1.0, 0.0)
    last = min(np.floor((right - cells.corner[0]) / cells.size[0]) + 1.0, columns - 1.0)
    top = max(np.floor((low - cells.corner[1]) / cells.size[1]) - 1.0, 0.0)
    bottom = min(np.floor((high - cells.corner[1]) / cells.size[1]) + 1.0, rows - 1.0)
    if (last - first + 1.0) * (bottom - top + 1.0) > _MOST_CELLS:
        return False
    for row in range(int(top), int(bottom) + 1):
        for column in range(int(first), int(last) + 1):
            if cells.beams[row, column] < FEWEST_BEAMS:
                return False
    return True


@inlined
def _crosses(eye: Eye, form: Form, around: Rectangle, ray: Triple, measured: float) -> bool:
    """Tell, without dividing, whether a beam ends behind a plane and goes through a rectangle of it."""
    height, foot = dot(minus(eye.origin, form.point), form.axis), chart_of(form, eye.origin)
    toward = -np.sign(height) * dot(ray, form.axis)
    if _ROUNDING * abs(height) > toward * measured:
        return False
    across, up = abs(height) * dot(ray, form.first), abs(height) * dot(ray, form.second)
    return bool(
        toward * (around.left - foot[0]) <= across <= toward * (around.right - foot[0])
        and toward * (around.low - foot[1]) <= up <= toward * (around.high - foot[1])
    )


@inlined
def _count_beam(sight: ScanSight, form: Form, ray: Triple, measured: float, cells: _Cells) -> None:
    """Add one beam, if it went through a cell."""
    eye, (rows, columns) = sight.eye, cells.beams.shape
    for from_within in (False, True):
        reach = reach_of(form, eye.origin, ray, from_within)
        if not reach < measured:
            continue
        place = plus(eye.origin, reach, ray)
        u, v = chart_of(form, place)
        across = np.floor((u - cells.corner[0]) / cells.size[0])
        down = np.floor((v - cells.corner[1]) / cells.size[1])
        if not (0 <= down < rows and (cells.wraps or 0 <= across < columns)):
            continue
        row, column = int(down), int(across) % columns
        cosine = abs(slope_at(form, place, ray))
        allowed = along_ray(eye, deviation_at(sight.noise, measured), cells.predicted_sd[row, column], cosine)
        if measured - reach > allowed and allowed <= eye.max_m:
            cells.beams[row, column] += 1


@compiled
def _around(count: NDArray[np.int32], wraps: bool) -> NDArray[np.int32]:
    """Sums (rows, columns) over each cell and the eight around it."""
    rows, columns = count.shape
    total = np.zeros((rows, columns), np.int32)
    for i in range(rows):
        for j in range(columns):
            if count[i, j]:
                for k in range(max(i - 1, 0), min(i + 2, rows)):
                    for m in range(j - 1, j + 2):
                        if wraps or 0 <= m < columns:
                            total[k, m % columns] += count[i, j]
    return total
