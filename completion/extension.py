# SPDX-License-Identifier: MIT
"""Extension: the hidden cells that a surface is inferred to cover, each with the reason why."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from shapely import MultiPoint, contains_xy

from completion.chart import ChartGrid
from completion.evidence import Evidence, EvidenceOptions, Label, weigh
from completion.limits import Limits, Mode
from completion.merging import MergedSurface
from completion.observation import Observation
from scenes.checks import BoolArray, FloatArray

_MAX_CELLS = 200_000


class Provenance(IntEnum):
    """How a place came to be in the model."""

    MEASURED = 0
    INTERIOR = 1  # a hole in the measured part: the surface goes on behind the occluder
    BETWEEN = 2  # between parts that an occluder had cut apart
    EDGES = 3  # inside the measured part's own straight edges, continued until they meet
    ARCHITECTURAL = 4  # on to the plane that encloses the room there
    FULL_TURN = 5  # around the back of a cylinder


CONFIDENCE: dict[Provenance, float] = {
    Provenance.MEASURED: 1.0,
    Provenance.INTERIOR: 0.95,
    Provenance.BETWEEN: 0.9,
    Provenance.EDGES: 0.75,
    Provenance.ARCHITECTURAL: 0.75,
    Provenance.FULL_TURN: 0.8,
}
"""Prior probability that a surface inferred for this reason exists; priors of the method, not calibrated."""


@dataclass(frozen=True, slots=True, eq=False)
class Patch:
    """One completed surface in its chart.

    Attributes
    ----------
    source : MergedSurface
        The fit and the pixels behind it.
    limits : Limits
        What bounded the continuation.
    grid : ChartGrid
        The cells.
    evidence : Evidence
        What the scans say of them.
    hypothesised : (rows, columns) bool
        Cells that the surface is inferred to cover.
    provenance : (rows, columns) int8
        A `Provenance` for each observed or hypothesised cell, -1 elsewhere.
    spread : (rows, columns) float
        Predicted standard deviation along the normal, metres.
    """

    source: MergedSurface
    limits: Limits
    grid: ChartGrid
    evidence: Evidence
    hypothesised: BoolArray
    provenance: NDArray[np.int8]
    spread: FloatArray

    @property
    def observed(self) -> BoolArray:
        """Cells where the surface was measured."""
        return self.evidence.observed

    @property
    def observed_m2(self) -> float:
        """Measured area in square metres."""
        return float(self.observed.sum()) * self.grid.cell_area

    @property
    def hypothesised_m2(self) -> float:
        """Inferred area in square metres, cells cut by a limit counted whole."""
        return float(self.hypothesised.sum()) * self.grid.cell_area


def extend(
    surface: MergedSurface,
    limits: Limits,
    observations: Sequence[Observation],
    owners: Sequence[NDArray[np.int32]],
    owner: int,
    options: EvidenceOptions,
    mode: Mode,
    max_sd_m: float,
) -> Patch:
    """Continue a surface into the cells that are hidden, within its limits.

    A cell is filled only where some scan says OCCLUDED and none says FREE, where it connects with the
    measured part through cells of which the same holds, and where the surface is known to `max_sd_m`.
    """
    grid = _grid(surface, limits, observations)
    centres = grid.centres()
    spread = surface.fit.standard_deviation(centres)
    evidence = weigh(grid, spread, observations, owners, owner, options)
    allowed = _allowed(grid, limits, evidence.observed, mode)
    known = (spread <= max_sd_m).reshape(grid.shape)
    hidden = (evidence.labels == Label.OCCLUDED) & ~evidence.observed & allowed & known
    silent = (evidence.labels == Label.NO_RETURN) & allowed
    reachable = _connected(hidden | silent | evidence.observed, evidence.observed, grid.wraps)
    hypothesised = hidden & reachable
    provenance = _provenance(grid, limits, evidence.observed, hypothesised)
    return Patch(surface, limits, grid, evidence, hypothesised, provenance, spread.reshape(grid.shape))


def _grid(surface: MergedSurface, limits: Limits, observations: Sequence[Observation]) -> ChartGrid:
    """Cells as small as the finer quarter of the pixels' footprints on the surface, within a bound."""
    footprint = np.concatenate([
        observation.scan.ranges[mask] * observation.scan.projection.pixel_angle
        for observation, mask in zip(observations, surface.masks, strict=True)
    ])  # fmt: skip
    cell = float(np.quantile(footprint, 0.25))
    low, high = (
        np.minimum(limits.low, limits.own_low) - 2 * cell,
        np.maximum(limits.high, limits.own_high) + 2 * cell,
    )
    width = limits.chart.period if limits.full_turn else high[0] - low[0]
    cell = max(cell, float(np.sqrt(width * (high[1] - low[1]) / _MAX_CELLS)))
    if np.isfinite(limits.chart.period):
        cell = min(cell, limits.chart.period / 48)
    return ChartGrid.over(limits.chart, low, high, cell, full_turn=limits.full_turn)


def _allowed(grid: ChartGrid, limits: Limits, observed: BoolArray, mode: Mode) -> BoolArray:
    """Cells inside the rectangle of the limits and on the right side of every cut."""
    uv = grid.centres_uv()
    half = grid.cell / 2
    inside = (uv[..., 1] >= limits.low[1] - half[1]) & (uv[..., 1] <= limits.high[1] + half[1])
    if not limits.full_turn:
        inside &= (uv[..., 0] >= limits.low[0] - half[0]) & (uv[..., 0] <= limits.high[0] + half[0])
    if mode == "conservative":
        inside &= _hull(grid, observed)
    centres = grid.centres()
    for cut in limits.cuts:
        inside &= (cut.distance(centres) > -float(np.hypot(*half))).reshape(grid.shape)
    return np.asarray(inside, dtype=np.bool_)


def _connected(passable: BoolArray, start: BoolArray, wraps: bool) -> BoolArray:
    """The part of `passable` connected with `start`, across the seam where the grid wraps."""
    part, n_parts = ndimage.label(passable)
    reached = np.zeros(n_parts + 1, dtype=np.bool_)
    reached[np.unique(part[start & passable])] = True
    reached[0] = False
    for _ in range(2 if wraps else 0):
        both = (part[:, 0] > 0) & (part[:, -1] > 0)
        joined = both & (reached[part[:, 0]] | reached[part[:, -1]])
        reached[part[joined, 0]] = reached[part[joined, -1]] = True
    return np.asarray(reached[part], dtype=np.bool_)


def _hull(grid: ChartGrid, cells: BoolArray) -> BoolArray:
    """Cells whose centre lies in the convex hull of the given ones."""
    rows, columns = np.nonzero(cells)
    if len(rows) < 3:
        return cells.copy()
    outline = MultiPoint(np.column_stack([columns, rows]).astype(np.float64)[_extremes(rows)]).convex_hull
    row, column = np.mgrid[: grid.shape[0], : grid.shape[1]]
    return np.asarray(contains_xy(outline.buffer(0.5), column, row), dtype=np.bool_)


def _extremes(rows: NDArray[np.int64]) -> NDArray[np.int64]:
    """Indices of the first and last cell in each row; `rows` ascends, and columns ascend in each."""
    first = np.flatnonzero(np.diff(rows, prepend=-1))
    return np.unique(np.concatenate([first, np.append(first[1:] - 1, len(rows) - 1)]))


def _provenance(
    grid: ChartGrid, limits: Limits, observed: BoolArray, hypothesised: BoolArray
) -> NDArray[np.int8]:
    result = np.full(grid.shape, -1, np.int8)
    uv = grid.centres_uv()
    beyond = ((uv < limits.own_low) | (uv > limits.own_high)).any(axis=-1)
    if limits.full_turn:
        beyond = (uv[..., 1] < limits.own_low[1]) | (uv[..., 1] > limits.own_high[1])
        turned = (uv[..., 0] < limits.own_low[0]) | (uv[..., 0] > limits.own_high[0])
        result[hypothesised & turned] = Provenance.FULL_TURN
    result[hypothesised & beyond] = Provenance.ARCHITECTURAL
    within = hypothesised & (result < 0)
    result[within] = Provenance.EDGES
    part, n_parts = ndimage.label(observed, structure=np.ones((3, 3)))
    sizes = np.bincount(part.ravel(), minlength=n_parts + 1)[1:]
    if len(sizes):
        largest = part == int(np.argmax(sizes)) + 1
        result[within & _hull(grid, observed)] = Provenance.BETWEEN
        result[within & _hull(grid, largest)] = Provenance.INTERIOR
    result[observed] = Provenance.MEASURED
    return result
