# SPDX-License-Identifier: MIT
"""Chart grid: the heights of a mesh over a plane, on cells in the plane."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from scenes.checks import BoolArray, FloatArray
from scenes.surfaces.catalogue import Plane

_MOST_CELLS_A_FACE = 4096
_NEAR = 8  # neighbours within which the density of points is told


@dataclass(frozen=True, slots=True, eq=False)
class ChartGrid:
    """Heights on cells in a plane.

    Attributes
    ----------
    heights : (rows, columns) float
        Over the plane, metres, NaN where there is no mesh.
    cell_m : float
        Side of a cell.
    places : (n, 2) float
        Rows and columns of the vertices, cells.
    """

    heights: FloatArray
    cell_m: float
    places: FloatArray


def grid_of(
    vertices: FloatArray, faces: NDArray[np.int32], plane: Plane, cell_m: float | None, most_cells: int
) -> ChartGrid:
    """Heights of a mesh (n, 3), (m, 3) over a plane, along the principal axes of its vertices in it.

    A cell has the mean height of the vertices in it, or that of the face over its middle. Without faces its
    side is such that two points lie in a usual one.
    """
    places = _principal(plane.to_uv(vertices))
    height = plane.distance(vertices)
    spans = np.ptp(places, axis=0)
    if cell_m is None:
        edges = places[faces] - places[np.roll(faces, 1, axis=1)]
        cell_m = float(np.median(np.linalg.norm(edges, axis=2))) if len(faces) else _side_of_two(places)
    area = 0.5 * np.abs(
        _cross(places[faces[:, 1]] - places[faces[:, 0]], places[faces[:, 2]] - places[faces[:, 0]])
    )
    least = np.sqrt(max(float(area.sum()), float(np.prod(spans)) / 4) / most_cells)
    cell_m = max(cell_m, float(least), 1e-9 * float(spans.max()) + 1e-30)
    places = (places - places.min(axis=0)) / cell_m + 0.5
    shape = (int(places[:, 0].max()) + 1, int(places[:, 1].max()) + 1)
    row, column = np.minimum(places.astype(np.int64), np.array(shape) - 1).T
    cell = row * shape[1] + column
    count = np.bincount(cell, minlength=shape[0] * shape[1])
    total = np.bincount(cell, height, minlength=len(count))
    where, value = _cells_of_faces(places, height, faces, shape)
    n_faces = np.bincount(where, minlength=len(count))
    from_faces = np.bincount(where, value, minlength=len(count))
    with np.errstate(invalid="ignore"):
        heights = np.where(count > 0, total / count, from_faces / n_faces)
    return ChartGrid(heights.reshape(shape), cell_m, places - 0.5)


def _side_of_two(places: FloatArray) -> float:
    """Side of the square that two of the points (n, 2) share, where they lie as densely as usual."""
    near = min(_NEAR, len(places) - 1)
    away = cKDTree(places).query(places, k=[near + 1])[0]
    return float(np.median(away) * np.sqrt(2 * np.pi / near)) if near else 0.0


def _principal(uv: FloatArray) -> FloatArray:
    """Chart coordinates (n, 2) along the principal axes, the longer last, each from its heavier side."""
    away = uv - uv.mean(axis=0)
    axes = np.linalg.eigh(away.T @ away)[1]
    turned = away @ axes
    side = np.sign(np.sum(turned**3, axis=0))
    out: FloatArray = turned * np.where(side == 0, 1, side)
    return out


def _cells_of_faces(
    places: FloatArray, height: FloatArray, faces: NDArray[np.int32], shape: tuple[int, int]
) -> tuple[NDArray[np.int64], FloatArray]:
    """Cells (k,) whose middles lie under faces, and the heights of these there."""
    corners = places[faces] - 0.5
    low = np.maximum(np.ceil(corners.min(axis=1)), 0).astype(np.int64)
    high = np.minimum(np.floor(corners.max(axis=1)), np.array(shape) - 1).astype(np.int64)
    sides = np.maximum(high - low + 1, 0)
    number = sides[:, 0] * sides[:, 1]
    number[number > _MOST_CELLS_A_FACE] = 0
    face = np.repeat(np.arange(len(faces)), number)
    within = np.arange(len(face)) - np.repeat(np.cumsum(number) - number, number)
    at = np.stack([within // sides[face, 1], within % sides[face, 1]], axis=1) + low[face]
    a, b, c = (corners[face, k] for k in range(3))
    whole = _cross(b - a, c - a)
    with np.errstate(invalid="ignore", divide="ignore"):
        second, third = _cross(at - a, c - a) / whole, _cross(b - a, at - a) / whole
    inside: BoolArray = (second >= 0) & (third >= 0) & (second + third <= 1)
    corner = height[faces[face[inside]]]
    share = np.stack([1 - second - third, second, third], axis=1)[inside]
    return at[inside, 0] * shape[1] + at[inside, 1], np.sum(corner * share, axis=1)


def _cross(one: FloatArray, other: FloatArray) -> FloatArray:
    """Cross product of plane vectors (n, 2)."""
    out: FloatArray = one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]
    return out
