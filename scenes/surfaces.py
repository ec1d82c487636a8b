# SPDX-License-Identifier: MIT
"""Plane and cylinder: distance, normal, ray hit and a metric chart on each."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Protocol, runtime_checkable

import numpy as np

from scenes.checks import FloatArray, InputError, check_direction, check_point, frozen_copy
from scenes.pose import Pose


@runtime_checkable
class Surface(Protocol):
    """What every surface offers. Points (n, 3) and charts (n, 2) in metres; charts are isometric."""

    kind: ClassVar[str]

    def distance(self, points: FloatArray) -> FloatArray:
        """Signed orthogonal distance (n,), positive on the side the normal points to."""
        ...

    def normal(self, points: FloatArray) -> FloatArray:
        """Unit normals (n, 3) at the surface points nearest to `points`."""
        ...

    def to_uv(self, points: FloatArray) -> FloatArray:
        """Chart coordinates (n, 2) of the surface points nearest to `points`."""
        ...

    def from_uv(self, uv: FloatArray) -> FloatArray:
        """World points (n, 3) of chart coordinates."""
        ...

    def ray_ranges(self, origins: FloatArray, directions: FloatArray) -> FloatArray:
        """Range (n,) to the first hit from the side the normal points to, inf where there is none."""
        ...

    def transformed(self, pose: Pose) -> Surface:
        """Return the surface moved by `pose`; its chart moves along."""
        ...

    @property
    def period(self) -> float:
        """Length after which the first chart coordinate is back at the same point; else inf."""
        ...


def perpendicular(direction: FloatArray) -> FloatArray:
    """Return a unit vector at right angles to `direction`, always the same one for the same direction."""
    x, y, z = (float(component) for component in direction)
    smallest = int(np.argmin([abs(x), abs(y), abs(z)]))
    across = ((0.0, z, -y), (-z, 0.0, x), (y, -x, 0.0))[smallest]  # direction x unit vector of that axis
    return np.array(across) / math.hypot(*across)


def _reference(axis: FloatArray, wished: object | None) -> FloatArray:
    """Return the unit vector at right angles to `axis` that is nearest to `wished`."""
    if wished is None:
        return perpendicular(axis)
    direction = check_direction("the chart's reference direction", wished)
    across = direction - axis * (axis @ direction)
    across = across - axis * (axis @ across)  # twice is enough, also for nearly parallel directions
    length = float(np.linalg.norm(across))
    if length < 1e-9:
        raise InputError(
            "the chart's reference direction is parallel to the normal or axis; give another one"
        )
    return across / length


@dataclass(frozen=True, slots=True, eq=False)
class Plane:
    """The plane through `point` with unit `normal`; chart origin `point`, u along `u_direction`.

    Examples
    --------
    >>> wall = Plane(point=(4, 0, 0), normal=(-1, 0, 0))
    >>> wall.distance(np.array([[3.0, 7.0, 1.0]])).tolist()
    [1.0]
    """

    point: FloatArray
    normal_direction: FloatArray
    u_direction: FloatArray

    kind: ClassVar[str] = "plane"

    def __init__(self, point: object, normal: object, u_direction: object | None = None) -> None:
        direction = check_direction("normal", normal)
        object.__setattr__(self, "point", frozen_copy(check_point("point", point)))
        object.__setattr__(self, "normal_direction", frozen_copy(direction))
        object.__setattr__(self, "u_direction", frozen_copy(_reference(direction, u_direction)))

    @property
    def v_direction(self) -> FloatArray:
        """Unit vector of the second chart axis; (u, v, normal) is right-handed."""
        return np.cross(self.normal_direction, self.u_direction)

    @property
    def period(self) -> float:
        """A plane's chart never returns: inf."""
        return float("inf")

    def distance(self, points: FloatArray) -> FloatArray:
        """Signed distance (n,), positive on the normal's side."""
        along: FloatArray = (points - self.point) @ self.normal_direction
        return along

    def normal(self, points: FloatArray) -> FloatArray:
        """The normal, once for each point."""
        return np.broadcast_to(self.normal_direction, points.shape).copy()

    def to_uv(self, points: FloatArray) -> FloatArray:
        """Chart coordinates (n, 2) of the feet of `points`."""
        offset = points - self.point
        return np.stack([offset @ self.u_direction, offset @ self.v_direction], axis=-1)

    def from_uv(self, uv: FloatArray) -> FloatArray:
        """Points (n, 3) of chart coordinates (n, 2)."""
        placed: FloatArray = self.point + uv[..., :1] * self.u_direction + uv[..., 1:] * self.v_direction
        return placed

    def ray_ranges(self, origins: FloatArray, directions: FloatArray) -> FloatArray:
        """Range (n,) along unit `directions`, inf for rays that leave or come from behind."""
        approach = -(directions @ self.normal_direction)
        height = self.distance(origins)
        hit = (approach > 1e-12) & (height >= 0)
        return np.where(hit, height / np.where(hit, approach, 1.0), np.inf)

    def transformed(self, pose: Pose) -> Plane:
        """Return the plane moved by `pose`."""
        return Plane(
            pose.apply(self.point), pose.rotate(self.normal_direction), pose.rotate(self.u_direction)
        )

    def flipped(self) -> Plane:
        """Return the same plane seen from its other side."""
        return Plane(self.point, -self.normal_direction, self.u_direction)


@dataclass(frozen=True, slots=True, eq=False)
class Cylinder:
    """The circular cylinder about the axis through `point` along `direction`, metres.

    Its chart is (s, h): arc length s = radius * angle from `zero_direction`, in (-pi r, pi r], and height h
    along the axis from `point`. `concave` is True for a wall seen from within (a vault, the inside of a
    pipe): normals then point to the axis and a ray meets the farther wall.

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
        object.__setattr__(self, "zero_direction", frozen_copy(_reference(axis, zero_direction)))
        object.__setattr__(self, "concave", bool(concave))

    @property
    def period(self) -> float:
        """The circumference: s returns after 2 pi r."""
        return float(2 * np.pi * self.radius)

    @property
    def _side_direction(self) -> FloatArray:
        return np.cross(self.direction, self.zero_direction)

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


def surfaces_close(first: Surface, second: Surface, *, angle: float, length: float) -> bool:
    """Tell whether two surfaces of one kind agree within `angle` (radians) and `length` (metres).

    Planes are compared at the first one's chart origin, cylinders by axis distance there and radius. The
    side from which they are seen does not count.
    """
    if isinstance(first, Plane) and isinstance(second, Plane):
        between = np.linalg.norm(np.cross(first.normal_direction, second.normal_direction))
        offset = abs(float(second.distance(first.point[None])[0]))
        return bool(between <= np.sin(angle)) and offset <= length
    if isinstance(first, Cylinder) and isinstance(second, Cylinder):
        between = np.linalg.norm(np.cross(first.direction, second.direction))
        offset = float(np.linalg.norm(second._radial(first.point[None])))
        same_radius = abs(first.radius - second.radius) <= length
        return bool(between <= np.sin(angle)) and offset <= length and same_radius
    return False
