# SPDX-License-Identifier: MIT
"""Hidden regions: hidden cells divided by continued edges; each region is surface as a whole or not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from completion.boundary.continuation import ContinuedEdge
from completion.evidence.chart_grid import ChartGrid
from scenes.checks import BoolArray, FloatArray

GOES_ON = 0.9
"""Probability that a surface which goes on behind an occluder ends where its edge does, continued."""


@dataclass(frozen=True, slots=True, eq=False)
class Borders:
    """Pairs of neighbouring hidden cells between which a continued edge passes.

    Attributes
    ----------
    first, second : (n,) int64
        Flat cells.
    edge : (n,) int32
        Which edge.
    cost : (n, 2) float
        Improbability of a boundary there with surface in the first cell, and with surface in the second: 1
        minus `GOES_ON` on the side where the surface was seen along the edge, 1 on the other.
    length : (n,) float
        Length of the cells' common side, metres.
    """

    first: NDArray[np.int64]
    second: NDArray[np.int64]
    edge: NDArray[np.int32]
    cost: FloatArray
    length: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class HiddenRegions:
    """The hidden zone, divided.

    Attributes
    ----------
    region : (rows, columns) int32
        Number of the region that each cell belongs to, from 0; -1 for cells that are not hidden.
    n_regions : int
        How many there are.
    borders : Borders
        Where continued edges part them.
    beside_measured, beside_open : (n_regions,) float
        Length of each region's outline on measured surface and on cells that beams passed, metres.
    """

    region: NDArray[np.int32]
    n_regions: int
    borders: Borders
    beside_measured: FloatArray
    beside_open: FloatArray


def divide_hidden(
    grid: ChartGrid,
    hidden: BoolArray,
    measured: BoolArray,
    open_: BoolArray,
    continued: Sequence[ContinuedEdge],
) -> HiddenRegions:
    """Divide the hidden cells along the continued edges.

    Parameters
    ----------
    grid : ChartGrid
        The cells.
    hidden, measured, open_ : (rows, columns) bool
        Where the surface may be, where it is, and where it is not.
    continued : sequence of ContinuedEdge
        Continued edges.
    """
    index = np.arange(hidden.size).reshape(grid.shape)
    sides = [(index[:, :-1], index[:, 1:], grid.cell[1]), (index[:-1], index[1:], grid.cell[0])]
    if grid.wraps:
        sides.append((index[:, -1], index[:, 0], grid.cell[1]))
    first = np.concatenate([a.ravel() for a, _, _ in sides])
    second = np.concatenate([b.ravel() for _, b, _ in sides])
    length = np.concatenate([np.full(a.size, side) for a, _, side in sides])
    flat = hidden.ravel()
    inner = flat[first] & flat[second]
    a, b = first[inner], second[inner]
    edge, cost = _parted(grid, a, b, continued)
    at = edge >= 0
    borders = Borders(a[at], b[at], edge[at], cost[at], length[inner][at])
    region = _numbered(flat, a[~at], b[~at])
    n_regions = int(region.max(initial=-1)) + 1
    beside = np.zeros((2, n_regions))
    for row, what in enumerate((measured.ravel(), open_.ravel())):
        for a, b in ((first, second), (second, first)):
            touching = flat[a] & what[b] & ~flat[b]
            beside[row] += np.bincount(region[a[touching]], length[touching], minlength=n_regions)
    return HiddenRegions(region.reshape(grid.shape), n_regions, borders, beside[0], beside[1])


def _parted(
    grid: ChartGrid, first: NDArray[np.int64], second: NDArray[np.int64], continued: Sequence[ContinuedEdge]
) -> tuple[NDArray[np.int32], FloatArray]:
    """The continued edge (n,) between each pair of cells, -1 for none, and the cost (n, 2) of `Borders`."""
    centres = grid.centres_uv().reshape(-1, 2)
    slack = 2 * float(grid.cell.max())
    cost = np.ones((len(first), 2))
    edge = np.full(len(first), -1, np.int32)
    for number, one in enumerate(continued):
        side = one.curve.across(centres) >= 0
        parted = np.flatnonzero(side[first] != side[second])
        progress = one.progress((centres[first[parted]] + centres[second[parted]]) / 2)
        parted = parted[(progress >= -slack) & (progress <= abs(one.end - one.start) + slack)]
        edge[parted[edge[parted] < 0]] = number
        cost[parted, np.where(side[first[parted]] == (one.side > 0), 0, 1)] = 1 - GOES_ON
    return edge, cost


def _numbered(hidden: BoolArray, first: NDArray[np.int64], second: NDArray[np.int64]) -> NDArray[np.int32]:
    """Number the hidden cells (n,) by the parts that the pairs connect; -1 for other cells."""
    number = np.full(hidden.size, -1, np.int32)
    graph = coo_array((np.ones(len(first), np.int8), (first, second)), shape=(hidden.size, hidden.size))
    part = connected_components(graph, directed=False)[1]
    number[hidden] = np.unique(part[hidden], return_inverse=True)[1]
    return number
