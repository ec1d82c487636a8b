# SPDX-License-Identifier: MIT
"""Tally: areas that were hidden, found, claimed and right, and the figures that follow from them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from benchmarks.completion.truth.strata import Stratum
from scenes.checks import FloatArray

TOLERANCES_M = (0.01, 0.02, 0.05)
HEADLINE = 1  # index of the tolerance that headline figures use
N_STRATA = max(Stratum) + 1


@dataclass(frozen=True, slots=True, eq=False)
class Tally:
    """Square metres.

    Attributes
    ----------
    hidden : (...,) float
        Reachable hidden area of the true surfaces.
    found : (..., 3) float
        Of it, what was inferred within each of `TOLERANCES_M`.
    claimed : (...,) float
        Inferred area that was hidden from the scans, or that they looked through.
    right : (..., 3) float
        Of it, what lies on a true surface within each of `TOLERANCES_M`.
    """

    hidden: FloatArray
    found: FloatArray
    claimed: FloatArray
    right: FloatArray

    @classmethod
    def zeros(cls, shape: tuple[int, ...]) -> Tally:
        """Return the empty tally."""
        n = len(TOLERANCES_M)
        return cls(np.zeros(shape), np.zeros((*shape, n)), np.zeros(shape), np.zeros((*shape, n)))

    def __add__(self, other: Tally) -> Tally:
        return Tally(
            self.hidden + other.hidden,
            self.found + other.found,
            self.claimed + other.claimed,
            self.right + other.right,
        )

    def pooled(self, surfaces: ArrayLike | None = None, strata: ArrayLike | None = None) -> Tally:
        """Return the sum over these rows (surfaces) and columns (strata), all of them when not given."""
        n_rows, n_columns = self.hidden.shape
        rows = np.arange(n_rows) if surfaces is None else np.atleast_1d(np.asarray(surfaces, dtype=np.int64))
        columns = np.arange(n_columns) if strata is None else np.atleast_1d(np.asarray(strata, np.int64))
        chosen = np.ix_(rows, columns)
        parts = (
            values[chosen].sum(axis=(0, 1)) for values in (self.hidden, self.found, self.claimed, self.right)
        )
        return Tally(*parts)

    @property
    def recall(self) -> FloatArray:
        """Share of the hidden area that was found, for each tolerance; NaN where nothing is hidden."""
        return _ratio(self.found, self.hidden[..., None])

    @property
    def precision(self) -> FloatArray:
        """Share of the claimed area that is right, for each tolerance; NaN where nothing was claimed."""
        return _ratio(self.right, self.claimed[..., None])

    @property
    def f1(self) -> FloatArray:
        """Harmonic mean of precision and recall."""
        return _ratio(2 * self.precision * self.recall, self.precision + self.recall)

    @property
    def iou(self) -> FloatArray:
        """Found area over hidden area and wrongly claimed area together; NaN where there is neither."""
        wrong = self.claimed[..., None] - self.right
        return _ratio(self.found, self.hidden[..., None] + wrong)


def total(tallies: Iterable[Tally], shape: tuple[int, ...] = ()) -> Tally:
    """Return the sum of tallies."""
    return sum(tallies, Tally.zeros(shape))


def _ratio(part: FloatArray, whole: FloatArray) -> FloatArray:
    whole = np.broadcast_to(whole, part.shape)
    ratio: FloatArray = np.divide(part, whole, out=np.full(part.shape, np.nan), where=whole > 0)
    return ratio
