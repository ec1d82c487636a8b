# SPDX-License-Identifier: MIT
"""Noise of beams on faces: how residuals grow with range and incidence, as the faces themselves show it.

What a file states of its noise is one number, and what a beam's direction is off by nobody states. Across a
face seen at an angle of incidence i from a distance r, the standard deviation s of a beam is

    s^2 = (c0 + c1 r^2 + c2 r^4) cos(i)^2 + c3 r^2 sin(i)^2,

with ranges whose noise is constant, grows evenly, or is that of a disparity, and with directions that
scatter (lateral noise: Nguyen, Izadi & Lovell 2012, section 3). The factors are fitted to robust variances
over bins of range and incidence, none of them negative.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from scenes.checks import FloatArray

_BINS_R, _BINS_COSINE = 10, 5
_FEWEST = 200  # beams of a bin that tell a variance
_LEAST = 0.01  # of the median variance of bins: rounded ranges of a face may all be one number


def fitted_sigma(
    residual: FloatArray,
    ranges: FloatArray,
    cosine: FloatArray,
    instrument: NDArray[Any],
    used: NDArray[np.bool_],
) -> FloatArray:
    """Return the standard deviation (n,) of each beam across its face, metres; NaN where too few tell.

    Parameters
    ----------
    residual, ranges, cosine : (n,) float
        Distance from the face's surface, metres; distance from the scanner; of the angle of incidence.
    instrument : (n,) int
        Beams of which instrument each is.
    used : (n,) bool
        Those on surfaces, from which it is fitted.
    """
    sigma = np.full(len(residual), np.nan)
    for kind in np.unique(instrument):
        own = instrument == kind
        factors = _fit(residual[own & used], _terms(ranges[own & used], cosine[own & used]))
        if factors is not None:
            sigma[own] = np.sqrt(_terms(ranges[own], cosine[own]) @ factors)
    return sigma


def _terms(ranges: FloatArray, cosine: FloatArray) -> FloatArray:
    square = np.square(ranges)
    facing = np.square(cosine)
    return np.column_stack([facing, square * facing, square**2 * facing, square * (1 - facing)])


def _fit(residual: FloatArray, terms: FloatArray) -> FloatArray | None:
    """Factors (4,), None where no bin has enough beams."""
    if len(residual) < _FEWEST:
        return None
    facing = terms[:, 0]
    ranges = np.sqrt(terms[:, 1] / facing)
    edges = np.quantile(ranges, np.linspace(0, 1, _BINS_R + 1)[1:-1])
    cell = np.searchsorted(edges, ranges) * _BINS_COSINE
    cell += np.minimum((np.sqrt(facing) * _BINS_COSINE).astype(np.int64), _BINS_COSINE - 1)
    rows, variances = [], []
    for k in np.unique(cell):
        mine = np.flatnonzero(cell == k)
        if len(mine) >= _FEWEST:
            rows.append(terms[mine].mean(axis=0))
            variances.append((1.4826 * np.median(np.abs(residual[mine]))) ** 2)
    if not rows or not np.isfinite(variances).all():
        return None
    variance = np.maximum(np.array(variances), max(_LEAST * float(np.median(variances)), 1e-14))
    # relative errors: each bin counts alike
    return np.asarray(nnls(np.array(rows) / variance[:, None], np.ones(len(rows)))[0])
