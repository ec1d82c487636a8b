# SPDX-License-Identifier: MIT
"""Placement: where a surface is after a change of its chart's parameters, and how that changes with them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from completion.fitting.chart import axis_frame
from scenes.checks import FloatArray, InputError
from scenes.surfaces.catalogue import Cone, Cylinder, Plane, Sphere, Surface, Torus

_LEAST_HALF_ANGLE = 1e-9  # radians; a cone that is narrower is a cylinder


@dataclass(frozen=True, slots=True, eq=False)
class Placement:
    """Point, direction, radius and half angle of a surface, each with its derivative by k parameters.

    Attributes
    ----------
    direction : (3,) float
        A plane's unit normal, a unit axis; zero for a sphere.
    point : (3,) float
        On the plane, on the axis, or a sphere's or torus' centre; metres.
    radius, half_angle : float
        Metres, radians; 0 where there is none. A torus' radius is here that of its tube, as a cylinder's.
    ring_radius : float
        Of the circle in a torus' tube, metres; else 0.
    across : (2, 3) float
        Two unit vectors at right angles to the direction that the surface had before it was moved.
    by_direction, by_point : (3, k) float
        Derivatives.
    by_radius, by_half_angle, by_ring_radius : (1, k) float
        Derivatives.
    """

    direction: FloatArray
    point: FloatArray
    radius: float
    half_angle: float
    across: FloatArray
    by_direction: FloatArray
    by_point: FloatArray
    by_radius: FloatArray
    by_half_angle: FloatArray
    by_ring_radius: FloatArray
    ring_radius: float = 0.0

    @property
    def is_plane(self) -> bool:
        """Whether the surface is a plane: its chart has an offset and two slopes."""
        return bool(self.by_direction.shape[1] == 3)


def place(surface: Surface, change: FloatArray) -> Placement:
    """Return where a surface is after a change (k,) of its chart's parameters, as `SurfaceFit` orders them.

    The chart is that at `surface`: a plane's point is p - a n and its normal n + b u + c v over its length,
    an axis z + a x + b y, so that `SurfaceFit.gradient` is the derivative of its distances.

    Raises InputError: a surface without such a chart.
    """
    if isinstance(surface, Plane):
        normal = surface.normal_direction
        across = np.stack([surface.u_direction, surface.v_direction])
        tilts = np.column_stack([np.zeros(3), across.T])
        direction, by_direction = _unit(normal + tilts @ change, tilts)
        by_point = np.column_stack([-normal, np.zeros((3, 2))])
        none = np.zeros((1, 3))
        point = surface.point - change[0] * normal
        return Placement(
            direction=direction,
            point=point,
            radius=0.0,
            half_angle=0.0,
            across=across,
            by_direction=by_direction,
            by_point=by_point,
            by_radius=none,
            by_half_angle=none,
            by_ring_radius=none,
        )
    if isinstance(surface, Sphere):
        unit, none = np.eye(4), np.zeros((3, 4))
        return Placement(
            direction=np.zeros(3),
            point=surface.centre + change[:3],
            radius=surface.radius + float(change[3]),
            half_angle=0.0,
            across=np.zeros((2, 3)),
            by_direction=none,
            by_point=unit[:3],
            by_radius=unit[3:],
            by_half_angle=none[:1],
            by_ring_radius=none[:1],
        )
    if isinstance(surface, Cylinder | Cone):
        return _place_axis(surface, change)
    if isinstance(surface, Torus):
        return _place_torus(surface, change)
    raise _unknown(surface)


def _unknown(surface: Surface) -> InputError:
    names = "planes, spheres, cylinders, cones and tori"
    return InputError(f"{type(surface).__name__}: relations are known of {names} alone")


def _place_torus(surface: Torus, change: FloatArray) -> Placement:
    """A change (7,) of a torus: shifts across its axis, tilts, the shift along it, and both radii."""
    unit, frame = np.eye(7), axis_frame(surface.direction)
    shifts, tilts = frame.T @ unit[[0, 1, 4]], frame[:2].T @ unit[2:4]
    direction, by_direction = _unit(surface.direction + tilts @ change, tilts)
    return Placement(
        direction=direction,
        point=surface.centre + shifts @ change,
        radius=surface.tube_radius + float(change[6]),
        half_angle=0.0,
        across=frame[:2],
        by_direction=by_direction,
        by_point=shifts,
        by_radius=unit[6:],
        by_half_angle=np.zeros((1, 7)),
        by_ring_radius=unit[5:6],
        ring_radius=surface.radius + float(change[5]),
    )


def _place_axis(surface: Cylinder | Cone, change: FloatArray) -> Placement:
    unit, frame = np.eye(len(change)), axis_frame(surface.direction)
    shifts, tilts = frame[:2].T @ unit[:2], frame[:2].T @ unit[2:4]
    direction, by_direction = _unit(surface.direction + tilts @ change, tilts)
    half_angle, by_half_angle = 0.0, np.zeros((1, len(change)))
    if isinstance(surface, Cone):
        half_angle, by_half_angle = surface.half_angle - float(change[5]), -unit[5:6]
    return Placement(
        direction=direction,
        point=surface.point + shifts @ change,
        radius=surface.radius + float(change[4]),
        half_angle=half_angle,
        across=frame[:2],
        by_direction=by_direction,
        by_point=shifts,
        by_radius=unit[4:5],
        by_half_angle=by_half_angle,
        by_ring_radius=np.zeros((1, len(change))),
    )


def _unit(vector: FloatArray, by: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The unit vector (3,) of a vector, and its derivative (3, k) from the vector's."""
    length = float(np.linalg.norm(vector))
    unit = vector / length
    return unit, (by - np.outer(unit, unit @ by)) / length


def moved(surface: Surface, change: FloatArray) -> Surface:
    """Return a surface after a change (k,) of its chart's parameters, see `place`.

    Its chart goes along. Raises InputError: no such surface is left.
    """
    if not change.any():
        return surface
    at = place(surface, change)
    if isinstance(surface, Plane):
        return Plane(at.point, at.direction, surface.u_direction)
    if isinstance(surface, Sphere):
        return Sphere(at.point, at.radius, concave=surface.concave)
    if isinstance(surface, Cylinder):
        return Cylinder(at.point, at.direction, at.radius, surface.zero_direction, surface.concave)
    if isinstance(surface, Cone):
        narrow = max(at.half_angle, _LEAST_HALF_ANGLE)
        return Cone(
            at.point,
            at.direction,
            at.radius,
            narrow,
            zero_direction=surface.zero_direction,
            concave=surface.concave,
        )
    if isinstance(surface, Torus):
        return Torus(
            centre=at.point,
            direction=at.direction,
            radius=at.ring_radius,
            tube_radius=at.radius,
            zero_direction=surface.zero_direction,
            concave=surface.concave,
        )
    raise _unknown(surface)
