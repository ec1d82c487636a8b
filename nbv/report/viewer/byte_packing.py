# SPDX-License-Identifier: MIT
"""Packing: whole numbers as bytes that compress well, one behind the other.

Neighbours are alike, so that differences are small: they are folded to 0, 1, 2, ... for 0, -1, 1, ..., and
of all numbers of a column the lowest bytes come first, then the next ones, which are nearly all zero.
Indices count back from the largest so far (as Google's webgl-loader did): 0 is a new one.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Integers = NDArray[Any]


class Packer:
    """Collects arrays; `add` returns where each lies, for the header."""

    def __init__(self) -> None:
        self._parts: list[bytes] = []
        self._size = 0

    def add(self, values: Integers, *, is_index: bool = False) -> dict[str, Any]:
        """Append whole numbers (n,) or (n, c), none larger than 2^30, and return their entry.

        Indices must be numbered in the order of their first appearance.
        """
        table = np.asarray(values, dtype=np.int64)
        columns = 1 if table.ndim == 1 else table.shape[1]
        codes = countdown(table.ravel())[:, None] if is_index else folded(table.reshape(-1, columns))
        width = max(1, -(-int(codes.max(initial=0)).bit_length() // 8))
        planes = [
            (codes[:, k] >> (8 * b)).astype(np.uint8) for k in range(codes.shape[1]) for b in range(width)
        ]
        entry = {"at": self._size, "n": len(codes), "columns": columns, "width": width, "index": is_index}
        self.add_bytes(b"".join(plane.tobytes() for plane in planes))
        return entry

    def add_bytes(self, data: bytes) -> dict[str, Any]:
        """Append bytes as they are, and return their entry."""
        entry = {"at": self._size, "n": len(data)}
        self._parts.append(data)
        self._size += len(data)
        return entry

    def bytes(self) -> bytes:
        """Return all that was added."""
        return b"".join(self._parts)


def folded(table: Integers) -> Integers:
    """Differences along the columns of (n, c), folded to non-negative numbers.

    Examples
    --------
    >>> folded(np.array([[3], [2], [2], [5]])).ravel().tolist()
    [6, 1, 0, 6]
    """
    steps = np.diff(table, axis=0, prepend=0)
    return (steps << 1) ^ (steps >> 63)


def countdown(index: Integers) -> Integers:
    """How far each index (n,) lies below the next new one.

    Examples
    --------
    >>> countdown(np.array([0, 1, 2, 2, 1, 3])).tolist()
    [0, 0, 0, 1, 2, 0]
    """
    seen = np.maximum.accumulate(np.concatenate([[-1], index]))[:-1]
    return seen + 1 - index


def by_appearance(index: Integers) -> tuple[Integers, Integers]:
    """Number indices (n,) by their first appearance: the new ones (n,), and the old one of each new one.

    Examples
    --------
    >>> new, old = by_appearance(np.array([7, 3, 7, 0]))
    >>> new.tolist(), old.tolist()
    ([0, 1, 0, 2], [7, 3, 0])
    """
    values, first, inverse = np.unique(index, return_index=True, return_inverse=True)
    order = np.argsort(first, kind="stable")
    rank = np.empty(len(order), np.int64)
    rank[order] = np.arange(len(order))
    return rank[inverse], values[order]
