# SPDX-License-Identifier: MIT
"""Charts of surfaces with an axis: circular cylinder, cone, elliptic cylinder; and that at any surface."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from completion.fitting.charts.chart import (
    Chart,
    PlaneChart,
    SphereChart,
    axis_frame,
    moved_axis,
    radius_about,
    turned_frame,
)
from completion.fitting.charts.torus_chart import TorusChart
from scenes.checks import FloatArray
from scenes.surfaces.catalogue import Cone, Cylinder, EllipticCylinder, Plane, Sphere, Surface, Torus
from scenes.surfaces.elliptic_cylinder import ellipse_feet, ellipse_normal


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

    def moved(self, change: FloatArray) -> CylinderChart | None:
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

    def moved(self, change: FloatArray) -> ConeChart | None:
        """The chart after a step (6,), on the moved axis; its radius is that at the new origin."""
        phi = self.phi + float(change[5])
        if abs(phi) >= 0.4999 * np.pi:
            return None
        origin, axis, along = moved_axis(self.origin, self.frame, change)
        return ConeChart(origin, axis_frame(axis), self.radius + float(change[4]) - along * np.tan(phi), phi)

    def growing(self) -> ConeChart:
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

    def moved(self, change: FloatArray) -> EllipticChart | None:
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


def chart_of(surface: Surface, centre: FloatArray, scale: float) -> Chart:
    """The chart at a surface, in coordinates relative to `centre` (3,) in units of `scale`."""
    if isinstance(surface, Plane):
        frame = np.stack([surface.u_direction, surface.v_direction, surface.normal_direction])
        return PlaneChart((surface.point - centre) / scale, frame)
    if isinstance(surface, Sphere):
        return SphereChart((surface.centre - centre) / scale, surface.radius / scale)
    if isinstance(surface, Torus):
        frame = axis_frame(surface.direction)
        middle = (surface.centre - centre) / scale
        return TorusChart(middle, frame, surface.radius / scale, surface.tube_radius / scale)
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
