# SPDX-License-Identifier: MIT
"""Quantisation: the steps in which an instrument can tell distances apart."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scenes.checks import FloatArray, InputError, check_options


@dataclass(frozen=True, slots=True, kw_only=True)
class Quantisation:
    """Steps of the range, or of the inverse depth of a triangulating camera.

    Parameters
    ----------
    range_step_m : float
        Step of the range, metres; 0 for none.
    inverse_depth_step_per_m : float
        Step of 1 / depth, which is uniform in disparity: at depth z a step of s z^2 metres; 0 for none.
        2.85e-3 is the Kinect v1 of Khoshelham and Elberink 2012; a stereo camera has its disparity step
        over focal length (px) times baseline (m).

    Raises
    ------
    InputError
        A negative step, both steps or none.

    Examples
    --------
    >>> Quantisation(range_step_m=0.25).rounded(np.array([1.1, 1.2])).tolist()
    [1.0, 1.25]
    """

    range_step_m: float = 0.0
    inverse_depth_step_per_m: float = 0.0

    def __post_init__(self) -> None:
        check_options(self, range_step_m=(0.0, np.inf), inverse_depth_step_per_m=(0.0, np.inf))
        if (self.range_step_m > 0) == (self.inverse_depth_step_per_m > 0):
            raise InputError("quantisation needs range_step_m or inverse_depth_step_per_m, and not both")

    def rounded(self, ranges: FloatArray, axis_cosine: FloatArray | float = 1.0) -> FloatArray:
        """Return `ranges` in metres, rounded to the nearest step; inf stays inf.

        Parameters
        ----------
        ranges : (...,) float
            Along the ray, metres.
        axis_cosine : (...,) float
            Cosine between ray and optical axis: depth = range * axis_cosine.
        """
        if self.range_step_m > 0:
            return np.asarray(np.round(ranges / self.range_step_m) * self.range_step_m)
        step = self.inverse_depth_step_per_m
        levels = np.round(1 / (np.maximum(ranges, 1e-6) * axis_cosine) / step)
        depth = 1 / (np.maximum(levels, 1.0) * step)
        return np.where(np.isfinite(ranges), depth / axis_cosine, ranges)

    def step_m(self, ranges: FloatArray, axis_cosine: FloatArray | float = 1.0) -> FloatArray:
        """Return the step (...,) along the ray at `ranges` (...,), metres; parameters as for `rounded`."""
        if self.range_step_m > 0:
            return np.full(np.shape(ranges), self.range_step_m)
        return np.asarray(self.inverse_depth_step_per_m * np.square(ranges) * axis_cosine)
