# SPDX-License-Identifier: MIT
"""Layout: the grid over a surface's chart, as fine as its pixels and as wide as what was hidden."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from completion.evidence.chart_grid import ChartGrid
from completion.extension.extent import Limits
from completion.merging.pipeline import MergedSurface
from completion.observe.observation import Observation
from scenes.checks import BoolArray, FloatArray
from scenes.surfaces.catalogue import Plane


def lay_grid(
    surface: MergedSurface, limits: Limits, observations: Sequence[Observation], max_cells: int
) -> ChartGrid:
    """Cells as small as the finer quarter of the pixels' footprints on the surface, at most `max_cells`."""
    footprint = np.concatenate([
        observation.scan.ranges[mask] * observation.scan.projection.pixel_angle
        for observation, mask in zip(observations, surface.masks, strict=True)
    ])  # fmt: skip
    cell = float(np.quantile(footprint, 0.25))
    low, high = _extent(limits, observations)
    low, high = low - 2 * cell, high + 2 * cell
    width = limits.chart.period if limits.full_turn else high[0] - low[0]
    cell = max(cell, float(np.sqrt(width * (high[1] - low[1]) / max_cells)))
    if np.isfinite(limits.chart.period):
        cell = min(cell, limits.chart.period / 48)
    return ChartGrid.over(limits.chart, low, high, cell, full_turn=limits.full_turn)


def _extent(limits: Limits, observations: Sequence[Observation]) -> tuple[FloatArray, FloatArray]:
    """The measured rectangle, widened within the window by all places that were hidden."""
    low, high = limits.window()
    if not isinstance(limits.chart, Plane):
        return low, high
    found = [limits.own_low[None], limits.own_high[None]]
    for seen in observations:
        rays = seen.rays[::2, ::2].reshape(-1, 3)
        reach = limits.chart.ray_ranges(seen.scan.origin, rays)
        behind = np.isfinite(reach) & (seen.scan.ranges[::2, ::2].ravel() < reach)
        uv = limits.chart.to_uv(seen.scan.origin + reach[behind, None] * rays[behind])
        found.append(uv[((uv >= low) & (uv <= high)).all(axis=1)])
    places = np.concatenate(found)
    return places.min(axis=0), places.max(axis=0)


def in_box(grid: ChartGrid, limits: Limits, low: FloatArray, high: FloatArray) -> BoolArray:
    """Cells (rows, columns) in a rectangle of the chart, all around where a cylinder may be closed."""
    uv = grid.centres_uv()
    half = grid.cell * (0.5 - 1e-6)  # cells that only touch the window are outside, however they are rounded
    axes = [1] if limits.full_turn else [0, 1]
    inside = (uv >= low - half) & (uv <= high + half)
    return np.asarray(inside[..., axes].all(axis=-1), dtype=np.bool_)
