# SPDX-License-Identifier: MIT
"""Levels of areas by least squares under the ripple, and areas that are level with one another."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from completion.flattening.pieces import Labels
from completion.flattening.ripple import Ripple
from scenes.checks import BoolArray, FloatArray

_PASSES = 3
_CHUNK = 8_192  # cells at a time
_USUAL = 3.0  # sd


@dataclass(frozen=True, slots=True, eq=False)
class Levels:
    """Levels (n,) of areas in metres, and their covariance (n, n).

    The ripple's longest waves are taken to be of any strength, so that differences are known, not the mean.
    """

    height_m: FloatArray
    covariance: FloatArray

    @classmethod
    def fitted(cls, heights: FloatArray, labels: Labels, ripple: Ripple, known: BoolArray) -> Levels:
        """Of heights (rows, columns) on a canvas that are levels by label plus ripple: least squares.

        Where heights are not `known` they follow the levels in turn, as the ripple is most probable there.
        """
        n = int(labels.max()) + 1
        columns = ripple.whitened_areas(labels, known)
        white = ripple.whitened(heights)[known].astype(np.float32)
        weight = np.ones_like(white)
        for turn in range(_PASSES):
            normal, right = _normal_equations(columns, weight, white)
            normal += 1e-8 * np.trace(normal) / n * np.eye(n)
            covariance = np.linalg.inv(normal)
            level = covariance @ right
            if turn + 1 == _PASSES:
                break
            rest = white - level.astype(np.float32) @ columns
            weight = np.minimum(1, (_USUAL / np.maximum(np.abs(rest), 1e-6)) ** 2).astype(np.float32)
            heights = level[labels] + ripple.continued(heights - level[labels], known)
            white = ripple.whitened(heights)[known].astype(np.float32)
        return cls(np.asarray(level, dtype=np.float64), np.asarray(covariance, dtype=np.float64))

    def variance_between(self, one: Labels, other: Labels) -> FloatArray:
        """Variance (n,) of the steps from some areas (n,) to others (n,), m^2."""
        both = self.covariance[one, one] + self.covariance[other, other] - 2 * self.covariance[one, other]
        return np.maximum(both, 1e-30)

    def against(self, one: Labels, other: Labels) -> FloatArray:
        """Evidence (n,) against some areas (n,) being level with others (n,): half the chi-square, nats."""
        out: FloatArray = (
            (self.height_m[one] - self.height_m[other]) ** 2 / self.variance_between(one, other) / 2
        )
        return out

    def with_equal(self, one: int, other: int) -> Levels:
        """The estimate given that two areas are level."""
        toward = self.covariance[one] - self.covariance[other]
        square = max(float(toward[one] - toward[other]), 1e-30)
        height = self.height_m - toward * ((self.height_m[one] - self.height_m[other]) / square)
        return Levels(height, self.covariance - np.outer(toward, toward) / square)

    def over(self, one: int) -> Levels:
        """Heights over one of the areas, with their covariance."""
        toward = self.covariance - self.covariance[one]
        return Levels(self.height_m - self.height_m[one], toward - toward[:, one][:, None])


def _normal_equations(
    columns: NDArray[np.float32], weight: NDArray[np.float32], white: NDArray[np.float32]
) -> tuple[FloatArray, FloatArray]:
    """Matrix (n, n) and right-hand side (n,) of levels by columns (n, m), of heights with weights (m,)."""
    n = len(columns)
    normal = np.zeros((n, n), np.float32)
    for first in range(0, columns.shape[1], _CHUNK):
        some = columns[:, first : first + _CHUNK]
        normal += (some * weight[first : first + _CHUNK]) @ some.T
    return normal.astype(np.float64), (columns @ (weight * white)).astype(np.float64)
