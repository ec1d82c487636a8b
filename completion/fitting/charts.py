# SPDX-License-Identifier: MIT
"""Minimal local charts for fitting: residual, gradient and step of each surface, regular at the fit itself.

Every chart is turned so that the surface's axis is z and has its origin at the axis point nearest to the
points' centroid (which is the origin of the coordinates here). After each step the chart is made anew: the
formulation of NPL's least-squares geometric elements. No chart holds a redundant parameter or an apex.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import ClassVar, Protocol

import numpy as np

from scenes.checks import FloatArray
from scenes.elliptic_cylinder import ellipse_feet, ellipse_normal
from scenes.surfaces import Cone, Cylinder, EllipticCylinder, Plane, Sphere, Surface, perpendicular


class Chart(Protocol):
    """A surface near which to linearise; lengths in the unit of the points."""

    n_parameters: ClassVar[int]

    @property
    def origin(self) -> FloatArray:
        """The chart's origin (3,)."""
        ...

    @property
    def frame(self) -> FloatArray:
        """Rows x, y, z of the chart (3, 3)."""
        ...

    def linearise(self, local: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Residuals (n,) and gradient (k, n) at points given in the chart, shape (3, n)."""
        ...

    def basis(self) -> FloatArray:
        """Parameter changes (k, k), one a column, in which the normal equations are well conditioned.

        On a shallow arc a greater radius and an axis farther away look alike. A radius that grows about the
        place where the points are does not look like any other change.
        """
        ...

    def moved(self, change: FloatArray) -> Chart | None:
        """The chart after a step (k,), None where no surface is left."""
        ...

    def lengths(self) -> FloatArray:
        """1 for each parameter that is a length, 0 for each angle (k,)."""
        ...

    def surface(self, centre: FloatArray, scale: float, concave: bool) -> Surface:
        """The surface, its lengths multiplied by `scale` and moved by `centre`."""
        ...

    def size(self) -> float:
        """What lengths are compared with: the radius, at least 1."""
        ...


def axis_frame(axis: FloatArray) -> FloatArray:
    """Rows x, y, z of a right-handed frame whose z is the axis (Duff et al. 2017: no cross product)."""
    x, y, z = axis.tolist()
    sign = math.copysign(1.0, z)
    a = -1.0 / (sign + z)
    b = x * y * a
    return np.array([[1 + sign * x * x * a, sign * b, -sign * x], [b, sign + y * y * a, -y], [x, y, z]])


def _radius_about(touch: FloatArray, n_parameters: int) -> FloatArray:
    """The basis in which the last parameter, the radius, draws the centre back along `touch` (2 or 3,)."""
    basis = np.eye(n_parameters)
    basis[: len(touch), -1] = -touch / max(1.0, float(np.linalg.norm(touch)))
    return basis


def _moved_axis(
    origin: FloatArray, frame: FloatArray, change: FloatArray
) -> tuple[FloatArray, FloatArray, float]:
    """Axis point nearest to the centroid, axis, and how far that point moved along it."""
    axis = frame.T @ np.array([change[2], change[3], 1.0])
    axis = axis / np.linalg.norm(axis)
    point = origin + frame.T @ np.array([change[0], change[1], 0.0])
    along = -float(point @ axis)
    return point + along * axis, axis, along


@dataclass(frozen=True, slots=True, eq=False)
class PlaneChart:
    """Offset along the normal, slopes along the plane's own u and v."""

    origin: FloatArray
    frame: FloatArray

    n_parameters: ClassVar[int] = 3

    def linearise(self, local: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Heights; gradient 1, u, v: the change of the plane's height, so that its sign is the surface's."""
        return local[2], np.stack([np.ones(local.shape[1]), local[0], local[1]])

    def basis(self) -> FloatArray:
        """The parameters themselves."""
        return np.eye(self.n_parameters)

    def moved(self, change: FloatArray) -> PlaneChart:
        """Planes are fitted in closed form; a step is a shift and a tilt."""
        normal = self.frame.T @ np.array([change[1], change[2], 1.0])
        normal = normal / np.linalg.norm(normal)
        point = self.origin - change[0] * self.frame[2]
        return PlaneChart(point, axis_frame(normal))

    def lengths(self) -> FloatArray:
        """Offset is a length."""
        return np.array([1.0, 0, 0])

    def surface(self, centre: FloatArray, scale: float, concave: bool) -> Plane:  # noqa: ARG002 - planes have no inside
        """The plane."""
        return Plane(centre + scale * self.origin, self.frame[2], self.frame[0])

    def size(self) -> float:
        """Planes have none."""
        return 1.0


@dataclass(frozen=True, slots=True, eq=False)
class SphereChart:
    """Centre and radius: f = |x - c| - r."""

    origin: FloatArray
    radius: float

    n_parameters: ClassVar[int] = 4

    @property
    def frame(self) -> FloatArray:
        """The world's axes."""
        return np.eye(3)

    def linearise(self, local: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Residuals and gradient -(u, 1), u the unit radial."""
        distance = np.sqrt(np.einsum("ij,ij->j", local, local))
        gradient = np.empty((4, local.shape[1]))
        np.divide(local, -np.maximum(distance, 1e-300), out=gradient[:3])
        gradient[3] = -1.0
        return distance - self.radius, gradient

    def basis(self) -> FloatArray:
        """The radius grows about where the points are."""
        return _radius_about(-self.origin / self.radius, 4)

    def moved(self, change: FloatArray) -> SphereChart | None:
        """Shift the centre, change the radius."""
        radius = self.radius + float(change[3])
        return SphereChart(self.origin + change[:3], radius) if radius > 0 else None

    def lengths(self) -> FloatArray:
        """All are lengths."""
        return np.ones(4)

    def surface(self, centre: FloatArray, scale: float, concave: bool) -> Sphere:
        """The sphere, its poles at right angles to where the points are."""
        place = -self.origin / max(float(np.linalg.norm(self.origin)), 1e-300)
        pole = perpendicular(place) if np.linalg.norm(place) > 0.5 else np.array([0.0, 0.0, 1.0])
        facing = place if np.linalg.norm(place) > 0.5 else None
        return Sphere(centre + scale * self.origin, scale * self.radius, pole, facing, concave)

    def size(self) -> float:
        """The radius."""
        return max(1.0, self.radius)


@dataclass(frozen=True, slots=True, eq=False)
class CylinderChart:
    """Two shifts and two tilts of the axis, and the radius: f = sqrt(x^2 + y^2) - r."""

    origin: FloatArray
    frame: FloatArray
    radius: float

    n_parameters: ClassVar[int] = 5

    def linearise(self, local: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Residuals and gradient (-ux, -uy, -z ux, -z uy, -1)."""
        x, y, z = local
        distance = np.sqrt(x * x + y * y)
        gradient = np.empty((5, local.shape[1]))
        inverse = -1.0 / np.maximum(distance, 1e-300)
        np.multiply(x, inverse, out=gradient[0])
        np.multiply(y, inverse, out=gradient[1])
        np.multiply(gradient[:2], z, out=gradient[2:4])
        gradient[4] = -1.0
        return distance - self.radius, gradient

    def basis(self) -> FloatArray:
        """The radius grows about where the points are."""
        return _radius_about(self.frame[:2] @ -self.origin / self.radius, 5)

    def moved(self, change: FloatArray) -> CylinderChart | None:
        """The chart on the moved axis."""
        radius = self.radius + float(change[4])
        origin, axis, _ = _moved_axis(self.origin, self.frame, change)
        return CylinderChart(origin, axis_frame(axis), radius) if radius > 0 else None

    def lengths(self) -> FloatArray:
        """Shifts and radius are lengths."""
        return np.array([1.0, 1, 0, 0, 1])

    def surface(self, centre: FloatArray, scale: float, concave: bool) -> Cylinder:
        """The cylinder."""
        return Cylinder(centre + scale * self.origin, self.frame[2], scale * self.radius, None, concave)

    def size(self) -> float:
        """The radius."""
        return max(1.0, self.radius)


@dataclass(frozen=True, slots=True, eq=False)
class ConeChart:
    """Axis, radius s at the origin, half angle phi <= 0 where the cone grows along z.

    f = cos(phi) (r - s) + sin(phi) z: regular at phi = 0, where the cone is a cylinder.
    """

    origin: FloatArray
    frame: FloatArray
    radius: float
    phi: float

    n_parameters: ClassVar[int] = 6

    def linearise(self, local: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Residuals and gradient in the order x, y, tilts, s, phi."""
        x, y, z = local
        cosine, sine = np.cos(self.phi), np.sin(self.phi)
        distance = np.sqrt(x * x + y * y)
        inverse = -cosine / np.maximum(distance, 1e-300)
        gradient = np.empty((6, local.shape[1]))
        np.multiply(x, inverse, out=gradient[0])
        np.multiply(y, inverse, out=gradient[1])
        gradient[2] = z * gradient[0] + sine * x
        gradient[3] = z * gradient[1] + sine * y
        gradient[4] = -cosine
        beyond = distance - self.radius
        gradient[5] = cosine * z - sine * beyond
        return cosine * beyond + sine * z, gradient

    def basis(self) -> FloatArray:
        """The parameters themselves."""
        return np.eye(self.n_parameters)

    def moved(self, change: FloatArray) -> ConeChart | None:
        """The chart on the moved axis, its radius taken where the new origin is."""
        phi = self.phi + float(change[5])
        if abs(phi) >= 0.4999 * np.pi:
            return None
        origin, axis, along = _moved_axis(self.origin, self.frame, change)
        return ConeChart(origin, axis_frame(axis), self.radius + float(change[4]) - along * np.tan(phi), phi)

    def growing(self) -> ConeChart:
        """The same cone with z towards the growing radius, where that is positive at the origin."""
        if self.phi > 0:
            return replace(self, frame=axis_frame(-self.frame[2]), phi=-self.phi)
        return self

    def lengths(self) -> FloatArray:
        """Shifts and radius are lengths."""
        return np.array([1.0, 1, 0, 0, 1, 0])

    def surface(self, centre: FloatArray, scale: float, concave: bool) -> Cone:
        """The cone; one that does not open has no apex and is refused by Cone."""
        point = centre + scale * self.origin
        return Cone(point, self.frame[2], scale * self.radius, max(-self.phi, 1e-300), None, concave)

    def size(self) -> float:
        """The radius at the origin."""
        return max(1.0, self.radius)


@dataclass(frozen=True, slots=True, eq=False)
class EllipticChart:
    """Axis (4), mean radius, and the ellipse's shape as two numbers that stay regular at a circle.

    The section is the image of the unit circle under [[m + p, q], [q, m - p]] up to a turn: p = (a - b) / 2,
    q = 0 in the chart of its own axes, where gradients by envelope are the foot's normal times its motion.
    """

    origin: FloatArray
    frame: FloatArray
    greater: float
    smaller: float

    n_parameters: ClassVar[int] = 7

    def linearise(self, local: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Residuals and gradient in the order x, y, tilts, m, p, q."""
        x, y, z = local
        cosine, sine = ellipse_feet(x, y, self.greater, self.smaller)
        along, across = ellipse_normal(cosine, sine, self.greater, self.smaller)
        gradient = np.empty((7, local.shape[1]))
        gradient[0], gradient[1] = -along, -across
        np.multiply(gradient[:2], z, out=gradient[2:4])
        by_greater, by_smaller = -along * cosine, -across * sine
        gradient[4] = by_greater + by_smaller
        gradient[5] = by_greater - by_smaller
        weight = np.hypot(self.smaller * cosine, self.greater * sine)
        gradient[6] = -sine * cosine * (self.greater + self.smaller) / weight
        residual = along * (x - self.greater * cosine) + across * (y - self.smaller * sine)
        return residual, gradient

    def basis(self) -> FloatArray:
        """The parameters themselves."""
        return np.eye(self.n_parameters)

    def moved(self, change: FloatArray) -> EllipticChart | None:
        """The chart on the moved axis, turned to the new ellipse's own axes."""
        mean = (self.greater + self.smaller) / 2 + float(change[4])
        p, q = (self.greater - self.smaller) / 2 + float(change[5]), float(change[6])
        half = float(np.hypot(p, q))
        if mean <= half or mean <= 0:
            return None
        turn = np.arctan2(q, p) / 2
        ahead = self.frame.T @ np.array([np.cos(turn), np.sin(turn), 0.0])
        origin, axis, _ = _moved_axis(self.origin, self.frame, change)
        return EllipticChart(origin, turned_frame(axis, ahead), mean + half, mean - half)

    def lengths(self) -> FloatArray:
        """All but the tilts are lengths."""
        return np.array([1.0, 1, 0, 0, 1, 1, 1])

    def surface(self, centre: FloatArray, scale: float, concave: bool) -> EllipticCylinder:
        """The elliptic cylinder."""
        radii = (scale * self.greater, scale * self.smaller)
        return EllipticCylinder(centre + scale * self.origin, self.frame[2], radii, self.frame[0], concave)

    def size(self) -> float:
        """The greater radius."""
        return max(1.0, self.greater)


def turned_frame(axis: FloatArray, ahead: FloatArray) -> FloatArray:
    """Rows x, y, z of a frame with z the axis and x as near to `ahead` as can be."""
    x_axis = ahead - axis * (ahead @ axis)
    x_axis = x_axis / np.linalg.norm(x_axis)
    return np.stack([x_axis, np.cross(axis, x_axis), axis])


def chart_of(surface: Surface, centre: FloatArray, scale: float) -> Chart:
    """The chart at a surface, in coordinates relative to `centre` in units of `scale`."""
    if isinstance(surface, Plane):
        frame = np.stack([surface.u_direction, surface.v_direction, surface.normal_direction])
        return PlaneChart((surface.point - centre) / scale, frame)
    if isinstance(surface, Sphere):
        return SphereChart((surface.centre - centre) / scale, surface.radius / scale)
    if isinstance(surface, Cylinder | Cone | EllipticCylinder):
        point = (surface.point - centre) / scale
        along = -float(point @ surface.direction)
        origin = point + along * surface.direction
        if isinstance(surface, Cylinder):
            return CylinderChart(origin, axis_frame(surface.direction), surface.radius / scale)
        if isinstance(surface, EllipticCylinder):
            frame = turned_frame(surface.direction, surface.zero_direction)
            return EllipticChart(origin, frame, surface.radii[0] / scale, surface.radii[1] / scale)
        radius = surface.radius / scale + along * np.tan(surface.half_angle)
        return ConeChart(origin, axis_frame(surface.direction), float(radius), -surface.half_angle)
    raise TypeError(f"no chart is known for a {type(surface).__name__}")
