# SPDX-License-Identifier: MIT
"""Labelling: which hidden regions are surface, as the cheapest boundary through all of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, maximum_flow

from completion.boundary.hidden_regions import HiddenRegions
from scenes.checks import BoolArray, FloatArray

_UNITS = 10_000  # capacities are whole numbers


@dataclass(frozen=True, slots=True, eq=False)
class Labelling:
    """Which regions are surface.

    Attributes
    ----------
    is_surface : (n_regions,) bool
        The labelling of least cost.
    margin : (n_regions,) float
        Cost of the labelling with the region forced to be no surface, less the cost with it forced to be
        surface, per metre of the region's outline: 1 where measured surface is all around, -1 where beams
        passed all around, 0 where nothing tells.
    """

    is_surface: BoolArray
    margin: FloatArray


def label_regions(regions: HiddenRegions) -> Labelling:
    """Choose the regions that are surface by a minimum cut (Boykov, Veksler & Zabih 2001).

    A boundary of the surface costs its length times its improbability. That is 1 along the outline of the
    hidden zone: surfaces seldom end just where an occluder's silhouette lies. It is less along a continued
    edge, where the surface is on that side of it on which it was seen. A region that touches neither measured
    nor open cells is no surface.

    Parameters
    ----------
    regions : HiddenRegions
        The hidden cells, divided.
    """
    n = regions.n_regions
    if not n:
        return Labelling(np.zeros(0, dtype=np.bool_), np.zeros(0))
    graph = _Graph.of(regions)
    is_surface, least = graph.cut(None, keep=True)
    forced = np.array([[least, least]] * n)
    for region in range(n):
        forced[region, int(is_surface[region])] = graph.cut(region, keep=not is_surface[region])[1]
    outline = np.maximum(graph.outline, 1e-9)
    return Labelling(is_surface, np.clip((forced[:, 1] - forced[:, 0]) / outline, -1.0, 1.0))


@dataclass(frozen=True, slots=True, eq=False)
class _Graph:
    """Regions as nodes from 0, the measured surface as node n, open space as node n + 1."""

    n: int
    rows: NDArray[np.int64]
    columns: NDArray[np.int64]
    cost: FloatArray
    outline: FloatArray

    @classmethod
    def of(cls, regions: HiddenRegions) -> _Graph:
        n, borders = regions.n_regions, regions.borders
        region = regions.region.ravel()
        a, b = region[borders.first].astype(np.int64), region[borders.second].astype(np.int64)
        apart = a != b
        a, b, cost, length = a[apart], b[apart], borders.cost[apart], borders.length[apart]
        pair, index = np.unique(np.append(a * n + b, b * n + a), return_inverse=True)
        between = np.bincount(index, np.append(*cost.T) * np.tile(length, 2), minlength=len(pair))
        shared = np.bincount(index, np.tile(length, 2), minlength=len(pair))
        every = np.arange(n)
        outline = regions.beside_measured + regions.beside_open
        outline = outline + np.bincount(pair // n, shared, minlength=n)
        return cls(
            n,
            np.concatenate([pair // n, np.full(n, n), every]),
            np.concatenate([pair % n, every, np.full(n, n + 1)]),
            np.concatenate([between, regions.beside_measured, regions.beside_open]),
            outline,
        )

    def cut(self, forced: int | None, *, keep: bool) -> tuple[BoolArray, float]:
        """Return which regions are surface and what it costs, with one region forced to be surface or not."""
        n, rows, columns, cost = self.n, self.rows, self.columns, self.cost
        if forced is not None:
            ends = (n, forced) if keep else (forced, n + 1)
            rows, columns = np.append(rows, ends[0]), np.append(columns, ends[1])
            cost = np.append(cost, 1e4)
        capacity = np.rint(np.minimum(cost, 1e4) * _UNITS).astype(np.int32)
        graph = coo_array((capacity, (rows, columns)), shape=(n + 2, n + 2)).tocsr()
        graph.sum_duplicates()
        flow = maximum_flow(graph, n, n + 1)
        rest = graph - flow.flow
        rest.data = np.maximum(rest.data, 0)
        rest.eliminate_zeros()
        reached = breadth_first_order(rest, n, return_predecessors=False)
        is_surface = np.zeros(n + 2, dtype=np.bool_)
        is_surface[reached] = True
        return is_surface[:n], float(flow.flow_value) / _UNITS
