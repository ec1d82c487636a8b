# SPDX-License-Identifier: MIT
"""Cover instance: which candidate sees which sample, and how much of the samples is to be seen how often."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, diags_array

from scenes.checks import BoolArray, FloatArray, InputError, frozen_copy
from texture.engine.compiled import compiled

Indices = NDArray[np.integer[Any]]
TOLERANCE = 1e-9  # of the coverable weight: sums of floats


@dataclass(frozen=True, eq=False)
class CoverInstance:
    """A covering problem: choose few candidates (rows) that together see enough samples (columns).

    Parameters
    ----------
    matrix : (m, n) csr
        Stored entries say which candidate sees which sample; their values do not matter.
    weights : (n,) float
        Weight of each sample, not negative: its area in square metres.
    target : float
        Fraction of the coverable weight to cover, 0..1; 1 asks for every coverable sample with weight.
    fold : int
        A sample counts as covered when so many candidates see it.

    Raises
    ------
    InputError
        Weights of another length or negative, a target outside 0..1, fold below 1.

    Examples
    --------
    >>> instance = CoverInstance(csr_array(np.array([[1, 1, 0], [0, 1, 0]])), np.ones(3))
    >>> instance.coverable.tolist(), instance.covered_weight([1])
    ([True, True, False], 1.0)
    """

    matrix: csr_array
    weights: FloatArray
    target: float = 1.0
    fold: int = 1

    def __post_init__(self) -> None:
        if len(self.weights) != self.matrix.shape[1]:
            raise InputError(f"{len(self.weights)} weights for {self.matrix.shape[1]} samples")
        if not (np.isfinite(self.weights) & (self.weights >= 0)).all():
            raise InputError("weights must be finite and not negative")
        if not 0 <= self.target <= 1:
            raise InputError(f"target must be a fraction from 0 to 1, got {self.target}")
        if self.fold < 1:
            raise InputError(f"samples must be seen at least once, got fold = {self.fold}")
        object.__setattr__(self, "weights", frozen_copy(self.weights, np.float64))

    @property
    def n_candidates(self) -> int:
        """How many candidates there are to choose from."""
        return int(self.matrix.shape[0])

    @property
    def n_samples(self) -> int:
        """How many samples there are to see."""
        return int(self.matrix.shape[1])

    @property
    def is_full(self) -> bool:
        """Whether every coverable sample is asked for."""
        return self.target == 1.0

    @cached_property
    def coverable(self) -> BoolArray:
        """Samples (n,) that enough candidates see."""
        seen = np.bincount(self.matrix.indices, minlength=self.n_samples)
        return np.asarray(seen >= self.fold)

    @cached_property
    def coverable_weight(self) -> float:
        """Weight of the coverable samples."""
        return float(self.weights[self.coverable].sum())

    @property
    def wanted(self) -> float:
        """Weight that is to be covered."""
        return self.target * self.coverable_weight

    @property
    def spare(self) -> float:
        """Weight of coverable samples that may stay uncovered, rounding allowed for."""
        share = 1 - self.target + TOLERANCE
        return 0.0 if self.is_full else share * self.coverable_weight

    def only(self, usable: BoolArray) -> CoverInstance:
        """Return the instance in which no other candidates than the `usable` (m,) see anything."""
        matrix = csr_array(diags_array(usable.astype(np.float64)) @ self.matrix)
        matrix.eliminate_zeros()
        return replace(self, matrix=matrix)

    def seen_by(self, candidate: int) -> NDArray[np.int32]:
        """Numbers (m,) of the samples that a candidate sees."""
        start, end = self.matrix.indptr[candidate : candidate + 2]
        samples: NDArray[np.int32] = self.matrix.indices[start:end]
        return samples

    def sums_seen(self, values: FloatArray) -> FloatArray:
        """Sum (m,) of the values (n,) of the samples that each candidate sees."""
        sums: FloatArray = _row_sums(self.matrix.indptr, self.matrix.indices, values)
        return sums

    def times_seen(self, chosen: Sequence[int]) -> NDArray[np.int64]:
        """How many of the `chosen` see each sample, (n,)."""
        times = np.zeros(self.n_samples, np.int64)
        for candidate in chosen:
            times[self.seen_by(candidate)] += 1
        return times

    def covered_weight(self, chosen: Sequence[int]) -> float:
        """Weight of the samples that enough of the `chosen` see."""
        return float(self.weights[self.times_seen(chosen) >= self.fold].sum())

    def is_met_by(self, times: NDArray[np.int64]) -> bool:
        """Whether it is enough when the samples are seen so many `times` (n,)."""
        missing = self.coverable & (times < self.fold) & (self.weights > 0)
        return float(self.weights[missing].sum()) <= self.spare


@compiled
def _row_sums(starts: Indices, members: Indices, values: FloatArray) -> FloatArray:
    """Sum the values of the members of each set; two sums side by side wait less for memory."""
    sums = np.zeros(len(starts) - 1)
    for one in range(len(sums)):
        even, odd = 0.0, 0.0
        for at in range(starts[one], starts[one + 1] - 1, 2):
            even += values[members[at]]
            odd += values[members[at + 1]]
        if (starts[one + 1] - starts[one]) % 2:
            even += values[members[starts[one + 1] - 1]]
        sums[one] = even + odd
    return sums
