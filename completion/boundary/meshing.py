# SPDX-License-Identifier: MIT
"""Meshing: chart cells as triangles, cut exactly where surfaces meet and where the view of an image ends."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from completion.boundary.edges import ChartLine, Circle, meeting_line
from completion.evidence.chart_grid import ChartGrid
from completion.evidence.evidence import Evidence, Label
from completion.observe.observation import Observation
from scenes.checks import BoolArray, FloatArray, Value
from scenes.scan.projection import PinholeProjection
from scenes.scan.range_image import RangeImage
from scenes.surfaces.catalogue import Cylinder, Plane, Surface

_LEAST_CORNERS = 3  # of a polygon


@dataclass(frozen=True, slots=True, eq=False)
class Trim(Value):
    """A curve of the chart that cells end at."""

    curve: ChartLine | Circle  # in the chart
    sign: float  # 1 to keep the side where `curve.across` is positive, -1 for the other one
    cells: BoolArray  # (rows, columns) cells that it cuts


@dataclass(frozen=True, slots=True, eq=False)
class ChartMesh(Value):
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
    polygons = _join_polygons(
        _of_boxes(_rectangles(full, width) if merged else _single(full)),
        _clip_cells(grid, cells & ~full, cuts, trims),
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


def _join_polygons(first: _Polygons, second: _Polygons) -> _Polygons:
    return _Polygons(np.concatenate([first.corner, second.corner]), np.concatenate([first.size, second.size]))


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


def _clip_cells(
    grid: ChartGrid, cells: BoolArray, cuts: Sequence[Surface], trims: Sequence[Trim]
) -> _Polygons:
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


_ALL_AROUND = np.ones((3, 3), np.uint8)
_SIDES = np.array([[0, 1, 0], [1, 1, 1], [0, 1, 0]], np.uint8)
_CORNERS = np.array([[0, 0], [0, 1], [1, 1], [1, 0]])


def frame_normals(scan: RangeImage) -> FloatArray:
    """Return inward normals (k, 3) of the four planes through a camera and the edges of its image.

    Half a pixel beyond the centres of the outermost pixels. A turning scanner has none.
    """
    camera = scan.projection
    if not isinstance(camera, PinholeProjection):
        return np.zeros((0, 3))
    normals = np.zeros((4, 3))
    for axis, focal, middle, size in (
        (0, camera.fx, camera.cx, camera.width),
        (1, camera.fy, camera.cy, camera.height),
    ):
        low, high = sorted(((edge - middle) / focal) for edge in (-0.5, size - 0.5))
        normals[2 * axis, [axis, 2]] = 1.0, -low
        normals[2 * axis + 1, [axis, 2]] = -1.0, high
    return scan.world_from_sensor.rotate(normals)


def trimmed_to_frames(
    grid: ChartGrid,
    evidence: Evidence,
    filled: BoolArray,
    confidence: FloatArray,
    observations: Sequence[Observation],
) -> tuple[BoolArray, FloatArray, tuple[Trim, ...]]:
    """Add the cells that the edge of the view cuts beside filled ones (rows, columns), and say where to cut.

    A cell is in view by its centre, so that along an oblique edge cells end in teeth. Each is cut by the
    image of the scan that holds most of its corners. Only planes seen by cameras are; no cell is added beside
    one that beams passed. Those that are added are as probable as what they lie beside: the second result is
    the confidence (rows, columns) with theirs.
    """
    nothing: tuple[Trim, ...] = ()
    if not isinstance(grid.surface, Plane) or not filled.any():
        return filled, confidence, nothing
    out = (evidence.labels == Label.OUT) & ~evidence.observed
    inner = filled & _grown(out, _ALL_AROUND)
    beside = np.argwhere(out & _grown(inner, _SIDES))
    beside = beside[~evidence.open[_around(beside, grid)].any(axis=1)]
    candidates = np.concatenate([np.argwhere(inner), beside])
    frames = [frame_normals(seen.scan) for seen in observations] if len(candidates) else []
    if not frames or not all(len(normals) for normals in frames):
        return filled, confidence, nothing
    origins, corners = [seen.scan.origin for seen in observations], _corners(grid, candidates)
    in_view, clearest = _in_view(frames, origins, corners)
    cut = in_view.any(axis=1) & ~in_view.all(axis=1)
    result, trims = filled.copy(), []
    result[tuple(candidates[cut].T)] = True
    for number in np.unique(clearest[cut]).tolist():
        for normal in frames[number]:
            mine = cut & (clearest == number) & (_heights(normal, origins[number], corners) < 0).any(axis=1)
            line = meeting_line(grid.surface, Plane(origins[number], normal)) if mine.any() else None
            if line is None:
                continue
            cells = np.zeros(grid.shape, dtype=np.bool_)
            cells[tuple(candidates[mine].T)] = True
            ahead = grid.surface.from_uv(np.array([line.point + line.normal, line.point]))
            inwards = float((ahead[0] - ahead[1]) @ normal)
            trims.append(Trim(line, float(np.sign(inwards)), cells))
    added, probable = np.argwhere(result & ~filled), confidence.copy()
    around = _around(added, grid)
    probable[tuple(added.T)] = (confidence[around] * filled[around]).max(axis=1)
    return result, probable, tuple(trims)


def _grown(cells: BoolArray, around: NDArray[np.uint8]) -> BoolArray:
    return np.asarray(cv2.dilate(cells.view(np.uint8), around), dtype=np.bool_)


def _around(cells: NDArray[np.int64], grid: ChartGrid) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Rows and columns (n, 9) of cells (n, 2) and of those all around them, within the grid."""
    steps = np.indices((3, 3)).reshape(2, 9) - 1
    row, column = (np.clip(cells[:, axis, None] + steps[axis], 0, grid.shape[axis] - 1) for axis in (0, 1))
    return row, column


def _corners(grid: ChartGrid, cells: NDArray[np.int64]) -> FloatArray:
    """The corners (n, 4, 3) of cells (n, 2), metres."""
    corners = (cells[:, None] + _CORNERS).reshape(-1, 2).astype(np.float64)
    return grid.surface.from_uv(grid.uv_of(corners[:, 0], corners[:, 1])).reshape(len(cells), 4, 3)


def _in_view(
    frames: Sequence[FloatArray], origins: Sequence[FloatArray], corners: FloatArray
) -> tuple[BoolArray, NDArray[np.int64]]:
    """Which corners (n, 4) of cells any image sees, and the first scan (n,) that sees most of a cell's."""
    in_view = np.zeros(corners.shape[:2], dtype=np.bool_)
    clearest, most = np.zeros(len(corners), np.int64), np.zeros(len(corners), np.int64)
    for number, (normals, origin) in enumerate(zip(frames, origins, strict=True)):
        inside = np.logical_and.reduce([_heights(normal, origin, corners) > 0 for normal in normals])
        in_view |= inside
        n_inside = np.count_nonzero(inside, axis=1)
        clearest[n_inside > most] = number
        most = np.maximum(most, n_inside)
    return in_view, clearest


def _heights(normal: FloatArray, origin: FloatArray, corners: FloatArray) -> FloatArray:
    """How far corners (n, 4, 3) lie on the inner side of a plane through the sensor (n, 4), by some unit."""
    return np.asarray((corners - origin) @ normal)
