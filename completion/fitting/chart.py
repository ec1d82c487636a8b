# SPDX-License-Identifier: MIT
"""Chart: a minimal local parametrisation of a surface, regular at the fit itself, to linearise and step in.

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
from scenes.surfaces.catalogue import Cone, Cylinder, EllipticCylinder, Plane, Sphere, Surface, Torus
from scenes.surfaces.cylinder import ellipse_feet, ellipse_normal
from scenes.surfaces.surface import perpendicular


class Chart(Protocol):
    """A surface near which to linearise; lengths in the unit of the points."""

    @property
    def n_parameters(self) -> int:
        """How many parameters it has."""
        ...

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

    def move(self, change: FloatArray) -> Chart | None:
        """The chart after a step (k,), None where no surface is left."""
        ...

    def lengths(self) -> FloatArray:
        """1 for each parameter that is a length, 0 for each angle (k,)."""
        ...

    def surface(self, centre: FloatArray, scale: float, concave: bool) -> Surface:
        """The surface, its lengths multiplied by `scale` and moved by `centre` (3,)."""
        ...

    def size(self) -> float:
        """What lengths are compared with: the radius, at least 1."""
        ...


def axis_frame(axis: FloatArray) -> FloatArray:
    """Rows x, y, z (3, 3) of a right-handed frame whose z is a unit axis (3,) (Duff et al. 2017)."""
    x, y, z = axis.tolist()
    sign = math.copysign(1.0, z)
    a = -1.0 / (sign + z)
    b = x * y * a
    return np.array([[1 + sign * x * x * a, sign * b, -sign * x], [b, sign + y * y * a, -y], [x, y, z]])


def turned_frame(axis: FloatArray, ahead: FloatArray) -> FloatArray:
    """Rows x, y, z (3, 3) of a frame with z a unit axis (3,) and x as near to `ahead` (3,) as can be."""
    x_axis = ahead - axis * (ahead @ axis)
    x_axis = x_axis / np.linalg.norm(x_axis)
    return np.stack([x_axis, np.cross(axis, x_axis), axis])


def radius_about(touch: FloatArray, n_parameters: int) -> FloatArray:
    """The basis in which the last parameter, the radius, draws the centre along -`touch`, (2,) or (3,)."""
    basis = np.eye(n_parameters)
    basis[: len(touch), -1] = -touch / max(1.0, float(np.linalg.norm(touch)))
    return basis


def moved_axis(
    origin: FloatArray, frame: FloatArray, change: FloatArray
) -> tuple[FloatArray, FloatArray, float]:
    """Return the axis after a step (k,) of a chart with `origin` (3,) and `frame` (3, 3).

    Its point (3,) nearest to the centroid, its direction (3,), and how far that point moved along it.
    """
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
        """Heights (n,) and gradient (3, n), rows 1, u, v, at points (3, n): of the plane's height."""
        return local[2], np.stack([np.ones(local.shape[1]), local[0], local[1]])

    def basis(self) -> FloatArray:
        """The parameters themselves, (3, 3)."""
        return np.eye(self.n_parameters)

    def move(self, change: FloatArray) -> PlaneChart:
        """The chart after a step (3,): a shift and two tilts. Planes are fitted in closed form."""
        normal = self.frame.T @ np.array([change[1], change[2], 1.0])
        normal = normal / np.linalg.norm(normal)
        point = self.origin - change[0] * self.frame[2]
        return PlaneChart(point, axis_frame(normal))

    def lengths(self) -> FloatArray:
        """1 for the offset, 0 for the tilts, (3,)."""
        return np.array([1.0, 0, 0])

    def surface(self, centre: FloatArray, scale: float, concave: bool) -> Plane:  # noqa: ARG002 - planes have no inside
        """The plane, scaled and moved by `centre` (3,)."""
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
        """The world's axes, (3, 3)."""
        return np.eye(3)

    def linearise(self, local: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Residuals (n,) and gradient (4, n), rows -u, -1 with u the unit radial, at points (3, n)."""
        distance = np.sqrt(np.einsum("ij,ij->j", local, local))
        gradient = np.empty((4, local.shape[1]))
        np.divide(local, -np.maximum(distance, 1e-300), out=gradient[:3])
        gradient[3] = -1.0
        return distance - self.radius, gradient

    def basis(self) -> FloatArray:
        """Changes (4, 4) in which the radius grows about where the points are."""
        return radius_about(-self.origin / self.radius, 4)

    def move(self, change: FloatArray) -> SphereChart | None:
        """The chart after a step (4,): a shift of the centre, and a change of the radius."""
        radius = self.radius + float(change[3])
        return SphereChart(self.origin + change[:3], radius) if radius > 0 else None

    def lengths(self) -> FloatArray:
        """1 for each, (4,)."""
        return np.ones(4)

    def surface(self, centre: FloatArray, scale: float, concave: bool) -> Sphere:
        """The sphere, scaled and moved by `centre` (3,), its poles at right angles to the points."""
        place = -self.origin / max(float(np.linalg.norm(self.origin)), 1e-300)
        pole = perpendicular(place) if np.linalg.norm(place) > 0.5 else np.array([0.0, 0.0, 1.0])
        facing = place if np.linalg.norm(place) > 0.5 else None
        return Sphere(centre + scale * self.origin, scale * self.radius, pole, facing, concave)

    def size(self) -> float:
        """The radius."""
        return max(1.0, self.radius)


@dataclass(frozen=True, slots=True, eq=False)
class TorusChart:
    """Shifts across the axis, its tilts, the shift along it, radius and tube radius.

    f = sqrt((rho - R)^2 + z^2) - r with rho = sqrt(x^2 + y^2): regular wherever the points are off the axis
    and off the tube's middle.
    """

    origin: FloatArray
    frame: FloatArray
    radius: float
    tube_radius: float

    n_parameters: ClassVar[int] = 7

    def linearise(self, local: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Residuals (n,) and gradient (7, n), rows x, y, tilts, z, R, r, at points (3, n) of the chart."""
        x, y, z = local
        from_axis = np.sqrt(x * x + y * y)
        beyond = from_axis - self.radius
        away = np.sqrt(beyond * beyond + z * z)
        safe = np.maximum(away, 1e-300)
        level, rise = beyond / safe, z / safe
        across = level / np.maximum(from_axis, 1e-300)
        gradient = np.empty((7, local.shape[1]))
        np.multiply(x, -across, out=gradient[0])
        np.multiply(y, -across, out=gradient[1])
        gradient[2] = z * gradient[0] + rise * x
        gradient[3] = z * gradient[1] + rise * y
        gradient[4] = -rise
        gradient[5] = -level
        gradient[6] = -1.0
        return away - self.tube_radius, gradient

    def basis(self) -> FloatArray:
        """Changes (7, 7) in which the radius grows about where the points are, as a cylinder's does."""
        basis = np.eye(7)
        touch = self.frame[:2] @ -self.origin / self.radius
        basis[:2, 5] = -touch / max(1.0, float(np.linalg.norm(touch)))
        return basis

    def move(self, change: FloatArray) -> TorusChart | None:
        """The chart after a step (7,); None where a radius is none."""
        radius, tube_radius = self.radius + float(change[5]), self.tube_radius + float(change[6])
        if radius <= 0 or tube_radius <= 0:
            return None
        axis = self.frame.T @ np.array([change[2], change[3], 1.0])
        origin = self.origin + self.frame.T @ np.array([change[0], change[1], change[4]])
        return TorusChart(origin, axis_frame(axis / np.linalg.norm(axis)), radius, tube_radius)

    def lengths(self) -> FloatArray:
        """1 for shifts and radii, 0 for the tilts, (7,)."""
        return np.array([1.0, 1, 0, 0, 1, 1, 1])

    def surface(self, centre: FloatArray, scale: float, concave: bool) -> Torus:
        """The torus, scaled and moved by `centre` (3,); a spindle is refused by Torus."""
        return Torus(
            centre=centre + scale * self.origin,
            direction=self.frame[2],
            radius=scale * self.radius,
            tube_radius=scale * self.tube_radius,
            concave=concave,
        )

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
        """Residuals (n,) and gradient (5, n), rows -ux, -uy, -z ux, -z uy, -1, at points (3, n)."""
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
        """Changes (5, 5) in which the radius grows about where the points are."""
        return radius_about(self.frame[:2] @ -self.origin / self.radius, 5)

    def move(self, change: FloatArray) -> CylinderChart | None:
        """The chart after a step (5,), on the moved axis."""
        radius = self.radius + float(change[4])
        origin, axis, _ = moved_axis(self.origin, self.frame, change)
        return CylinderChart(origin, axis_frame(axis), radius) if radius > 0 else None

    def lengths(self) -> FloatArray:
        """1 for shifts and radius, 0 for angles, (k,)."""
        return np.array([1.0, 1, 0, 0, 1])

    def surface(self, centre: FloatArray, scale: float, concave: bool) -> Cylinder:
        """The cylinder, its lengths multiplied by `scale` and moved by `centre` (3,)."""
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
        """Residuals (n,) and gradient (6, n), rows x, y, tilts, s, phi, at points (3, n) of the chart."""
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
        """The parameters themselves, (k, k)."""
        return np.eye(self.n_parameters)

    def move(self, change: FloatArray) -> ConeChart | None:
        """The chart after a step (6,), on the moved axis; its radius is that at the new origin."""
        phi = self.phi + float(change[5])
        if abs(phi) >= 0.4999 * np.pi:
            return None
        origin, axis, along = moved_axis(self.origin, self.frame, change)
        return ConeChart(origin, axis_frame(axis), self.radius + float(change[4]) - along * np.tan(phi), phi)

    def turn_to_growth(self) -> ConeChart:
        """The same cone with z towards the growing radius, where that is positive at the origin."""
        if self.phi > 0:
            return replace(self, frame=axis_frame(-self.frame[2]), phi=-self.phi)
        return self

    def lengths(self) -> FloatArray:
        """1 for shifts and radius, 0 for angles, (k,)."""
        return np.array([1.0, 1, 0, 0, 1, 0])

    def surface(self, centre: FloatArray, scale: float, concave: bool) -> Cone:
        """The cone, scaled and moved by `centre` (3,); one that does not open is refused by Cone."""
        point = centre + scale * self.origin
        return Cone(point, self.frame[2], scale * self.radius, max(-self.phi, 1e-300), concave=concave)

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
        """Residuals (n,) and gradient (7, n), rows x, y, tilts, m, p, q, at points (3, n) of the chart."""
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
        """The parameters themselves, (k, k)."""
        return np.eye(self.n_parameters)

    def move(self, change: FloatArray) -> EllipticChart | None:
        """The chart after a step (7,), on the moved axis, turned to the new ellipse's own axes."""
        mean = (self.greater + self.smaller) / 2 + float(change[4])
        p, q = (self.greater - self.smaller) / 2 + float(change[5]), float(change[6])
        half = float(np.hypot(p, q))
        if mean <= half or mean <= 0:
            return None
        turn = np.arctan2(q, p) / 2
        ahead = self.frame.T @ np.array([np.cos(turn), np.sin(turn), 0.0])
        origin, axis, _ = moved_axis(self.origin, self.frame, change)
        return EllipticChart(origin, turned_frame(axis, ahead), mean + half, mean - half)

    def lengths(self) -> FloatArray:
        """1 for all but the tilts, (7,)."""
        return np.array([1.0, 1, 0, 0, 1, 1, 1])

    def surface(self, centre: FloatArray, scale: float, concave: bool) -> EllipticCylinder:
        """The elliptic cylinder, its lengths multiplied by `scale` and moved by `centre` (3,)."""
        radii = (scale * self.greater, scale * self.smaller)
        return EllipticCylinder(centre + scale * self.origin, self.frame[2], radii, self.frame[0], concave)

    def size(self) -> float:
        """The greater radius."""
        return max(1.0, self.greater)


def standard_chart(
    surface: Plane | Sphere | Cylinder | Cone | EllipticCylinder | Torus, centre: FloatArray, scale: float
) -> Chart:
    """The chart at a surface of the catalogue, relative to `centre` (3,) in units of `scale`."""
    if isinstance(surface, Plane):
        frame = np.stack([surface.u_direction, surface.v_direction, surface.normal_direction])
        return PlaneChart((surface.point - centre) / scale, frame)
    if isinstance(surface, Sphere):
        return SphereChart((surface.centre - centre) / scale, surface.radius / scale)
    if isinstance(surface, Torus):
        frame = axis_frame(surface.direction)
        middle = (surface.centre - centre) / scale
        return TorusChart(middle, frame, surface.radius / scale, surface.tube_radius / scale)
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
