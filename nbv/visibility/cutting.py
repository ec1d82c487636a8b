# SPDX-License-Identifier: MIT
"""Triangles cut into pieces of equal area, always across the longest edge: the loop, compiled."""

import numpy as np
from numpy.typing import NDArray

from scenes.checks import FloatArray
from texture.engine.compiled import compiled

_DEPTH = 128  # of cuts within one another; each leaves at most three quarters


@compiled
def cut_triangles(
    corners: FloatArray, counts: NDArray[np.int64], rounding: float, pieces: FloatArray, of: NDArray[np.int64]
) -> None:
    """Cut triangle k of `corners` (m, 3, 3) into `counts[k]` pieces of equal area, and write them in a row.

    `pieces` (n, 3, 3) and `of` (n,), the triangle each comes from, hold as many as are counted. Of two pieces
    that are cut from one triangle the first holds an even number of pieces, so that neighbours in the row are
    halves of one triangle. The first edge counts as the longest that is shorter by `rounding` of it at most.
    """
    waiting, numbers = np.empty((_DEPTH, 3, 3)), np.empty(_DEPTH, np.int64)
    lengths, done = np.empty(3), 0
    for k in range(len(counts)):
        if counts[k] < 1:
            continue
        numbers[0], top = counts[k], 0
        for corner in range(3):
            for axis in range(3):
                waiting[0, corner, axis] = corners[k, corner, axis]
        while top >= 0:
            n = numbers[top]
            if n == 1:
                for corner in range(3):
                    for axis in range(3):
                        pieces[done, corner, axis] = waiting[top, corner, axis]
                of[done] = k
                done, top = done + 1, top - 1
                continue
            for side in range(3):
                x = waiting[top, (side + 1) % 3, 0] - waiting[top, side, 0]
                y = waiting[top, (side + 1) % 3, 1] - waiting[top, side, 1]
                z = waiting[top, (side + 1) % 3, 2] - waiting[top, side, 2]
                lengths[side] = np.sqrt(x * x + y * y + z * z)
            longest, least = 0, (1 - rounding) * max(lengths[0], lengths[1], lengths[2])
            while lengths[longest] < least:
                longest += 1
            left = 2 * max(int(np.rint(n / 4)), 1) if n > 2 else 1
            numbers[top], numbers[top + 1] = n - left, left
            for axis in range(3):
                a, b = waiting[top, longest, axis], waiting[top, (longest + 1) % 3, axis]
                apex, middle = waiting[top, (longest + 2) % 3, axis], a + (b - a) * (left / n)
                waiting[top, 0, axis], waiting[top, 1, axis], waiting[top, 2, axis] = middle, b, apex
                here = top + 1
                waiting[here, 0, axis], waiting[here, 1, axis], waiting[here, 2, axis] = a, middle, apex
            top += 1
