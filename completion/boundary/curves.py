# SPDX-License-Identifier: MIT
"""Curves: lines and circles in a surface's chart, and the lines along which it meets other surfaces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scenes.checks import FloatArray
from scenes.surfaces.catalogue import Cylinder, Plane, Surface

_LEAST_SINE = 0.1  # of the angle between surfaces: flatter ones meet anywhere
_SQUARE = float(np.cos(np.radians(3.0)))  # between a plane's normal and an axis


@dataclass(frozen=True, slots=True, eq=False)
class Line:
    """The line through `point` along the unit vector `direction`, chart coordinates in metres."""

    point: FloatArray
    direction: FloatArray

    @property
    def normal(self) -> FloatArray:
        """Unit vector (2,) a quarter turn anticlockwise of the direction."""
        return np.array([-self.direction[1], self.direction[0]])

    @property
    def length(self) -> float:
        """A line never returns."""
        return float("inf")

    def across(self, uv: FloatArray) -> FloatArray:
        """Signed distance (...,)."""
        return np.asarray((uv - self.point) @ self.normal)

    def towards(self, uv: FloatArray) -> FloatArray:
        """Unit vector (..., 2) in which `across` grows."""
        return np.broadcast_to(self.normal, uv.shape)

    def along(self, uv: FloatArray) -> FloatArray:
        """Length (...,) from `point`."""
        return np.asarray((uv - self.point) @ self.direction)

    def at(self, along: FloatArray) -> FloatArray:
        """Chart coordinates (..., 2)."""
        return np.asarray(self.point + np.asarray(along)[..., None] * self.direction)


@dataclass(frozen=True, slots=True, eq=False)
class Circle:
    """The circle around `centre` with `radius`, chart coordinates in metres."""

    centre: FloatArray
    radius: float

    @property
    def length(self) -> float:
        """Circumference."""
        return float(2 * np.pi * self.radius)

    def across(self, uv: FloatArray) -> FloatArray:
        """Signed distance (...,), positive inside."""
        return np.asarray(self.radius - np.linalg.norm(uv - self.centre, axis=-1), dtype=np.float64)

    def towards(self, uv: FloatArray) -> FloatArray:
        """Unit vector (..., 2) in which `across` grows."""
        offset = self.centre - uv
        size = np.linalg.norm(offset, axis=-1, keepdims=True)
        return np.asarray(offset / np.maximum(size, 1e-12), dtype=np.float64)

    def along(self, uv: FloatArray) -> FloatArray:
        """Arc length (...,) in -pi r .. pi r."""
        offset = uv - self.centre
        return np.asarray(self.radius * np.arctan2(offset[..., 1], offset[..., 0]), dtype=np.float64)

    def at(self, along: FloatArray) -> FloatArray:
        """Chart coordinates (..., 2)."""
        angle = np.asarray(along) / self.radius
        return np.asarray(self.centre + self.radius * np.stack([np.cos(angle), np.sin(angle)], axis=-1))


def fit_circle(uv: FloatArray) -> Circle | None:
    """Fit a circle to points (n, 2) by Pratt's normalisation (Pratt 1987).

    None where the points lie on a line.
    """
    mean = uv.mean(axis=0)
    x, y = (uv - mean).T
    z = x * x + y * y
    moments = np.column_stack([z, x, y, np.ones(len(x))])
    constraint = np.array([[0, 0, 0, -2.0], [0, 1, 0, 0], [0, 0, 1, 0], [-2.0, 0, 0, 0]])
    values, vectors = np.linalg.eig(np.linalg.solve(constraint, moments.T @ moments))
    rounding = 1e-9 * float(np.abs(values).max())
    proper = (np.abs(values.imag) < rounding) & (values.real > -rounding)  # nothing where the fit is exact
    real = np.where(proper, values.real, np.inf)
    if not np.isfinite(real).any():
        return None
    a, b, c, d = vectors[:, int(np.argmin(real))].real
    if abs(a) < 1e-12:
        return None
    centre = np.array([-b, -c]) / (2 * a)
    square = float(centre @ centre - d / a)
    return Circle(mean + centre, float(np.sqrt(square))) if square > 0 else None


def meeting_line(chart: Surface, other: Surface) -> Line | None:
    """Return the line in `chart` along which two surfaces of one frame meet, None where it is no line.

    Plane and plane meet in a line; so do a cylinder and a plane at right angles to its axis, or along it.
    """
    if isinstance(chart, Plane) and isinstance(other, Plane):
        return _of_planes(chart, other)
    if isinstance(chart, Cylinder) and isinstance(other, Plane):
        return _across_axis(chart, other)
    return None


def _of_planes(chart: Plane, other: Plane) -> Line | None:
    """Where other.normal . (point + u a + v b - other.point) vanishes."""
    gradient = np.array([
        chart.u_direction @ other.normal_direction,
        chart.v_direction @ other.normal_direction,
    ])  # fmt: skip
    sine = float(np.linalg.norm(gradient))
    if sine < _LEAST_SINE:
        return None
    height = float(other.distance(chart.point[None])[0])
    normal = gradient / sine
    return Line(-height / sine * normal, np.array([normal[1], -normal[0]]))


def _across_axis(chart: Cylinder, other: Plane) -> Line | None:
    """The height at which a plane at right angles to the axis cuts the cylinder."""
    cosine = float(chart.direction @ other.normal_direction)
    if abs(cosine) < _SQUARE:
        return None
    height = -float(other.distance(chart.point[None])[0]) / cosine
    return Line(np.array([0.0, height]), np.array([1.0, 0.0]))
