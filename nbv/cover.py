# SPDX-License-Identifier: MIT
"""Cover: few rows of a visibility matrix that together see enough, for a scene that is known.

Lazy greedy choice (Minoux 1978; at most 1 + ln n times the optimum for full cover) and reverse deletion.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from scenes.checks import FloatArray, InputError

_TOLERANCE = 1e-9  # of the total weight: sums of floats

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True, slots=True, eq=False)
class Cover:
    """A choice of rows.

    Attributes
    ----------
    chosen : tuple of int
        Row numbers in the order of choice.
    covered : float
        Weight that they cover.
    coverable : float
        Weight that all rows together cover.
    wanted : float
        Weight that was asked for.
    """

    chosen: tuple[int, ...]
    covered: float
    coverable: float
    wanted: float

    @property
    def is_complete(self) -> bool:
        """Whether what was wanted is covered."""
        return self.covered >= self.wanted - _TOLERANCE * max(self.coverable, 1e-300)


def greedy_cover(
    matrix: csr_array,
    weights: FloatArray,
    target: float = 1.0,
    *,
    n_most: int | None = None,
    progress: Progress | None = None,
) -> Cover:
    """Choose rows until they cover `target` of the coverable weight: always what adds most, then prune.

    Parameters
    ----------
    matrix : (m, n) csr
        Stored entries say which row sees which column; their values do not matter.
    weights : (n,) float
        Weight of each column, not negative.
    target : float
        Fraction of the coverable weight, 0..1.
    n_most : int, optional
        Choose no more than so many rows.
    progress : callable, optional
        Called with ("cover", percent of the wanted weight, 100).

    Raises
    ------
    InputError
        Weights of another length or negative, a target outside 0..1, n_most below 1.

    Examples
    --------
    >>> rows = csr_array(np.array([[1, 1, 0, 0], [0, 1, 1, 0], [0, 0, 1, 1]]))
    >>> greedy_cover(rows, np.ones(4)).chosen
    (0, 2)
    """
    check_cover(matrix, weights, target)
    if n_most is not None and n_most < 1:
        raise InputError(f"a cover needs at least one view, got {n_most}")
    coverable = coverable_weight(matrix, weights)
    wanted = target * coverable
    chosen = _choose_lazily(matrix, weights, wanted, n_most or matrix.shape[0], progress)
    kept = drop_redundant(matrix, weights, chosen, min(wanted, covered_weight(matrix, weights, chosen)))
    return Cover(tuple(kept), covered_weight(matrix, weights, kept), coverable, wanted)


def drop_redundant(matrix: csr_array, weights: FloatArray, chosen: list[int], wanted: float) -> list[int]:
    """Drop rows as long as `wanted` stays covered, the one first whose own share is smallest."""
    kept = list(chosen)
    times = np.zeros(matrix.shape[1], np.int64)
    for row in kept:
        times[_columns(matrix, row)] += 1
    covered = float(weights[times > 0].sum())
    while kept:
        alone = [float(weights[c[times[c] == 1]].sum()) for c in (_columns(matrix, row) for row in kept)]
        least = int(np.argmin(alone))
        if covered - alone[least] < wanted - _TOLERANCE * max(covered, 1e-300):
            break
        times[_columns(matrix, kept.pop(least))] -= 1
        covered = float(weights[times > 0].sum())
    return kept


def covered_weight(matrix: csr_array, weights: FloatArray, chosen: list[int] | tuple[int, ...]) -> float:
    """Weight of the columns that the chosen rows see."""
    seen = np.zeros(matrix.shape[1], dtype=np.bool_)
    for row in chosen:
        seen[_columns(matrix, row)] = True
    return float(weights[seen].sum())


def coverable_weight(matrix: csr_array, weights: FloatArray) -> float:
    """Weight of the columns that some row sees."""
    seen = np.zeros(matrix.shape[1], dtype=np.bool_)
    seen[matrix.indices] = True
    return float(weights[seen].sum())


def check_cover(matrix: csr_array, weights: FloatArray, target: float) -> None:
    """Raise InputError unless weights fit the matrix and the target is a fraction."""
    if len(weights) != matrix.shape[1]:
        raise InputError(f"{len(weights)} weights for {matrix.shape[1]} columns")
    if not (np.isfinite(weights) & (weights >= 0)).all():
        raise InputError("weights must be finite and not negative")
    if not 0 <= target <= 1:
        raise InputError(f"target must be a fraction from 0 to 1, got {target}")


def _choose_lazily(
    matrix: csr_array, weights: FloatArray, wanted: float, n_most: int, progress: Progress | None
) -> list[int]:
    """Take rows by their gain, lazily.

    A row's gain only shrinks: one whose old gain is not the largest need not be looked at again.
    """
    left = weights.astype(np.float64).copy()
    heap = [(-gain, row, 0) for row in range(matrix.shape[0]) if (gain := _gain(matrix, left, row)) > 0]
    heapq.heapify(heap)
    chosen: list[int] = []
    covered = 0.0
    enough = wanted - _TOLERANCE * max(wanted, 1e-300)
    while heap and covered < enough and len(chosen) < n_most:
        negative, row, counted_at = heapq.heappop(heap)
        if counted_at < len(chosen):
            if (gain := _gain(matrix, left, row)) > 0:
                heapq.heappush(heap, (-gain, row, len(chosen)))
            continue
        chosen.append(row)
        covered -= negative
        left[_columns(matrix, row)] = 0.0
        if progress is not None:
            progress("cover", min(int(100 * covered / max(wanted, 1e-300)), 100), 100)
    return chosen


def _gain(matrix: csr_array, left: FloatArray, row: int) -> float:
    return float(left[_columns(matrix, row)].sum())


def _columns(matrix: csr_array, row: int) -> NDArray[np.int32]:
    columns: NDArray[np.int32] = matrix.indices[matrix.indptr[row] : matrix.indptr[row + 1]]
    return columns
