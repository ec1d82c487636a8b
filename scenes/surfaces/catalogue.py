# SPDX-License-Identifier: MIT
"""The surfaces under one name, and their comparison within a tolerance."""

from __future__ import annotations

import numpy as np

from scenes.checks import FloatArray
from scenes.surfaces.cone import Cone
from scenes.surfaces.cylinder import Cylinder, EllipticCylinder
from scenes.surfaces.plane import Plane
from scenes.surfaces.sphere_torus import Sphere, Torus
from scenes.surfaces.surface import Surface

__all__ = ["Cone", "Cylinder", "EllipticCylinder", "Plane", "Sphere", "Surface", "Torus", "surfaces_close"]


def surfaces_close(first: Surface, second: Surface, *, angle: float, length: float) -> bool:
    """Tell whether two surfaces of one kind agree within `angle` (radians) and `length` (metres).

    Planes are compared at the first one's chart origin; surfaces with an axis by axis distance there, and by
    their radii; spheres by centre and radius; tori by centre, axis and both radii; cones also by half angle,
    and both ways of their axis differ.
    The side from which they are seen does not count.

    Parameters
    ----------
    first, second : Surface
        Surfaces of different kinds never agree.
    angle, length : float
        How far directions (radians), and points and radii (metres) may be apart.
    """
    if isinstance(first, Plane) and isinstance(second, Plane):
        offset = abs(float(second.distance(first.point[None])[0]))
        return _parallel(first.normal_direction, second.normal_direction, angle) and offset <= length
    if isinstance(first, Sphere) and isinstance(second, Sphere):
        apart = float(np.linalg.norm(first.centre - second.centre))
        return apart <= length and abs(first.radius - second.radius) <= length
    if isinstance(first, Cylinder) and isinstance(second, Cylinder):
        same_radius = abs(first.radius - second.radius) <= length
        return _same_axis(first, second, angle, length) and same_radius
    if isinstance(first, Cone) and isinstance(second, Cone):
        same_radius = abs(first.radius - float(second.radius_at(first.point[None])[0])) <= length
        opens_alike = float(first.direction @ second.direction) > 0
        same_angle = abs(first.half_angle - second.half_angle) <= angle
        return _same_axis(first, second, angle, length) and opens_alike and same_radius and same_angle
    if isinstance(first, Torus) and isinstance(second, Torus):
        apart = float(np.linalg.norm(first.centre - second.centre))
        radii = abs(first.radius - second.radius), abs(first.tube_radius - second.tube_radius)
        return _parallel(first.direction, second.direction, angle) and max(apart, *radii) <= length
    if isinstance(first, EllipticCylinder) and isinstance(second, EllipticCylinder):
        same_radii = bool(np.abs(np.subtract(first.radii, second.radii)).max() <= length)
        turned = float(np.linalg.norm(np.cross(first.zero_direction, second.zero_direction)))
        out_of_place = turned * (first.radii[0] - first.radii[1])  # a circle may be turned at will
        return _same_axis(first, second, angle, length) and same_radii and out_of_place <= length
    return False


def _parallel(first: FloatArray, second: FloatArray, angle: float) -> bool:
    return bool(np.linalg.norm(np.cross(first, second)) <= np.sin(angle))


def _same_axis(
    first: Cylinder | Cone | EllipticCylinder,
    second: Cylinder | Cone | EllipticCylinder,
    angle: float,
    length: float,
) -> bool:
    """Tell whether the axes agree in direction, and in place at the first one's point."""
    gap = first.point - second.point
    offset = float(np.linalg.norm(gap - (gap @ second.direction) * second.direction))
    return _parallel(first.direction, second.direction, angle) and offset <= length
