# SPDX-License-Identifier: MIT
"""Requirement: what a measurement of a surface point must satisfy to count."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from nbv.scanning.sensor import Sensor
from scenes.checks import InputError

GRAZING_COSINE = 0.02  # flatter than this (88.9 deg) nothing counts as seen


@dataclass(frozen=True, slots=True)
class SightLimits:
    """Smallest |cosine| of incidence and range gate (metres) within which a line of sight counts."""

    min_cosine: float = GRAZING_COSINE
    min_range_m: float = 0.0
    max_range_m: float = float("inf")


@dataclass(frozen=True, slots=True, kw_only=True)
class Requirement:
    """What counts as measured well enough.

    Parameters
    ----------
    max_incidence_deg : float
        Largest angle between line of sight and surface normal, degrees, 0 < angle <= 90; 90 asks for
        visibility alone (up to 88.9 deg).
    max_range_m : float, optional
        Largest range in metres; the sensor's own limit when not given.

    Raises
    ------
    InputError
        An angle outside 0..90 deg, a range that is not positive.

    Examples
    --------
    >>> round(Requirement(max_incidence_deg=60).min_cosine, 6)
    0.5
    """

    max_incidence_deg: float = 60.0
    max_range_m: float | None = None

    def __post_init__(self) -> None:
        if not 0 < self.max_incidence_deg <= 90:
            raise InputError(f"max_incidence_deg must lie in 0..90 deg, got {self.max_incidence_deg}")
        if self.max_range_m is not None and not self.max_range_m > 0:
            raise InputError(f"max_range_m must be positive, got {self.max_range_m}")

    @property
    def min_cosine(self) -> float:
        """The smallest cosine of incidence that counts."""
        return max(float(np.cos(np.radians(self.max_incidence_deg))), GRAZING_COSINE)

    def limits(self, sensor: Sensor) -> SightLimits:
        """Limits under which `sensor` meets the requirement."""
        seen = self.visibility(sensor)
        return SightLimits(self.min_cosine, seen.min_range_m, seen.max_range_m)

    def visibility(self, sensor: Sensor) -> SightLimits:
        """Limits under which `sensor` sees a point at all, at any incidence."""
        farthest = min(sensor.max_range_m, self.max_range_m or np.inf)
        return SightLimits(GRAZING_COSINE, sensor.min_range_m, farthest)

    def to_json(self) -> dict[str, Any]:
        """Return the entries of `plan.json` and `coverage.json`."""
        return {"max_incidence_deg": self.max_incidence_deg, "max_range_m": self.max_range_m}
