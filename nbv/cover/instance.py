# SPDX-License-Identifier: MIT
"""Cover instance: which candidate sees which sample, how often how much is to be seen; and a cover of it.

A cover holds the chosen candidates, how many any choice must have, and the certificate that proves it. For
multipliers y >= 0 of the samples and a price p >= 0 of weight, every choice that meets the instance has
at least

    p * wanted - sum over coverable i of max(p * w_i - fold * y_i, 0) - sum over all c of max(s_c - 1, 0)

members, s_c being the sum of y over what candidate c sees (Lagrangian dual; in full cover p is so large that
the first two terms become fold * sum of y). The check is one sparse matrix-vector product with the unreduced
matrix, in integers and fractions: rounding cannot make the bound too large, whoever found the multipliers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from math import ceil
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, diags_array

from nbv.run.wording import count
from scenes.checks import BoolArray, FloatArray, InputError, Value, frozen_copy
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
    for number in range(len(sums)):
        even, odd = 0.0, 0.0
        for at in range(starts[number], starts[number + 1] - 1, 2):
            even += values[members[at]]
            odd += values[members[at + 1]]
        if (starts[number + 1] - starts[number]) % 2:
            even += values[members[starts[number + 1] - 1]]
        sums[number] = even + odd
    return sums


_ONE = 1 << 40  # multipliers are whole numbers of 1 / _ONE


@dataclass(frozen=True, slots=True, eq=False)
class Certificate:
    """Multipliers of a lower bound.

    Attributes
    ----------
    multipliers : (n,) int
        y of each sample, in units of 2^-40.
    price : float
        p, for each unit of weight; not used in full cover.
    """

    multipliers: NDArray[np.int64]
    price: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "multipliers", frozen_copy(self.multipliers, np.int64))
        if ((self.multipliers < 0) | (self.multipliers > _ONE)).any() or not 0 <= self.price < np.inf:
            raise InputError(
                "the multipliers of a certificate must lie in 0..1, and its price must not be negative"
            )

    @classmethod
    def round_down(cls, multipliers: FloatArray, price: float = 0.0) -> Certificate:
        """Return a certificate of multipliers (n,), cut off at 0 and 1 and rounded down."""
        return cls(np.floor(np.clip(multipliers, 0.0, 1.0) * _ONE).astype(np.int64), price)

    def value(self, instance: CoverInstance) -> Fraction:
        """Return the bound that the multipliers prove for `instance`, exactly.

        Raises
        ------
        InputError
            Multipliers of another instance.
        """
        if len(self.multipliers) != instance.n_samples:
            raise InputError(f"{len(self.multipliers)} multipliers for {instance.n_samples} samples")
        excess = np.maximum(_sums(instance.matrix, self.multipliers) - _ONE, 0)
        proved = -Fraction(int(excess.sum()), _ONE)
        useful = self.multipliers[instance.coverable & (instance.weights > 0)]
        if instance.is_full:
            return proved + Fraction(instance.fold * int(useful.sum()), _ONE)
        price = Fraction(self.price)
        total = Fraction(0)
        for at in np.flatnonzero(instance.coverable):
            weight = Fraction(float(instance.weights[at]))
            total += weight
            proved -= max(
                price * weight - Fraction(instance.fold * int(self.multipliers[at]), _ONE), Fraction(0)
            )
        return proved + price * total * (Fraction(instance.target) - Fraction(TOLERANCE))

    def bound(self, instance: CoverInstance) -> int:
        """Return the least number of candidates of any choice that meets `instance`."""
        return max(ceil(self.value(instance)), 0)


def _sums(matrix: csr_array, multipliers: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the sum of multipliers over what each candidate sees: whole numbers, exact."""
    seen = csr_array((np.ones(len(matrix.indices), np.int64), matrix.indices, matrix.indptr), matrix.shape)
    sums: NDArray[np.int64] = seen @ multipliers
    return sums


@dataclass(frozen=True, slots=True)
class LowerBound(Value):
    """At least `views` are needed with these candidates and samples; `kind` says by which argument.

    Registration constraints are left aside: they only ever ask for more.
    """

    views: int
    kind: str

    def describe(self) -> str:
        """Return the bound in words."""
        return (
            f"at least {count(self.views, 'view is', 'views are')} needed to meet the target with these "
            f"candidates and samples, "
            f"registration constraints left aside ({self.kind})"
        )

    def to_json(self) -> dict[str, Any]:
        """Return the entry of `plan.json`."""
        return {"views": self.views, "kind": self.kind}


@dataclass(frozen=True, slots=True, eq=False)
class Cover:
    """A choice of candidates by their numbers, each adding most to those before it.

    It is complete when it covers what was wanted, which a limit on their number may forbid. `bound` says how
    many any complete choice has at least, and `certificate` proves that of the linear relaxation. Where the
    clock ended the search of so many `steps`, another machine may find another cover.
    """

    chosen: tuple[int, ...]
    is_complete: bool
    bound: LowerBound
    certificate: Certificate
    steps: int = 0
    was_cut_short: bool = False

    @property
    def is_smallest(self) -> bool:
        """Whether no complete choice is smaller."""
        return self.is_complete and len(self.chosen) <= self.bound.views
