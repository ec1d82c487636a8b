# SPDX-License-Identifier: MIT
"""Local frame: an origin near the geometry, since single precision errs by 0.25 m at UTM coordinates."""

from __future__ import annotations

import numpy as np

from scenes.checks import FloatArray

_FINE_M = 1e-5  # rounding that is no matter


def local_origin(points: FloatArray) -> FloatArray:
    """Return the origin (3,), in whole metres, about which `points` (n, 3) are to be written as float32.

    Zero where they are near enough to the world's own: rounding stays below 0.01 mm, or would hardly change
    because they reach about as far as they are away.

    Examples
    --------
    >>> local_origin(np.array([[500000.2, 5000000.0, 100.0], [500002.0, 5000003.0, 101.0]])).tolist()
    [500001.0, 5000002.0, 100.0]
    >>> local_origin(np.array([[-3.0, 0.0, 0.0], [9.0, 1.0, 2.0]])).tolist()
    [0.0, 0.0, 0.0]
    """
    if not len(points):
        return np.zeros(3)
    low, high = points.min(axis=0), points.max(axis=0)
    middle = (low + high) / 2
    step = float(np.spacing(np.float32(np.abs([low, high]).max())))
    is_near = step < _FINE_M or np.linalg.norm(middle) < np.linalg.norm(high - low)
    return np.zeros(3) if is_near else np.round(middle)
