# SPDX-License-Identifier: MIT
"""Circular and elliptic cylinders: distance, normal, ray hit and their metric charts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import scipy

from scenes.checks import FloatArray, InputError, Value, check_direction, check_point, frozen_copy
from scenes.pose import Pose
from scenes.surfaces.surface import cross, reference_direction


@dataclass(frozen=True, slots=True, eq=False)
class Cylinder(Value):
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

    def transform(self, pose: Pose) -> Cylinder:
        """Return the cylinder moved by `pose`."""
        return Cylinder(
            pose.apply(self.point),
            pose.rotate(self.direction),
            self.radius,
            pose.rotate(self.zero_direction),
            self.concave,
        )

    transformed = transform  # earlier name


_N_FOOT_STEPS = 60  # Newton from the safe side is monotone; far fewer are needed off the axes
_N_ARC_STEPS = 30


@dataclass(frozen=True, slots=True, eq=False)
class EllipticCylinder(Value):
    """The cylinder about the axis through `point` along `direction` whose section is an ellipse, metres.

    `radii` are the greater and the smaller semi-axis, `zero_direction` that of the greater. The chart is
    (s, h): arc length along the ellipse from `zero_direction`, within half the perimeter, and height along
    the axis from `point`; it is isometric. `concave` is True for a wall seen from within.

    Examples
    --------
    >>> duct = EllipticCylinder((0, 0, 0), (0, 0, 1), radii=(2.0, 1.0), zero_direction=(1, 0, 0))
    >>> duct.distance(np.array([[0.0, 3.0, 5.0], [3.0, 0.0, 0.0]])).tolist()
    [2.0, 1.0]
    """

    point: FloatArray
    direction: FloatArray
    radii: tuple[float, float]
    zero_direction: FloatArray
    concave: bool

    kind: ClassVar[str] = "elliptic-cylinder"

    def __init__(
        self,
        point: object,
        direction: object,
        radii: tuple[float, float],
        zero_direction: object | None = None,
        concave: bool = False,
    ) -> None:
        greater, smaller = (float(radius) for radius in radii)
        if not (np.isfinite(greater) and greater >= smaller > 0):
            raise InputError(
                f"radii must be positive numbers of metres, the greater first, got {tuple(radii)}"
            )
        axis = check_direction("direction", direction)
        object.__setattr__(self, "point", frozen_copy(check_point("point", point)))
        object.__setattr__(self, "direction", frozen_copy(axis))
        object.__setattr__(self, "radii", (greater, smaller))
        object.__setattr__(self, "zero_direction", frozen_copy(reference_direction(axis, zero_direction)))
        object.__setattr__(self, "concave", bool(concave))

    @property
    def period(self) -> float:
        """The perimeter: s returns after it."""
        return float(4 * self.radii[1] * scipy.special.ellipe(self._parameter))

    @property
    def _parameter(self) -> float:
        """The elliptic integrals' m for arcs counted from the greater semi-axis."""
        return 1.0 - (self.radii[0] / self.radii[1]) ** 2

    @property
    def _side_direction(self) -> FloatArray:
        return cross(self.direction, self.zero_direction)

    def _section(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        offset = points - self.point
        return offset @ self.zero_direction, offset @ self._side_direction

    def distance(self, points: FloatArray) -> FloatArray:
        """Signed distance (n,): positive outside, or inside where the cylinder is concave."""
        x, y = self._section(points)
        cosine, sine = ellipse_feet(x, y, *self.radii)
        outward = _outward_distance(x, y, cosine, sine, *self.radii)
        return np.negative(outward) if self.concave else outward

    def normal(self, points: FloatArray) -> FloatArray:
        """Unit normals (n, 3) at the feet of `points`."""
        cosine, sine = ellipse_feet(*self._section(points), *self.radii)
        along, across = ellipse_normal(cosine, sine, *self.radii)
        outward: FloatArray = (
            along[..., None] * self.zero_direction + across[..., None] * self._side_direction
        )
        return np.negative(outward) if self.concave else outward

    def to_uv(self, points: FloatArray) -> FloatArray:
        """Chart coordinates (n, 2): arc length and height of the feet of `points`."""
        cosine, sine = ellipse_feet(*self._section(points), *self.radii)
        arc = self.radii[1] * scipy.special.ellipeinc(np.arctan2(sine, cosine), self._parameter)
        return np.stack([arc, (points - self.point) @ self.direction], axis=-1)

    def from_uv(self, uv: FloatArray) -> FloatArray:
        """Points (n, 3) of chart coordinates (n, 2)."""
        wanted, smaller = uv[..., 0], self.radii[1]
        angle = 2 * np.pi * wanted / self.period
        for _ in range(_N_ARC_STEPS):
            speed = smaller * np.sqrt(1 - self._parameter * np.sin(angle) ** 2)
            change = (smaller * scipy.special.ellipeinc(angle, self._parameter) - wanted) / speed
            angle = angle - np.clip(change, -0.5, 0.5)
            if np.abs(change).max(initial=0.0) < 1e-15:
                break
        placed: FloatArray = (
            self.point
            + self.radii[0] * np.cos(angle)[..., None] * self.zero_direction
            + smaller * np.sin(angle)[..., None] * self._side_direction
            + uv[..., 1:] * self.direction
        )
        return placed

    def ray_ranges(self, origins: FloatArray, directions: FloatArray) -> FloatArray:
        """Range (n,) along unit `directions` to the near wall, or the far one where concave; else inf."""
        x, y = self._section(origins)
        along, across = directions @ self.zero_direction, directions @ self._side_direction
        x, along = x / self.radii[0], along / self.radii[0]  # the section becomes the unit circle
        y, across = y / self.radii[1], across / self.radii[1]
        speed2 = along**2 + across**2
        along_axis = speed2 <= 1e-18 / self.radii[0] ** 2
        speed2 = np.where(along_axis, 1.0, speed2)
        middle = -(x * along + y * across) / speed2
        depth2 = 1.0 - (x + middle * along) ** 2 - (y + middle * across) ** 2
        meets = (depth2 >= 0) & ~along_axis
        half_chord = np.sqrt(np.where(meets, depth2, 0.0) / speed2)
        ranges = middle + half_chord if self.concave else middle - half_chord
        return np.where(meets & (ranges >= 0), ranges, np.inf)

    def transform(self, pose: Pose) -> EllipticCylinder:
        """Return the elliptic cylinder moved by `pose`."""
        return EllipticCylinder(
            pose.apply(self.point),
            pose.rotate(self.direction),
            self.radii,
            pose.rotate(self.zero_direction),
            self.concave,
        )

    transformed = transform  # earlier name


def ellipse_feet(
    x: FloatArray, y: FloatArray, greater: float, smaller: float
) -> tuple[FloatArray, FloatArray]:
    """Cosine and sine (n,) of the parameter t of the nearest ellipse points (a cos t, b sin t).

    The foot is (a^2 x / (q + a^2), b^2 y / (q + b^2)), q the largest root of a convex decreasing function
    (Eberly, Distance from a point to an ellipse): Newton from its left never overshoots.
    """
    u, v = np.abs(x) / greater, np.abs(y) / smaller
    ratio = (smaller / greater) ** 2
    # In units of a^2: (u / (q + 1))^2 + (ratio v / (q + ratio))^2 = 1, q > -ratio.
    pull = ratio * v
    q = np.maximum(pull - ratio, u - 1.0)
    for _ in range(_N_FOOT_STEPS):
        first = u / (q + 1.0)
        second = np.divide(pull, q + ratio, out=np.zeros_like(q), where=q + ratio > 0)
        excess = first**2 + second**2 - 1.0
        slope = first**2 / (q + 1.0) + np.divide(
            second**2, q + ratio, out=np.zeros_like(q), where=q + ratio > 0
        )
        change = np.divide(excess, 2 * slope, out=np.zeros_like(q), where=(excess > 0) & (slope > 0))
        q = q + change
        if (change <= 4e-16 * (np.abs(q) + ratio)).all():
            break
    cosine = np.minimum(u / (q + 1.0), 1.0)
    sine = np.divide(pull, q + ratio, out=np.sqrt(np.maximum(1 - cosine**2, 0.0)), where=q + ratio > 1e-300)
    length = np.hypot(cosine, sine)
    length = np.where(length > 0, length, 1.0)
    return np.copysign(cosine / length, x), np.copysign(sine / length, y)


def ellipse_normal(
    cosine: FloatArray, sine: FloatArray, greater: float, smaller: float
) -> tuple[FloatArray, FloatArray]:
    """Components (n,) of the outward unit normal at (a cos t, b sin t)."""
    along, across = smaller * cosine, greater * sine
    length = np.hypot(along, across)
    return along / length, across / length


def _outward_distance(
    x: FloatArray, y: FloatArray, cosine: FloatArray, sine: FloatArray, greater: float, smaller: float
) -> FloatArray:
    along, across = ellipse_normal(cosine, sine, greater, smaller)
    outward: FloatArray = along * (x - greater * cosine) + across * (y - smaller * sine)
    return outward
