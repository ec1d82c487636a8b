# SPDX-License-Identifier: MIT
"""Range image: an organised scan, with the geometry of its pixels and the pose it was taken from."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from scenes.checks import BoolArray, FloatArray, InputError, check_options, frozen_copy
from scenes.pose import Pose
from scenes.projection import Projection

_MOST_M = 1e9  # beyond any scanner: files write such numbers for "no return"


@dataclass(frozen=True, slots=True, eq=False)
class ScanTruth:
    """What a simulated scan really met, pixel by pixel.

    Attributes
    ----------
    face, surface : (rows, columns) int32
        Face index and surface id in the scene, -1 where the ray met nothing.
    ranges : (rows, columns) float
        Distance without noise, metres, inf where the ray met nothing.
    incidence : (rows, columns) float
        Angle between ray and surface normal, radians; NaN where the ray met nothing.
    """

    face: NDArray[np.int32]
    surface: NDArray[np.int32]
    ranges: FloatArray
    incidence: FloatArray

    def __post_init__(self) -> None:
        for name, dtype in (("face", np.int32), ("surface", np.int32), ("ranges", None), ("incidence", None)):
            object.__setattr__(self, name, frozen_copy(getattr(self, name), dtype or np.float64))


@dataclass(frozen=True, slots=True, eq=False)
class RangeImage:
    """One organised scan.

    Parameters
    ----------
    ranges : (rows, columns) float
        Distance along each pixel's ray, metres; inf where nothing came back. So do NaN, 0 and less,
        and what lies beyond 1e9 m: numbers that files write for no return.
    projection : Projection
        Pinhole or spherical geometry of the pixels.
    world_from_sensor : Pose
        Where the sensor stood.
    colour : (rows, columns, 3), optional
        sRGB in 0..1.
    sensor_points : (rows, columns, 3) float, optional
        Measured points in the sensor frame where they do not lie exactly on the projection's rays (real
        terrestrial scans); NaN where nothing came back. A pixel without both has no return.
    sigma_m : float, optional
        Known standard deviation of the range noise in metres; None when unknown, 0 when noise-free.
    noise : str
        Name of the noise model that was active, "" when not known.
    truth : ScanTruth, optional
        What a simulated scan really met.
    name : str
        What to call the scan in reports.

    Raises
    ------
    InputError
        Arrays that do not have the projection's shape, a sigma that is negative or not finite.
    """

    ranges: FloatArray
    projection: Projection
    world_from_sensor: Pose
    colour: NDArray[np.float32] | None = None
    sensor_points: FloatArray | None = None
    sigma_m: float | None = None
    noise: str = ""
    truth: ScanTruth | None = None
    name: str = "scan"

    def __post_init__(self) -> None:
        ranges = np.array(self.ranges, dtype=np.float64)
        check_options(self, sigma_m=(0.0, np.inf))
        if ranges.shape != self.projection.shape:
            raise InputError(f"ranges have shape {ranges.shape}, the projection {self.projection.shape}")
        with np.errstate(invalid="ignore"):
            ranges[~(np.isfinite(ranges) & (ranges > 0) & (ranges <= _MOST_M))] = np.inf
        if self.truth is not None and self.truth.ranges.shape != ranges.shape:
            raise InputError(f"truth has shape {self.truth.ranges.shape}, expected {ranges.shape}")
        for name, dtype in (("colour", np.float32), ("sensor_points", np.float64)):
            array = getattr(self, name)
            if array is None:
                continue
            if np.shape(array) != (*ranges.shape, 3):
                raise InputError(f"{name} has shape {np.shape(array)}, expected {(*ranges.shape, 3)}")
            object.__setattr__(self, name, frozen_copy(array, dtype))
        if self.sensor_points is not None:
            ranges[~np.isfinite(self.sensor_points).all(axis=-1)] = np.inf
            points = np.where(np.isfinite(ranges)[..., None], self.sensor_points, np.nan)
            object.__setattr__(self, "sensor_points", frozen_copy(points))
        object.__setattr__(self, "ranges", frozen_copy(ranges))

    @classmethod
    def from_points(
        cls,
        points: FloatArray,
        projection: Projection,
        world_from_sensor: Pose,
        colour: NDArray[np.float32] | None = None,
        name: str = "scan",
    ) -> RangeImage:
        """Return the scan of sensor-frame points (rows, columns, 3); not finite = nothing came back."""
        points = np.where(np.isfinite(points).all(axis=-1, keepdims=True), points, np.nan)
        ranges = np.linalg.norm(points, axis=-1)
        return cls(ranges, projection, world_from_sensor, colour=colour, sensor_points=points, name=name)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.projection.shape

    @property
    def valid(self) -> BoolArray:
        """Where something came back, shape (rows, columns)."""
        return np.isfinite(self.ranges)

    @property
    def origin(self) -> FloatArray:
        """Where the sensor stood, world coordinates, shape (3,)."""
        return self.world_from_sensor.translation

    def points_in_sensor(self) -> FloatArray:
        """Measured points (rows, columns, 3) in the sensor frame, NaN where nothing came back."""
        if self.sensor_points is not None:
            return self.sensor_points
        reach = np.where(self.valid, self.ranges, np.nan)
        return reach[..., None] * self.projection.directions()

    def points(self) -> FloatArray:
        """Measured points (rows, columns, 3) in world coordinates, NaN where nothing came back."""
        return self.world_from_sensor.apply(self.points_in_sensor())

    def rays(self) -> FloatArray:
        """Unit viewing rays (rows, columns, 3), world frame, through the measured points where known."""
        rays = self.projection.directions()
        if self.sensor_points is not None:
            measured = self.sensor_points / np.where(self.valid, self.ranges, 1.0)[..., None]
            rays = np.where(self.valid[..., None], measured, rays)
        return self.world_from_sensor.rotate(rays)

    def pixels(self, points: FloatArray) -> FloatArray:
        """Row and column (n, 2) that see world `points` (n, 3); NaN outside the field of view."""
        return self.projection.pixels(self.world_from_sensor.inverse().apply(points))

    def transformed(self, pose: Pose) -> RangeImage:
        """Return the same scan in a world moved by `pose`."""
        return replace(self, world_from_sensor=pose @ self.world_from_sensor)
