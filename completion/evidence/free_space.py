# SPDX-License-Identifier: MIT
"""Free space: the cells of a surface that observed beams went through, in closed form."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from completion.evidence.chart_grid import ChartGrid
from completion.evidence.form import Form, chart_of, form_of, reach_of, slope_at
from completion.evidence.sight import Sight, along_ray, sight_of
from completion.observe.observation import Observation
from completion.observe.rays import deviation_at, ray_at
from completion.observe.tolerance import Tolerance
from completion.observe.triple import dot, minus, plus
from scenes.checks import BoolArray, FloatArray
from texture.engine.compiled import compiled

_ROUNDING = 1 - 1e-9  # of lengths that are compared beforehand
_LEAST_BEAMS = 2  # in a cell and those around it, that veto it where ranges are noisy


def free_cells(
    grid: ChartGrid, predicted_sd: FloatArray, observations: Sequence[Observation], tolerance: Tolerance
) -> BoolArray:
    """Tell for each cell, flat, whether observed beams went through it.

    Every beam is intersected with the surface in closed form. Without noise one beam is a veto; with noise
    it takes two in the cell's 3 x 3 neighbourhood, one of them in the cell itself. On a curved surface the
    neighbours of a vetoed cell are vetoed too, since facets lie off the surface by less than a cell.
    """
    count, form = np.zeros(grid.shape, np.int32), form_of(grid.surface)
    corner, cell, sd = (
        tuple(grid.corner.tolist()),
        tuple(grid.cell.tolist()),
        predicted_sd.reshape(grid.shape),
    )
    for seen in observations:
        _count_beams(sight_of(seen, tolerance), form, corner, cell, grid.wraps, sd, count)
    vetoed = count > 0
    if any(seen.is_noisy for seen in observations):
        vetoed &= _around(count, grid.wraps) >= _LEAST_BEAMS
    if form.is_curved:
        vetoed = _around(vetoed.astype(np.int32), grid.wraps) > 0
    return np.asarray(vetoed.ravel(), dtype=np.bool_)


@compiled
def _count_beams(
    sight: Sight,
    form: Form,
    corner: tuple[float, float],
    size: tuple[float, float],
    wraps: bool,
    predicted_sd: FloatArray,
    count: NDArray[np.int32],
) -> None:
    """Add to each cell (rows, columns) the beams that went through it."""
    rows, columns = count.shape
    eye, ranges, width = sight.eye, sight.ranges, sight.eye.shape[1]
    height, foot = dot(minus(eye.origin, form.point), form.axis), chart_of(form, eye.origin)
    left, low = corner[0] - foot[0] - size[0], corner[1] - foot[1] - size[1]
    right, high = left + (columns + 2) * size[0], low + (rows + 2) * size[1]
    for pixel in range(ranges.size):
        measured = ranges[pixel]
        if not np.isfinite(measured):
            continue
        ray = ray_at(sight.rays, pixel // width, pixel % width)
        if not form.is_curved:
            # Leave out, before dividing, beams that end before the plane or miss the chart by a cell.
            toward = -np.sign(height) * dot(ray, form.axis)
            across, up = abs(height) * dot(ray, form.first), abs(height) * dot(ray, form.second)
            if (
                _ROUNDING * abs(height) > toward * measured
                or not toward * left <= across <= toward * right
                or not toward * low <= up <= toward * high
            ):
                continue
        for from_within in (False, True):
            reach = reach_of(form, eye.origin, ray, from_within)
            if not reach < measured:
                continue
            place = plus(eye.origin, reach, ray)
            u, v = chart_of(form, place)
            across, down = np.floor((u - corner[0]) / size[0]), np.floor((v - corner[1]) / size[1])
            if not (0 <= down < rows and (wraps or 0 <= across < columns)):
                continue
            row, column = int(down), int(across) % columns
            cosine = abs(slope_at(form, place, ray))
            allowed = along_ray(eye, deviation_at(sight.noise, measured), predicted_sd[row, column], cosine)
            if measured - reach > allowed and allowed <= eye.max_m:
                count[row, column] += 1


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
