# SPDX-License-Identifier: MIT
"""Image field: a smooth error over a scan's image, as large and as long as the residuals of surfaces show it.

Errors of the disparity, of a lens, of an interpolated table change slowly from pixel to pixel. They are taken
as a Gaussian random field over the image, in deviations of the range: a sum of bumps on a grid, with
correlation exp(-d2 / 2 l2). How large it is, and how long, is told by the components of residuals beyond the
fits (`residual_modes`), of which it explains the variance. Both are not known well from one scan: they are
averaged over, by their probability.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from completion.uncertainty.residual_modes import ResidualModes
from scenes.checks import FloatArray

LENGTHS = (0.2, 0.35, 0.6, 1.0, 2.0)
"""Correlation lengths, in half longer sides of the image; shorter ones show in blocks of pixels."""

_SQUARES = np.geomspace(1e-6, 100.0, 73)  # mean squares that are tried, in squared deviations of the range
_STUDENT = 30.0  # degrees of freedom of a surface's residuals: one that is bent by itself says little
_LEAST_WEIGHT = 1e-3  # of a length's probability


@dataclass(frozen=True, slots=True, eq=False)
class ImageField:
    """Smooth errors of a scan.

    Attributes
    ----------
    squares : dict of float to float
        By correlation length, the mean square of the field, in squared deviations of the range.
    freedom : float
        From how many independent components it was estimated.
    """

    squares: dict[float, float]
    freedom: float

    def shifts(self, modes: ResidualModes) -> FloatArray:
        """What the field does to a surface's fit: J'W f (k, b), for one deviation of each of b bumps."""
        size = len(modes.factor)
        taken = [np.zeros((size, 0))] + [
            np.sqrt(square) * modes.taken_on(bumps(modes.places, length))[:size]
            for length, square in self.squares.items()
        ]
        return np.asarray(modes.factor @ np.concatenate(taken, axis=1))


NO_FIELD = ImageField({}, np.inf)


def bumps(places: FloatArray, length: float) -> FloatArray:
    """Return Gaussian bumps (n, b) at places (n, 2) of an image, whose squares add up to 1 everywhere."""
    width = length / np.sqrt(2.0)  # their correlation is as long as two of them
    n = int(np.ceil(2.0 / length)) + 3
    centre = (np.arange(n) - (n - 1) / 2) * length
    x, y = (np.exp(-0.5 * np.square((one[:, None] - centre) / width)) for one in places.T)
    both = (x[:, :, None] * y[:, None, :]).reshape(len(places), -1)
    return np.asarray(both / (np.sqrt(np.pi) * width / length))


def fit_field(modes: Sequence[ResidualModes]) -> ImageField:
    """Return the smooth errors of a scan by the residual modes of its surfaces; none of no surface.

    A scan whose ranges are stated to be exact has no deviations in which errors could be told.
    The squares are weighted by their probability: Student's likelihood of the components of each surface,
    before it any size up to the noise's own is as probable, and larger ones less.
    """
    modes = [one for one in modes if one.gain.any()]
    if not modes:
        return NO_FIELD
    square = np.repeat([one.square for one in modes], [len(one.beyond) for one in modes])
    tried = {length: _Tried.of(modes, length, square) for length in LENGTHS}
    top = max(float(one.log_posterior.max()) for one in tried.values())
    weights = {length: np.exp(one.log_posterior - top) for length, one in tried.items()}
    total = sum(float(one.sum()) for one in weights.values())
    share = {length: float(one.sum()) / total for length, one in weights.items()}
    squares = {
        length: float(one @ _SQUARES) / total
        for length, one in weights.items()
        if share[length] >= _LEAST_WEIGHT
    }
    freedom = sum(share[length] * one.freedom for length, one in tried.items())
    return ImageField(squares, max(freedom, 1.0))


def mean_field(fields: Sequence[ImageField]) -> ImageField:
    """Return what holds of scans like these whose own field is not known."""
    if not fields:
        return NO_FIELD
    squares = {
        length: float(np.mean([one.squares.get(length, 0.0) for one in fields]))
        for length in LENGTHS
        if any(length in one.squares for one in fields)
    }
    return ImageField(squares, float(np.mean([one.freedom for one in fields])))


@dataclass(frozen=True, slots=True, eq=False)
class _Tried:
    """How probable each mean square (k,) of a field of one length is, and from how many components."""

    log_posterior: FloatArray
    freedom: float

    @classmethod
    def of(cls, modes: Sequence[ResidualModes], length: float, square: FloatArray) -> _Tried:
        """Try a length on surfaces, whose residuals' mean squares are repeated for each component (c,)."""
        taken = [one.taken_on(bumps(one.places, length))[len(one.factor) :] for one in modes]
        every = np.concatenate(taken)
        explained = np.square(every).sum(axis=1)
        log_likelihood = np.zeros(len(_SQUARES))
        first = 0
        for one in modes:
            own = slice(first, first + len(one.beyond))
            variance = square[own, None] + explained[own, None] * _SQUARES
            fit = (np.square(one.beyond)[:, None] / variance).sum(axis=0)
            log_likelihood -= 0.5 * np.log(variance).sum(axis=0)
            log_likelihood -= (_STUDENT + len(one.beyond)) / 2 * np.log1p(fit / _STUDENT)
            first = own.stop
        log_posterior = log_likelihood - np.log1p(_SQUARES)
        best = _SQUARES[int(np.argmax(log_posterior))]
        weight = 1.0 / np.sqrt(square + best * explained)
        alike = (every @ every.T) * np.outer(weight, weight)
        return cls(log_posterior, float(np.trace(alike) ** 2 / np.square(alike).sum()))
