# SPDX-License-Identifier: MIT
"""Meshing: chart cells as triangles, cut exactly where surfaces meet."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from completion.boundary.curves import Circle, Line
from completion.evidence.chart_grid import ChartGrid
from scenes.checks import BoolArray, FloatArray
from scenes.surfaces.catalogue import Cylinder, Surface

_LEAST_CORNERS = 3  # of a polygon


@dataclass(frozen=True, slots=True, eq=False)
class Trim:
    """A curve of the chart that cells end at."""

    curve: Line | Circle  # in the chart
    sign: float  # 1 to keep the side where `curve.across` is positive, -1 for the other one
    cells: BoolArray  # (rows, columns) cells that it cuts


@dataclass(frozen=True, slots=True, eq=False)
class ChartMesh:
    """Triangles on a chart."""

    vertices: FloatArray  # (n, 3) points on the surface, working frame
    faces: NDArray[np.int32]  # (m, 3) counter-clockwise seen from the normal's side
    cells: FloatArray  # (n, 2) fractional row and column of each vertex; integers are cell corners
    face_cell: NDArray[np.int64]  # (m,) flat cell of each face, the first where it spans several


def mesh_cells(
    grid: ChartGrid, cells: BoolArray, cuts: Sequence[Surface], trims: Sequence[Trim] = (), *, merged: bool
) -> ChartMesh:
    """Triangulate the given cells of a grid, clipped by the cuts and trims.

    Parameters
    ----------
    grid : ChartGrid
        The grid.
    cells : (rows, columns) bool
        Cells to mesh.
    cuts : sequence of Surface
        Keep what lies on the normals' side; cells across a cut become polygons that end on it.
    trims : sequence of Trim
        The same for curves of the chart, each for its own cells.
    merged : bool
        Join equal cells to rectangles (along the axis only, on a curved surface): fewer faces, the same
        area. Without, every cell has its own two faces.
    """
    full = cells & _whole(grid, cells, cuts)
    for trim in trims:
        full &= ~trim.cells
    width = 1 if np.isfinite(grid.surface.period) else grid.shape[1]
    polygons = _joined(
        _of_boxes(_rectangles(full, width) if merged else _single(full)),
        _clipped(grid, cells & ~full, cuts, trims),
    )
    size, corner = polygons.size, polygons.corner
    if not len(size):
        empty = np.zeros((0, 3))
        return ChartMesh(empty, np.zeros((0, 3), np.int32), np.zeros((0, 2)), np.zeros(0, np.int64))
    start = np.cumsum(size) - size
    places, index = _distinct(corner)
    fans = [np.flatnonzero(size > k + 1) for k in range(1, int(size.max()) - 1)]
    owner = np.concatenate(fans)
    second = start[owner] + np.repeat(np.arange(1, len(fans) + 1), [len(fan) for fan in fans])
    triangles = index[np.stack([start[owner], second, second + 1], axis=1)].astype(np.int32)
    middle = np.minimum.reduceat(corner, start)[owner]
    row, column = np.minimum(np.floor(middle + 1e-6).astype(np.int64), np.array(grid.shape) - 1).T
    proper = (triangles[:, 0] != triangles[:, 1]) & (triangles[:, 1] != triangles[:, 2])
    proper &= triangles[:, 0] != triangles[:, 2]
    vertices = grid.surface.from_uv(grid.uv_of(places[:, 0], places[:, 1]))
    inward = isinstance(grid.surface, Cylinder) and grid.surface.concave  # its chart is that of the outside
    faces_out = triangles[proper][:, ::-1] if inward else triangles[proper]
    return ChartMesh(vertices, faces_out, places, (row * grid.shape[1] + column)[proper])


@dataclass(frozen=True, slots=True, eq=False)
class _Polygons:
    """Convex polygons of cell coordinates, one after the other."""

    corner: FloatArray  # (n, 2) fractional row and column of all their corners
    size: NDArray[np.int64]  # (m,) corners of each, at least three

    def above(self, height: FloatArray) -> tuple[_Polygons, NDArray[np.int64]]:
        """The parts where `height` (n,), given at the corners, is not negative; which polygons are left.

        A step of Sutherland & Hodgman (1974), taken for all of them.
        """
        start = np.cumsum(self.size) - self.size
        following = np.arange(1, len(height) + 1)
        following[start + self.size - 1] = start
        inside = height >= 0
        crosses = inside != inside[following]
        share = height / np.where(crosses, height - height[following], 1.0)
        crossing = self.corner + share[:, None] * (self.corner[following] - self.corner)
        kept = np.stack([inside, crosses], axis=1)
        size = np.add.reduceat(kept.sum(axis=1), start)
        left = np.flatnonzero(size >= _LEAST_CORNERS)
        kept &= np.repeat(size >= _LEAST_CORNERS, self.size)[:, None]
        return _Polygons(np.stack([self.corner, crossing], axis=1)[kept], size[left]), left


def _joined(one: _Polygons, other: _Polygons) -> _Polygons:
    return _Polygons(np.concatenate([one.corner, other.corner]), np.concatenate([one.size, other.size]))


def _distinct(corner: FloatArray) -> tuple[FloatArray, NDArray[np.int64]]:
    """Distinct places (k, 2) among cell coordinates to 1e-5 of a cell, and the place of each."""
    fine = np.rint(corner * 1e5).astype(np.int64)
    _, first, index = np.unique(
        fine[:, 0] * (fine[:, 1].max() + 1) + fine[:, 1], return_index=True, return_inverse=True
    )
    return corner[first], index


def _whole(grid: ChartGrid, cells: BoolArray, cuts: Sequence[Surface]) -> BoolArray:
    """Of the cells (rows, columns) those whose corners lie on the normals' sides of the cuts, all of them."""
    whole = cells.copy()
    if not cuts or not cells.any():
        return whole
    (top, bottom), (left, right) = (np.flatnonzero(cells.any(axis=k))[[0, -1]] for k in (1, 0))
    row, column = np.mgrid[top : bottom + 2, left : right + 2].astype(np.float64)
    corners = grid.surface.from_uv(grid.uv_of(row, column).reshape(-1, 2))
    for cut in cuts:
        inside = (cut.distance(corners) >= 0).reshape(row.shape)
        all_four = inside[:-1, :-1] & inside[1:, :-1] & inside[:-1, 1:] & inside[1:, 1:]
        whole[top : bottom + 1, left : right + 1] &= all_four
    return whole


def _single(cells: BoolArray) -> NDArray[np.int64]:
    row, column = np.nonzero(cells)
    return np.stack([row, row + 1, column, column + 1], axis=1)


def _rectangles(cells: BoolArray, max_width: int) -> NDArray[np.int64]:
    """Cover the cells by rectangles (row, end row, column, end column): equal runs of rows joined."""
    row, _, left, right = _single(cells).T if max_width == 1 else _runs(cells).T
    order = np.lexsort((row, right, left))
    row, left, right = row[order], left[order], right[order]
    follows = (np.diff(left) == 0) & (np.diff(right) == 0) & (np.diff(row) == 1)
    first = np.flatnonzero(np.concatenate([[True], ~follows])[: len(row)])
    last = np.concatenate([first[1:] - 1, [len(row) - 1]])[: len(first)]
    boxes = np.stack([row[first], row[last] + 1, left[first], right[first]], axis=1)
    return boxes[np.lexsort(boxes.T[::-1])]


def _runs(cells: BoolArray) -> NDArray[np.int64]:
    """Stretches of cells along the rows as boxes (row, row + 1, column, end column)."""
    step = np.diff(np.pad(cells, ((0, 0), (1, 1))).astype(np.int8), axis=1)
    (row, left), (_, right) = np.nonzero(step > 0), np.nonzero(step < 0)
    return np.stack([row, row + 1, left, right], axis=1)


def _of_boxes(boxes: NDArray[np.int64]) -> _Polygons:
    """Boxes (n, 4) of rows and columns as polygons."""
    corner = boxes[:, [0, 2, 0, 3, 1, 3, 1, 2]].astype(np.float64)
    return _Polygons(corner.reshape(-1, 2), np.full(len(boxes), 4, np.int64))


def _clipped(grid: ChartGrid, cells: BoolArray, cuts: Sequence[Surface], trims: Sequence[Trim]) -> _Polygons:
    """The cells as polygons on the inner side of the cuts, and of those trims that go through them."""
    boxes = _single(cells)
    left = _of_boxes(boxes)
    row, column = boxes[:, 0], boxes[:, 2]
    edges: tuple[Surface | Trim, ...] = (*cuts, *trims)
    for edge in edges:
        if not len(left.size):
            break
        uv = grid.uv_of(left.corner[:, 0], left.corner[:, 1])
        if isinstance(edge, Trim):
            height = np.ones(len(uv))
            met = np.repeat(edge.cells[row, column], left.size)
            height[met] = edge.sign * edge.curve.across(uv[met])
        else:
            height = edge.distance(grid.surface.from_uv(uv))
        left, kept = left.above(height)
        row, column = row[kept], column[kept]
    return left
