# SPDX-License-Identifier: MIT
"""Calibration: whether predicted deviations and confidences are what the truth makes of them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from scenes.checks import BoolArray, FloatArray

N_BINS = 10


@dataclass(frozen=True, slots=True, eq=False)
class Reliability:
    """Predicted confidence against what came true, weighted by area.

    Attributes
    ----------
    area, predicted, right : (..., 10) float
        For each tenth of the confidence scale: square metres, and those times confidence and times truth.
    squared : (...,) float
        Square metres times the squared difference between confidence and truth.
    """

    area: FloatArray
    predicted: FloatArray
    right: FloatArray
    squared: FloatArray

    @classmethod
    def of(cls, confidence: FloatArray, right: BoolArray, areas: FloatArray) -> Reliability:
        """Return the reliability of n places with confidences (n,), which were right or not (n,)."""
        tenth = np.clip((confidence * N_BINS).astype(np.int64), 0, N_BINS - 1)

        def binned(weight: FloatArray) -> FloatArray:
            return np.asarray(np.bincount(tenth, weight, N_BINS), dtype=np.float64)

        return cls(
            binned(areas),
            binned(areas * confidence),
            binned(areas * right),
            np.asarray(np.sum(areas * np.square(confidence - right)), dtype=np.float64),
        )

    def __add__(self, other: Reliability) -> Reliability:
        return Reliability(
            self.area + other.area,
            self.predicted + other.predicted,
            self.right + other.right,
            self.squared + other.squared,
        )

    @property
    def brier(self) -> FloatArray:
        """Mean squared difference between confidence and truth, NaN without area (Brier 1950)."""
        return self._share(self.squared)

    @property
    def error(self) -> FloatArray:
        """Expected calibration error: mean |confidence - frequency| over the bins, NaN without area."""
        return self._share(np.abs(self.predicted - self.right).sum(axis=-1))

    def _share(self, part: FloatArray) -> FloatArray:
        area = self.area.sum(axis=-1)
        share: FloatArray = np.divide(part, area, out=np.full(np.shape(area), np.nan), where=area > 0)
        return share


def no_reliability() -> Reliability:
    """Return the reliability of nothing."""
    return Reliability(np.zeros(N_BINS), np.zeros(N_BINS), np.zeros(N_BINS), np.zeros(()))


@dataclass(frozen=True, slots=True)
class ReasonClaims:
    """What was inferred for one reason: how much, how much of it is right, and how sure it was.

    Attributes
    ----------
    reason : str
        Its name.
    claimed_m2, right_m2 : float
        Square metres.
    predicted_m2 : float
        Claimed square metres times predicted confidence.
    """

    reason: str
    claimed_m2: float
    right_m2: float
    predicted_m2: float


@dataclass(frozen=True, slots=True)
class SurfaceErrors:
    """How one inferred surface's errors compare with what it predicted.

    Attributes
    ----------
    area_m2 : float
        Its claimed area.
    sd_m : float
        Median predicted standard deviation, metres.
    within : float
        Share of its area no farther than twice that from a true surface, whichever that is.
    within_own : float
        Share no farther than that from the unbounded surface that it continues; NaN if it continues none.
    """

    area_m2: float
    sd_m: float
    within: float
    within_own: float


@dataclass(frozen=True, slots=True)
class DeviationBin:
    """Surfaces of similar predicted deviation: how many, the median and how much lies within two of it."""

    n_surfaces: int
    sd_m: float
    within: float
    within_own: float


def deviation_bins(surfaces: Iterable[SurfaceErrors], n_bins: int = 4) -> list[DeviationBin]:
    """Return surfaces in `n_bins` classes of predicted deviation, each surface counting once."""
    ordered = sorted(surfaces, key=lambda surface: surface.sd_m)
    chunks = [ordered[i * len(ordered) // n_bins : (i + 1) * len(ordered) // n_bins] for i in range(n_bins)]
    return [summary(chunk) for chunk in chunks if chunk]


def summary(surfaces: Iterable[SurfaceErrors]) -> DeviationBin:
    """Return the surfaces as one class; NaN where there are none."""
    rows = list(surfaces)
    own = [row.within_own for row in rows if np.isfinite(row.within_own)]
    if not rows:
        return DeviationBin(0, float("nan"), float("nan"), float("nan"))
    return DeviationBin(
        len(rows),
        float(np.median([row.sd_m for row in rows])),
        float(np.mean([row.within for row in rows])),
        float(np.mean(own)) if own else float("nan"),
    )
