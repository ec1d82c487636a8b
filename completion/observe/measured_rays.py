# SPDX-License-Identifier: MIT
"""Beams: measured rays from one place, each with the surface that it met."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from completion.observe.observation import Observation
from scenes.checks import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Beams:
    """Measured beams from one place, with the number, from 1, of the surface that each met; 0 for none.

    Attributes
    ----------
    origin : (3,) float
        Where they start, metres.
    label : (n,) int32
        Surface of each.
    ranges, sigma : (n,) float
        Measured range and its standard deviation, metres.
    rays : (n, 3) float
        Unit directions.
    """

    origin: FloatArray
    label: NDArray[np.int32]
    ranges: FloatArray
    sigma: FloatArray
    rays: FloatArray

    @classmethod
    def of(cls, observation: Observation, label: NDArray[np.int32]) -> Beams:
        """All beams of a scan, from labels (rows, columns)."""
        scan = observation.scan
        return cls(
            scan.origin,
            label.ravel(),
            scan.ranges.ravel(),
            observation.sigma.ravel(),
            observation.rays.reshape(-1, 3),
        )

    def thinned(self, step: int) -> Beams:
        """Every step-th beam."""
        return self._only(slice(None, None, step))

    def of_surfaces(self, numbers: NDArray[np.int64]) -> Beams:
        """All beams that met these surfaces, the numbers from 1."""
        return self._only(np.flatnonzero(np.isin(self.label, numbers)))

    def _only(self, chosen: slice | NDArray[np.int64]) -> Beams:
        return Beams(
            self.origin, self.label[chosen], self.ranges[chosen], self.sigma[chosen], self.rays[chosen]
        )
