# SPDX-License-Identifier: MIT
"""Intensity: how much light of a beam comes back from a matt surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scenes.checks import FloatArray, check_options

_LUMINANCE = np.array([0.2126, 0.7152, 0.0722])  # of linear sRGB, ITU-R BT.709


@dataclass(frozen=True, slots=True, kw_only=True)
class Intensity:
    """Lambert's law and the inverse square of the range: rho cos(theta) (reference / r)^2.

    The value is 1 for a white surface that faces the beam at the reference range.

    Parameters
    ----------
    reflectivity : float, optional
        rho of every surface, 0..1; from the colour at the hit when not given.
    reference_range_m : float
        Metres.

    Raises
    ------
    InputError
        A reflectivity outside 0..1, a reference range that is not positive.
    """

    reflectivity: float | None = None
    reference_range_m: float = 10.0

    def __post_init__(self) -> None:
        check_options(self, reflectivity=(0.0, 1.0), reference_range_m=(1e-6, np.inf))

    def reflectivity_of(self, colour: NDArray[np.float32]) -> FloatArray | float:
        """Reflectivity, the given one or that of `colour` (..., 3), sRGB in 0..1."""
        return reflectivity_of_colour(colour) if self.reflectivity is None else self.reflectivity

    def of(
        self, ranges: FloatArray, cosine: FloatArray, reflectivity: FloatArray | float
    ) -> NDArray[np.float32]:
        """Intensity of echoes from `ranges` (m) at this `|cosine|` of incidence; 0 where nothing was met."""
        with np.errstate(divide="ignore", invalid="ignore"):
            light = reflectivity * cosine * (self.reference_range_m / ranges) ** 2
        return np.asarray(np.where(np.isfinite(ranges) & (ranges > 0), light, 0.0), dtype=np.float32)


def reflectivity_of_colour(colour: NDArray[np.float32]) -> FloatArray:
    """Luminance of sRGB colours (..., 3) in 0..1: the share of light that a matt surface scatters."""
    encoded = np.clip(np.asarray(colour, dtype=np.float64), 0.0, 1.0)
    linear = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    luminance: FloatArray = linear @ _LUMINANCE
    return luminance
