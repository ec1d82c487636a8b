# SPDX-License-Identifier: MIT
"""Thinning: a mesh with fewer triangles, for pictures."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from scenes.checks import FloatArray

_COARSER = 1.25  # each try


def thinned(
    vertices: FloatArray, faces: NDArray[Any], most: int
) -> tuple[FloatArray, NDArray[np.int64], NDArray[np.int64]]:
    """Join vertices that lie in one cell of a lattice, as coarse as it takes (Rossignac & Borrel 1993).

    A mesh (n, 3), metres, (m, 3) with no more than `most` triangles stays as it is. Returns the vertices (k,
    3) and faces (l, 3) of a thinner mesh, and which of the vertices (k,) it consists of.
    """
    faces = np.asarray(faces, dtype=np.int64)
    kept = np.arange(len(vertices))
    if len(faces) <= most:
        return vertices, faces, kept
    low = vertices.min(axis=0)
    area = np.linalg.norm(np.cross(*(vertices[faces[:, k]] - vertices[faces[:, 0]] for k in (1, 2))), axis=1)
    side, few = float(np.sqrt(area.sum() / most)) / 2, faces
    while len(few) > most:
        cell = np.floor((vertices - low) / side).astype(np.int64)
        _, kept, index = np.unique(cell, axis=0, return_index=True, return_inverse=True)
        few = index.reshape(-1)[faces]
        few = few[(few[:, 0] != few[:, 1]) & (few[:, 1] != few[:, 2]) & (few[:, 0] != few[:, 2])]
        side *= _COARSER
    return vertices[kept], few, kept
