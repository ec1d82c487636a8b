# SPDX-License-Identifier: MIT
"""Merging of vertices that are one place but for rounding."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from scenes.checks import FloatArray, IntArray


def merge_vertices(points: FloatArray, reach: float) -> tuple[FloatArray, IntArray]:
    """Return distinct places (k, 3), and which of them each of points (n, 3) is.

    Points within `reach` of each other, also by way of others, are one place: the first of them, by x, y, z.

    Examples
    --------
    >>> merge_vertices(np.array([[1.0, 0, 0], [0, 0, 0], [0, 1e-17, 0]]), 1e-9)[1].tolist()
    [1, 0, 0]
    """
    distinct, number = np.unique(points, axis=0, return_inverse=True)
    pairs = cKDTree(distinct).query_pairs(reach, output_type="ndarray")
    graph = coo_array((np.ones(len(pairs), np.bool_), tuple(pairs.T)), shape=(len(distinct),) * 2)
    label = connected_components(graph, directed=False)[1].astype(np.int64)
    first = np.unique(label, return_index=True)[1]
    return distinct[first], label[number.reshape(-1)]
