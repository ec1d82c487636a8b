# SPDX-License-Identifier: MIT
"""Precision: how densely and how exactly an instrument measures a surface, by range and incidence."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nbv.scanning.effects.effects import Effects
from nbv.scanning.effects.noise_models import range_sigma_m
from scenes.checks import FloatArray

_GREY = 0.2  # reflectivity for which data sheets state noise, where nothing is known


@dataclass(frozen=True, slots=True)
class Precision:
    """Density and precision of the points that an instrument measures on a surface.

    Pixels, `pixel_angle` radians apart, and depth noise are taken at the middle of the image: off the axis
    pixels lie denser, so that the density is a lower limit there. Of the effects noise, pointing and
    quantisation count; the surface reflects what `effects.intensity` says, else 20 %. A station's position
    has a standard deviation in each direction, metres; a surface point is the mean of what was measured in a
    disc of the averaging radius, 0 for single points.
    """

    pixel_angle: float
    effects: Effects
    registration_sd_m: float = 0.0
    averaging_radius_m: float = 0.0

    @property
    def is_known(self) -> bool:
        """Whether the instrument's errors are known at all."""
        return any(
            s is not None for s in (self.effects.noise, self.effects.pointing, self.effects.quantisation)
        )

    @property
    def reflectivity(self) -> float:
        """Share of the light that the surface is taken to scatter."""
        light = self.effects.intensity
        return _GREY if light is None or light.reflectivity is None else light.reflectivity

    def density_per_m2(self, distance: FloatArray, cosine: FloatArray) -> FloatArray:
        """Return how many points fall on a square metre: cosine / (pixel_angle distance)^2.

        Parameters
        ----------
        distance, cosine : (n,) float
            Range in metres, cosine of incidence.

        Examples
        --------
        >>> Precision(1e-3, Effects()).density_per_m2(np.array([10.0]), np.array([0.5])).round(6).tolist()
        [5000.0]
        """
        return np.asarray(cosine / np.square(self.pixel_angle * distance), dtype=np.float64)

    def sd_m(self, distance: FloatArray, cosine: FloatArray) -> FloatArray:
        """Return the standard deviation of a surface point along the surface's normal, metres.

        Range noise and steps act along the ray: their component along the normal goes with the cosine of
        incidence. Pointing errors act across the ray: theirs goes with the sine. Averaging divides this
        variance by the number of points in the disc. The registration's variance adds to it.

        Parameters
        ----------
        distance, cosine : (n,) float
            Range in metres, cosine of incidence.
        """
        cosine = np.clip(cosine, 0.0, 1.0)
        incidence = np.arccos(cosine)
        variance = np.zeros_like(distance, dtype=np.float64)
        if self.effects.noise is not None:
            sigma = range_sigma_m(self.effects.noise, distance, incidence, 1.0, self.reflectivity)
            variance += np.square(sigma * cosine)
        if self.effects.quantisation is not None:
            variance += np.square(self.effects.quantisation.step_m(distance) * cosine) / 12
        if self.effects.pointing is not None:
            across = self.effects.pointing.sigma_rad(incidence, self.pixel_angle) * distance
            variance += np.square(across) * (1 - np.square(cosine))
        n_points = self.density_per_m2(distance, cosine) * np.pi * self.averaging_radius_m**2
        return np.sqrt(variance / np.maximum(n_points, 1.0) + self.registration_sd_m**2)
