# SPDX-License-Identifier: MIT
"""Requirement: what a measurement of a surface point must satisfy to count."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from nbv.run.plan_options import RequirementOptions
from nbv.scanning.effects import Effects
from nbv.scanning.noise_models import ConstantNoise, range_sigma_m
from nbv.scanning.sensor import Sensor
from nbv.visibility.limits import GRAZING_COSINE
from scenes.checks import BoolArray, FloatArray, InputError, Value
from scenes.scan.range_image import RangeImage

_GREY = 0.2  # reflectivity for which data sheets state noise, where nothing is known


@dataclass(frozen=True, slots=True)
class Precision(Value):
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


ROUNDING = 1e-12  # of cosines, densities and deviations that are compared with a limit


@dataclass(frozen=True, slots=True)
class SightLimits(Value):
    """Limits within which a line of sight counts: cosine of incidence, without sign, range gate in metres.

    Fewest points on a square metre and largest standard deviation in metres need `precision`: what the
    instrument makes of a surface.
    """

    min_cosine: float = GRAZING_COSINE
    min_range_m: float = 0.0
    max_range_m: float = float("inf")
    min_density_per_m2: float = 0.0
    max_sd_m: float = float("inf")
    precision: Precision | None = None

    def in_range(self, distance: FloatArray) -> BoolArray:
        """Tell which ranges (n,) lie in the gate."""
        inside: BoolArray = (distance >= self.min_range_m) & (distance <= self.max_range_m) & (distance > 0)
        return inside

    def steep_enough(self, cosine: FloatArray) -> BoolArray:
        """Tell which cosines of incidence (n,) are large enough."""
        return np.asarray(cosine >= self.min_cosine - ROUNDING)

    def dense_enough(self, distance: FloatArray, cosine: FloatArray) -> BoolArray:
        """Tell where points, by range in metres and cosine (n,), would lie densely enough."""
        if self.precision is None or self.min_density_per_m2 == 0:
            return np.ones(len(distance), dtype=np.bool_)
        density = self.precision.density_per_m2(distance, cosine)
        return density >= self.min_density_per_m2 * (1 - ROUNDING)

    def exact_enough(self, distance: FloatArray, cosine: FloatArray) -> BoolArray:
        """Tell where points, by range in metres and cosine (n,), would be exact enough."""
        if self.precision is None or np.isinf(self.max_sd_m):
            return np.ones(len(distance), dtype=np.bool_)
        return self.precision.sd_m(distance, cosine) <= self.max_sd_m * (1 + ROUNDING)

    def hold(self, distance: FloatArray, cosine: FloatArray) -> BoolArray:
        """Tell which lines of sight, by range and cosine (n,), satisfy all limits."""
        held = self.in_range(distance) & self.steep_enough(cosine)
        at = np.flatnonzero(held)
        distance, cosine = distance[at], cosine[at]
        held[at] = self.dense_enough(distance, cosine) & self.exact_enough(distance, cosine)
        return held


@dataclass(frozen=True, slots=True, kw_only=True)
class Requirement(RequirementOptions):
    """What counts as measured well enough.

    Parameters
    ----------
    max_incidence_deg : float
        Largest angle between line of sight and surface normal, degrees, 0 < angle <= 90; 90 asks for
        visibility alone (up to 88.9 deg).
    max_range_m : float, optional
        Largest range in metres; the sensor's own limit when not given.
    min_density_per_m2 : float, optional
        Fewest measured points on a square metre of surface.
    max_sd_m : float, optional
        Largest predicted standard deviation of a surface point along its normal, metres
        (`nbv.visibility.requirement`).
    registration_sd_m, averaging_radius_m : float
        What `max_sd_m` reckons with: standard deviation of a station's position in each direction, and the
        radius of the disc over which a surface point is averaged (0: single points), metres.
    k : int
        How many views must each satisfy all of this.

    Raises
    ------
    InputError
        An angle outside 0..90 deg; a range, density or deviation that is not positive; k below 1.

    Examples
    --------
    >>> round(Requirement(max_incidence_deg=60).min_cosine, 6)
    0.5
    """

    def __post_init__(self) -> None:
        if not 0 < self.max_incidence_deg <= 90:
            raise InputError(f"max_incidence_deg must lie in 0..90 deg, got {self.max_incidence_deg}")
        for name in ("max_range_m", "min_density_per_m2", "max_sd_m"):
            value = getattr(self, name)
            if value is not None and not value > 0:
                raise InputError(f"{name} must be positive, got {value}")
        for name in ("registration_sd_m", "averaging_radius_m"):
            if not 0 <= getattr(self, name) < np.inf:
                raise InputError(f"{name} must not be negative, got {getattr(self, name)}")
        if self.k < 1:
            raise InputError(f"k must be at least 1 view, got {self.k}")

    @classmethod
    def of(cls, options: RequirementOptions) -> Requirement:
        """Return the requirement with the numbers of `options`."""
        return cls(**asdict(options))

    @property
    def min_cosine(self) -> float:
        """The smallest cosine of incidence that counts."""
        return max(float(np.cos(np.radians(self.max_incidence_deg))), GRAZING_COSINE)

    def limits(self, sensor: Sensor) -> SightLimits:
        """Limits under which `sensor` meets the requirement.

        Raises
        ------
        InputError
            A largest deviation for a sensor whose errors are not known.
        """
        farthest = min(sensor.max_range_m, self.max_range_m or np.inf)
        return self.limits_of(sensor.projection.pixel_angle, sensor.effects, (sensor.min_range_m, farthest))

    def limits_of(self, pixel_angle: float, effects: Effects, gate: tuple[float, float]) -> SightLimits:
        """Limits for an instrument by its pixels (radians), errors and range gate (metres)."""
        precision = Precision(pixel_angle, effects, self.registration_sd_m, self.averaging_radius_m)
        if self.max_sd_m is not None and not precision.is_known:
            raise InputError(
                "a largest standard deviation asks for an instrument whose errors are known: "
                "choose a noise model, or a sensor profile that has one"
            )
        density, deviation = self.min_density_per_m2 or 0.0, self.max_sd_m or np.inf
        return SightLimits(self.min_cosine, *gate, density, deviation, precision)

    def limits_of_scan(self, scan: RangeImage) -> SightLimits:
        """Limits for a scan by its pixels and noise; of range limits the requirement's own holds alone."""
        noise = None if scan.sigma_m is None else ConstantNoise(constant_m=scan.sigma_m)
        gate = (0.0, self.max_range_m or np.inf)
        return self.limits_of(scan.projection.pixel_angle, Effects(noise=noise), gate)

    def visibility(self, sensor: Sensor) -> SightLimits:
        """Limits under which `sensor` sees a point at all, at any incidence."""
        farthest = min(sensor.max_range_m, self.max_range_m or np.inf)
        return SightLimits(GRAZING_COSINE, sensor.min_range_m, farthest)

    def describe(self) -> str:
        """Return the requirement in words.

        Examples
        --------
        >>> Requirement(max_sd_m=0.002, k=2).describe()
        '60\u00b0 incidence or less, a standard deviation of 2 mm or less, by 2 views or more'
        """
        parts = [f"{self.max_incidence_deg:g}\u00b0 incidence or less"]
        if self.max_range_m is not None:
            parts.append(f"{self.max_range_m:g} m range or less")
        if self.min_density_per_m2 is not None:
            parts.append(f"{self.min_density_per_m2:g} points per m\u00b2 or more")
        if self.max_sd_m is not None:
            parts.append(f"a standard deviation of {1e3 * self.max_sd_m:g} mm or less")
        return ", ".join(parts) + (f", by {self.k} views or more" if self.k > 1 else "")

    def to_json(self) -> dict[str, Any]:
        """Return the entries of `plan.json` and `coverage.json`."""
        return asdict(self)
