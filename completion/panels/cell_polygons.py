# SPDX-License-Identifier: MIT
"""Cell polygons: whole cells and triangles of cells as polygons, by cancelling the sides that they share."""

from __future__ import annotations

from math import atan2, pi

import numpy as np
import shapely
from numpy.typing import NDArray

from scenes.checks import BoolArray, FloatArray
from texture.engine.compiled import compiled, inlined

_PARTS = 10_000  # of a cell's side, to which corners are rounded


def polygons_of_cells(whole: BoolArray, triangles: FloatArray) -> shapely.MultiPolygon:
    """Return what `whole` cells (rows, columns) and triangles (n, 3, 2) cover; x is the column, y the row.

    No triangle lies in a whole cell or leaves its own; they are anticlockwise, rows and columns of their
    corners rounded to a ten thousandth. Corners of cells stay corners of the polygons along straight sides.
    """
    corner = np.rint(triangles * _PARTS).astype(np.int64)
    ends = np.stack([corner, np.roll(corner, -1, axis=1)], axis=2).reshape(-1, 2, 2)
    level, upright = ((ends[:, 0, k] == ends[:, 1, k]) & (ends[:, 0, k] % _PARTS == 0) for k in (0, 1))
    filled = np.pad(whole, 1).astype(np.int8)
    step: NDArray[np.int8] = filled[1:, 1:-1] - filled[:-1, 1:-1]
    along_rows = _on_lines(step, ends[level & ~upright])
    step = filled[1:-1, :-1] - filled[1:-1, 1:]
    along_columns = _on_lines(step.T, ends[upright & ~level][..., ::-1])[..., ::-1]
    within = _within_cells(ends[~level & ~upright], whole.shape[1] * _PARTS + 1)
    edges = np.concatenate([along_rows, along_columns, within])
    if not len(edges):
        return shapely.MultiPolygon()
    places, node = np.unique(edges.reshape(-1, 2), axis=0, return_inverse=True)
    begin, end = node.reshape(-1, 2).T
    order = np.argsort(begin, kind="stable")
    begin, end = begin[order], end[order]
    first = np.searchsorted(begin, np.arange(len(places) + 1))
    chain, size = _rings(begin, end, first, places)
    rings = np.split(places[chain][:, ::-1] / _PARTS, np.cumsum(size)[:-1])
    return _nested([ring for ring in rings if len(ring) > 2])


def _on_lines(step: NDArray[np.int8], ends: NDArray[np.int64]) -> NDArray[np.int64]:
    """Edges (k, 2, 2) on the lines between rows that are left of the whole cells' sides and of others.

    `step` (rows + 1, columns) is 1 where a cell's side leads along its line, -1 where one leads back;
    `ends` (n, 2, 2) are row and column, in parts, of where the others begin and end.
    """
    length = step.shape[1] * _PARTS + 1
    line, cell = np.nonzero(step)
    side = (line * length + cell * _PARTS)[:, None] + [0, _PARTS]
    back = step[line, cell] < 0
    side[back] = side[back, ::-1]
    other = ends[..., 0] // _PARTS * length + ends[..., 1]
    key, index = np.unique(np.concatenate([side, other]), return_inverse=True)
    index = index.reshape(-1, 2)
    net = np.bincount(index[:, 0], minlength=len(key)) - np.bincount(index[:, 1], minlength=len(key))
    covered = np.cumsum(net)[:-1]
    left = np.flatnonzero(covered)
    pair = np.stack([key[left], key[left + 1]], axis=1)
    pair[covered[left] < 0] = pair[covered[left] < 0, ::-1]
    return np.stack([pair // length * _PARTS, pair % length], axis=-1)


def _within_cells(ends: NDArray[np.int64], width: int) -> NDArray[np.int64]:
    """Of edges (n, 2, 2) those that none leads back along; `width` is more than any column, in parts."""
    place = ends @ [width, 1]
    place = place[place[:, 0] != place[:, 1]]
    pair, index = np.unique(np.sort(place, axis=1), axis=0, return_inverse=True)
    net = np.bincount(index.ravel(), np.where(place[:, 0] < place[:, 1], 1, -1), len(pair))
    pair[net < 0] = pair[net < 0, ::-1]
    return np.stack(np.divmod(pair[net != 0], width), axis=-1)


@compiled
def _rings(
    begin: NDArray[np.int64], end: NDArray[np.int64], first: NDArray[np.int64], places: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Chain edges between nodes to rings that pass no node twice: their nodes, and how many each has.

    Edges are sorted by where they begin; those of node k are `first[k]` to `first[k + 1]`. Where several go
    on, the one that turns most to the left does, so that rings touch and do not cross.
    """
    n = len(begin)
    used, on_path = np.zeros(n, np.bool_), np.full(len(places), -1)
    path, chain, size = np.empty(n + 1, np.int64), np.empty(n, np.int64), np.empty(n, np.int64)
    n_chained, n_rings = 0, 0
    for seed in range(n):
        edge, depth = seed, 0
        if not used[seed]:
            path[0], on_path[begin[seed]], depth = begin[seed], 0, 1
        while edge >= 0 and not used[edge]:
            used[edge] = True
            node = end[edge]
            back = on_path[node]
            if back >= 0:
                size[n_rings] = depth - back
                n_rings += 1
                for k in range(back, depth):
                    chain[n_chained] = path[k]
                    n_chained += 1
                    on_path[path[k]] = -1
                depth = back
            path[depth], on_path[node] = node, depth
            depth += 1
            edge = _leftmost(edge, begin, end, first, places, used)
        for k in range(depth):
            on_path[path[k]] = -1
    return chain[:n_chained], size[:n_rings]


@inlined
def _leftmost(
    edge: int,
    begin: NDArray[np.int64],
    end: NDArray[np.int64],
    first: NDArray[np.int64],
    places: NDArray[np.int64],
    used: BoolArray,
) -> int:
    """The unused edge from where one ends that turns most to the left; -1 without any."""
    node, best, most = end[edge], -1, -2 * pi
    row, column = places[node, 0] - places[begin[edge], 0], places[node, 1] - places[begin[edge], 1]
    for k in range(first[node], first[node + 1]):
        if not used[k]:
            down, right = places[end[k], 0] - places[node, 0], places[end[k], 1] - places[node, 1]
            turn = atan2(float(column * down - row * right), float(column * right + row * down))
            turn = -pi if turn == pi else turn
            if turn > most:
                best, most = k, turn
    return best


def _nested(rings: list[FloatArray]) -> shapely.MultiPolygon:
    """Anticlockwise rings as polygons, clockwise ones as holes of the smallest that they lie in."""
    faces = shapely.polygons([shapely.linearrings(ring) for ring in rings])
    size, is_shell = shapely.area(faces), shapely.is_ccw(shapely.get_exterior_ring(faces))
    shell, hole = np.flatnonzero(is_shell & (size > 0)), np.flatnonzero(~is_shell & (size > 0))
    inside = shapely.point_on_surface(faces[hole])
    of_hole, of_shell = shapely.STRtree(faces[shell]).query(inside, predicate="within")
    holes: list[list[FloatArray]] = [[] for _ in shell]
    larger = size[shell[of_shell]] > size[hole[of_hole]]
    order = np.lexsort((size[shell[of_shell]], of_hole, ~larger))[: larger.sum()]
    _, nearest = np.unique(of_hole[order], return_index=True)
    for k in order[nearest]:
        holes[of_shell[k]].append(rings[hole[of_hole[k]]])
    return shapely.MultiPolygon([
        shapely.Polygon(rings[k], inner) for k, inner in zip(shell, holes, strict=True)
    ])  # fmt: skip
