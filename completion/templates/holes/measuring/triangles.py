# SPDX-License-Identifier: MIT
"""Triangles: a mesh looked at as points all over it, and the corners of its flat parts' rims."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from completion.templates.engine.measured import Measured
from completion.templates.holes.measuring.plates import Plate
from scenes.checks import FloatArray

_N_POINTS = 20_000


def scattered(measured: Measured, *, rng: np.random.Generator) -> Measured:
    """Return points all over the triangles, as many an area everywhere, instead of the mesh's corners."""
    faces = measured.faces
    if faces is None or not len(faces):
        return measured
    corners = measured.points[faces]
    edges = corners[:, 1:] - corners[:, :1]
    area = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1) / 2
    if not area.sum() > 0:
        return measured
    # even steps along the sum of areas, so that no triangle has more than its share
    steps = (np.arange(_N_POINTS) + rng.random(_N_POINTS)) / _N_POINTS * area.sum()
    face = np.minimum(np.searchsorted(area.cumsum(), steps), len(area) - 1)
    r, s = np.sqrt(rng.random(_N_POINTS)), rng.random(_N_POINTS)
    weights = np.column_stack([1 - r, r * (1 - s), r * s])
    points = np.einsum("ni,nij->nj", weights, corners[face])
    return replace(measured, points=points, spacing=0.5 * float(np.sqrt(area.sum() / _N_POINTS)), faces=None)


def rim_corners(measured: Measured, plate: Plate) -> FloatArray | None:
    """Return the places (k, 2) in the plate's chart of corners where its triangles end; None without any."""
    if measured.faces is None:
        return None
    uv, height = plate.chart(measured.points)
    faces = measured.faces[(np.abs(height) < plate.slab)[measured.faces].all(axis=1)]
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    once, counts = np.unique(edges, axis=0, return_counts=True)
    return np.asarray(uv[np.unique(once[counts == 1])])
