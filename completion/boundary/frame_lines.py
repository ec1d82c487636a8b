# SPDX-License-Identifier: MIT
"""Frame lines: where the edges of images cut a plane's hidden cells, so that the view ends straight."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from completion.boundary.curves import meeting_line
from completion.boundary.meshing import Trim
from completion.evidence.chart_grid import ChartGrid
from completion.evidence.evidence import Evidence, Label
from completion.observe.observation import Observation
from scenes.checks import BoolArray, FloatArray
from scenes.scan.projection import PinholeProjection
from scenes.scan.range_image import RangeImage
from scenes.surfaces.catalogue import Plane

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
