# SPDX-License-Identifier: MIT
"""Observation: a scan prepared for completion, and its measured beams with the surface that each met."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from completion.observe.noise_estimate import RangeNoise, estimate_noise
from scenes.checks import BoolArray, FloatArray
from scenes.pose import Pose
from scenes.scan.range_image import RangeImage


@dataclass(frozen=True, slots=True, eq=False)
class Observation:
    """A scan in the frame that completion works in.

    Attributes
    ----------
    scan : RangeImage
        The scan, its pose relative to the working frame.
    points, rays : (rows, columns, 3) float
        Measured points (NaN where nothing came back) and unit viewing rays.
    sigma : (rows, columns) float
        What each range may stray by from a flat surface (`RangeNoise.deviation`), metres.
    noise : RangeNoise
        The model behind `sigma`.
    """

    scan: RangeImage
    points: FloatArray
    rays: FloatArray
    sigma: FloatArray
    noise: RangeNoise

    @property
    def is_noisy(self) -> bool:
        """Whether the ranges carry noise at all."""
        return self.noise.constant_m > 0 or self.noise.quadratic_per_m > 0

    @property
    def valid(self) -> BoolArray:
        """Where something came back, (rows, columns)."""
        return self.scan.valid


def observe(scan: RangeImage, reference_from_world: Pose, sigma_m: float | None = None) -> Observation:
    """Prepare `scan` in the frame that `reference_from_world` leads to.

    Parameters
    ----------
    scan : RangeImage
        The scan as read.
    reference_from_world : Pose
        Motion into the working frame.
    sigma_m : float, optional
        Range noise in metres; when None, the scan's own `sigma_m` or, without one, an estimate from the
        scan: the roughness of small tiles, most of which are flat.
    """
    moved = scan.transformed(reference_from_world)
    rays = moved.rays()
    reach = np.where(moved.valid, moved.ranges, np.nan)
    points: FloatArray = moved.origin + reach[..., None] * rays
    known = scan.sigma_m if sigma_m is None else sigma_m
    noise = estimate_noise(moved, rays) if known is None else RangeNoise(float(known), 0.0)
    return Observation(moved, points, rays, noise.deviation(reach), noise)


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
        """Return all beams that met the surfaces of these numbers (k,), from 1."""
        return self._only(np.flatnonzero(np.isin(self.label, numbers)))

    def _only(self, chosen: slice | NDArray[np.int64]) -> Beams:
        return Beams(
            self.origin, self.label[chosen], self.ranges[chosen], self.sigma[chosen], self.rays[chosen]
        )
