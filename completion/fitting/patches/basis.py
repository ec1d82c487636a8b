# SPDX-License-Identifier: MIT
"""B-spline bases along one side of a patch: clamped, with even knots."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import factorial

import numpy as np
from scipy.interpolate import BSpline, PPoly

from scenes.checks import FloatArray, InputError, IntArray, frozen_copy


@dataclass(frozen=True, slots=True, eq=False)
class Basis:
    """The `n` B-splines of a degree on [0, 1], clamped at both ends, between even knots.

    Attributes
    ----------
    n, degree : int
        How many, and their degree.
    knots : (n + degree + 1,) float
        In [0, 1], each end repeated.
    pieces : (spans, degree + 1, degree + 1) float
        Of each span the polynomial of each B-spline that lives there: by B-spline, then by power.

    Raises
    ------
    InputError
        Fewer B-splines than a polynomial of that degree has.
    """

    n: int
    degree: int
    knots: FloatArray
    pieces: FloatArray

    def __init__(self, n: int, degree: int) -> None:
        if n <= degree:
            raise InputError(
                f"{n} controls are too few along a side of degree {degree}; at least {degree + 1}"
            )
        inner = np.arange(1, n - degree) / (n - degree)
        knots = np.concatenate([np.zeros(degree + 1), inner, np.ones(degree + 1)])
        pieces = np.zeros((n - degree, degree + 1, degree + 1))
        for k in range(n):
            low, high = max(0, k - degree), min(n - degree - 1, k)
            powers = PPoly.from_spline(BSpline(knots, np.eye(n)[k], degree)).c[::-1, degree:n]
            for span in range(low, high + 1):
                pieces[span, k - span] = powers[:, span]
        object.__setattr__(self, "n", n)
        object.__setattr__(self, "degree", degree)
        object.__setattr__(self, "knots", frozen_copy(knots))
        object.__setattr__(self, "pieces", frozen_copy(pieces))

    @property
    def spans(self) -> int:
        """How many spans there are between knots."""
        return self.n - self.degree

    @property
    def stations(self) -> FloatArray:
        """The Greville abscissae (n,), at which values determine a spline well."""
        return np.array([self.knots[k + 1 : k + 1 + self.degree].mean() for k in range(self.n)])

    def span(self, at: FloatArray) -> IntArray:
        """Return the span (m,) in which each parameter (m,) lies: the number of its first B-spline."""
        return np.clip((at * self.spans).astype(np.int64), 0, self.spans - 1)

    def local(self, at: FloatArray, order: int = 0) -> FloatArray:
        """Return derivatives (m, degree + 1), of an order, of the B-splines that live at parameters (m,)."""
        span = self.span(at)
        offset = at - span / self.spans
        powers = np.arange(self.degree + 1)
        factors = [factorial(k) / factorial(k - order) if k >= order else 0.0 for k in powers]
        raised = offset[:, None] ** np.maximum(powers - order, 0) * np.array(factors)
        return np.asarray(np.einsum("mp,mkp->mk", raised, self.pieces[span]))

    def values(self, at: FloatArray, order: int = 0) -> FloatArray:
        """Return the derivatives (m, n), of an order, of all B-splines at parameters (m,)."""
        held = np.zeros((len(at), self.n))
        rows = np.arange(len(at))[:, None]
        held[rows, self.span(at)[:, None] + np.arange(self.degree + 1)] = self.local(at, order)
        return held

    def gram(self, order: int) -> FloatArray:
        """Return the integrals (n, n) of products of the B-splines' derivatives of an order."""
        nodes, weights = np.polynomial.legendre.leggauss(self.degree + 1)
        at = (np.arange(self.spans)[:, None] + (nodes + 1) / 2) / self.spans
        held = self.values(np.clip(at.ravel(), 0.0, np.nextafter(1.0, 0.0)), order)
        scaled = held * np.tile(weights / (2 * self.spans), self.spans)[:, None]
        return np.asarray(held.T @ scaled)


@lru_cache(maxsize=64)
def basis(n: int, degree: int) -> Basis:
    """Return the basis of n B-splines of a degree, made once."""
    return Basis(n, degree)
