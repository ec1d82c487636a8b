# SPDX-License-Identifier: MIT
"""The patch: a tensor product B-spline surface, its bases, points, normals and boundaries."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import factorial
from typing import Literal

import numpy as np
from scipy.interpolate import BSpline, PPoly
from scipy.sparse import csr_array

from scenes.checks import FloatArray, InputError, IntArray, Value, frozen_copy


@dataclass(frozen=True, slots=True, eq=False)
class Basis(Value):
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


SideName = Literal["u0", "u1", "v0", "v1"]
SIDES: tuple[SideName, ...] = ("u0", "u1", "v0", "v1")
"""The boundaries of a patch: where u is 0, where it is 1, and so on."""


@dataclass(frozen=True, slots=True, eq=False)
class SplinePatch(Value):
    """A B-spline surface over u and v in [0, 1], clamped, between even knots.

    Parameters
    ----------
    controls : (n, m, 3) float
        Control points, u first, in the unit of the points.
    degree : (int, int)
        Along u and along v.

    Raises
    ------
    InputError
        Controls of another shape, or fewer along a side than its degree needs.

    Examples
    --------
    >>> flat = np.stack(np.meshgrid(np.linspace(0, 1, 4), np.linspace(0, 1, 4), [0.0], indexing="ij"), -1)
    >>> SplinePatch(flat[:, :, 0]).at(np.array([[0.25, 0.5]])).round(6).tolist()
    [[0.25, 0.5, 0.0]]
    """

    controls: FloatArray
    degree: tuple[int, int]

    def __init__(self, controls: object, degree: tuple[int, int] = (3, 3)) -> None:
        held = np.asarray(controls, dtype=np.float64)
        if held.ndim != 3 or held.shape[2] != 3:
            raise InputError(f"expected controls with shape (n, m, 3), got {held.shape}")
        for n, number in zip(held.shape[:2], degree, strict=True):
            basis(n, number)
        object.__setattr__(self, "controls", frozen_copy(held))
        object.__setattr__(self, "degree", degree)

    @property
    def bases(self) -> tuple[Basis, Basis]:
        """The bases along u and along v."""
        n, m, _ = self.controls.shape
        return basis(n, self.degree[0]), basis(m, self.degree[1])

    @property
    def knots(self) -> tuple[FloatArray, FloatArray]:
        """The knots along u (n + degree + 1,) and along v (m + degree + 1,), each end repeated."""
        along_u, along_v = self.bases
        return along_u.knots, along_v.knots

    def at(self, uv: FloatArray, order: tuple[int, int] = (0, 0)) -> FloatArray:
        """Return the points (k, 3), or derivatives of an order, at parameters (k, 2)."""
        rows = products(self.bases, uv, order)
        return np.asarray(rows @ self.controls.reshape(-1, 3))

    def normals(self, uv: FloatArray) -> FloatArray:
        """Return the unit normals (k, 3), along u x v, at parameters (k, 2); NaN where there is none."""
        across = np.cross(self.at(uv, (1, 0)), self.at(uv, (0, 1)))
        with np.errstate(all="ignore"):
            return np.asarray(across / np.linalg.norm(across, axis=1, keepdims=True))

    def scale_and_shift(self, factor: float, offset: FloatArray) -> SplinePatch:
        """Return it made larger by a factor, then moved by (3,)."""
        return SplinePatch(self.controls * factor + offset, self.degree)

    moved = scale_and_shift  # earlier name


def products(bases: tuple[Basis, Basis], uv: FloatArray, order: tuple[int, int] = (0, 0)) -> csr_array:
    """Return the products (k, n m) of the bases' derivatives at parameters (k, 2), as a sparse matrix."""
    along_u, along_v = bases
    values = along_u.local(uv[:, 0], order[0])[:, :, None] * along_v.local(uv[:, 1], order[1])[:, None, :]
    first = along_u.span(uv[:, 0]) * along_v.n + along_v.span(uv[:, 1])
    inner = np.arange(along_u.degree + 1)[:, None] * along_v.n + np.arange(along_v.degree + 1)
    n_each = inner.size
    columns = (first[:, None] + inner.ravel()).astype(np.int32)
    ends = np.arange(0, (len(uv) + 1) * n_each, n_each, dtype=np.int32)
    return csr_array((values.ravel(), columns.ravel(), ends), shape=(len(uv), along_u.n * along_v.n))


def side_places(side: SideName, along: FloatArray) -> FloatArray:
    """Return the parameters (k, 2) of places (k,) along a boundary."""
    end = np.full(len(along), float(side[1]))
    return np.column_stack([end, along] if side[0] == "u" else [along, end])


def side_rows(side: SideName, n: int, m: int) -> tuple[FloatArray, FloatArray]:
    """Return the numbers (k,) of the controls on a boundary, and of those one row inside, row after row."""
    number = np.arange(n * m).reshape(n, m)
    turned = number if side[0] == "u" else number.T
    return (turned[0], turned[1]) if side[1] == "0" else (turned[-1], turned[-2])
