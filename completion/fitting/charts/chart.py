# SPDX-License-Identifier: MIT
"""Chart: a minimal local parametrisation of a surface, regular at the fit itself, to linearise and step in.

Every chart is turned so that the surface's axis is z and has its origin at the axis point nearest to the
points' centroid (which is the origin of the coordinates here). After each step the chart is made anew: the
formulation of NPL's least-squares geometric elements. No chart holds a redundant parameter or an apex.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Protocol

import numpy as np

from scenes.checks import FloatArray
from scenes.surfaces.catalogue import Plane, Sphere, Surface
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

    def moved(self, change: FloatArray) -> Chart | None:
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
