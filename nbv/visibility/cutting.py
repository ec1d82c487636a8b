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
        waiting[0], numbers[0], top = corners[k], counts[k], 0
        while top >= 0:
            n = numbers[top]
            if n == 1:
                pieces[done], of[done] = waiting[top], k
                done, top = done + 1, top - 1
                continue
            piece = waiting[top].copy()
            for side in range(3):
                x, y, z = piece[(side + 1) % 3] - piece[side]
                lengths[side] = np.sqrt(x * x + y * y + z * z)
            longest, least = 0, (1 - rounding) * lengths.max()
            while lengths[longest] < least:
                longest += 1
            a, b, apex = piece[longest], piece[(longest + 1) % 3], piece[(longest + 2) % 3]
            left = 2 * max(int(np.rint(n / 4)), 1) if n > 2 else 1
            middle = a + (b - a) * (left / n)
            waiting[top, 0], waiting[top, 1], waiting[top, 2] = middle, b, apex
            numbers[top] = n - left
            top += 1
            waiting[top, 0], waiting[top, 1], waiting[top, 2] = a, middle, apex
            numbers[top] = left
