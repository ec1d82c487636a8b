# SPDX-License-Identifier: MIT
"""Grid: the cells over the part of a surface's chart in which it may be continued."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from completion.evidence.chart_grid import ChartGrid
from completion.evidence.evidence import Scans
from completion.evidence.form import Form, chart_of, form_of, reach_of
from completion.evidence.reach import TILE, Reach, farthest_along
from completion.evidence.sight import ball_around
from completion.extension.extent import Extent
from completion.merging.merged_surface import MergedSurface
from completion.observe.observation import Observation
from completion.observe.rays import Rays, Triple, dot, minus, plus, ray_at
from scenes.checks import FloatArray
from scenes.run.mapping import trim
from scenes.surfaces.catalogue import Plane
from texture.engine.compiled import compiled, inlined

_MOST_CELLS = 1_000_000  # of one surface, however small they are asked for
_MOST_PIXELS = 1_000_000  # that a cell's size is read from
_STRIDE = 2  # rows and columns between the beams that tell how far a surface is hidden
_SLACK = 1e-6  # of lengths that are compared beforehand


def lay_grid(
    surface: MergedSurface,
    extent: Extent,
    scans: Scans,
    *,
    max_cells: int,
    cell_m: float | None,
) -> ChartGrid:
    """Return a grid over the extent, its cells as small as the lower quartile of the pixels' footprints.

    Or of side `cell_m`. They are larger where there would be more than `max_cells`, or 1,000,000 of a side
    that was asked for.
    """
    cell, most = float(np.quantile(_footprints(surface, scans.observations), 0.25)), max_cells
    if cell_m is not None:
        cell, most = cell_m, _MOST_CELLS
    low, high = _hidden_box(extent, scans)
    low, high = low - 2 * cell, high + 2 * cell
    width = extent.chart.period if extent.full_turn else high[0] - low[0]
    cell = max(cell, float(np.sqrt(width * (high[1] - low[1]) / most)))
    if np.isfinite(extent.chart.period):
        cell = min(cell, extent.chart.period / 48)
    return ChartGrid.over(extent.chart, low, high, cell, full_turn=extent.full_turn)


def _footprints(surface: MergedSurface, observations: Sequence[Observation]) -> FloatArray:
    """How wide the pixels (n,) of a surface are on it where it faces them, metres."""
    footprints = []
    for seen, pixels in surface.sampled_by(observations, _MOST_PIXELS):
        footprints.append(seen.scan.ranges.ravel()[pixels] * seen.scan.projection.pixel_angle)
        trim()
    return np.concatenate(footprints)


def _hidden_box(extent: Extent, scans: Scans) -> tuple[FloatArray, FloatArray]:
    """The measured rectangle, widened within the window by all places that were hidden."""
    low, high = extent.window()
    if not isinstance(extent.chart, Plane):
        return low, high
    places = farthest_hidden(extent.chart, low, high, scans)
    places = np.concatenate([extent.own_low[None], extent.own_high[None], places])
    return places.min(axis=0), places.max(axis=0)


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
    far_places, form = [np.zeros((0, 2))], form_of(chart)
    corners = chart.from_uv(np.array([low, high]))
    window = ball_around(np.sort(corners, axis=0), (high - low) * _SLACK)
    for number in np.flatnonzero(scans.views.may_see(window)).tolist():
        seen, reach = scans.observations[number], scans.reach[number]
        origin, pixel = seen.scan.origin, _farthest(form, seen.scan.ranges, seen.rays, reach, low, high)
        if (pixel < 0).all():
            continue
        rays = seen.rays_at(pixel[pixel >= 0])
        far_places.append(chart.to_uv(origin + chart.ray_ranges(origin, rays)[:, None] * rays))
        trim()
    return np.concatenate(far_places)


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
