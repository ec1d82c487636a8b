# SPDX-License-Identifier: MIT
"""Window: which part of an image may see the places within a sphere."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numba import int64

from completion.evidence.sight import Eye
from completion.observe.triple import Triple, dot
from scenes.checks import FloatArray
from texture.engine.compiled import inlined

Window: TypeAlias = tuple[int, int, int, int]
"""First and last row, first and last column of pixels; a last one of -1 says that there are none."""

_SLACK = 1e-9  # of rounding, radians


@inlined
def window_of(eye: Eye, angles: FloatArray, middle: Triple, radius: float) -> Window:
    """Rows and columns of all pixels that see a place within a sphere.

    `angles` (rows + columns,) are those of `Sight`.
    """
    at = (
        dot(eye.turn[0], middle) + eye.shift[0],
        dot(eye.turn[1], middle) + eye.shift[1],
        dot(eye.turn[2], middle) + eye.shift[2],
    )
    if eye.is_spherical:
        return _of_turning(eye, angles, at, radius)
    return _of_pinhole(eye, at, radius)


@inlined
def _of_pinhole(eye: Eye, at: Triple, radius: float) -> Window:
    """First and last row and column that a sphere about a place, sensor frame, may be seen in."""
    x, y, z = at
    rows, columns = eye.shape
    fx, fy, cx, cy = eye.lens
    near, farther = z - radius, z + radius
    if farther < 0.0:
        return 0, -1, 0, -1
    if near <= 0.0:
        return 0, rows - 1, 0, columns - 1
    low, high = (y - radius), (y + radius)
    ups = fy * low / near, fy * low / farther, fy * high / near, fy * high / farther
    low, high = (x - radius), (x + radius)
    sides = fx * low / near, fx * low / farther, fx * high / near, fx * high / farther
    top, bottom = _clipped(cy + min(ups), cy + max(ups), rows)
    left, right = _clipped(cx + min(sides), cx + max(sides), columns)
    return top, bottom, left, right


@inlined
def _clipped(low: float, high: float, n: int) -> tuple[int, int]:
    """First and last of n pixels between two places, and one more on either side."""
    if high < -1.0 or low > n:
        return 0, -1
    return int(max(np.floor(low) - 1.0, 0.0)), int(min(np.ceil(high) + 1.0, n - 1.0))


@inlined
def _of_turning(eye: Eye, angles: FloatArray, at: Triple, radius: float) -> Window:
    """`_of_pinhole` for a turning scanner."""
    x, y, z = at
    rows, columns = eye.shape
    distance = np.sqrt(x * x + y * y + z * z)
    if not distance > radius:
        return 0, rows - 1, 0, columns - 1
    half = np.arcsin(radius / distance) + _SLACK
    elevation = np.arctan2(-y, np.sqrt(x * x + z * z))
    top, bottom = _between(angles, int64(0), rows, (elevation - half, elevation + half), eye.pixel_angle)
    if abs(elevation) + half >= np.pi / 2 - 1e-3:
        return top, bottom, 0, columns - 1
    side = np.arcsin(min(np.sin(half) / np.cos(elevation), 1.0)) + _SLACK
    middle = (angles[rows] + angles[rows + columns - 1]) / 2
    turned = (np.arctan2(x, z) - middle + np.pi) % (2 * np.pi) - np.pi
    if abs(turned) + side >= np.pi:
        return top, bottom, 0, columns - 1
    around = middle + turned - side, middle + turned + side
    left, right = _between(angles, rows, columns, around, eye.pixel_angle)
    return top, bottom, left, right


@inlined
def _between(
    angles: FloatArray, first: int, n: int, within: tuple[float, float], only_step: float
) -> tuple[int, int]:
    """First and last of n monotonic angles from `first` on within two, and one more on either side.

    There are none where the nearest is a whole step away; a single angle has the step `only_step`.
    """
    low, high = within
    a, b = angles[first], angles[first + n - 1]
    before = abs(angles[first + 1] - a) if n > 1 else only_step
    beyond = abs(b - angles[first + n - 2]) if n > 1 else only_step
    rises = b >= a
    if rises and (high < a - before - _SLACK or low > b + beyond + _SLACK):
        return 0, -1
    if not rises and (high < b - beyond - _SLACK or low > a + before + _SLACK):
        return 0, -1
    start, end = _count_below(angles, first, n, rises, low), _count_below(angles, first, n, rises, high)
    if not rises:
        start, end = n - end, n - start
    return max(start - 2, 0), min(end + 1, n - 1)


@inlined
def _count_below(angles: FloatArray, first: int, n: int, rises: bool, limit: float) -> int:
    """How many of n monotonic angles from `first` on are smaller than a limit."""
    low, high = 0, n
    while low < high:
        k = (low + high) // 2
        if angles[first + k if rises else first + n - 1 - k] < limit:
            low = k + 1
        else:
            high = k
    return low
