# SPDX-License-Identifier: MIT
"""The sphere: distance, normal, ray hit and a chart of longitude and latitude."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from scenes.checks import FloatArray, InputError, check_direction, check_point, frozen_copy
from scenes.pose import Pose
from scenes.surfaces.surface import cross, reference_direction


@dataclass(frozen=True, slots=True, eq=False)
class Sphere:
    """The sphere about `centre`, metres.

    No chart of a sphere is isometric (Gauss). This one is (radius * longitude, radius * latitude) about
    `pole_direction`, longitude counted from `zero_direction`: lengths are true along v everywhere and along
    u on the equator; elsewhere u is stretched by 1 / cos(latitude), and each pole is a whole line. Turn the
    pole away from the data. `concave` is True for a sphere seen from within.

    Examples
    --------
    >>> ball = Sphere(centre=(0, 0, 0), radius=0.5)
    >>> ball.distance(np.array([[0.0, 2.0, 0.0]])).tolist()
    [1.5]
    """

    centre: FloatArray
    radius: float
    pole_direction: FloatArray
    zero_direction: FloatArray
    concave: bool

    kind: ClassVar[str] = "sphere"

    def __init__(
        self,
        centre: object,
        radius: float,
        pole_direction: object = (0.0, 0.0, 1.0),
        zero_direction: object | None = None,
        concave: bool = False,
    ) -> None:
        if not np.isfinite(radius) or radius <= 0:
            raise InputError(f"radius must be a positive number of metres, got {radius}")
        pole = check_direction("pole_direction", pole_direction)
        object.__setattr__(self, "centre", frozen_copy(check_point("centre", centre)))
        object.__setattr__(self, "radius", float(radius))
        object.__setattr__(self, "pole_direction", frozen_copy(pole))
        object.__setattr__(self, "zero_direction", frozen_copy(reference_direction(pole, zero_direction)))
        object.__setattr__(self, "concave", bool(concave))

    @property
    def period(self) -> float:
        """The length of the equator: u returns after 2 pi r."""
        return float(2 * np.pi * self.radius)

    def distance(self, points: FloatArray) -> FloatArray:
        """Signed distance (n,): positive outside, or inside where the sphere is concave."""
        outward: FloatArray = np.linalg.norm(points - self.centre, axis=-1) - self.radius
        return np.negative(outward) if self.concave else outward

    def normal(self, points: FloatArray) -> FloatArray:
        """Unit normals (n, 3): away from the centre, or towards it where the sphere is concave."""
        radial = points - self.centre
        length = np.linalg.norm(radial, axis=-1, keepdims=True)
        outward = np.where(length > 0, radial / np.where(length > 0, length, 1.0), self.zero_direction)
        return -outward if self.concave else outward

    def to_uv(self, points: FloatArray) -> FloatArray:
        """Chart coordinates (n, 2): longitude and latitude of the feet of `points`, times the radius."""
        offset = points - self.centre
        ahead, height = offset @ self.zero_direction, offset @ self.pole_direction
        aside = offset @ cross(self.pole_direction, self.zero_direction)
        longitude, latitude = np.arctan2(aside, ahead), np.arctan2(height, np.hypot(ahead, aside))
        return self.radius * np.stack([longitude, latitude], axis=-1)

    def from_uv(self, uv: FloatArray) -> FloatArray:
        """Points (n, 3) of chart coordinates (n, 2)."""
        longitude, latitude = uv[..., :1] / self.radius, uv[..., 1:] / self.radius
        aside = cross(self.pole_direction, self.zero_direction)
        level = np.cos(longitude) * self.zero_direction + np.sin(longitude) * aside
        outward = np.cos(latitude) * level + np.sin(latitude) * self.pole_direction
        placed: FloatArray = self.centre + self.radius * outward
        return placed

    def ray_ranges(self, origins: FloatArray, directions: FloatArray) -> FloatArray:
        """Range (n,) along unit `directions` to the near side, or the far one where concave; else inf."""
        offset = origins - self.centre
        middle = -np.einsum("...i,...i->...", directions, offset)  # where the ray is nearest the centre
        nearest = offset + middle[..., None] * directions
        depth2 = self.radius**2 - np.einsum("...i,...i->...", nearest, nearest)
        half_chord = np.sqrt(np.maximum(depth2, 0.0))
        ranges = middle + half_chord if self.concave else middle - half_chord
        return np.where((depth2 >= 0) & (ranges >= 0), ranges, np.inf)

    def transformed(self, pose: Pose) -> Sphere:
        """Return the sphere moved by `pose`."""
        return Sphere(
            pose.apply(self.centre),
            self.radius,
            pose.rotate(self.pole_direction),
            pose.rotate(self.zero_direction),
            self.concave,
        )
