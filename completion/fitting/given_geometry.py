# SPDX-License-Identifier: MIT
"""Given values: a radius and a direction that a fit holds exactly, and the chart that keeps them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from completion.fitting.chart import Chart
from completion.fitting.kinds import KINDS, chart_of
from completion.fitting.result import SurfaceFit
from scenes.checks import FloatArray, InputError, check_direction
from scenes.surfaces.catalogue import Cone, Cylinder, EllipticCylinder, Plane, Sphere, Surface, Torus


@dataclass(frozen=True, slots=True, eq=False)
class HeldChart:
    """Another chart, stepped in its `free` parameters alone; the rest have no gradient.

    Parameters
    ----------
    inner : Chart
        Of the whole surface, where the held parameters have their given values.
    free : tuple of int
        Places of the parameters that are sought.
    """

    inner: Chart
    free: tuple[int, ...]

    @property
    def n_parameters(self) -> int:
        """How many are free."""
        return len(self.free)

    @property
    def origin(self) -> FloatArray:
        """The inner chart's origin (3,)."""
        return self.inner.origin

    @property
    def frame(self) -> FloatArray:
        """The inner chart's rows x, y, z (3, 3)."""
        return self.inner.frame

    def linearise(self, local: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Residuals (n,) and gradient (k, n) by the free parameters, at points (3, n)."""
        residual, gradient = self.inner.linearise(local)
        return residual, gradient[list(self.free)]

    def basis(self) -> FloatArray:
        """The inner chart's changes (k, k), as far as they leave the held parameters alone."""
        return self.inner.basis()[np.ix_(self.free, self.free)]

    def move(self, change: FloatArray) -> HeldChart | None:
        """The chart after a step (k,) of the free parameters."""
        whole = np.zeros(self.inner.n_parameters)
        whole[list(self.free)] = change
        inner = self.inner.move(whole)
        return None if inner is None else HeldChart(inner, self.free)

    def lengths(self) -> FloatArray:
        """1 for each free parameter that is a length, 0 for each angle (k,)."""
        return self.inner.lengths()[list(self.free)]

    def surface(self, centre: FloatArray, scale: float, concave: bool) -> Surface:
        """The inner chart's surface, scaled and moved by `centre` (3,)."""
        return self.inner.surface(centre, scale, concave)

    def size(self) -> float:
        """The inner chart's size."""
        return self.inner.size()

    def full_covariance(self, covariance: FloatArray) -> FloatArray:
        """A covariance (k, k) of the free parameters as one of all, with zeros for what is held."""
        n = self.inner.n_parameters
        whole = np.zeros((n, n))
        whole[np.ix_(self.free, self.free)] = covariance
        return whole


@dataclass(frozen=True, slots=True, eq=False)
class GivenGeometry:
    """What is given of a surface.

    Attributes
    ----------
    shape : str
        Of the surface.
    radius : float or None
        Metres; of a torus that of the circle in the tube's middle.
    direction : (3,) float or None
        Unit vector along the axis; a plane's normal.
    """

    shape: str
    radius: float | None = None
    direction: FloatArray | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """The held parameters' names, as `SurfaceFit.parameters` has them."""
        axis = "normal" if self.shape == "plane" else "direction"
        given = {axis: self.direction is not None, "radius": self.radius is not None}
        return tuple(name for name, is_held in given.items() if is_held)

    @property
    def free(self) -> tuple[int, ...]:
        """Places of the parameters that are sought."""
        kind = KINDS[self.shape]
        held = set() if self.radius is None else {kind.radius}
        held |= set() if self.direction is None else set(kind.axis)
        return tuple(place for place in range(kind.n_parameters) if place not in held)

    @property
    def n(self) -> int:
        """How many parameters are held."""
        return KINDS[self.shape].n_parameters - len(self.free)

    def scale(self, factor: float) -> GivenGeometry:
        """The same in another unit of length."""
        return self if self.radius is None else replace(self, radius=factor * self.radius)

    def impose(self, surface: Surface, place: FloatArray) -> Iterator[Surface]:
        """Surfaces with the given values that are near `surface` about a `place` (3,).

        A direction is turned to about the place's foot; a radius is changed where the foot stays on the
        surface, with the centre or the axis on either side of it.
        """
        given = self.direction
        turned = surface if given is None else _turn_surface(surface, _sign_direction(given, surface), place)
        if self.radius is None:
            yield turned
        else:
            yield from _resize_surface(turned, self.radius, place)

    def exact(self, surface: Surface) -> Surface:
        """A surface that has the given values but for rounding, with them to the last digit."""
        turned = surface
        if self.direction is not None:
            turned = _with_direction(turned, _sign_direction(self.direction, turned))
        if self.radius is not None and isinstance(turned, Sphere):
            return Sphere(
                turned.centre, self.radius, turned.pole_direction, turned.zero_direction, turned.concave
            )
        if self.radius is not None and isinstance(turned, Cylinder):
            return Cylinder(
                turned.point, turned.direction, self.radius, turned.zero_direction, turned.concave
            )
        if self.radius is not None and isinstance(turned, Torus):
            return Torus(
                turned.centre, turned.direction, self.radius, turned.tube_radius, concave=turned.concave
            )
        return turned

    def chart(self, surface: Surface, centre: FloatArray, scale: float) -> HeldChart:
        """The chart at a surface that has the given values, relative to `centre` (3,); see `chart_of`."""
        return HeldChart(chart_of(surface, centre, scale), self.free)

    def starts(self, charts: list[Chart]) -> list[Chart]:
        """Charts with the given values near others, in coordinates about the points' centroid."""
        origin, near_charts = np.zeros(3), list[Chart]()
        for chart in charts:
            try:
                near = list(self.impose(chart.surface(origin, 1.0, False), origin))
                near_charts += [self.chart(surface, origin, 1.0) for surface in near]
            except InputError:
                continue  # a spindle, or a cone that is none
        return near_charts

    def mark(self, fit: SurfaceFit) -> SurfaceFit:
        """The fit, told what was held, and with that to the last digit."""
        return replace(fit, surface=self.exact(fit.surface), held=self.names)


def given_of_shape(shape: str, radius: object | None, axis: object | None) -> GivenGeometry | None:
    """Return what is held of a shape, None where nothing is.

    Raises
    ------
    InputError
        A radius that is none, an axis without direction, a shape that has no such value.
    """
    if radius is None and axis is None:
        return None
    if shape == "auto":
        raise InputError("a given radius or axis is that of a shape; name it in place of auto")
    if radius is not None:
        if KINDS[shape].radius is None:
            cure = "; its axis can be given" if shape != "plane" else ""
            raise InputError(f"{KINDS[shape].title} has no one radius to be given{cure}")
        if isinstance(radius, bool) or not isinstance(radius, int | float | np.number):
            raise InputError(f"radius must be a number of metres, got {radius!r}")
        if not np.isfinite(radius) or radius <= 0:
            raise InputError(f"radius must be a positive number of metres, got {radius}")
    if axis is not None and not KINDS[shape].axis:
        raise InputError(f"{KINDS[shape].title} has no axis to be given")
    direction = None if axis is None else check_direction("axis", axis)
    return GivenGeometry(shape, None if radius is None else float(radius), direction)


def _sign_direction(direction: FloatArray, surface: Surface) -> FloatArray:
    """A direction; for a cone the way in which it grows."""
    backwards = isinstance(surface, Cone) and surface.direction @ direction < 0
    return -direction if backwards else direction


def _with_direction(surface: Surface, direction: FloatArray) -> Surface:
    """The surface with another direction about its own point."""
    if isinstance(surface, Plane):
        return Plane(surface.point, direction, surface.u_direction)
    if isinstance(surface, Cylinder):
        return Cylinder(surface.point, direction, surface.radius, None, surface.concave)
    if isinstance(surface, Cone):
        return Cone(surface.point, direction, surface.radius, surface.half_angle, concave=surface.concave)
    if isinstance(surface, EllipticCylinder):
        ahead = surface.zero_direction
        return EllipticCylinder(surface.point, direction, surface.radii, ahead, surface.concave)
    if isinstance(surface, Torus):
        radii = surface.radius, surface.tube_radius
        return Torus(surface.centre, direction, *radii, concave=surface.concave)
    raise TypeError(f"a {type(surface).__name__} has no direction")


def _turn_surface(surface: Surface, direction: FloatArray, place: FloatArray) -> Surface:
    """The surface turned to a direction; its axis passes where it passed beside the place."""
    if isinstance(surface, Cylinder):
        along = float((place - surface.point) @ surface.direction)
        point = surface.point + along * surface.direction
        surface = Cylinder(point, surface.direction, surface.radius, None, surface.concave)
    return _with_direction(surface, direction)


def _resize_surface(surface: Surface, radius: float, place: FloatArray) -> Iterator[Surface]:
    """The surface with another radius, the foot of the place kept, from either side."""
    if isinstance(surface, Torus):
        yield Torus(surface.centre, surface.direction, radius, surface.tube_radius, concave=surface.concave)
        offset = place - surface.centre
        level = offset - (offset @ surface.direction) * surface.direction
        length = float(np.linalg.norm(level))
        if length > 0.5 * surface.radius:  # seen from one side: the tube stays where it is
            centre = surface.centre + (surface.radius - radius) / length * level
            yield Torus(centre, surface.direction, radius, surface.tube_radius, concave=surface.concave)
        return
    away = surface.normal(place[None])[0] * (-1.0 if getattr(surface, "concave", False) else 1.0)
    foot = place - surface.distance(place[None])[0] * surface.normal(place[None])[0]
    if isinstance(surface, Sphere):
        yield Sphere(surface.centre, radius, concave=surface.concave)
        for side in (away, -away):
            yield Sphere(foot - radius * side, radius, concave=surface.concave)
    elif isinstance(surface, Cylinder):
        yield Cylinder(surface.point, surface.direction, radius, None, surface.concave)
        for side in (away, -away):
            yield Cylinder(foot - radius * side, surface.direction, radius, None, surface.concave)
