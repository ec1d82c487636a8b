# SPDX-License-Identifier: MIT
"""Noise of range measurements: how far a measured range strays along its ray, by published models.

Standard deviations are metres. References:

* Khoshelham and Elberink, "Accuracy and resolution of Kinect depth data for indoor mapping applications",
  Sensors 12, 2012: the standard deviation of depth z is 1.425e-3 z^2 (its steps are a matter of
  `nbv.scanning.effects`);
* Nguyen, Izadi and Lovell, "Modeling Kinect sensor noise for improved 3D reconstruction and tracking",
  3DIMPVT 2012: axial noise 0.0012 + 0.0019 (z - 0.4)^2, plus 0.0001 / sqrt(z) * theta^2 / (pi/2 - theta)^2
  beyond an incidence of 60 deg (its lateral part is a matter of `nbv.scanning.effects`);
* stereo: an error of the disparity d = f b / z is an error z^2 / (f b) of the depth;
* terrestrial: sigma^2 = a^2 + (b r^2 / (rho cos theta))^2, the second term for the light that comes back;
  a and b are the user's, published ones differ from instrument to instrument;
* constant plus parts per million of the range, and a table by range and reflectivity, as data sheets state
  them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Protocol, runtime_checkable

import numpy as np

from scenes.checks import FloatArray, InputError, check_number, check_options

_STEEPEST = np.radians(89.0)  # incidence is clipped here: the formulas have a pole at 90 deg
_DARKEST = 1e-3  # reflectivity times cosine, below which nothing would come back anyway


@runtime_checkable
class NoiseModel(Protocol):
    """Standard deviation of a measured distance."""

    model: ClassVar[str]
    acts_on_depth: ClassVar[bool]

    def sigma_m(
        self, distance: FloatArray, incidence: FloatArray, reflectivity: FloatArray | float = 1.0, /
    ) -> FloatArray:
        """Standard deviation in metres, before quantisation.

        Parameters
        ----------
        distance : (...,) float
            Metres: z-depth where `acts_on_depth`, else range.
        incidence : (...,) float
            Angle between ray and surface normal, radians.
        reflectivity : (...,) float
            Share of the light that the surface scatters, 0..1.
        """
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class ConstantNoise:
    """A constant plus parts per million of the range.

    Examples
    --------
    >>> ConstantNoise(constant_m=0.001, ppm=10.0).sigma_m(np.array([100.0]), np.zeros(1)).tolist()
    [0.002]
    """

    constant_m: float
    ppm: float = 0.0

    model: ClassVar[str] = "constant"
    acts_on_depth: ClassVar[bool] = False

    def __post_init__(self) -> None:
        check_options(self, constant_m=(0.0, np.inf), ppm=(0.0, np.inf))

    def sigma_m(
        self, distance: FloatArray, _incidence: FloatArray, _reflectivity: FloatArray | float = 1.0, /
    ) -> FloatArray:
        """Return constant_m + ppm 1e-6 r (...,), metres; one number of shape () without ppm."""
        if self.ppm == 0:
            return np.asarray(self.constant_m, dtype=np.float64)
        return np.asarray(self.constant_m + self.ppm * 1e-6 * distance, dtype=np.float64)


@dataclass(frozen=True, slots=True, kw_only=True)
class KhoshelhamNoise:
    """Kinect v1 depth by Khoshelham and Elberink 2012, equation (10)."""

    per_m: float = 1.425e-3

    model: ClassVar[str] = "khoshelham2012"
    acts_on_depth: ClassVar[bool] = True

    def __post_init__(self) -> None:
        check_options(self, per_m=(0.0, np.inf))

    def sigma_m(
        self, distance: FloatArray, _incidence: FloatArray, _reflectivity: FloatArray | float = 1.0, /
    ) -> FloatArray:
        """Return per_m z^2 (...,), metres."""
        return self.per_m * distance**2


@dataclass(frozen=True, slots=True, kw_only=True)
class NguyenNoise:
    """Kinect v1 axial noise by Nguyen, Izadi and Lovell 2012."""

    constant_m: float = 0.0012
    quadratic_per_m: float = 0.0019
    nearest_m: float = 0.4
    steep: float = 1e-4
    steep_from_deg: float = 60.0

    model: ClassVar[str] = "nguyen2012"
    acts_on_depth: ClassVar[bool] = True

    def __post_init__(self) -> None:
        at_least_0 = (0.0, np.inf)
        check_options(self, constant_m=at_least_0, quadratic_per_m=at_least_0, steep=at_least_0)
        check_options(self, nearest_m=at_least_0, steep_from_deg=(0.0, 90.0))

    def sigma_m(
        self, distance: FloatArray, incidence: FloatArray, _reflectivity: FloatArray | float = 1.0, /
    ) -> FloatArray:
        """Return constant_m + quadratic_per_m (z - nearest_m)^2 (...,), metres; steep views add a term."""
        theta = np.clip(incidence, 0.0, _STEEPEST)
        steep = self.steep / np.sqrt(np.maximum(distance, 1e-6)) * theta**2 / (np.pi / 2 - theta) ** 2
        even = self.constant_m + self.quadratic_per_m * (distance - self.nearest_m) ** 2
        sigma: FloatArray = even + np.where(theta > np.radians(self.steep_from_deg), steep, 0.0)
        return sigma


@dataclass(frozen=True, slots=True, kw_only=True)
class StereoNoise:
    """Depth from disparity: subpixel_px is the standard deviation of the disparity in pixels."""

    subpixel_px: float
    focal_px: float
    baseline_m: float

    model: ClassVar[str] = "stereo"
    acts_on_depth: ClassVar[bool] = True

    def __post_init__(self) -> None:
        check_options(self, subpixel_px=(0.0, np.inf), focal_px=(1.0, np.inf), baseline_m=(1e-6, np.inf))

    def sigma_m(
        self, distance: FloatArray, _incidence: FloatArray, _reflectivity: FloatArray | float = 1.0, /
    ) -> FloatArray:
        """Return z^2 subpixel_px / (focal_px baseline_m) (...,), metres."""
        return self.subpixel_px / (self.focal_px * self.baseline_m) * distance**2


@dataclass(frozen=True, slots=True, kw_only=True)
class TerrestrialNoise:
    """A laser scanner: noise grows as less light comes back."""

    constant_m: float
    signal_per_m: float

    model: ClassVar[str] = "terrestrial"
    acts_on_depth: ClassVar[bool] = False

    def __post_init__(self) -> None:
        check_options(self, constant_m=(0.0, np.inf), signal_per_m=(0.0, np.inf))

    def sigma_m(
        self, distance: FloatArray, incidence: FloatArray, reflectivity: FloatArray | float = 1.0, /
    ) -> FloatArray:
        """Return sqrt(constant_m^2 + (signal_per_m r^2 / (rho cos theta))^2) (...,), metres."""
        light = np.maximum(reflectivity * np.cos(np.clip(incidence, 0.0, _STEEPEST)), _DARKEST)
        return np.hypot(self.constant_m, self.signal_per_m * distance**2 / light)


@dataclass(frozen=True, slots=True, kw_only=True)
class TableNoise:
    """A data sheet's table: standard deviations at ranges, for surfaces of one or more reflectivities.

    Linear between the entries, along the range and along the light rho cos(theta) that comes back. Beyond
    the table the noise grows as where photons limit it, with r / sqrt(rho cos theta): past the farthest range
    at the rate of the last two ranges, or at that of another surface for the same light where it is larger;
    below the darkest surface at the rate of the two darkest. It stays what it is nearer than the table and
    brighter than it. A table for one reflectivity does not depend on the light.

    Parameters
    ----------
    range_m : sequence of float
        Ranges, metres, rising.
    reflectivity : sequence of float
        Share of the light that surfaces scatter, 0..1, rising.
    sd_m : sequence of sequences of float
        Metres: one row for each reflectivity, one entry in it for each range.

    Raises
    ------
    InputError
        Lists that do not rise or do not fit each other, impossible values.

    Examples
    --------
    >>> noise = TableNoise(range_m=(10, 30), reflectivity=(0.1, 0.9), sd_m=((0.004, 0.008), (0.001, 0.002)))
    >>> noise.sigma_m(np.array([10.0, 20.0]), np.zeros(2), np.array([0.5, 0.1])).tolist()
    [0.0025, 0.006]
    """

    range_m: tuple[float, ...]
    reflectivity: tuple[float, ...]
    sd_m: tuple[tuple[float, ...], ...]

    model: ClassVar[str] = "table"
    acts_on_depth: ClassVar[bool] = False

    def __post_init__(self) -> None:
        for name, most in (("range_m", np.inf), ("reflectivity", 1.0)):
            values = getattr(self, name)
            for value in values:
                check_number(name, value, 1e-6, most)
            if not len(values) or not np.all(np.diff(values) > 0):
                raise InputError(f"{name} must be numbers that rise, got {list(values)}")
            object.__setattr__(self, name, tuple(map(float, values)))
        shape = (len(self.reflectivity), len(self.range_m))
        if len(self.sd_m) != shape[0] or any(np.shape(row) != shape[1:] for row in self.sd_m):
            raise InputError(
                f"sd_m must have {shape[0]} x {shape[1]} numbers: a row for each reflectivity with an entry "
                f"for each range; got {list(self.sd_m)}"
            )
        for value in np.ravel(self.sd_m):
            check_number("sd_m", value, 0.0)
        object.__setattr__(self, "sd_m", tuple(tuple(map(float, row)) for row in self.sd_m))

    def sigma_m(
        self, distance: FloatArray, incidence: FloatArray, reflectivity: FloatArray | float = 1.0, /
    ) -> FloatArray:
        """Return the entry (...,) for range and light, metres."""
        known: list[FloatArray] = [
            np.interp(distance, self.range_m, row) + rate * np.maximum(distance - self.range_m[-1], 0.0)
            for row, rate in zip(self.sd_m, self._rates(), strict=True)
        ]
        if len(known) == 1:
            return known[0]
        light = np.maximum(reflectivity * np.cos(np.clip(incidence, 0.0, _STEEPEST)), _DARKEST)
        shares = [np.interp(light, self.reflectivity, row) for row in np.eye(len(known))]
        sigma = np.sum([share * sd for share, sd in zip(shares, known, strict=True)], axis=0)
        dim = 1 / np.sqrt(self.reflectivity[:2])
        rate = np.maximum(known[0] - known[1], 0.0) / (dim[0] - dim[1])
        sigma += rate * np.maximum(1 / np.sqrt(light) - dim[0], 0.0)
        return np.asarray(sigma, dtype=np.float64)

    def _rates(self) -> FloatArray:
        """Growth (n,) of the noise past the farthest range, metres a metre, for each reflectivity."""
        if len(self.range_m) == 1:
            return np.zeros(len(self.reflectivity))
        steps = np.array([row[-1] - row[-2] for row in self.sd_m]) / (self.range_m[-1] - self.range_m[-2])
        by_light = np.sqrt(self.reflectivity) * np.maximum(steps, 0.0)
        return np.asarray(by_light.max() / np.sqrt(self.reflectivity), dtype=np.float64)


def range_sigma_m(
    noise: NoiseModel,
    ranges: FloatArray,
    incidence: FloatArray,
    axis_cosine: FloatArray | float = 1.0,
    reflectivity: FloatArray | float = 1.0,
) -> FloatArray:
    """Standard deviation along the ray in metres, before quantisation.

    Parameters
    ----------
    ranges, incidence : (...,) float
        Metres along the ray, and the angle between ray and surface normal in radians.
    axis_cosine : (...,) float
        Cosine between ray and optical axis: depth cameras err in depth = range * axis_cosine.
    reflectivity : (...,) float
        Of the surface, 0..1.
    """
    if not noise.acts_on_depth:
        return noise.sigma_m(ranges, incidence, reflectivity)
    return noise.sigma_m(ranges * axis_cosine, incidence, reflectivity) / axis_cosine
