# SPDX-License-Identifier: MIT
"""Equations c(x) = 0 of surfaces' parameters, with their derivatives, and what they are measured in."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from completion.fitting.chart import axis_frame
from completion.relations.limits import LEAST_APART
from scenes.checks import FloatArray, InputError, Value
from scenes.surfaces.catalogue import Cone, Cylinder, Plane, Sphere, Surface, Torus
from scenes.surfaces.surface import perpendicular

_LEAST_HALF_ANGLE = 1e-9  # radians; a cone that is narrower is a cylinder


@dataclass(frozen=True, slots=True, eq=False)
class Placement(Value):
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


def move_surface(surface: Surface, change: FloatArray) -> Surface:
    """Return a surface after a change (k,) of its chart's parameters, see `place`.

    Its chart goes along. Raises InputError: no such surface is left.
    """
    return surface_at(place(surface, change), surface) if change.any() else surface


def surface_at(at: Placement, like: Surface) -> Surface:
    """Return the surface at a placement, of the kind, side and chart of another.

    Raises InputError: a surface without placements.
    """
    if isinstance(like, Plane):
        return Plane(at.point, at.direction, like.u_direction)
    if isinstance(like, Sphere):
        return Sphere(at.point, at.radius, concave=like.concave)
    if isinstance(like, Cylinder):
        return Cylinder(at.point, at.direction, at.radius, like.zero_direction, like.concave)
    if isinstance(like, Cone):
        narrow = max(at.half_angle, _LEAST_HALF_ANGLE)
        return Cone(
            at.point,
            at.direction,
            at.radius,
            narrow,
            zero_direction=like.zero_direction,
            concave=like.concave,
        )
    if isinstance(like, Torus):
        return Torus(
            centre=at.point,
            direction=at.direction,
            radius=at.ring_radius,
            tube_radius=at.radius,
            zero_direction=like.zero_direction,
            concave=like.concave,
        )
    raise _unknown(like)


ANGLE, LENGTH, RADIUS = 0, 1, 2  # what a row is of

Rows = tuple[FloatArray | np.float64, dict[int, FloatArray]]
"""Values of equations, and their derivatives by the parameters of each surface."""


@dataclass(frozen=True, slots=True, eq=False)
class RelationFrame:
    """What relations are measured in that is not of the surfaces: where they began, and which way is up.

    `kept` remembers what was worked out of where they began, by the surfaces that it is of.
    """

    start: Mapping[int, Placement]  # by number
    up: FloatArray | None = None  # (3,) unit vector
    kept: dict[tuple[int, ...], Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, eq=False)
class Constraint(Value):
    """The equations of a relation at a place.

    Attributes
    ----------
    value : (m,) float
        c, metres and radians.
    blocks : dict of int to (m, k) float
        Derivative by the k parameters of each of its surfaces.
    rows : (m,) int
        ANGLE, LENGTH or RADIUS: what each equation is of.
    """

    value: FloatArray
    blocks: dict[int, FloatArray]
    rows: tuple[int, ...]

    def only(self, kept: Sequence[int]) -> Constraint:
        """Some of the equations."""
        numbers = list(kept)
        blocks = {number: block[numbers] for number, block in self.blocks.items()}
        return Constraint(self.value[numbers], blocks, tuple(self.rows[k] for k in numbers))


def built(rows: Rows, what: int) -> Constraint:
    """Equations that are all of one thing (ANGLE, LENGTH or RADIUS)."""
    value = np.atleast_1d(np.asarray(rows[0], dtype=np.float64))
    blocks = {number: np.atleast_2d(block) for number, block in rows[1].items()}
    return Constraint(value, blocks, (what,) * len(value))


def stack(parts: Sequence[Constraint]) -> Constraint:
    """Equations below one another; each part may be of some of the surfaces."""
    widths = {number: block.shape[1] for part in parts for number, block in part.blocks.items()}
    blocks = {
        number: np.concatenate([part.blocks.get(number, np.zeros((len(part.rows), width))) for part in parts])
        for number, width in widths.items()
    }
    return Constraint(
        np.concatenate([part.value for part in parts]), blocks, sum((part.rows for part in parts), ())
    )


def weighted_sum(parts: Sequence[tuple[float, Rows]]) -> Rows:
    """The sum of values, each with its weight, and its derivatives."""
    blocks: dict[int, FloatArray] = {}
    for weight, (_, arrays) in parts:
        for number, block in arrays.items():
            blocks[number] = blocks[number] + weight * block if number in blocks else weight * block
    return sum((weight * np.asarray(value) for weight, (value, _) in parts), np.zeros(())), blocks


@dataclass(frozen=True, slots=True, eq=False)
class MirrorPlane:
    """A plane: the points x with normal . (x - base) = level; `tilts` (2, 3) are unit vectors across it."""

    normal: FloatArray  # (3,) unit vector
    base: FloatArray  # (3,)
    level: float
    tilts: FloatArray

    @classmethod
    def of(cls, normal: FloatArray, point: FloatArray, base: FloatArray | None = None) -> MirrorPlane:
        """The mirror through a point (3,) with a normal of any length, about a base (3,)."""
        unit = np.asarray(normal / np.linalg.norm(normal))
        first = perpendicular(unit)
        middle = point if base is None else base
        return cls(unit, middle, float(unit @ (point - middle)), np.stack([first, np.cross(unit, first)]))

    @property
    def point(self) -> FloatArray:
        """On it, (3,), as near to its base as can be."""
        return self.base + self.level * self.normal

    def move(self, change: FloatArray) -> tuple[MirrorPlane, FloatArray]:
        """The mirror after a change (3,), two tilts and an offset, and the normal's derivative (3, 3)."""
        vector = self.normal + change[:2] @ self.tilts
        length = float(np.linalg.norm(vector))
        unit = vector / length
        by = (self.tilts.T - np.outer(unit, unit @ self.tilts.T)) / length
        mirror = MirrorPlane(unit, self.base, self.level + float(change[2]), self.tilts)
        return mirror, np.column_stack([by, np.zeros(3)])

    def reflect(self, direction: FloatArray, by: FloatArray) -> tuple[FloatArray, FloatArray]:
        """A direction (3,) in the mirror, and the derivative (3, 3) by `by`, the normal's."""
        along = float(self.normal @ direction)
        slope = -2 * (np.outer(self.normal, direction @ by) + along * by)
        return direction - 2 * along * self.normal, slope

    def image(self, point: FloatArray, by: FloatArray) -> tuple[FloatArray, FloatArray]:
        """A point (3,) in the mirror, and the derivative (3, 3) by the mirror's tilts and offset."""
        step = point - self.base
        above = float(self.normal @ step) - self.level
        slope = -2 * (np.outer(self.normal, step @ by) + above * by)
        slope[:, 2] += 2 * self.normal
        return point - 2 * above * self.normal, slope


def mirrors_between(placement: Placement, two: Placement) -> Iterator[MirrorPlane]:
    """The planes in which one surface may be the other's image: bisectors, as far as the two tell them."""
    middle = (placement.point + two.point) / 2
    if not placement.direction.any():
        yield MirrorPlane.of(two.point - placement.point, middle)
        return
    for sign in (1.0, -1.0):
        between = placement.direction - sign * two.direction
        apart = float(np.linalg.norm(between))
        if placement.is_plane and apart > 2 * LEAST_APART:
            level = (
                placement.direction @ (placement.point - middle) - sign * two.direction @ (two.point - middle)
            ) / apart
            yield MirrorPlane.of(between, middle + level * between / apart)
        elif not placement.is_plane and apart > 2 * LEAST_APART and apart < 2 * np.sqrt(1 - LEAST_APART**2):
            yield MirrorPlane.of(between, _nearest(placement, two))
    if not placement.is_plane:
        along = placement.direction + np.copysign(1.0, placement.direction @ two.direction) * two.direction
        step = two.point - placement.point
        aside = step - float(step @ along) * along / float(along @ along)
        if np.linalg.norm(aside) > 1e-9 * max(1e-12, float(np.linalg.norm(step))):
            yield MirrorPlane.of(aside, middle)


def _nearest(placement: Placement, two: Placement) -> FloatArray:
    """The point (3,) midway between two axes where they are nearest."""
    step, cosine = two.point - placement.point, float(placement.direction @ two.direction)
    along = np.linalg.solve(
        np.array([[1.0, -cosine], [cosine, -1.0]]),
        np.array([placement.direction @ step, two.direction @ step]),
    )
    nearest = placement.point + along[0] * placement.direction, two.point + along[1] * two.direction
    return np.asarray((nearest[0] + nearest[1]) / 2)
