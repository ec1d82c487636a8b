# SPDX-License-Identifier: MIT
"""Constraints: a relation as equations c(x) = 0 of its surfaces' parameters, and their derivatives."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from completion.relations.engine.placement import Placement
from completion.relations.engine.relation import Relation
from scenes.checks import FloatArray, InputError

ANGLE, LENGTH, RADIUS = 0, 1, 2  # what a row is of

_Rows = tuple[FloatArray | np.float64, dict[int, FloatArray]]


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """What relations are measured in that is not of the surfaces: where they began, and which way is up."""

    start: Mapping[int, Placement]  # by number
    up: FloatArray | None = None  # (3,) unit vector


@dataclass(frozen=True, slots=True, eq=False)
class Constraint:
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
        some = list(kept)
        blocks = {one: block[some] for one, block in self.blocks.items()}
        return Constraint(self.value[some], blocks, tuple(self.rows[k] for k in some))


def constrain(relation: Relation, at: Mapping[int, Placement], frame: Frame) -> Constraint:
    """Return the equations of a relation where its surfaces are `at`.

    Directions count without their sign: of two that are parallel or at an angle, the sign is the one that
    fits best where the surfaces began (`frame.start`), and so is that of a distance. There is no arc cosine
    and no absolute value, so that derivatives exist where the relation holds.

    Raises InputError: a relation that these surfaces cannot have.
    """
    one = relation.surfaces[0]
    kind = relation.kind
    if kind in ("radius", "half_angle", "equal_radius", "equal_ring_radius"):
        return _sizes(relation, at)
    if kind in ("vertical", "horizontal"):
        return _against_gravity(relation, at, frame)
    for number in relation.surfaces:
        if not at[number].direction.any():
            raise InputError(f"a sphere has no direction: it cannot be {kind.replace('_', ' ')}")
    _check_kinds(relation, at)
    two = relation.surfaces[1]
    if kind == "parallel":
        return _built(_parallel(one, two, at, frame), ANGLE)
    if kind == "perpendicular":
        return _built(_inclined(one, two, at, 1.0, 0.0), ANGLE)
    if kind == "angle":
        return _built(_angle(relation, at, frame), ANGLE)
    if kind == "axis_in_plane":
        rows = _inclined(one, two, at, 1.0, 0.0), _height(one, two, at)
        return _stacked([_built(rows[0], ANGLE), _built(rows[1], LENGTH)])
    turned = _built(_parallel(one, two, at, frame), ANGLE)
    if kind in ("coplanar", "coaxial"):
        beside = _height(one, two, at) if kind == "coplanar" else _offset(one, two, at)
        return _stacked([turned, _built(beside, LENGTH)])
    if kind == "distance":
        apart = _distance(one, two, at, frame)
        return _built((apart[0] - float(relation.value or 0.0), apart[1]), LENGTH)
    three, four = relation.surfaces[2:]
    first, second = _distance(one, two, at, frame), _distance(three, four, at, frame)
    blocks = dict(first[1])
    for number, block in second[1].items():
        blocks[number] = blocks[number] - block if number in blocks else -block
    return _built((first[0] - second[0], blocks), LENGTH)


def _check_kinds(relation: Relation, at: Mapping[int, Placement]) -> None:
    """Raise InputError where a relation of planes or of axes is that of others."""
    flat = [at[number].is_plane for number in relation.surfaces]
    if relation.kind == "coplanar" and not all(flat):
        raise InputError("coplanar relates two planes")
    if relation.kind == "coaxial" and any(flat):
        raise InputError("coaxial relates two axes")
    if relation.kind == "axis_in_plane" and flat != [True, False]:
        raise InputError("axis in plane relates a plane and then an axis")


def _built(rows: _Rows, what: int) -> Constraint:
    value = np.atleast_1d(np.asarray(rows[0], dtype=np.float64))
    blocks = {number: np.atleast_2d(block) for number, block in rows[1].items()}
    return Constraint(value, blocks, (what,) * len(value))


def _stacked(parts: Sequence[Constraint]) -> Constraint:
    value = np.concatenate([part.value for part in parts])
    blocks = {number: np.concatenate([part.blocks[number] for part in parts]) for number in parts[0].blocks}
    return Constraint(value, blocks, sum((part.rows for part in parts), ()))


def _sign(first: FloatArray, second: FloatArray) -> float:
    return -1.0 if first @ second < 0 else 1.0


def _parallel(one: int, two: int, at: Mapping[int, Placement], frame: Frame) -> _Rows:
    """Both components of the directions' difference across where the first one began."""
    across = frame.start[one].across
    sign = _sign(frame.start[one].direction, frame.start[two].direction)
    value = across @ (at[one].direction - sign * at[two].direction)
    return value, {one: across @ at[one].by_direction, two: -sign * across @ at[two].by_direction}


def _inclined(one: int, two: int, at: Mapping[int, Placement], sign: float, cosine: float) -> _Rows:
    """The cosine of the angle less that which it shall be."""
    first, second = at[one], at[two]
    value = sign * first.direction @ second.direction - cosine
    blocks = {
        one: sign * second.direction @ first.by_direction,
        two: sign * first.direction @ second.by_direction,
    }
    return value, blocks


def _angle(relation: Relation, at: Mapping[int, Placement], frame: Frame) -> _Rows:
    """The cosine's misfit over the sine: to first order the angle's, radians."""
    one, two = relation.surfaces
    angle = float(relation.value or 0.0)
    sine = np.sin(angle)
    if sine < 1e-3:
        raise InputError(f"an angle of {np.degrees(angle):g} deg is the relation parallel")
    sign = 1.0 if np.cos(angle) == 0 else _sign(frame.start[one].direction, frame.start[two].direction)
    sign *= 1.0 if np.cos(angle) >= 0 else -1.0
    value, blocks = _inclined(one, two, at, sign, float(np.cos(angle)))
    return value / sine, {number: block / sine for number, block in blocks.items()}


def _height(one: int, two: int, at: Mapping[int, Placement]) -> _Rows:
    """How far the second's point is above the first, a plane."""
    normal, step = at[one].direction, at[two].point - at[one].point
    own = step @ at[one].by_direction - normal @ at[one].by_point
    return normal @ step, {one: own, two: normal @ at[two].by_point}


def _offset(one: int, two: int, at: Mapping[int, Placement]) -> _Rows:
    """Both components of the way between two parallel axes, across the first."""
    first, step = at[one], at[two].point - at[one].point
    across, along = at[one].across, at[one].direction
    tilt, reach = across @ along, float(along @ step)
    sideways = across - np.outer(tilt, along)  # of the step
    own = -np.outer(tilt, step @ first.by_direction) - reach * across @ first.by_direction
    return sideways @ step, {one: own - sideways @ first.by_point, two: sideways @ at[two].by_point}


def _distance(one: int, two: int, at: Mapping[int, Placement], frame: Frame) -> _Rows:
    """How far apart two parallel planes, a plane and an axis, or two axes are."""
    planes = [at[number].is_plane for number in (one, two)]
    if not any(planes):
        value, blocks = _offset(one, two, at)
        length = float(np.linalg.norm(value))
        way = value / length if length > 0 else np.array([1.0, 0.0])
        return np.float64(length), {number: way @ block for number, block in blocks.items()}
    flat, other = (one, two) if planes[0] else (two, one)
    value, blocks = _height(flat, other, at)
    began = frame.start[flat].direction @ (frame.start[other].point - frame.start[flat].point)
    sign = -1.0 if began < 0 else 1.0
    return sign * value, {number: sign * block for number, block in blocks.items()}


def _sizes(relation: Relation, at: Mapping[int, Placement]) -> Constraint:
    """Radii and half angles against each other or against a value."""
    if relation.kind == "half_angle":
        (one,) = relation.surfaces
        if at[one].half_angle <= 0:
            raise InputError("only a cone has a half angle")
        value = at[one].half_angle - float(relation.value or 0.0)
        return _built((np.float64(value), {one: at[one].by_half_angle}), ANGLE)
    if relation.kind == "equal_ring_radius":
        one, two = relation.surfaces
        if min(at[one].ring_radius, at[two].ring_radius) <= 0:
            raise InputError("only tori have a ring")
        value = at[one].ring_radius - at[two].ring_radius
        return _built(
            (np.float64(value), {one: at[one].by_ring_radius, two: -at[two].by_ring_radius}), RADIUS
        )
    for number in relation.surfaces:
        if at[number].radius <= 0 or at[number].half_angle > 0:
            raise InputError("only spheres, cylinders and tubes of tori have one radius")
    one, *others = relation.surfaces
    if not others:
        value = at[one].radius - float(relation.value or 0.0)
        return _built((np.float64(value), {one: at[one].by_radius}), RADIUS)
    (two,) = others
    value = at[one].radius - at[two].radius
    return _built((np.float64(value), {one: at[one].by_radius, two: -at[two].by_radius}), RADIUS)


def _against_gravity(relation: Relation, at: Mapping[int, Placement], frame: Frame) -> Constraint:
    """A plane that is vertical has a level normal, an axis that is vertical goes along gravity."""
    if frame.up is None:
        raise InputError(f"{relation.kind} needs to know which way is up")
    (one,) = relation.surfaces
    if not at[one].direction.any():
        raise InputError(f"a sphere has no direction: it cannot be {relation.kind}")
    if (relation.kind == "vertical") == at[one].is_plane:
        return _built((frame.up @ at[one].direction, {one: frame.up @ at[one].by_direction}), ANGLE)
    across, sign = frame.start[one].across, _sign(frame.start[one].direction, frame.up)
    value = across @ (at[one].direction - sign * frame.up)
    return _built((value, {one: across @ at[one].by_direction}), ANGLE)
