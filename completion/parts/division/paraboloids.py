# SPDX-License-Identifier: MIT
"""Paraboloids: the least-squares paraboloid over the neighbours of each of many points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scenes.checks import FloatArray, IntArray
from texture.engine.compiled import compiled, inlined

N_TERMS = 6  # 1, x, y, x^2, xy, y^2
_RIDGE = 1e-12  # of the number of neighbours: places that determine no paraboloid


@dataclass(frozen=True, slots=True, eq=False)
class Paraboloids:
    """One a point: normal (n, 3), rms residual (n,), and deviation (n,) of the normal per metre."""

    normals: FloatArray
    rms: FloatArray
    slope_factor: FloatArray


def paraboloids(points: FloatArray, nearest: IntArray) -> Paraboloids:
    """Fit paraboloids over the neighbours (n, k) of points (n, 3), each over the plane of its neighbours."""
    k = nearest.shape[1]
    spread, scale = _spreads(points, nearest)
    _, axes = np.linalg.eigh(spread)  # columns: normal, second, first axis
    gram, right = _normal_equations(points, nearest, axes, scale)
    inverse = np.linalg.inv(gram + _RIDGE * k * np.eye(N_TERMS))
    solution = np.einsum("nij,nj->ni", inverse, right)
    rms = _residuals(points, nearest, axes, scale, solution)
    up = np.stack([np.ones(len(points)), -solution[:, 2], -solution[:, 1]], axis=-1)
    world = np.einsum("nij,nj->ni", axes, up)
    normals = world / np.linalg.norm(world, axis=1, keepdims=True)
    return Paraboloids(normals, rms, np.sqrt((inverse[:, 1, 1] + inverse[:, 2, 2]) / 2) / scale)


@compiled
def _spreads(points: FloatArray, nearest: IntArray) -> tuple[FloatArray, FloatArray]:
    """Scatter (n, 3, 3) of the neighbours about their mean, and their rms distance (n,) from the point."""
    n, k = nearest.shape
    spread, scale = np.empty((n, 3, 3)), np.empty(n)
    offset, mean = np.empty((k, 3)), np.empty(3)
    for i in range(n):
        mean[:] = 0.0
        square = 0.0
        for j in range(k):
            for a in range(3):
                away = points[nearest[i, j], a] - points[i, a]
                offset[j, a] = away
                mean[a] += away
                square += away * away
        mean /= k
        spread[i] = 0.0
        for j in range(k):
            for a in range(3):
                for b in range(a + 1):
                    spread[i, a, b] += (offset[j, a] - mean[a]) * (offset[j, b] - mean[b])
        for a in range(3):
            for b in range(a):
                spread[i, b, a] = spread[i, a, b]
        scale[i] = np.sqrt(square / k) if square > 0 else 1.0
    return spread, scale


@compiled
def _normal_equations(
    points: FloatArray, nearest: IntArray, axes: FloatArray, scale: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Normal equations (n, 6, 6), (n, 6) of the paraboloids, in units of their scale."""
    n, k = nearest.shape
    gram, right = np.zeros((n, N_TERMS, N_TERMS)), np.zeros((n, N_TERMS))
    terms = np.empty(N_TERMS)
    for i in range(n):
        for j in range(k):
            z = _terms(points, nearest[i, j], i, axes, scale, terms)
            for a in range(N_TERMS):
                right[i, a] += terms[a] * z
                for b in range(a + 1):
                    gram[i, a, b] += terms[a] * terms[b]
        for a in range(N_TERMS):
            for b in range(a):
                gram[i, b, a] = gram[i, a, b]
    return gram, right


@compiled
def _residuals(
    points: FloatArray, nearest: IntArray, axes: FloatArray, scale: FloatArray, solution: FloatArray
) -> FloatArray:
    """Rms residual (n,) of the paraboloids, metres."""
    n, k = nearest.shape
    rms, terms = np.empty(n), np.empty(N_TERMS)
    for i in range(n):
        square = 0.0
        for j in range(k):
            rest = _terms(points, nearest[i, j], i, axes, scale, terms)
            for a in range(N_TERMS):
                rest -= terms[a] * solution[i, a]
            square += rest * rest
        rms[i] = scale[i] * np.sqrt(square / max(k - N_TERMS, 1))
    return rms


@inlined
def _terms(
    points: FloatArray, other: int, one: int, axes: FloatArray, scale: FloatArray, terms: FloatArray
) -> float:
    """Write the terms (6,) of a neighbour about a point; its height is returned."""
    x = y = z = 0.0
    for a in range(3):
        away = (points[other, a] - points[one, a]) / scale[one]
        z += away * axes[one, a, 0]
        y += away * axes[one, a, 1]
        x += away * axes[one, a, 2]
    terms[0], terms[1], terms[2] = 1.0, x, y
    terms[3], terms[4], terms[5] = x * x, x * y, y * y
    return z
