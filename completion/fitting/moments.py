# SPDX-License-Identifier: MIT
"""Moments: the 35 sums of monomials that stand for any number of points, and their centroid."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from math import comb

import numpy as np

from scenes.checks import FloatArray, check_point, check_points, check_vectors

_SQUARES = ((2, 0, 0), (0, 2, 0), (0, 0, 2), (1, 1, 0), (1, 0, 1), (0, 1, 1))
MONOMIALS = (*_SQUARES, (1, 0, 0), (0, 1, 0), (0, 0, 1), (0, 0, 0))
"""Exponents of x2, y2, z2, xy, xz, yz, x, y, z, 1: the order of a quadric's ten coefficients."""

EXPONENTS = tuple(sorted((e for e in product(range(5), repeat=3) if sum(e) <= 4), key=lambda e: (sum(e), e)))
_PLACE = {exponents: place for place, exponents in enumerate(EXPONENTS)}
_LINEAR = [_PLACE[exponents] for exponents in MONOMIALS[6:9]]
_PAIRS = np.array([[_PLACE[tuple(np.add(a, b))] for b in MONOMIALS] for a in MONOMIALS])
_CHUNK = 8192


@dataclass(frozen=True, slots=True, eq=False)
class Moments:
    """Sums over points of x^i y^j z^k, i + j + k <= 4, about `centre`.

    Attributes
    ----------
    centre : (3,) float
        What coordinates are relative to, metres.
    sums : (35,) float
        In the order of `EXPONENTS`, in powers of metres; the first is the number of points.

    Examples
    --------
    >>> left, right = np.eye(3), -np.eye(3)
    >>> both = moments(left).merge(moments(right))
    >>> both.n, both.mean().round(12).tolist()
    (6, [0.0, 0.0, 0.0])
    """

    centre: FloatArray
    sums: FloatArray

    @property
    def n(self) -> int:
        """Number of points."""
        return round(float(self.sums[0]))

    def mean(self) -> FloatArray:
        """The centroid (3,), metres."""
        return np.asarray(self.centre + self.sums[_LINEAR] / self.sums[0], dtype=np.float64)

    def gram(self) -> FloatArray:
        """Sums of m m' (10, 10), m the ten monomials of a quadric."""
        return np.asarray(self.sums[_PAIRS], dtype=np.float64)

    def about(self, centre: object) -> Moments:
        """The same moments about another centre, by the binomial theorem."""
        target = check_point("centre", centre)
        shift = self.centre - target
        powers = shift[:, None] ** np.arange(5)[None, :]
        sums = np.zeros(len(EXPONENTS))
        for place, (i, j, k) in enumerate(EXPONENTS):
            for a, b, c in product(range(i + 1), range(j + 1), range(k + 1)):
                factor = comb(i, a) * comb(j, b) * comb(k, c)
                weight = powers[0, i - a] * powers[1, j - b] * powers[2, k - c]
                sums[place] += factor * weight * self.sums[_PLACE[a, b, c]]
        return Moments(target, sums)

    def scale(self, scale: float) -> Moments:
        """The moments of the points divided by `scale`; the centre is the origin then."""
        order = np.array([sum(exponents) for exponents in EXPONENTS])
        return Moments(np.zeros(3), self.sums / float(scale) ** order)

    def merge(self, other: Moments) -> Moments:
        """The moments of both sets of points, about the centroid of this one."""
        here = self.about(self.mean())
        return Moments(here.centre, here.sums + other.about(here.centre).sums)

    def radius(self) -> float:
        """Root mean square distance from the centroid, metres."""
        central = self.about(self.mean())
        return float(np.sqrt(sum(central.sums[_PLACE[e]] for e in MONOMIALS[:3]) / central.sums[0]))


def centroid(points: FloatArray) -> FloatArray:
    """The mean (3,) of points (n, 3) by one product, several times as fast as numpy's mean of rows."""
    with np.errstate(all="ignore"):
        return np.asarray(np.ones(len(points)) @ points / max(len(points), 1), dtype=np.float64)


def moments(points: object, centre: object | None = None) -> Moments:
    """Sum the monomials of `points` (n, 3) in one pass; about their centroid unless `centre` is given."""
    cloud = check_vectors("points", points)
    mean = centroid(cloud)
    if not np.isfinite(mean).all():
        cloud = check_points("points", cloud)  # says which are not finite
    about = mean if centre is None else check_point("centre", centre)
    gram, buffer = np.zeros((10, 10)), np.ones((10, min(_CHUNK, len(cloud))))
    for first in range(0, len(cloud), _CHUNK):
        chunk = cloud[first : first + _CHUNK]
        rows = buffer[:, : len(chunk)]
        np.subtract(chunk.T, about[:, None], out=rows[6:9])
        x, y, z = rows[6:9]
        np.multiply(rows[6:9], rows[6:9], out=rows[:3])
        np.multiply(x, rows[7:9], out=rows[3:5])
        np.multiply(y, z, out=rows[5])
        gram += rows @ rows.T
    sums = np.zeros(len(EXPONENTS))
    sums[_PAIRS.ravel()] = gram.ravel()
    return Moments(about, sums)
