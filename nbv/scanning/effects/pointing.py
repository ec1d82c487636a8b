# SPDX-License-Identifier: MIT
"""Pointing: where a measured point is put sideways of its ray, by errors of encoders or of pixels.

Encoders of a laser scanner err in azimuth and elevation; the point keeps its range. A camera errs in the
image plane; the point keeps its depth. Either way it leaves the ray of its pixel.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scenes.checks import FloatArray, check_options
from scenes.scan.projection import Projection

_STEEPEST = np.radians(89.0)  # incidence is clipped here: the formula has a pole at 90 deg


@dataclass(frozen=True, slots=True, kw_only=True)
class PointingNoise:
    """Standard deviation sideways, the same in both directions.

    The three terms add up: sd_deg + pixel (sd_px + slope_px theta / (pi/2 - theta)), theta the incidence.

    Parameters
    ----------
    sd_deg : float
        Angle in degrees, what data sheets call angular accuracy.
    sd_px, slope_px : float
        In pixels; 0.8 and 0.035 are the lateral noise of Nguyen, Izadi and Lovell 2012.

    Raises
    ------
    InputError
        A negative standard deviation.
    """

    sd_deg: float = 0.0
    sd_px: float = 0.0
    slope_px: float = 0.0

    def __post_init__(self) -> None:
        check_options(self, sd_deg=(0.0, 45.0), sd_px=(0.0, 1e3), slope_px=(0.0, 1e3))

    def sigma_rad(self, incidence: FloatArray, pixel_angle: float) -> FloatArray:
        """Return the standard deviation (...,) at each incidence (...,); angles in radians."""
        theta = np.clip(incidence, 0.0, _STEEPEST)
        pixels = self.sd_px + self.slope_px * theta / (np.pi / 2 - theta)
        return np.asarray(np.radians(self.sd_deg) + pixel_angle * pixels, dtype=np.float64)

    def displaced(
        self,
        distance: FloatArray,
        incidence: FloatArray,
        projection: Projection,
        rays: FloatArray,
        rng: np.random.Generator,
    ) -> FloatArray:
        """Return measured points (rows, columns, 3) in the sensor frame, NaN where nothing came back.

        Parameters
        ----------
        distance : (rows, columns) float
            Measured ranges, metres; inf where nothing came back.
        incidence : (rows, columns) float
            Radians.
        projection : Projection
            Of a camera or of a turning scanner.
        rays : (rows, columns, 3) float
            Its unit rays.
        rng : Generator
            Two normal numbers are drawn for every pixel, whatever came back.
        """
        came_back = np.isfinite(distance)
        sigma = self.sigma_rad(np.where(came_back, incidence, 0.0), projection.pixel_angle)
        right, down = rng.standard_normal((2, *distance.shape)) * sigma
        reach = np.where(came_back, distance, np.nan)
        if projection.kind == "pinhole":
            depth = reach * rays[..., 2]
            slope = rays[..., :2] / rays[..., 2:]
            flat = [slope[..., 0] + right, slope[..., 1] + down, np.ones_like(depth)]
            return np.asarray(depth[..., None] * np.stack(flat, axis=-1), dtype=np.float64)
        azimuth = np.arctan2(rays[..., 0], rays[..., 2]) + right
        elevation = np.arcsin(np.clip(-rays[..., 1], -1.0, 1.0)) - down
        across = np.cos(elevation)
        turned = np.stack([across * np.sin(azimuth), -np.sin(elevation), across * np.cos(azimuth)], axis=-1)
        return np.asarray(reach[..., None] * turned, dtype=np.float64)
