# SPDX-License-Identifier: MIT
"""Triangle distance: how far points are from a mesh."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import trimesh
from scipy.spatial import cKDTree

from scenes.checks import FloatArray
from scenes.mesh.labelled_mesh import triangle_areas

_NEAREST = 8  # triangles that are tried for each point
_PIECES = 20_000  # about as many triangles as large ones are cut into


def distances(points: FloatArray, corners: FloatArray) -> FloatArray:
    """Distance (n,) of points (n, 3) from triangles (m, 3, 3), metres; inf where there are none.

    Triangles are cut until all are of similar size; for each point those with the nearest centres are tried.
    """
    return TriangleTree.of(corners).distances(points)


@dataclass(frozen=True, slots=True, eq=False)
class TriangleTree:
    """Triangles prepared for distances: build once, ask often.

    Attributes
    ----------
    corners : (m, 3, 3) float
        The triangles, cut until all are of similar size, metres.
    tree : cKDTree
        Of their centres.
    """

    corners: FloatArray
    tree: cKDTree

    @classmethod
    def of(cls, corners: FloatArray) -> TriangleTree:
        """Return the tree of triangles (m, 3, 3), metres."""
        pieces = _similar(corners) if len(corners) else corners
        return cls(pieces, cKDTree(pieces.mean(axis=1)))

    def distances(self, points: FloatArray) -> FloatArray:
        """Distance (n,) of points (n, 3) from the triangles, metres; inf where there are none."""
        nearest = np.full(len(points), np.inf)
        if not len(self.corners) or not len(points):
            return nearest
        k = min(_NEAREST, len(self.corners))
        nearest_index = self.tree.query(points, k=k)[1].reshape(len(points), k)
        for column in range(k):
            foot = trimesh.triangles.closest_point(self.corners[nearest_index[:, column]], points)
            nearest = np.minimum(nearest, np.linalg.norm(foot - points, axis=1))
        return nearest


def _similar(corners: FloatArray) -> FloatArray:
    """Cut triangles at the middle of their longest side until all are of similar size."""
    sides = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2).max(axis=1)
    slivers = float(sides.sum()) / max(_PIECES, 4 * len(corners))  # cut by area these would be countless
    longest = max(2 * float(np.sqrt(triangle_areas(corners).sum() / _PIECES)), slivers)
    done = []
    while len(corners):
        sides = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
        large = sides.max(axis=1) > longest
        done.append(corners[~large])
        corners, start = corners[large], sides[large].argmax(axis=1)
        a, b, c = (
            np.take_along_axis(corners, (start + k)[:, None, None] % 3, axis=1)[:, 0] for k in range(3)
        )
        middle = (a + b) / 2
        corners = np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])
    return np.concatenate(done)
