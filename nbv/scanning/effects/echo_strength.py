# SPDX-License-Identifier: MIT
"""Echo strength: how much light of a beam comes back, and which echoes are lost."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scenes.checks import BoolArray, FloatArray, check_options

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
        """Return the intensity (...,) of echoes; 0 where nothing was met.

        Parameters
        ----------
        ranges, cosine : (...,) float
            Metres, inf where nothing was met, and the absolute cosine of incidence.
        reflectivity : float or (...,) float
            0..1.
        """
        with np.errstate(divide="ignore", invalid="ignore"):
            light = reflectivity * cosine * (self.reference_range_m / ranges) ** 2
        return np.asarray(np.where(np.isfinite(ranges) & (ranges > 0), light, 0.0), dtype=np.float32)


def reflectivity_of_colour(colour: NDArray[np.float32]) -> FloatArray:
    """Luminance of sRGB colours (..., 3) in 0..1: the share of light that a matt surface scatters."""
    encoded = np.clip(np.asarray(colour, dtype=np.float64), 0.0, 1.0)
    linear = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    luminance: FloatArray = linear @ _LUMINANCE
    return luminance


@dataclass(frozen=True, slots=True, kw_only=True)
class Dropout:
    """Which echoes are lost.

    A glossy surface sends a beam that meets it at incidence theta into the direction 2 theta off the way
    back. With probability `specular_loss` (1 - max(0, cos 2 theta)^`specular_exponent`) nothing comes back:
    never when the surface faces the sensor, with `specular_loss` when it is turned by 45 deg or more. The
    exponent is that of Phong's lobe.

    Parameters
    ----------
    min_intensity : float
        Weaker echoes are lost; see `nbv.scanning.effects.echo_strength` for the scale.
    max_incidence_deg : float
        Echoes at larger incidence are lost, degrees.
    specular_loss : float
        Share of echoes that glossiness may cost, 0..1.
    specular_exponent : float
        How narrow the mirror's lobe is.

    Raises
    ------
    InputError
        Values outside these bounds.
    """

    min_intensity: float = 0.0
    max_incidence_deg: float = 90.0
    specular_loss: float = 0.0
    specular_exponent: float = 20.0

    def __post_init__(self) -> None:
        check_options(self, min_intensity=(0.0, np.inf), max_incidence_deg=(0.0, 90.0))
        check_options(self, specular_loss=(0.0, 1.0), specular_exponent=(0.0, np.inf))

    def kept(
        self, intensity: NDArray[np.float32], incidence: FloatArray, rng: np.random.Generator
    ) -> BoolArray:
        """Tell which echoes (...,) are kept; one uniform number is drawn for every pixel.

        Parameters
        ----------
        intensity, incidence : (...,) float
            On the scale of `Intensity`, and in radians.
        rng : Generator
            Drawn from where glossiness costs echoes.
        """
        with np.errstate(invalid="ignore"):
            kept = (intensity >= self.min_intensity) & ~(incidence > np.radians(self.max_incidence_deg))
            if self.specular_loss > 0:
                lobe = np.maximum(np.cos(2 * incidence), 0.0) ** self.specular_exponent
                kept &= ~(rng.random(incidence.shape) < self.specular_loss * (1 - lobe))
        return np.asarray(kept, dtype=np.bool_)
