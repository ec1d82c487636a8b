# SPDX-License-Identifier: MIT
"""Hidden regions: hidden cells divided by continued edges; the cheapest boundary says which are surface."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import breadth_first_order, connected_components, maximum_flow

from completion.boundary.continuation import ContinuedEdge
from completion.boundary.limits import GOES_ON, MOST_COST_M
from completion.evidence.chart_grid import ChartGrid
from scenes.checks import BoolArray, FloatArray, Value
from texture.engine.compiled import compiled


def further_flow(residual: Any, is_source: BoolArray) -> NDArray[np.int64]:
    """Return how much more (n,) could flow between each node and the terminal on its side of the cut.

    By that much the cut costs more where the node is forced to the other side. A solver that begins again for
    each node takes time with the square of their number; here the shortest paths that are left are followed
    from the node until they reach the terminal (Edmonds & Karp 1972), and what flowed is put back.

    Parameters
    ----------
    residual : sparse array, (n + 2, n + 2)
        What the largest flow left of the capacities, whole numbers; the source is node n, the sink n + 1.
    is_source : (n + 2,) bool
        Nodes on the source's side: no capacity is left from these to the others.
    """
    gaps = coo_array(residual)
    rows, columns = np.append(gaps.row, gaps.col), np.append(gaps.col, gaps.row)
    key, index = np.unique(rows.astype(np.int64) * len(is_source) + columns, return_inverse=True)
    capacity = np.bincount(index[: gaps.nnz], gaps.data, minlength=len(key)).astype(np.int64)
    row, column = np.divmod(key, len(is_source))
    start, back = np.searchsorted(row, np.arange(len(is_source) + 1)), np.lexsort((row, column))
    more = np.zeros(len(is_source) - 2, np.int64)
    for terminal, side, left in ((-2, is_source, capacity), (-1, ~is_source, capacity[back])):
        _add_flows(start, column, back, left, len(is_source) + terminal, side, more)
    return more


@compiled
def _add_flows(
    start: NDArray[np.int64],
    other: NDArray[np.int64],
    back: NDArray[np.int64],
    left: NDArray[np.int64],
    source: int,
    side: BoolArray,
    more: NDArray[np.int64],
) -> None:
    """Add to each node of a `side` what may flow there from the source through nodes of that side.

    Edges of node i, to the `other` ends, are numbered from `start[i]` on; `back` is the number of the edge
    the other way. What is `left` of the capacities is changed and put back.
    """
    seen, onward, queue = (
        np.zeros(side.size, np.int64),
        np.zeros(side.size, np.int64),
        np.zeros(side.size, np.int64),
    )
    touched, is_touched, search = np.zeros(left.size, np.int64), np.zeros(left.size, np.bool_), 0
    before = left.copy()
    for node in range(more.size):
        if not side[node]:
            continue
        n_touched = 0
        while True:
            search += 1
            queue[0], seen[node], head, tail = node, search, 0, 1
            while head < tail and seen[source] != search:
                here = queue[head]
                head += 1
                for edge in range(start[here], start[here + 1]):
                    there = other[edge]
                    if side[there] and seen[there] != search and left[back[edge]] > 0:
                        seen[there], onward[there], queue[tail] = search, back[edge], there
                        tail += 1
            if seen[source] != search:
                break
            least, here = left[onward[source]], source
            while here != node:
                least, here = min(least, left[onward[here]]), other[onward[here]]
            here = source
            while here != node:
                edge = onward[here]
                left[edge] -= least
                left[back[edge]] += least
                for changed in (edge, back[edge]):
                    if not is_touched[changed]:
                        is_touched[changed], touched[n_touched] = True, changed
                        n_touched += 1
                here = other[edge]
            more[node] += least
        for edge in touched[:n_touched]:
            left[edge], is_touched[edge] = before[edge], False


_UNITS = 10_000  # of cost in a metre: capacities are whole numbers


@dataclass(frozen=True, slots=True, eq=False)
class Borders(Value):
    """Pairs of neighbouring hidden cells between which a continued edge passes.

    A boundary there costs 1 minus `GOES_ON` on the side where the surface was seen along the edge, else 1.
    """

    first: NDArray[np.int64]  # (n,) flat cell on one side
    second: NDArray[np.int64]  # (n,) and on the other
    edge: NDArray[np.int32]  # (n,) which edge
    cost: FloatArray  # (n, 2) improbability with surface in the first cell, and in the second
    length: FloatArray  # (n,) length of the cells' common side, metres


@dataclass(frozen=True, slots=True, eq=False)
class HiddenRegions(Value):
    """The hidden zone, divided."""

    region: NDArray[np.int32]  # (rows, columns) number of each cell's region, from 0; -1 where not hidden
    n_regions: int  # how many there are
    borders: Borders  # where continued edges part them
    beside_measured: FloatArray  # (n_regions,) length of the outline on measured surface, metres
    beside_open: FloatArray  # (n_regions,) the same on cells that beams passed


def divide_hidden(
    grid: ChartGrid,
    hidden: BoolArray,
    measured: BoolArray,
    open_: BoolArray,
    continued: Sequence[ContinuedEdge],
) -> HiddenRegions:
    """Divide the hidden cells along the continued edges.

    `hidden`, `measured`, `open_`, all (rows, columns), tell where the surface may be, is, and is not.
    """
    a, b, length = _neighbours(grid, hidden, hidden)
    number = np.full(hidden.size, -1, np.int64)  # of each hidden cell
    number[hidden.ravel()] = np.arange(np.count_nonzero(hidden))
    row, column = np.nonzero(hidden)
    u, v = grid.axes()
    edge, cost = _border_costs(np.stack([u[column], v[row]], axis=1), number[a], number[b], grid, continued)
    at = edge >= 0
    borders = Borders(a[at], b[at], edge[at], cost[at], length[at])
    pairs = coo_array(
        (np.ones(np.count_nonzero(~at), np.int8), (number[a[~at]], number[b[~at]])), (len(row),) * 2
    )
    n_regions, part = connected_components(pairs, directed=False)
    region = np.full(hidden.shape, -1, np.int32)
    region[hidden] = part
    beside = np.zeros((2, n_regions))
    for total, what in zip(beside, (measured & ~hidden, open_ & ~hidden), strict=True):
        inner, _, length = _neighbours(grid, hidden, what)
        total += np.bincount(region.ravel()[inner], length, minlength=n_regions)
        _, inner, length = _neighbours(grid, what, hidden)
        total += np.bincount(region.ravel()[inner], length, minlength=n_regions)
    return HiddenRegions(region, n_regions, borders, beside[0], beside[1])


def _neighbours(
    grid: ChartGrid, first: BoolArray, second: BoolArray
) -> tuple[NDArray[np.int64], NDArray[np.int64], FloatArray]:
    """Pairs (n,) of flat neighbours, the left or upper of `first` and the other of `second`, and their sides.

    Both (rows, columns) are cells; sides (n,) are in metres.
    """
    index = np.arange(first.size).reshape(grid.shape)
    sides: list[tuple[Any, Any, float]] = [
        (np.s_[:, :-1], np.s_[:, 1:], grid.cell[1]),
        (np.s_[:-1], np.s_[1:], grid.cell[0]),
    ]
    if grid.wraps:
        sides.append((np.s_[:, -1:], np.s_[:, :1], grid.cell[1]))
    both = [first[a] & second[b] for a, b, _ in sides]
    return (
        np.concatenate([index[a][mask] for mask, (a, _, _) in zip(both, sides, strict=True)]),
        np.concatenate([index[b][mask] for mask, (_, b, _) in zip(both, sides, strict=True)]),
        np.concatenate(
            [np.full(np.count_nonzero(mask), side) for mask, (_, _, side) in zip(both, sides, strict=True)]
        ),
    )


def _border_costs(
    centres: FloatArray,
    first: NDArray[np.int64],
    second: NDArray[np.int64],
    grid: ChartGrid,
    continued: Sequence[ContinuedEdge],
) -> tuple[NDArray[np.int32], FloatArray]:
    """The continued edge (n,) between each pair of cells, -1 for none, and the cost (n, 2) of `Borders`.

    The pairs (n,) index the centres (m, 2) of the hidden cells in the chart.
    """
    slack = 2 * float(grid.cell.max())
    cost = np.ones((len(first), 2))
    edge = np.full(len(first), -1, np.int32)
    for number, continued_edge in enumerate(continued):
        side = continued_edge.curve.across(centres) >= 0
        parted = np.flatnonzero(side[first] != side[second])
        progress = continued_edge.progress((centres[first[parted]] + centres[second[parted]]) / 2)
        parted = parted[
            (progress >= -slack) & (progress <= abs(continued_edge.end - continued_edge.start) + slack)
        ]
        edge[parted[edge[parted] < 0]] = number
        cost[parted, np.where(side[first[parted]] == (continued_edge.side > 0), 0, 1)] = 1 - GOES_ON
    return edge, cost


@dataclass(frozen=True, slots=True, eq=False)
class Labelling(Value):
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
    """
    n = regions.n_regions
    if not n:
        return Labelling(np.zeros(0, dtype=np.bool_), np.zeros(0))
    graph = _Graph.of(regions)
    cost = np.stack([graph.measured, graph.open_])  # of no surface and of surface, for regions alone
    is_surface = cost[0] > cost[1]
    for part in graph.parts():
        is_surface[part], cost[:, part] = graph.within(part).cuts()
    outline = np.maximum(graph.outline, 1e-9) * _UNITS
    return Labelling(is_surface, np.clip((cost[0] - cost[1]) / outline, -1.0, 1.0))


@dataclass(frozen=True, slots=True, eq=False)
class _Graph:
    """Regions as nodes from 0, and what parts them from the measured surface, from open space, from others.

    Costs are whole numbers, `_UNITS` a metre.
    """

    measured: NDArray[np.int64]  # (n,) of a boundary to the measured surface
    open_: NDArray[np.int64]  # (n,) of a boundary to open space
    first: NDArray[np.int64]  # (m,) regions with surface
    second: NDArray[np.int64]  # (m,) beside ones without
    between: NDArray[np.int64]  # (m,) of a boundary between them
    outline: FloatArray  # (n,) length of the regions' outline, metres

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
        outline = regions.beside_measured + regions.beside_open
        outline = outline + np.bincount(pair // n, shared, minlength=n)
        return cls(
            measured=_whole(regions.beside_measured),
            open_=_whole(regions.beside_open),
            first=pair // n,
            second=pair % n,
            between=_whole(between.astype(np.float64)),
            outline=outline,
        )

    def parts(self) -> list[NDArray[np.int64]]:
        """The regions of each connected part of several: the others do not bear on how it is cut."""
        n = len(self.outline)
        graph = coo_array((np.ones(len(self.first), np.int8), (self.first, self.second)), shape=(n, n))
        part = connected_components(graph, directed=False)[1]
        order = np.argsort(part, kind="stable")
        parts = np.split(order, np.flatnonzero(np.diff(part[order])) + 1)
        return [members for members in parts if len(members) > 1]

    def within(self, part: NDArray[np.int64]) -> _Graph:
        """The part of these regions (k,) alone, ascending."""
        at = np.isin(self.first, part)
        first, second = (np.searchsorted(part, ends[at]) for ends in (self.first, self.second))
        return _Graph(
            measured=self.measured[part],
            open_=self.open_[part],
            first=first,
            second=second,
            between=self.between[at],
            outline=self.outline[part],
        )

    def cuts(self) -> tuple[BoolArray, NDArray[np.int64]]:
        """Return which regions (n,) are surface, and costs (2, n) with each forced to be none, and to be."""
        n = len(self.outline)
        every = np.arange(n)
        capacity = np.concatenate([self.between, self.measured, self.open_]).astype(np.int32)
        rows = np.concatenate([self.first, np.full(n, n), every])
        columns = np.concatenate([self.second, every, np.full(n, n + 1)])
        order = np.lexsort((columns, rows))
        start = np.searchsorted(rows[order], np.arange(n + 3))
        graph = csr_array((capacity[order], columns[order], start), shape=(n + 2, n + 2))
        flow = maximum_flow(graph, n, n + 1)
        residual = graph - flow.flow
        residual.data = np.maximum(residual.data, 0)
        residual.eliminate_zeros()
        is_surface = np.zeros(n + 2, dtype=np.bool_)
        is_surface[breadth_first_order(residual, n, return_predecessors=False)] = True
        cost = np.full((2, n), int(flow.flow_value), np.int64)
        cost[(~is_surface[:n]).astype(np.int64), np.arange(n)] += further_flow(residual, is_surface)
        return is_surface[:n], cost


def _whole(cost: FloatArray) -> NDArray[np.int64]:
    return np.asarray(np.rint(np.minimum(cost, MOST_COST_M) * _UNITS), dtype=np.int64)
