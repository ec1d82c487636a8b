# SPDX-License-Identifier: MIT
"""Prior: how probable it is, before parts are compared, that two of them are one surface."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from completion.merging.agreement import Part
from scenes.checks import BoolArray, FloatArray

_LEAST_AREA = 1e-9  # of a part's outline, square metres


@dataclass(frozen=True, slots=True, eq=False)
class Prior:
    """Odds that two of n parts are one surface, by what else is near and by the gap between them."""

    parts: Sequence[Part]
    boxes: FloatArray  # (n, 2, 3) least and greatest coordinates of each, metres
    is_curved: BoolArray  # (n,)
    n_scans: int  # that they are of

    @classmethod
    def of(cls, parts: Sequence[Part], n_scans: int) -> Prior:
        """Return the prior of the parts of so many scans."""
        boxes = np.array([one.box for one in parts]).reshape(-1, 2, 3)
        return cls(parts, boxes, np.array([one.form.is_curved for one in parts], dtype=np.bool_), n_scans)

    def log_odds(self, first: int, second: int) -> float:
        """Logarithm of the odds that two parts, by their indices, are one surface.

        A part has about one in its scan that goes on with it. With k others of its kind that are nearer than
        the second is, the odds for the second are 1 to k + 1: what is joined across a crowd agrees by chance
        more often. The nearer side's count holds.

        What is joined is claimed to go on over the gap as well. The size of things has no scale of its own,
        and with the prior 1 / A^2 of areas a surface of at least A0 has at least A with probability A0 / A
        (Gott 1993): A0 is what the outlines of both parts hold, A what the outline around both holds.
        """
        nearer = min(self._n_nearer(first, second), self._n_nearer(second, first))
        return -float(np.log1p(nearer / self.n_scans)) - _log_growth(self.parts[first], self.parts[second])

    def _n_nearer(self, first: int, second: int) -> int:
        """How many parts of its kind may be nearer to the first than the second is."""
        low, high = self.boxes[:, 0], self.boxes[:, 1]
        apart = np.maximum(np.maximum(low - high[first], low[first] - high), 0.0)
        square = np.einsum("ij,ij->i", apart, apart)
        rivals = (square < square[second]) & (self.is_curved == self.is_curved[first])
        return int(np.count_nonzero(rivals)) - int(rivals[first])


def _log_growth(one: Part, other: Part) -> float:
    """Logarithm of how many times the outline around both holds what their own outlines hold."""
    surface = other.fit.surface
    first, second = surface.to_uv(one.points), surface.to_uv(other.points)
    if np.isfinite(surface.period):
        first[:, 0] += np.rint((second[:, 0].mean() - first[:, 0]) / surface.period) * surface.period
    seen = max(_outlined(first) + _outlined(second), _LEAST_AREA)
    return float(np.log(max(_outlined(np.concatenate([first, second])) / seen, 1.0)))


def _outlined(uv: FloatArray) -> float:
    """Area of the convex hull of points (n, 2), square metres."""
    return float(cv2.contourArea(cv2.convexHull(uv.astype(np.float32))))
