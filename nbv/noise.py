# SPDX-License-Identifier: MIT
"""Noise models of range measurements, by name; off unless asked for.

Standard deviations are metres along the ray. References:

* Khoshelham and Elberink, "Accuracy and resolution of Kinect depth data", Sensors 12, 2012: the standard
deviation
  of depth z is 1.425e-3 z^2, and depth comes in steps of 2.85e-3 z^2;
* Nguyen, Izadi and Lovell, "Modeling Kinect sensor noise", 3DIMPVT 2012: axial noise 0.0012 + 0.0019 (z -
0.4)^2,
  plus 0.0001 / sqrt(z) * theta^2 / (pi/2 - theta)^2 beyond an incidence of 60 deg (its lateral part is not
  modelled);
* a constant plus parts per million of the range, as data sheets of terrestrial scanners state it.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from scenes.checks import FloatArray, InputError

_STEEPEST = np.radians(89.0)  # incidence is clipped here: the formula of Nguyen et al. has a pole at 90 deg


@dataclass(frozen=True, slots=True)
class NoiseModel:
    """A named noise model.

    Attributes
    ----------
    name : str
        What files and reports call it.
    depth_sigma_m : callable
        (z, incidence) -> standard deviation in metres of z, which is the depth where `acts_on_depth`, else
        the range.
    acts_on_depth : bool
        Whether the model is one of z-depth (depth cameras) rather than of range.
    inverse_depth_step : float
        Quantisation step of 1 / z in 1 / m, 0 for none.
    """

    name: str
    depth_sigma_m: Callable[[FloatArray, FloatArray], FloatArray]
    acts_on_depth: bool = False
    inverse_depth_step: float = 0.0

    def sigma_m(
        self, ranges: FloatArray, incidence: FloatArray, axis_cosine: FloatArray | float = 1.0
    ) -> FloatArray:
        """Standard deviation along the ray in metres, before quantisation.

        Parameters
        ----------
        ranges, incidence : (...,) float
            Metres along the ray, and the angle between ray and surface normal in radians.
        axis_cosine : (...,) float
            Cosine between ray and optical axis: depth cameras err in depth = range * axis_cosine.
        """
        if not self.acts_on_depth:
            return self.depth_sigma_m(ranges, incidence)
        return self.depth_sigma_m(ranges * axis_cosine, incidence) / axis_cosine

    def disturb(
        self,
        ranges: FloatArray,
        incidence: FloatArray,
        axis_cosine: FloatArray | float = 1.0,
        rng: np.random.Generator | int | None = None,
    ) -> FloatArray:
        """Return `ranges` with noise and quantisation; not finite ones stay as they are.

        One normal number is drawn for every entry, hit or not, so that the noise of a pixel does not depend
        on what the others see.
        """
        rng = np.random.default_rng(rng)
        drawn = rng.standard_normal(np.shape(ranges))
        finite = np.isfinite(ranges)
        safe = np.where(finite, ranges, 1.0)
        noisy = safe + drawn * self.sigma_m(safe, np.where(finite, incidence, 0.0), axis_cosine)
        if self.inverse_depth_step > 0:
            step = self.inverse_depth_step
            levels = np.round(1 / (np.maximum(noisy, 1e-6) * axis_cosine) / step)
            noisy = 1 / (np.maximum(levels, 1.0) * step) / axis_cosine
        return np.where(finite, noisy, ranges)


def _constant(sigma: float, ppm: float = 0.0) -> Callable[[FloatArray, FloatArray], FloatArray]:
    def sigma_of(ranges: FloatArray, _incidence: FloatArray) -> FloatArray:
        return np.asarray(sigma + ppm * 1e-6 * ranges, dtype=np.float64)

    return sigma_of


def _khoshelham(depth: FloatArray, _incidence: FloatArray) -> FloatArray:
    return 1.425e-3 * depth**2


def _nguyen(depth: FloatArray, incidence: FloatArray) -> FloatArray:
    theta = np.clip(incidence, 0.0, _STEEPEST)
    steep = 1e-4 / np.sqrt(np.maximum(depth, 1e-6)) * theta**2 / (np.pi / 2 - theta) ** 2
    sigma: FloatArray = 0.0012 + 0.0019 * (depth - 0.4) ** 2 + np.where(theta > np.pi / 3, steep, 0.0)
    return sigma


_FIXED = {
    "none": NoiseModel("none", _constant(0.0)),
    "khoshelham2012": NoiseModel("khoshelham2012", _khoshelham, True, 2.85e-3),
    "nguyen2012": NoiseModel("nguyen2012", _nguyen, True),
    "constant-ppm": NoiseModel("constant-ppm", _constant(1e-3, 10.0)),
}
_NUMBER = r"(\d+(?:\.\d+)?)"


def noise_model(name: str) -> NoiseModel:
    """Return the noise model called `name`.

    Parameters
    ----------
    name : str
        "none", "gaussian-2mm" (any number), "khoshelham2012", "nguyen2012", "constant-ppm" (1 mm + 10 ppm) or
        "constant-2mm-10ppm" (any numbers).

    Raises
    ------
    InputError
        No such model.

    Examples
    --------
    >>> noise_model("gaussian-2mm").sigma_m(np.array([1.0, 9.0]), np.zeros(2)).tolist()
    [0.002, 0.002]
    """
    if name in _FIXED:
        return _FIXED[name]
    if match := re.fullmatch(f"gaussian-{_NUMBER}mm", name):
        return NoiseModel(name, _constant(float(match[1]) / 1000))
    if match := re.fullmatch(f"constant-{_NUMBER}mm-{_NUMBER}ppm", name):
        return NoiseModel(name, _constant(float(match[1]) / 1000, float(match[2])))
    raise InputError(
        f"no noise model named {name!r}; there are {', '.join(_FIXED)}, gaussian-<n>mm, constant-<n>mm-<n>ppm"
    )
