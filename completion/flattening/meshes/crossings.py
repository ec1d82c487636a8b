# SPDX-License-Identifier: MIT
"""Crossings: faces of a mesh that cross others after a movement and did not before."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from scenes.checks import BoolArray, FloatArray
from texture.engine.compiled import compiled, inlined

_SPAN = 2.0  # cells of the search in usual faces
_MOST = 64  # cells along each axis that one face is entered in


def new_crossings(
    before: FloatArray, after: FloatArray, faces: NDArray[np.int32], moved: BoolArray
) -> BoolArray:
    """Faces (m,) that take part in a crossing after and not before: an edge of one runs through another.

    `before`, `after` (n, 3) are the vertices; pairs with a `moved` (m,) face are tested exactly, except those
    that share a vertex. Faces that touch, or lie in one plane, do not cross.
    """
    crossing = np.zeros(len(faces), np.bool_)
    if not moved.any():
        return crossing
    corners = after[faces]
    low, high = corners.min(axis=1), corners.max(axis=1)
    size = max(float(_SPAN * np.median((high - low).max(axis=1))), 1e-9 * float(np.ptp(after)) + 1e-300)
    near = np.all((high >= low[moved].min(axis=0)) & (low <= high[moved].max(axis=0)), axis=1)
    chosen = np.flatnonzero(near)
    first = np.floor(low[chosen] / size).astype(np.int64)
    count = np.minimum(np.floor(high[chosen] / size).astype(np.int64) - first + 1, _MOST)
    number = count.prod(axis=1)
    entry = np.repeat(np.arange(len(chosen)), number)
    within = np.arange(len(entry)) - np.repeat(np.cumsum(number) - number, number)
    across = count[entry]
    step = np.stack(
        [
            within // (across[:, 1] * across[:, 2]),
            within // across[:, 2] % across[:, 1],
            within % across[:, 2],
        ],
        axis=1,
    )
    place = first[entry] + step
    place -= place.min(axis=0)
    key = (place[:, 0] * (place[:, 1].max() + 1) + place[:, 1]) * (place[:, 2].max() + 1) + place[:, 2]
    order = np.argsort(key, kind="stable")
    starts = np.flatnonzero(np.r_[True, np.diff(key[order]) != 0, True])
    starts[-1] = len(order)
    _mark(before, after, faces, moved, low, high, chosen[entry[order]], starts, crossing)
    return crossing


@compiled
def _mark(
    before: FloatArray,
    after: FloatArray,
    faces: NDArray[np.int32],
    moved: BoolArray,
    low: FloatArray,
    high: FloatArray,
    entries: NDArray[np.int64],
    starts: NDArray[np.int64],
    crossing: BoolArray,
) -> None:
    """Mark the faces that cross newly; `entries` from each start to the next are the faces of one cell."""
    for cell in range(len(starts) - 1):
        for i in range(starts[cell], starts[cell + 1]):
            one = entries[i]
            for j in range(i + 1, starts[cell + 1]):
                other = entries[j]
                if not (moved[one] or moved[other]) or (crossing[one] and crossing[other]):
                    continue
                apart = False
                for k in range(3):
                    if low[one, k] > high[other, k] or low[other, k] > high[one, k]:
                        apart = True
                    for m in range(3):
                        if faces[one, k] == faces[other, m]:
                            apart = True
                if apart:
                    continue
                if _cross(after, faces, one, other) and not _cross(before, faces, one, other):
                    crossing[one] = True
                    crossing[other] = True


@inlined
def _cross(points: FloatArray, faces: NDArray[np.int32], one: int, other: int) -> bool:
    """Whether an edge of one face runs through the other."""
    for k in range(3):
        if _pierces(points, faces[other], faces[one, k], faces[one, (k + 1) % 3]):
            return True
        if _pierces(points, faces[one], faces[other, k], faces[other, (k + 1) % 3]):
            return True
    return False


@inlined
def _pierces(points: FloatArray, face: NDArray[np.int32], start: int, end: int) -> bool:
    """Whether an edge runs through a face: its ends on either side, the face's edges around it."""
    a, b, c, p, q = points[face[0]], points[face[1]], points[face[2]], points[start], points[end]
    above, below = _volume(a, b, c, p), _volume(a, b, c, q)
    if above * below >= 0:
        return False
    first, second, third = _volume(p, q, a, b), _volume(p, q, b, c), _volume(p, q, c, a)
    return (first > 0 and second > 0 and third > 0) or (first < 0 and second < 0 and third < 0)


@inlined
def _volume(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray) -> float:
    """Six times the signed volume of a tetrahedron; 0 where it is no more than rounding."""
    x, y, z = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    p, q, r = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    u, v, w = d[0] - a[0], d[1] - a[1], d[2] - a[2]
    volume: float = x * (q * w - r * v) - y * (p * w - r * u) + z * (p * v - q * u)
    scale: float = (abs(x) + abs(y) + abs(z)) * (abs(p) + abs(q) + abs(r)) * (abs(u) + abs(v) + abs(w))
    return volume if abs(volume) > 1e-12 * scale else 0.0
