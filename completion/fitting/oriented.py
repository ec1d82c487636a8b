# SPDX-License-Identifier: MIT
"""Oriented points: normals without a side by their neighbours' principal components."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from scenes.checks import FloatArray

_N_TREE = 50_000
N_NEIGHBOURS = 24


def oriented(sample: FloatArray, points: FloatArray) -> tuple[FloatArray, float]:
    """Normals (m, 3), without a side, of sample points by their neighbours, and the typical roughness."""
    thinned = points[:: max(1, len(points) // _N_TREE)]
    _, nearest = cKDTree(thinned).query(sample, k=min(N_NEIGHBOURS, len(thinned)))
    around = thinned[nearest]
    around = around - around.mean(axis=1, keepdims=True)
    values, vectors = np.linalg.eigh(np.einsum("mki,mkj->mij", around, around) / (around.shape[1] - 3))
    extent = float(np.sqrt(np.einsum("ij,ij->", sample - sample.mean(axis=0), sample - sample.mean(axis=0))))
    roughness = float(np.median(np.sqrt(np.maximum(values[:, 0], 0.0))))
    return vectors[:, :, 0], max(roughness, 1e-9 * extent / np.sqrt(len(sample)))
