# SPDX-License-Identifier: MIT
"""Triple: places and directions as three numbers, which compiled loops keep in registers."""

from __future__ import annotations

from typing import TypeAlias

from scenes.checks import FloatArray
from texture.engine.compiled import inlined

Triple: TypeAlias = tuple[float, float, float]


def triple(vector: FloatArray) -> Triple:
    """Return a vector (3,) as three numbers."""
    x, y, z = vector.tolist()
    return x, y, z


@inlined
def dot(a: Triple, b: Triple) -> float:
    """Inner product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inlined
def minus(a: Triple, b: Triple) -> Triple:
    """Difference."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@inlined
def plus(a: Triple, length: float, b: Triple) -> Triple:
    """The place at so many lengths of `b` from `a`."""
    return a[0] + length * b[0], a[1] + length * b[1], a[2] + length * b[2]
