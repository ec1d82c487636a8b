# SPDX-License-Identifier: MIT
"""Verdicts: which pairs of parts differ, of those that were compared; a byte a pair, on disk where many."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from completion.merging.agreement import Part, compare
from scenes.checks import FloatArray, IntArray
from scenes.run.mapping import allocate

_ALIKE, _DIFFERENT = 1, 2


class Verdicts:
    """Which of n parts differ from one another; pairs that were not compared are when they are asked for."""

    def __init__(self, parts: Sequence[Part], pairs: IntArray, chi2: FloatArray) -> None:
        """Keep what pairs (k, 2) came to: they differ where `chi2` (k,) is more than 1."""
        self._parts = parts
        self._known: NDArray[np.int8] = allocate((len(parts), len(parts)), np.int8)
        for here, there in (pairs.T, pairs.T[::-1]):
            self._known[here, there] = np.where(chi2 > 1, _DIFFERENT, _ALIKE)

    def contradict(self, one: Sequence[int], other: Sequence[int]) -> bool:
        """Tell whether some pair across two groups of parts fails the test."""
        found = self._known[np.ix_(one, other)]
        if (found == _DIFFERENT).any():
            return True
        return any(self._differ(one[i], other[j]) for i, j in np.argwhere(found == 0).tolist())

    def _differ(self, one: int, other: int) -> bool:
        """Compare two parts, the one with the lower number with the other."""
        first, second = min(one, other), max(one, other)
        is_so = compare(self._parts[first], self._parts[second]).chi2 > 1
        self._known[first, second] = self._known[second, first] = _DIFFERENT if is_so else _ALIKE
        return is_so
