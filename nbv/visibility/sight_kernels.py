# SPDX-License-Identifier: MIT
"""Compiled loop over the samples that may be seen from a position: all that needs no ray."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from scenes.checks import FloatArray


@njit(nogil=True, cache=True, error_model="numpy")
def facing(
    position: FloatArray,
    points: FloatArray,
    normals: FloatArray,
    among: NDArray[np.int64],
    min_cosine: float,
    min_range_m: float,
    max_range_m: float,
) -> tuple[NDArray[np.int64], FloatArray, FloatArray]:
    """Return which samples `among` are in range and steep enough, their distances and signed cosines."""
    index = np.empty(len(among), np.int64)
    distance, cosine = np.empty(len(among)), np.empty(len(among))
    n = 0
    for k in among:
        x, y, z = position[0] - points[k, 0], position[1] - points[k, 1], position[2] - points[k, 2]
        length = math.sqrt(x * x + y * y + z * z)
        if not (length > 0.0 and min_range_m <= length <= max_range_m):
            continue
        slope = (x * normals[k, 0] + y * normals[k, 1] + z * normals[k, 2]) / length
        if abs(slope) >= min_cosine:
            index[n], distance[n], cosine[n] = k, length, slope
            n += 1
    return index[:n].copy(), distance[:n].copy(), cosine[:n].copy()


@njit(nogil=True, cache=True, error_model="numpy")
def lifted(
    position: FloatArray,
    points: FloatArray,
    normals: FloatArray,
    index: NDArray[np.int64],
    distance: FloatArray,
    cosine: FloatArray,
    lift: float,
    extent_m: float,
    tolerance_m: float,
) -> FloatArray:
    """Return where lines of sight to the samples `index` end: off their surface, on the viewer's side.

    `lift` is the share of the distance, or of `extent_m` where that is larger, by which they are moved along
    the normal; they may end `tolerance_m` before the sample, at most half way.
    """
    ends = np.empty((len(index), 3))
    for i in range(len(index)):
        k = index[i]
        off = math.copysign(lift * max(distance[i], extent_m), cosine[i])
        nearer = min(tolerance_m / distance[i], 0.5)
        for axis in range(3):
            towards = position[axis] - points[k, axis]
            ends[i, axis] = points[k, axis] + normals[k, axis] * off + towards * nearer
    return ends
