# SPDX-License-Identifier: MIT
"""Triangulation: a point is measured only where two devices see it, so there are two kinds of shadow."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from nbv.scanning.effects import NO_EFFECTS, Effects
from nbv.scanning.sensor import Partner, Profiled, check_gate, image_slope, in_pyramid
from scenes.checks import BoolArray, FloatArray, InputError, check_number
from scenes.pose import Pose
from scenes.rays.raycast import RayCaster
from scenes.scan.projection import PinholeProjection, SphericalProjection

_LIFT = 1e-6  # of the distance: Embree works in float32


@dataclass(frozen=True, slots=True, repr=False)
class TriangulationSensor(Profiled):
    """A camera with a second device beside it: projector and camera, or two cameras.

    The image is the camera's. What the second device does not see has no depth: an object's shadow lies to
    its left in the image when the second device stands to the right of the camera.

    Parameters
    ----------
    fov_deg : float
        Full angle across the longer side of the image, degrees.
    width, height : int
        Pixels; they are square.
    baseline_m : float
        Position of the second device on the camera's x axis, metres; to the right when positive.
    partner_fov_deg : float, optional
        Full angle that the second device covers across, degrees; the camera's when not given.
    min_range_m, max_range_m : float
        Range gate, metres along the ray.
    name : str
        What reports call it.
    effects : Effects
        By what its scans differ from exact ranges.
    points_per_s : float, optional
        Speed: pixels a second.

    Raises
    ------
    InputError
        Angles outside 0..180 deg, no pixels, no baseline, an empty range gate.
    """

    fov_deg: float = 60.0
    width: int = 640
    height: int = 480
    baseline_m: float = 0.075
    partner_fov_deg: float | None = None
    min_range_m: float = 0.3
    max_range_m: float = 5.0
    name: str = "triangulation"
    effects: Effects = NO_EFFECTS
    points_per_s: float | None = None

    kind: ClassVar[str] = "triangulation"

    def __post_init__(self) -> None:
        check_gate(self.name, self.min_range_m, self.max_range_m, self.points_per_s)
        PinholeProjection.from_fov(self.width, self.height, self.fov_deg)  # raises for what cannot be
        if not np.isfinite(self.baseline_m) or self.baseline_m == 0:
            raise InputError(f"baseline_m must be finite and not zero, got {self.baseline_m}")
        if self.partner_fov_deg is not None and not 0 < self.partner_fov_deg < 180:
            raise InputError(f"partner_fov_deg must lie between 0 and 180, got {self.partner_fov_deg}")

    @property
    def projection(self) -> PinholeProjection:
        """The geometry of the pixels."""
        return PinholeProjection.from_fov(self.width, self.height, self.fov_deg)

    @property
    def partner(self) -> Partner:
        """The second device, with parallel axes."""
        across, down = image_slope(self.fov_deg, self.width, self.height)
        if self.partner_fov_deg is not None:
            across = float(np.tan(np.radians(self.partner_fov_deg) / 2))
        return Partner((self.baseline_m, 0.0, 0.0), (across, down))

    def sees(self, points: FloatArray) -> BoolArray:
        """Tell which sensor-frame points (n, 3) lie in the camera's aperture."""
        return in_pyramid(points, image_slope(self.fov_deg, self.width, self.height))


@dataclass(frozen=True, slots=True, repr=False)
class LineSensor(Profiled):
    """A profile scanner: one row of pixels, fanned out in the plane of x and z; motion is the user's.

    Parameters
    ----------
    fan_deg : float
        Full angle of the fan, degrees, at most 360.
    width : int
        Pixels along the row, at equal angles.
    baseline_m : float
        Position on the y axis of the camera that watches the laser line, metres; 0 for a scanner that
        measures the time of flight and needs none.
    min_range_m, max_range_m : float
        Range gate, metres.
    name : str
        What reports call it.
    effects : Effects
        By what its scans differ from exact ranges.
    points_per_s : float, optional
        Speed: pixels a second.

    Raises
    ------
    InputError
        An angle out of bounds, fewer than two pixels, an empty range gate.
    """

    fan_deg: float = 60.0
    width: int = 640
    baseline_m: float = 0.0
    min_range_m: float = 0.1
    max_range_m: float = 10.0
    name: str = "line"
    effects: Effects = NO_EFFECTS
    points_per_s: float | None = None

    kind: ClassVar[str] = "line"

    def __post_init__(self) -> None:
        check_gate(self.name, self.min_range_m, self.max_range_m, self.points_per_s)
        check_number("baseline_m", self.baseline_m, -np.inf)
        if not 0 < self.fan_deg <= 360:
            raise InputError(f"fan_deg must lie in 0..360, got {self.fan_deg}")
        if self.width < 2:
            raise InputError(f"a profile needs 2 pixels or more, got {self.width}")

    @property
    def projection(self) -> SphericalProjection:
        """The geometry of the pixels: one row at elevation 0."""
        return SphericalProjection.regular(self.width, 1, self.fan_deg, (0.0, 0.0))

    @property
    def partner(self) -> Partner | None:
        """The camera that watches the laser line, and sees all of it that nothing hides."""
        return Partner((0.0, self.baseline_m, 0.0)) if self.baseline_m else None

    def sees(self, points: FloatArray) -> BoolArray:
        """Tell which sensor-frame points (n, 3) lie in the fan, within half a pixel of its plane."""
        elevation = np.arctan2(-points[..., 1], np.hypot(points[..., 0], points[..., 2]))
        azimuth = np.arctan2(points[..., 0], points[..., 2])
        inside: BoolArray = np.abs(azimuth) <= np.radians(self.fan_deg) / 2 + 1e-12
        inside &= np.abs(elevation) <= np.radians(self.fan_deg / self.width) / 2
        return inside


def both_see(
    caster: RayCaster,
    points: FloatArray,
    directions: FloatArray,
    normals: FloatArray,
    partner: Partner,
    world_from_sensor: Pose,
) -> BoolArray:
    """Tell which hits the second device sees too.

    It must have them in its field of view and stand on the same side of their face as the first device, with
    nothing between. Rays ended at `points` (n, 3) and were going along `directions` (n, 3), world frame,
    metres; `normals` (n, 3) are units of the faces that they met, to either side. The pose is the first
    device's.
    """
    position = world_from_sensor.apply(np.array(partner.position_m))
    outward = normals * -np.copysign(1.0, np.einsum("ij,ij->i", normals, directions))[:, None]
    towards = position - points
    seen = np.einsum("ij,ij->i", towards, outward) > 0
    seen &= partner.sees(world_from_sensor.inverse().apply(points))
    left = np.flatnonzero(seen)
    distance = np.linalg.norm(towards[left], axis=1)
    lifted = points[left] + outward[left] * (_LIFT * distance)[:, None]
    seen[left] = ~caster.are_blocked(lifted, np.broadcast_to(position, lifted.shape))
    return np.asarray(seen, dtype=np.bool_)
