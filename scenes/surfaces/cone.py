# SPDX-License-Identifier: MIT
"""The circular cone: distance, normal, ray hit and its unrolled chart."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from scenes.checks import FloatArray, InputError, Value, check_direction, check_point, frozen_copy
from scenes.pose import Pose
from scenes.surfaces.surface import cross, reference_direction


@dataclass(frozen=True, slots=True, eq=False)
class Cone(Value):
    """One nappe of a circular cone: radius `radius` about the axis at `point`, growing along `direction`.

    The apex is derived, so that slender cones are described as well as blunt ones. The chart is the cone
    unrolled into the plane: isometric, v along the generator through `zero_direction`, u across it, origin
    on that generator at `point`'s height. Unrolled, the cone is a sector of angle 2 pi sin(half_angle): the
    chart is cut along the generator opposite `zero_direction` and returns after a turn, not a shift, so
    `period` is inf. `concave` is True for a funnel seen from within.

    Parameters
    ----------
    point, direction : (3,) float
        On the axis, metres, and along it to where the cone grows wider; made a unit vector.
    radius : float
        At `point`, metres.
    half_angle : float
        Between axis and generator, radians.
    zero_direction : (3,) float, optional
        From the axis to the generator on which u is 0.
    concave : bool
        Whether it is seen from within.

    Raises
    ------
    InputError
        Numbers that are not finite, a radius or an angle out of range, a direction without length.

    Examples
    --------
    >>> hat = Cone(point=(0, 0, 1), direction=(0, 0, 1), radius=1.0, half_angle=np.pi / 4)
    >>> hat.distance(np.array([[3.0, 0, 1]])).round(9).tolist()
    [1.414213562]
    """

    point: FloatArray
    direction: FloatArray
    radius: float
    half_angle: float
    zero_direction: FloatArray
    concave: bool

    kind: ClassVar[str] = "cone"

    def __init__(
        self,
        point: object,
        direction: object,
        radius: float,
        half_angle: float,
        zero_direction: object | None = None,
        concave: bool = False,
    ) -> None:
        if not np.isfinite(radius) or radius <= 0:
            raise InputError(f"radius must be a positive number of metres, got {radius}")
        if not 0 < half_angle < np.pi / 2:
            raise InputError(f"half_angle must lie between 0 and pi / 2, got {half_angle}")
        axis = check_direction("direction", direction)
        object.__setattr__(self, "point", frozen_copy(check_point("point", point)))
        object.__setattr__(self, "direction", frozen_copy(axis))
        object.__setattr__(self, "radius", float(radius))
        object.__setattr__(self, "half_angle", float(half_angle))
        object.__setattr__(self, "zero_direction", frozen_copy(reference_direction(axis, zero_direction)))
        object.__setattr__(self, "concave", bool(concave))

    @property
    def apex(self) -> FloatArray:
        """The tip (3,), metres."""
        tip: FloatArray = self.point - (self.radius / np.tan(self.half_angle)) * self.direction
        return tip

    @property
    def period(self) -> float:
        """The unrolled chart turns instead of repeating: inf."""
        return float("inf")

    def radius_at(self, points: FloatArray) -> FloatArray:
        """Radius (n,) of the cone at the height of `points`, negative beyond the apex."""
        grown: FloatArray = self.radius + ((points - self.point) @ self.direction) * np.tan(self.half_angle)
        return grown

    def _meridian(self, points: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Radial vectors, distances outward and slant heights above `point`'s circle along the generator."""
        offset = points - self.point
        height = offset @ self.direction
        radial = offset - height[..., None] * self.direction
        beyond = np.linalg.norm(radial, axis=-1) - self.radius
        sine, cosine = np.sin(self.half_angle), np.cos(self.half_angle)
        return radial, cosine * beyond - sine * height, sine * beyond + cosine * height

    def distance(self, points: FloatArray) -> FloatArray:
        """Signed distance (n,): positive outside, or inside where concave; behind the apex to the apex."""
        _, outward, slant = self._meridian(points)
        below = slant + self.radius / np.sin(self.half_angle)
        outward = np.where(below < 0, np.hypot(outward, below), outward)
        return np.negative(outward) if self.concave else outward

    def normal(self, points: FloatArray) -> FloatArray:
        """Unit normals (n, 3) of the generators nearest to `points`."""
        radial, _, _ = self._meridian(points)
        length = np.linalg.norm(radial, axis=-1, keepdims=True)
        level = np.where(length > 0, radial / np.where(length > 0, length, 1.0), self.zero_direction)
        outward: FloatArray = np.cos(self.half_angle) * level - np.sin(self.half_angle) * self.direction
        return np.negative(outward) if self.concave else outward

    def to_uv(self, points: FloatArray) -> FloatArray:
        """Chart coordinates (n, 2) of the feet of `points` on the unrolled cone."""
        radial, _, slant = self._meridian(points)
        side = cross(self.direction, self.zero_direction)
        sine = np.sin(self.half_angle)
        turn = np.arctan2(radial @ side, radial @ self.zero_direction) * sine
        from_apex = np.maximum(slant + self.radius / sine, 0.0)
        return np.stack([from_apex * np.sin(turn), slant - 2 * from_apex * np.sin(turn / 2) ** 2], axis=-1)

    def from_uv(self, uv: FloatArray) -> FloatArray:
        """Points (n, 3) of chart coordinates (n, 2)."""
        sine, cosine = np.sin(self.half_angle), np.cos(self.half_angle)
        u, v = uv[..., :1], uv[..., 1:]
        to_origin = self.radius / sine
        angle = np.arctan2(u, v + to_origin) / sine
        from_apex = np.hypot(u, v + to_origin)
        slant = v + u**2 / (
            from_apex + v + to_origin + (from_apex == 0)
        )  # |.| - to_origin, nothing cancelled
        slant = np.where(v + to_origin > 0, slant, from_apex - to_origin)
        level = np.cos(angle) * self.zero_direction + np.sin(angle) * cross(
            self.direction, self.zero_direction
        )
        placed: FloatArray = (
            self.point + (self.radius + sine * slant) * level + cosine * slant * self.direction
        )
        return placed

    def ray_ranges(self, origins: FloatArray, directions: FloatArray) -> FloatArray:
        """Range (n,) along unit `directions` to the first hit of the seen side; else inf."""
        offset = origins - self.apex
        sine2, cosine2 = np.sin(self.half_angle) ** 2, np.cos(self.half_angle) ** 2
        height, rise = offset @ self.direction, directions @ self.direction
        across = offset - height[..., None] * self.direction
        spread = directions - rise[..., None] * self.direction
        a = cosine2 * np.einsum("...i,...i->...", spread, spread) - sine2 * rise**2
        b = cosine2 * np.einsum("...i,...i->...", spread, across) - sine2 * rise * height
        c = cosine2 * np.einsum("...i,...i->...", across, across) - sine2 * height**2
        discriminant = b * b - a * c
        root = np.sqrt(np.maximum(discriminant, 0.0))
        q = -(b + np.where(b >= 0, root, -root))
        values = np.full(np.broadcast(a, b).shape, np.inf)
        for top, bottom in ((q, a), (c, q)):
            defined = (np.abs(bottom) > 1e-300) & (discriminant >= 0)
            ranges = top / np.where(defined, bottom, 1.0)
            slope = a * ranges + b  # half the derivative along the ray: negative where it goes in
            facing = slope > 0 if self.concave else slope < 0
            valid = defined & facing & (ranges >= 0) & (height + ranges * rise >= 0)
            values = np.where(valid & (ranges < values), ranges, values)
        return values

    def transform(self, pose: Pose) -> Cone:
        """Return the cone moved by `pose`."""
        return Cone(
            point=pose.apply(self.point),
            direction=pose.rotate(self.direction),
            radius=self.radius,
            half_angle=self.half_angle,
            zero_direction=pose.rotate(self.zero_direction),
            concave=self.concave,
        )

    transformed = transform  # earlier name
