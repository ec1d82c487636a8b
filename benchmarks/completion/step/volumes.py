# SPDX-License-Identifier: MIT
"""Volume of a cloud of a closed surface, without any surface fitted: what a rolling ball cannot enter."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import Delaunay

from scenes.checks import FloatArray

_BALLS = (0.4, 0.5, 0.6, 0.7, 0.8, 0.9)  # of the largest
_TIGHT = 0.97  # of the largest ball's volume: a ball that passes the surface somewhere finds far less


def ball_volume(points: FloatArray, largest: float) -> float:
    """Volume enclosed by points (n, 3) that a ball cannot pass between (Edelsbrunner & Muecke 1994).

    Tetrahedra of the Delaunay triangulation are outside where a ball gets to them through triangles whose
    circumscribed circles are larger than it. Of balls up to a radius the least is taken that stays outside:
    it rounds inner edges least.
    """
    most = _enclosed(points, largest)
    return next(v for share in (*_BALLS, 1.0) if (v := _enclosed(points, share * largest)) >= _TIGHT * most)


def _enclosed(points: FloatArray, radius: float) -> float:
    """Volume that a ball of a radius cannot get to."""
    mesh = Delaunay(points + 1e-9 * np.ptp(points) * np.random.default_rng(0).normal(size=points.shape))
    corners = points[mesh.simplices]
    n = len(corners)
    rows, columns = [], []
    for k in range(4):
        triangle = np.delete(corners, k, axis=1)
        other = mesh.neighbors[:, k]
        passes = _circumradius(triangle) > radius
        rows.append(np.flatnonzero(passes))
        columns.append(np.where(other[passes] < 0, n, other[passes]))
    row, column = np.concatenate(rows), np.concatenate(columns)
    graph = coo_array((np.ones(len(row)), (row, column)), shape=(n + 1, n + 1))
    _, piece = connected_components(graph, directed=False)
    edges = corners[:, 1:] - corners[:, :1]
    volume = np.abs(np.linalg.det(edges)) / 6
    return float(volume[piece[:n] != piece[n]].sum())


def _circumradius(triangles: FloatArray) -> FloatArray:
    """Radii (m,) of the circles about triangles (m, 3, 3)."""
    sides = np.linalg.norm(triangles - np.roll(triangles, 1, axis=1), axis=2)
    across = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    twice = np.linalg.norm(across, axis=1)
    return np.asarray(sides.prod(axis=1) / np.maximum(2 * twice, 1e-300))
