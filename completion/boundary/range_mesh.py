# SPDX-License-Identifier: MIT
"""Range mesh: the pixels of an organised scan as triangles, none across a jump."""

from __future__ import annotations

from math import sqrt

import numpy as np
from numpy.typing import NDArray

from scenes.checks import BoolArray, FloatArray
from texture.engine.compiled import compiled, inlined


def mesh_range_image(
    points: FloatArray, members: BoolArray, max_step: FloatArray, origin: FloatArray
) -> NDArray[np.int32]:
    """Triangles (m, 3) between neighbouring pixels of an organised scan, none across a jump.

    They are counter-clockwise seen from the sensor at `origin` (3,), whichever way the grid's rows and
    columns run. Of the points (rows, columns, 3) the `members` (rows, columns) are used; `max_step` (rows,
    columns) is the longest edge allowed at each, metres.
    """
    rows, columns = members.shape
    kept = np.zeros((2, max(rows - 1, 0), max(columns - 1, 0)), np.bool_)
    below = columns + 1  # from a pixel to the one across its square
    others = ((columns, below), (below, 1))  # of the lower left triangle, and of the upper right one
    n_away = _join(np.ascontiguousarray(points), members, max_step, np.array(origin, dtype=np.float64), kept)
    triangles = []
    for joined, (second, third) in zip(kept, others, strict=True):
        row, column = np.nonzero(joined)
        first = (row * columns + column).astype(np.int32)
        turned = (third, second) if 2 * n_away > kept.sum() else (second, third)
        triangles.append(np.stack([first, *(first + step for step in turned)], axis=1))
    return np.concatenate(triangles).astype(np.int32, copy=False)


@compiled
def _join(
    points: FloatArray, members: BoolArray, max_step: FloatArray, origin: FloatArray, kept: BoolArray
) -> int:
    """Mark the triangles in the squares of pixels; say how many of them turn their backs on the origin.

    `kept` is (2, rows - 1, columns - 1): whether the pixel's square has its lower left triangle, its upper
    right one.
    """
    n_away = 0
    rows, columns = members.shape
    for row in range(rows - 1):
        for column in range(columns - 1):
            if not (members[row, column] and members[row + 1, column + 1]):
                continue
            a, c = points[row, column], points[row + 1, column + 1]
            across = _distance(a, c)
            least = min(max_step[row, column], max_step[row + 1, column + 1])
            for half in range(2):
                i, j = (row + 1, column) if half == 0 else (row, column + 1)
                b = points[i, j]
                step = min(least, max_step[i, j])
                if members[i, j] and across <= step and _distance(a, b) <= step and _distance(b, c) <= step:
                    kept[half, row, column] = True
                    volume = _volume(origin, a, b, c) if half == 0 else _volume(origin, a, c, b)
                    n_away += volume < 0
    return n_away


@inlined
def _distance(first: FloatArray, second: FloatArray) -> float:
    """Distance of two points (3,)."""
    x, y, z = first[0] - second[0], first[1] - second[1], first[2] - second[2]
    return sqrt(x * x + y * y + z * z)


@inlined
def _volume(origin: FloatArray, a: FloatArray, b: FloatArray, c: FloatArray) -> float:
    """Six times the signed volume of the pyramid over a triangle, positive seen counter-clockwise."""
    x, y, z = origin[0] - a[0], origin[1] - a[1], origin[2] - a[2]
    p, q, r = origin[0] - b[0], origin[1] - b[1], origin[2] - b[2]
    u, v, w = origin[0] - c[0], origin[1] - c[1], origin[2] - c[2]
    volume: float = x * (q * w - r * v) - y * (p * w - r * u) + z * (p * v - q * u)
    return volume
