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
    inside = _corner_heights(grid, cuts) >= 0
    whole = inside[:, :-1, :-1] & inside[:, 1:, :-1] & inside[:, :-1, 1:] & inside[:, 1:, 1:]
    full = cells & whole.all(axis=0)
    for trim in trims:
        full &= ~trim.cells
    partial = cells & ~full
    curved = np.isfinite(grid.surface.period)
    boxes = _rectangles(full, 1 if curved else full.shape[1]) if merged else _single(full)
    polygons = [*(_box_polygon(box) for box in boxes), *_clipped(grid, partial, cuts, trims)]
    if not polygons:
        empty = np.zeros((0, 3))
        return ChartMesh(empty, np.zeros((0, 3), np.int32), np.zeros((0, 2)), np.zeros(0, np.int64))
    corner = np.concatenate(polygons)
    size = np.array([len(polygon) for polygon in polygons])
    start = np.concatenate([[0], np.cumsum(size)[:-1]])
    places, index = _distinct(corner)
    fans = [
        np.stack([start[size > k + 1], start[size > k + 1] + k, start[size > k + 1] + k + 1], axis=1)
        for k in range(1, int(size.max()) - 1)
    ]
    faces = np.concatenate(fans)
    owner = np.searchsorted(start, faces[:, 0], side="right") - 1
    middle = np.array([polygon.min(axis=0) for polygon in polygons])[owner]
    row, column = np.minimum(np.floor(middle + 1e-6).astype(np.int64), np.array(grid.shape) - 1).T
    triangles = index[faces].astype(np.int32)
    proper = (triangles[:, 0] != triangles[:, 1]) & (triangles[:, 1] != triangles[:, 2])
    proper &= triangles[:, 0] != triangles[:, 2]
    vertices = grid.surface.from_uv(grid.uv_of(places[:, 0], places[:, 1]))
    inward = isinstance(grid.surface, Cylinder) and grid.surface.concave  # its chart is that of the outside
    faces_out = triangles[proper][:, ::-1] if inward else triangles[proper]
    return ChartMesh(vertices, faces_out, places, (row * grid.shape[1] + column)[proper])


def _distinct(corner: FloatArray) -> tuple[FloatArray, NDArray[np.int64]]:
    """Distinct places (k, 2) among cell coordinates to 1e-5 of a cell, and the place of each."""
    fine = np.rint(corner * 1e5).astype(np.int64)
    _, first, index = np.unique(
        fine[:, 0] * (fine[:, 1].max() + 1) + fine[:, 1], return_index=True, return_inverse=True
    )
    return corner[first], index


def _corner_heights(grid: ChartGrid, cuts: Sequence[Surface]) -> FloatArray:
    """Signed distance (cuts, rows + 1, columns + 1) of the cell corners from the cuts; zeros for no cut."""
    rows, columns = grid.shape
    if not cuts:
        return np.zeros((1, rows + 1, columns + 1))
    row, column = np.mgrid[: rows + 1, : columns + 1].astype(np.float64)
    corners = grid.surface.from_uv(grid.uv_of(row, column).reshape(-1, 2))
    return np.stack([cut.distance(corners).reshape(rows + 1, columns + 1) for cut in cuts])


def _single(cells: BoolArray) -> NDArray[np.int64]:
    row, column = np.nonzero(cells)
    return np.stack([row, row + 1, column, column + 1], axis=1)


def _rectangles(cells: BoolArray, max_width: int) -> NDArray[np.int64]:
    """Cover the cells by rectangles (row, end row, column, end column): equal runs of rows joined."""
    open_runs: dict[tuple[int, int], int] = {}
    boxes: list[tuple[int, int, int, int]] = []
    for row in range(cells.shape[0] + 1):
        runs = set(_runs(cells[row], max_width)) if row < cells.shape[0] else set()
        ended = [run for run in open_runs if run not in runs]
        boxes.extend((open_runs.pop(run), row, *run) for run in ended)
        for run in runs:
            open_runs.setdefault(run, row)
    return np.array(sorted(boxes), dtype=np.int64).reshape(-1, 4)


def _runs(line: BoolArray, max_width: int) -> list[tuple[int, int]]:
    if max_width == 1:
        return [(int(column), int(column) + 1) for column in np.flatnonzero(line)]
    edges = np.flatnonzero(np.diff(np.concatenate([[False], line, [False]]).astype(np.int8)))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _box_polygon(box: NDArray[np.int64]) -> FloatArray:
    top, bottom, left, right = box
    return np.array([[top, left], [top, right], [bottom, right], [bottom, left]], dtype=np.float64)


def _clipped(
    grid: ChartGrid, cells: BoolArray, cuts: Sequence[Surface], trims: Sequence[Trim]
) -> list[FloatArray]:
    """Each cell as the polygon (row, column) that is left on the inner side (Sutherland & Hodgman 1974)."""
    result = []
    for box in _single(cells):
        polygon = _box_polygon(box)
        for cut in cuts:
            height = cut.distance(grid.surface.from_uv(grid.uv_of(polygon[:, 0], polygon[:, 1])))
            polygon = _half(polygon, height)
            if len(polygon) < 3:
                break
        for trim in (trim for trim in trims if trim.cells[box[0], box[2]] and len(polygon) >= 3):
            height = trim.sign * trim.curve.across(grid.uv_of(polygon[:, 0], polygon[:, 1]))
            polygon = _half(polygon, height)
        if len(polygon) >= 3:
            result.append(polygon)
    return result


def _half(polygon: FloatArray, height: FloatArray) -> FloatArray:
    """The part of a convex polygon where `height`, given at its corners, is not negative."""
    kept = []
    for here in range(len(polygon)):
        there = (here + 1) % len(polygon)
        if height[here] >= 0:
            kept.append(polygon[here])
        if (height[here] >= 0) != (height[there] >= 0):
            share = height[here] / (height[here] - height[there])
            kept.append(polygon[here] + share * (polygon[there] - polygon[here]))
    return np.array(kept).reshape(-1, 2)


def mesh_range_image(
    points: FloatArray, members: BoolArray, max_step: FloatArray, origin: FloatArray
) -> NDArray[np.int32]:
    """Triangles (m, 3) between neighbouring pixels of an organised scan, none across a jump.

    They are counter-clockwise seen from the sensor at `origin` (3,), whichever way the grid's rows and
    columns run. Of the points (rows, columns, 3) the `members` (rows, columns) are used; `max_step` (rows,
    columns) is the longest edge allowed at each, metres.
    """
    rows, columns = members.shape
    index = np.arange(rows * columns, dtype=np.int32).reshape(rows, columns)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    triangles = np.concatenate(
        [np.stack([a, d, c], -1).reshape(-1, 3), np.stack([a, c, b], -1).reshape(-1, 3)]
    )
    flat, used, step = points.reshape(-1, 3), members.ravel(), max_step.ravel()
    triangles = triangles[used[triangles].all(axis=1)]
    corner = flat[triangles]
    longest = np.linalg.norm(corner - np.roll(corner, 1, axis=1), axis=2).max(axis=1)
    kept = longest <= step[triangles].min(axis=1)
    towards = origin - corner[kept]
    volumes = np.linalg.det(towards) if kept.any() else np.zeros(0)
    order = [0, 2, 1] if (volumes < 0).sum() > len(volumes) / 2 else [0, 1, 2]
    return np.asarray(triangles[kept][:, order], dtype=np.int32)
