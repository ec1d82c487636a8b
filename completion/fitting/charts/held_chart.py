# SPDX-License-Identifier: MIT
"""A chart some of whose parameters stay as they are given."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from completion.fitting.charts.chart import Chart
from scenes.checks import FloatArray
from scenes.surfaces.catalogue import Surface


@dataclass(frozen=True, slots=True, eq=False)
class HeldChart:
    """Another chart, stepped in its `free` parameters alone; the rest have no gradient.

    Parameters
    ----------
    inner : Chart
        Of the whole surface, where the held parameters have their given values.
    free : tuple of int
        Places of the parameters that are sought.
    """

    inner: Chart
    free: tuple[int, ...]

    @property
    def n_parameters(self) -> int:
        """How many are free."""
        return len(self.free)

    @property
    def origin(self) -> FloatArray:
        """The inner chart's origin (3,)."""
        return self.inner.origin

    @property
    def frame(self) -> FloatArray:
        """The inner chart's rows x, y, z (3, 3)."""
        return self.inner.frame

    def linearise(self, local: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Residuals (n,) and gradient (k, n) by the free parameters, at points (3, n)."""
        residual, gradient = self.inner.linearise(local)
        return residual, gradient[list(self.free)]

    def basis(self) -> FloatArray:
        """The inner chart's changes (k, k), as far as they leave the held parameters alone."""
        return self.inner.basis()[np.ix_(self.free, self.free)]

    def moved(self, change: FloatArray) -> HeldChart | None:
        """The chart after a step (k,) of the free parameters."""
        whole = np.zeros(self.inner.n_parameters)
        whole[list(self.free)] = change
        inner = self.inner.moved(whole)
        return None if inner is None else HeldChart(inner, self.free)

    def lengths(self) -> FloatArray:
        """1 for each free parameter that is a length, 0 for each angle (k,)."""
        return self.inner.lengths()[list(self.free)]

    def surface(self, centre: FloatArray, scale: float, concave: bool) -> Surface:
        """The inner chart's surface, scaled and moved by `centre` (3,)."""
        return self.inner.surface(centre, scale, concave)

    def size(self) -> float:
        """The inner chart's size."""
        return self.inner.size()

    def widened(self, covariance: FloatArray) -> FloatArray:
        """A covariance (k, k) of the free parameters as one of all, with zeros for what is held."""
        n = self.inner.n_parameters
        whole = np.zeros((n, n))
        whole[np.ix_(self.free, self.free)] = covariance
        return whole
