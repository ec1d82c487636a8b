# SPDX-License-Identifier: MIT
"""Distances of points from triangles: how near inferred surface is to the true one."""

from __future__ import annotations

import numpy as np
import trimesh
from scipy.spatial import cKDTree

from scenes.checks import FloatArray

CLOSE_M = 0.02  # inferred surface this near to the true one counts as right
_NEAREST = 8  # triangles that are tried for each point


def distances(points: FloatArray, corners: FloatArray) -> FloatArray:
    """Distance (n,) of points from triangles (m, 3, 3), of which those with the nearest centres are tried.

    Up to 64 triangles are all tried, so that large ones are not missed; more should be of similar size.
    """
    if len(corners) <= 64:
        tried = np.broadcast_to(np.arange(len(corners)), (len(points), len(corners)))
    else:
        found = cKDTree(corners.mean(axis=1)).query(points, k=min(_NEAREST, len(corners)))[1]
        tried = found.reshape(len(points), -1)
    nearest = np.full(len(points), np.inf)
    for column in range(tried.shape[1]):
        foot = trimesh.triangles.closest_point(corners[tried[:, column]], points)
        nearest = np.minimum(nearest, np.linalg.norm(foot - points, axis=1))
    return nearest
