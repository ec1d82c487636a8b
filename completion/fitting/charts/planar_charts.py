# SPDX-License-Identifier: MIT
"""Charts of plane and sphere, and the chart at any surface."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from completion.fitting.charts.axial_charts import ConeChart, CylinderChart, EllipticChart
from completion.fitting.charts.chart import Chart, axis_frame, radius_about, turned_frame
from scenes.checks import FloatArray
from scenes.surfaces.catalogue import Cone, Cylinder, EllipticCylinder, Plane, Sphere, Surface, perpendicular


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

    def moved(self, change: FloatArray) -> PlaneChart:
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

    def moved(self, change: FloatArray) -> SphereChart | None:
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


def chart_of(surface: Surface, centre: FloatArray, scale: float) -> Chart:
    """The chart at a surface, in coordinates relative to `centre` (3,) in units of `scale`."""
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
