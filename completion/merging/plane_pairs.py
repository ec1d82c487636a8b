# SPDX-License-Identifier: MIT
"""Plane pairs: how two fitted planes differ, against their covariances, in closed form."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from completion.evidence.form import Form
from completion.observe.triple import dot, minus
from scenes.checks import FloatArray
from texture.engine.compiled import compiled, inlined

_LEAST_SCALE = 1e-150  # standard deviation that counts as none
_RANK = 1e-12  # of the greatest eigenvalue of a correlation, below which one counts as none


@compiled
def compare_planes(
    here: Form,
    there: Form,
    covariance: FloatArray,
    other: FloatArray,
    doubt: tuple[float, float],
    least_cosine: float,
) -> tuple[float, float]:
    """Return squared Mahalanobis distance and log density of the difference of two planes' parameters.

    Offset along the normal and slopes along u and v, with `covariance` (3, 3) in the chart of the first and
    `other` (3, 3) in that of the second, and `doubt` the variances of shift and turn between their scans.
    Over the chart of the first both the second's height and the charts' coordinates are linear, so three
    places say how its parameters carry over. (inf, -inf) where the cosine between the normals is less than
    `least_cosine`.
    """
    cosine = dot(here.axis, there.axis)
    if cosine < least_cosine:
        return np.inf, -np.inf
    offset = minus(here.point, there.point)
    height = np.array([
        -dot(offset, there.axis) / cosine,
        -dot(here.first, there.axis) / cosine,
        -dot(here.second, there.axis) / cosine,
    ])  # fmt: skip
    carried = np.zeros((3, 3))
    carried[0, 0] = 1.0
    for column in range(1, 3):
        side = there.first if column == 1 else there.second
        lean = dot(here.axis, side)
        carried[0, column] = dot(offset, side) + lean * height[0]
        carried[1, column] = dot(here.first, side) + lean * height[1]
        carried[2, column] = dot(here.second, side) + lean * height[2]
    total = covariance.copy()
    total[0, 0] += doubt[0]
    total[1, 1] += doubt[1]
    total[2, 2] += doubt[1]
    for i in range(3):
        for j in range(3):
            for k in range(3):
                for m in range(3):
                    total[i, j] += carried[i, k] * other[k, m] * carried[j, m]
    return density(height, total)


@compiled
def compare_plane_pairs(
    pairs: NDArray[np.int64],
    forms: FloatArray,
    covariances: FloatArray,
    doubts: FloatArray,
    least_cosine: float,
) -> tuple[FloatArray, FloatArray]:
    """`compare_planes` of pairs (k, 2) of planes, both numbers (k,).

    `forms` (n, 12) are a plane's point, normal, u and v directions, `covariances` (n, 3, 3), `doubts` (k, 2)
    the variances of shift and turn between the scans of each pair.
    """
    square, log_density = np.empty(len(pairs)), np.empty(len(pairs))
    for k in range(len(pairs)):
        i, j = pairs[k, 0], pairs[k, 1]
        here, there = _plane_of(forms[i]), _plane_of(forms[j])
        square[k], log_density[k] = compare_planes(
            here, there, covariances[i], covariances[j], (doubts[k, 0], doubts[k, 1]), least_cosine
        )
    return square, log_density


@inlined
def _plane_of(a: FloatArray) -> Form:
    """A plane by its numbers (12,)."""
    return Form(
        is_curved=False,
        point=(a[0], a[1], a[2]),
        axis=(a[3], a[4], a[5]),
        first=(a[6], a[7], a[8]),
        second=(a[9], a[10], a[11]),
        radius=1.0,
        outward=1.0,
    )


@compiled
def density(difference: FloatArray, covariance: FloatArray) -> tuple[float, float]:
    """Squared Mahalanobis distance of a difference (k,) with `covariance` (k, k), and its log density."""
    n = difference.size
    scale = np.empty(n)
    for i in range(n):
        scale[i] = max(np.sqrt(max(covariance[i, i], 0.0)), _LEAST_SCALE)
    correlation = np.empty((n, n))
    for i in range(n):
        for j in range(n):
            correlation[i, j] = covariance[i, j] / (scale[i] * scale[j])
    values, vectors = np.linalg.eigh(correlation)
    largest, square, log_det = 0.0, 0.0, 0.0
    for k in range(n):
        largest = max(largest, abs(values[k]))
    for k in range(n):
        along = 0.0
        for i in range(n):
            along += vectors[i, k] * difference[i] / scale[i]
        if abs(values[k]) > _RANK * largest:
            square += along * along / values[k]
        log_det += np.log(abs(2 * np.pi * values[k] + _RANK)) + 2 * np.log(scale[k])
    return square, -(square + log_det) / 2
