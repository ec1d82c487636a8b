# SPDX-License-Identifier: MIT
"""Reach: what can be walked to over allowed points, from neighbour to neighbour (compiled)."""

from __future__ import annotations

import numpy as np

from scenes.checks import BoolArray, IntArray
from texture.engine.compiled import compiled


@compiled
def reached(first: IntArray, beside: IntArray, allowed: BoolArray, begin: IntArray) -> BoolArray:
    """Which points (n,) can be walked to from those in `begin`; `first`, `beside` are a sparse graph's."""
    found = np.zeros(len(allowed), dtype=np.bool_)
    stack = np.empty(len(allowed), dtype=np.int64)
    top = 0
    for one in begin:
        if allowed[one] and not found[one]:
            found[one] = True
            stack[top] = one
            top += 1
    while top > 0:
        top -= 1
        here = stack[top]
        for place in range(first[here], first[here + 1]):
            there = beside[place]
            if allowed[there] and not found[there]:
                found[there] = True
                stack[top] = there
                top += 1
    return found
