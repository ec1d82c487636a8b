# SPDX-License-Identifier: MIT
"""Cover: the chosen candidates, how many any choice must have, and the certificate that proves it.

For multipliers y >= 0 of the samples and a price p >= 0 of weight, every choice that meets the instance has
at least

    p * wanted - sum over coverable i of max(p * w_i - fold * y_i, 0) - sum over all c of max(s_c - 1, 0)

members, s_c being the sum of y over what candidate c sees (Lagrangian dual; in full cover p is so large that
the first two terms become fold * sum of y). The check is one sparse matrix-vector product with the unreduced
matrix, in integers and fractions: rounding cannot make the bound too large, whoever found the multipliers.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from math import ceil
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from nbv.cover.instance import TOLERANCE, CoverInstance
from nbv.run.wording import count
from scenes.checks import FloatArray, InputError, frozen_copy

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
    def rounded(cls, multipliers: FloatArray, price: float = 0.0) -> Certificate:
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
class LowerBound:
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
