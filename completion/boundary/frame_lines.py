# SPDX-License-Identifier: MIT
"""Frame lines: where the edges of images cut a plane's hidden cells, so that the view ends straight."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from completion.boundary.curves import meeting_line
from completion.boundary.meshing import Trim
from completion.evidence.chart_grid import ChartGrid
from completion.evidence.evidence import Evidence, Label
from completion.observe.observation import Observation
from scenes.checks import BoolArray, FloatArray
from scenes.scan.projection import PinholeProjection
from scenes.scan.range_image import RangeImage
from scenes.surfaces.catalogue import Plane

_ALL_AROUND = np.ones((3, 3))
_CORNERS = np.array([[0, 0], [0, 1], [1, 1], [1, 0]])


def frame_planes(scan: RangeImage) -> tuple[Plane, ...]:
    """Return the four planes through a camera and the edges of its image, their normals inwards.

    Half a pixel beyond the centres of the outermost pixels. A turning scanner has none.
    """
    camera = scan.projection
    if not isinstance(camera, PinholeProjection):
        return ()
    pose, planes = scan.world_from_sensor, []
    for axis, focal, middle, size in (
        (0, camera.fx, camera.cx, camera.width),
        (1, camera.fy, camera.cy, camera.height),
    ):
        slopes = sorted(((edge - middle) / focal) for edge in (-0.5, size - 0.5))
        for sign, slope in zip((1.0, -1.0), slopes, strict=True):
            normal = np.zeros((1, 3))
            normal[0, axis], normal[0, 2] = sign, -sign * slope
            planes.append(Plane(scan.origin, pose.rotate(normal)[0]))
    return tuple(planes)


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
    out = (evidence.labels == Label.OUT) & ~evidence.observed
    nothing: tuple[Trim, ...] = ()
    if not isinstance(grid.surface, Plane) or not out.any() or not filled.any():
        return filled, confidence, nothing
    frames = [frame_planes(seen.scan) for seen in observations]
    if not all(frames):
        return filled, confidence, nothing
    beside = out & ndimage.binary_dilation(filled)
    beside &= ~ndimage.binary_dilation(evidence.open, _ALL_AROUND)
    candidates = np.argwhere(beside | (filled & ndimage.binary_dilation(out, _ALL_AROUND)))
    if not len(candidates):
        return filled, confidence, nothing
    height = _heights(grid, candidates, frames)
    inside = np.asarray(np.all(height > 0, axis=1))  # (scans, cells, corners)
    in_view = np.any(inside, axis=0)
    cut = np.any(in_view, axis=1) & ~np.all(in_view, axis=1)
    scan = np.argmax(np.sum(inside, axis=2), axis=0)
    result, trims = filled.copy(), []
    result[tuple(candidates[cut].T)] = True
    for number, planes in enumerate(frames):
        for side, plane in enumerate(planes):
            mine = cut & (scan == number) & (height[number, side] < 0).any(axis=-1)
            line = meeting_line(grid.surface, plane) if mine.any() else None
            if line is None:
                continue
            cells = np.zeros(grid.shape, dtype=np.bool_)
            cells[tuple(candidates[mine].T)] = True
            ahead = grid.surface.from_uv(np.array([line.point + line.normal, line.point]))
            inwards = float((ahead[0] - ahead[1]) @ plane.normal_direction)
            trims.append(Trim(line, float(np.sign(inwards)), cells))
    beside = ndimage.grey_dilation(np.where(filled, confidence, 0.0), (3, 3))
    return result, np.where(result & ~filled, beside, confidence), tuple(trims)


def _heights(grid: ChartGrid, cells: NDArray[np.int64], frames: Sequence[Sequence[Plane]]) -> FloatArray:
    """How far corners of cells (n, 2) lie on the inner side of each plane (scans, 4, n, 4), metres."""
    corners = (cells[:, None] + _CORNERS).reshape(-1, 2).astype(np.float64)
    points = grid.surface.from_uv(grid.uv_of(corners[:, 0], corners[:, 1]))
    heights = [[plane.distance(points) for plane in planes] for planes in frames]
    return np.array(heights).reshape(len(frames), 4, len(cells), 4)
