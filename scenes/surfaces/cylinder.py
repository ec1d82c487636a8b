# SPDX-License-Identifier: MIT
"""The circular cylinder: distance, normal, ray hit and its metric chart."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from scenes.checks import FloatArray, InputError, check_direction, check_point, frozen_copy
from scenes.pose import Pose
from scenes.surfaces.surface import cross, reference_direction


@dataclass(frozen=True, slots=True, eq=False)
class Cylinder:
    """The circular cylinder about the axis through `point` along `direction`, metres.

    Its chart is (s, h): arc length s = radius * angle from `zero_direction`, in (-pi r, pi r], and height h
    along the axis from `point`. `concave` is True for a wall seen from within (a vault, the inside of a
    pipe): normals then point to the axis and a ray meets the farther wall.

    Parameters
    ----------
    point, direction : (3,) float
        On the axis, metres, and along it; made a unit vector.
    radius : float
        Metres.
    zero_direction : (3,) float, optional
        From the axis to where arc length is 0.
    concave : bool
        Whether it is seen from within.

    Raises
    ------
    InputError
        Numbers that are not finite, a radius that is not positive, a direction without length.

    Examples
    --------
    >>> post = Cylinder(point=(0, 0, 0), direction=(0, 0, 1), radius=0.5)
    >>> post.distance(np.array([[2.0, 0.0, 9.0]])).tolist()
    [1.5]
    """

    point: FloatArray
    direction: FloatArray
    radius: float
    zero_direction: FloatArray
    concave: bool

    kind: ClassVar[str] = "cylinder"

    def __init__(
        self,
        point: object,
        direction: object,
        radius: float,
        zero_direction: object | None = None,
        concave: bool = False,
    ) -> None:
        if not np.isfinite(radius) or radius <= 0:
            raise InputError(f"radius must be a positive number of metres, got {radius}")
        axis = check_direction("direction", direction)
        object.__setattr__(self, "point", frozen_copy(check_point("point", point)))
        object.__setattr__(self, "direction", frozen_copy(axis))
        object.__setattr__(self, "radius", float(radius))
        object.__setattr__(self, "zero_direction", frozen_copy(reference_direction(axis, zero_direction)))
        object.__setattr__(self, "concave", bool(concave))

    @property
    def period(self) -> float:
        """The circumference: s returns after 2 pi r."""
        return float(2 * np.pi * self.radius)

    @property
    def _side_direction(self) -> FloatArray:
        return cross(self.direction, self.zero_direction)

    def _radial(self, points: FloatArray) -> FloatArray:
        offset = points - self.point
        radial: FloatArray = offset - (offset @ self.direction)[..., None] * self.direction
        return radial

    def distance(self, points: FloatArray) -> FloatArray:
        """Signed distance (n,): positive outside, or inside where the cylinder is concave."""
        outward: FloatArray = np.linalg.norm(self._radial(points), axis=-1) - self.radius
        return np.negative(outward) if self.concave else outward

    def normal(self, points: FloatArray) -> FloatArray:
        """Unit normals (n, 3): away from the axis, or towards it where the cylinder is concave."""
        radial = self._radial(points)
        length = np.linalg.norm(radial, axis=-1, keepdims=True)
        outward = np.where(length > 0, radial / np.where(length > 0, length, 1.0), self.zero_direction)
        return -outward if self.concave else outward

    def to_uv(self, points: FloatArray) -> FloatArray:
        """Chart coordinates (n, 2): arc length and height of the feet of `points`."""
        offset = points - self.point
        angle = np.arctan2(offset @ self._side_direction, offset @ self.zero_direction)
        return np.stack([self.radius * angle, offset @ self.direction], axis=-1)

    def from_uv(self, uv: FloatArray) -> FloatArray:
        """Points (n, 3) of chart coordinates (n, 2)."""
        angle = uv[..., :1] / self.radius
        outward = np.cos(angle) * self.zero_direction + np.sin(angle) * self._side_direction
        placed: FloatArray = self.point + self.radius * outward + uv[..., 1:] * self.direction
        return placed

    def ray_ranges(self, origins: FloatArray, directions: FloatArray) -> FloatArray:
        """Range (n,) along unit `directions` to the near wall, or the far one where concave; else inf."""
        from_axis = self._radial(origins)
        across = directions - (directions @ self.direction)[..., None] * self.direction
        speed2 = np.einsum("...i,...i->...", across, across)
        along_axis = speed2 <= 1e-18
        speed2 = np.where(along_axis, 1.0, speed2)
        middle = -np.einsum("...i,...i->...", across, from_axis) / speed2  # where the ray is nearest the axis
        nearest = from_axis + middle[..., None] * across
        depth2 = self.radius**2 - np.einsum("...i,...i->...", nearest, nearest)
        meets = (depth2 >= 0) & ~along_axis
        half_chord = np.sqrt(np.where(meets, depth2, 0.0) / speed2)
        ranges = middle + half_chord if self.concave else middle - half_chord
        return np.where(meets & (ranges >= 0), ranges, np.inf)

    def transformed(self, pose: Pose) -> Cylinder:
        """Return the cylinder moved by `pose`."""
        return Cylinder(
            pose.apply(self.point),
            pose.rotate(self.direction),
            self.radius,
            pose.rotate(self.zero_direction),
            self.concave,
        )
