# SPDX-License-Identifier: MIT
"""Feet: the places of a patch that are nearest to points."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from completion.fitting.patches.patch import SplinePatch, products
from scenes.checks import BoolArray, FloatArray

_STEP = 0.1  # of u and v at most: farther the linear picture does not hold


class Feet(NamedTuple):
    """Where the nearest places are: parameters, normals there, and how far points are across the patch."""

    uv: FloatArray  # (k, 2)
    normals: FloatArray  # (k, 3)
    distance: FloatArray  # (k,) along the normal
    is_inside: BoolArray  # (k,) False where the foot is on a boundary, and the point perhaps beyond


def feet_of(patch: SplinePatch, points: FloatArray, uv: FloatArray, steps: int) -> Feet:
    """Return the feet of points (k, 3) after some Gauss-Newton steps from parameters (k, 2)."""
    uv, controls = uv.copy(), patch.controls.reshape(-1, 3)
    for number in range(steps + 1):
        at, along_u, along_v = (
            products(patch.bases, uv, order) @ controls for order in ((0, 0), (1, 0), (0, 1))
        )
        off = points - at
        if number == steps:
            break
        uu, uv_, vv = (_dot(*pair) for pair in ((along_u, along_u), (along_u, along_v), (along_v, along_v)))
        right_u, right_v = _dot(along_u, off), _dot(along_v, off)
        determinant = np.maximum(uu * vv - uv_**2, 1e-9 * uu * vv + 1e-300)
        step = np.column_stack([vv * right_u - uv_ * right_v, uu * right_v - uv_ * right_u])
        uv = np.clip(uv + np.clip(step / determinant[:, None], -_STEP, _STEP), 0.0, 1.0)
    across = np.cross(along_u, along_v)
    normals = across / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-300)
    return Feet(uv, normals, _dot(off, normals), np.asarray(((uv > 0.0) & (uv < 1.0)).all(axis=1)))


def nearest_uv(patch: SplinePatch, uv: FloatArray, points: FloatArray, stride: int) -> FloatArray:
    """Return parameters (k, 2) to begin with, of points (k, 3).

    Each `stride`-th of them has known ones (j, 2).
    """
    if stride == 1:
        return uv
    nearest = cKDTree(points[::stride]).query(points)[1]
    return feet_of(patch, points, uv[nearest], 1).uv


def _dot(one: FloatArray, other: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("ij,ij->i", one, other))
