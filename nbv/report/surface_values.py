# SPDX-License-Identifier: MIT
"""Values on a surface: what samples say of any point of their face, and of finely cut faces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from nbv.coverage import Coverage
from nbv.samples import SurfaceSamples
from scenes.checks import FloatArray
from scenes.mesh import LabelledMesh, triangle_areas

_MOST_LEVELS = 10
_SAMPLES_A_FACE = 6.0  # faces that stand for more samples are cut into four


def nearest_samples(
    samples: SurfaceSamples, points: FloatArray, face: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Return for points (n, 3) on faces (n,) the nearest sample (n,), of the same face if it has any."""
    if not len(points):
        return np.zeros(0, np.int64)
    apart = 4 * max(samples.extent_m, 1e-9)  # faces stand so far apart in the fourth dimension
    tree = cKDTree(np.column_stack([samples.points, samples.face * apart]))
    index: NDArray[np.int64] = tree.query(np.column_stack([points, face * apart]))[1]
    return index


@dataclass(frozen=True, slots=True, eq=False)
class FineCoverage:
    """Coverage on faces that are small enough to show it; three vertices of its own for each face.

    Attributes
    ----------
    corners : (m, 3, 3) float
        Metres.
    face, surface : (m,) int32
        Face of the scene's mesh and surface that each lies on.
    best_cosine : (m,) float
        Largest cosine of incidence over the views that see it, 0 where none does.
    n_views : (m,) int32
        Views that see it.
    state : (m,) int8
        Index into `nbv.coverage.STATES`.
    reason : (m,) int8
        Why unreachable, index into `nbv.reachability.REASONS`; -1 elsewhere.
    """

    corners: FloatArray
    face: NDArray[np.int32]
    surface: NDArray[np.int32]
    best_cosine: FloatArray
    n_views: NDArray[np.int32]
    state: NDArray[np.int8]
    reason: NDArray[np.int8]


def fine_coverage(mesh: LabelledMesh, coverage: Coverage) -> FineCoverage:
    """Cut a mesh's faces as finely as its samples lie, and give each piece its nearest sample's values."""
    samples = coverage.samples
    limit = _SAMPLES_A_FACE * samples.total_m2 / max(len(samples), 1)
    kept = np.flatnonzero(mesh.face_areas() > 0)
    corners, face = mesh.corners[kept], kept
    for _ in range(_MOST_LEVELS):
        large = triangle_areas(corners) > limit
        if not large.any():
            break
        corners = np.concatenate([corners[~large], _quartered(corners[large])])
        face = np.concatenate([face[~large], np.repeat(face[large], 4)])
    order = np.argsort(face, kind="stable")
    corners, face = corners[order], face[order]
    nearest = nearest_samples(samples, corners.mean(axis=1), face)
    return FineCoverage(
        corners,
        face.astype(np.int32),
        mesh.face_surface[face],
        coverage.best_cosine[nearest],
        coverage.n_views[nearest],
        coverage.state[nearest],
        coverage.reason[nearest],
    )


def _quartered(corners: FloatArray) -> FloatArray:
    """Each triangle as four, face by face: by the middles of its sides."""
    a, b, c = np.moveaxis(corners, 1, 0)
    ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
    parts = [np.stack(part, axis=1) for part in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))]
    return np.stack(parts, axis=1).reshape(-1, 3, 3)
