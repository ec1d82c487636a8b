# SPDX-License-Identifier: MIT
"""Constraints: a relation as equations c(x) = 0 of its surfaces' parameters, and their derivatives.

Symmetry: pairs of surfaces that are images of each other in one mirror, which itself is eliminated.
The misfits r(x, mu) of all pairs depend on the surfaces x and on the mirror mu: two tilts and an offset.
Three of them, which tell most of the mirror where the surfaces began, are solved for it: r_K(x, mu) = 0. The
others are the equations, c(x) = r_L(x, mu(x)), with derivatives r_L,x - r_L,mu (r_K,mu)^-1 r_K,x. One pair of
planes says nothing; each further one takes away three degrees of freedom.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import qr

from completion.relations.equations import (
    ANGLE,
    LENGTH,
    RADIUS,
    Constraint,
    MirrorPlane,
    Placement,
    RelationFrame,
    Rows,
    built,
    mirrors_between,
    stack,
    weighted_sum,
)
from completion.relations.limits import LEAST_TOLD
from completion.relations.relation import Relation
from scenes.checks import FloatArray, InputError
from scenes.surfaces.surface import perpendicular

_N_ROUNDS = 30
_SMALL = 1e-14  # radians, and shares of the surfaces' reach: a step of the mirror that is the last
_MOST = 2.0  # radians and shares: a step beyond it is cut, so that pairs of no mirror do not lead away
_STILL = np.zeros((3, 3))


def symmetric(surfaces: tuple[int, ...], at: Mapping[int, Placement], frame: RelationFrame) -> Constraint:
    """Return the equations of pairs (a, a', b, b', ...) that are images in one mirror.

    Raises InputError: halves of different kinds, cones, tori; pairs that do not tell the mirror.
    """
    pairs = list(zip(surfaces[::2], surfaces[1::2], strict=True))
    for index, two in pairs:
        _check_halves(at[index], at[two])
    if surfaces not in frame.kept:
        frame.kept[surfaces] = _MirrorStart.of(surfaces, frame.start)
    begun: _MirrorStart = frame.kept[surfaces]
    begin, frames, kept, change = begun.mirror, begun.frames, begun.kept, np.zeros(3)
    for _ in range(_N_ROUNDS):
        constraint, by_mirror = _misfits(*begin.move(change), frames, at)
        step = np.linalg.solve(by_mirror[kept], constraint.value[kept])
        largest = float(np.abs(step * np.array([1.0, 1.0, 1 / begun.reach])).max())
        if largest < _SMALL:
            break
        change = change - step * min(1.0, _MOST / largest)
    other_rows = [k for k in range(len(constraint.rows)) if k not in kept]
    by = by_mirror[other_rows] @ np.linalg.inv(by_mirror[kept])
    blocks = {number: block[other_rows] - by @ block[kept] for number, block in constraint.blocks.items()}
    value = constraint.value[other_rows] - by @ constraint.value[kept]
    return Constraint(value, blocks, tuple(constraint.rows[k] for k in other_rows))


def _reach(surfaces: Sequence[int], at: Mapping[int, Placement]) -> float:
    """How far the surfaces' points are from their middle, root mean square, metres."""
    points = np.array([at[number].point for number in surfaces])
    return float(np.sqrt(np.square(points - points.mean(axis=0)).sum(axis=1).mean())) or 1.0


def mirror_of(surfaces: Sequence[int], at: Mapping[int, Placement]) -> MirrorPlane:
    """The mirror between the halves of one of the pairs that suits all pairs best where the surfaces are.

    Raises InputError: no pair tells one.
    """
    pairs = [(at[surface], at[two]) for surface, two in zip(surfaces[::2], surfaces[1::2], strict=True)]
    centre, reach = np.mean([at[number].point for number in surfaces], axis=0), _reach(surfaces, at)
    least, best = np.inf, None
    for placement, two in pairs:
        for mirror in mirrors_between(placement, two):
            parts = [_PairFrame.of(mirror, *pair).misfit(mirror, *pair, _STILL) for pair in pairs]
            off = sum(
                float(value) ** 2 * (reach**2 if row == ANGLE else 1.0)
                for part in parts
                for value, row in zip(part[0].value, part[0].rows, strict=True)
            )
            if off < least * (1 - 1e-9):
                least, best = off, mirror
    if best is None:
        raise InputError("symmetric: no pair tells where the mirror is")
    return MirrorPlane.of(best.normal, best.point, centre)


@dataclass(frozen=True, slots=True, eq=False)
class _PairFrame:
    """What a pair is measured in: two unit vectors (2, 3) across the second half, and the image's sign."""

    across: FloatArray
    sign: float

    @classmethod
    def of(cls, mirror: MirrorPlane, placement: Placement, two: Placement) -> _PairFrame:
        if not two.direction.any():
            return cls(np.vstack([mirror.normal, mirror.tilts]), 1.0)
        image, _ = mirror.reflect(placement.direction, _STILL)
        first = mirror.normal - float(mirror.normal @ two.direction) * two.direction
        length = float(np.linalg.norm(first))
        first = first / length if length > LEAST_TOLD else perpendicular(two.direction)
        across = np.stack([first, np.cross(two.direction, first)])
        return cls(across, -1.0 if image @ two.direction < 0 else 1.0)

    def misfit(
        self, mirror: MirrorPlane, placement: Placement, two: Placement, by: FloatArray
    ) -> tuple[Constraint, FloatArray]:
        """How far the first half's image is off the second, and its derivative (m, 3) by the mirror.

        Blocks are 0 for the first half and 1 for the second; `by` (3, 3) is the derivative of the normal.
        """
        turn = np.eye(3) - 2 * np.outer(mirror.normal, mirror.normal)
        image, moves = mirror.image(placement.point, by)
        apart, across, axis = image - two.point, self.across, two.direction
        own_point = turn @ placement.by_point
        if not axis.any():
            blocks = {0: across @ own_point, 1: -across @ two.by_point}
            placed, slopes = built((across @ apart, blocks), LENGTH), across @ moves
            return stack([placed, _radii(placement, two)]), np.vstack([slopes, np.zeros((1, 3))])
        turned, turns = mirror.reflect(placement.direction, by)
        blocks = {0: across @ turn @ placement.by_direction, 1: -self.sign * across @ two.by_direction}
        angles = built((across @ (turned - self.sign * axis), blocks), ANGLE)
        if two.is_plane:
            blocks = {0: axis @ own_point, 1: apart @ two.by_direction - axis @ two.by_point}
            placed = built((axis @ apart, blocks), LENGTH)
            return stack([angles, placed]), np.vstack([across @ turns, axis @ moves])
        tilt, reach = across @ axis, float(axis @ apart)
        sideways = across - np.outer(tilt, axis)
        by_direction = -np.outer(tilt, apart @ two.by_direction) - reach * across @ two.by_direction
        placed = built(
            (sideways @ apart, {0: sideways @ own_point, 1: by_direction - sideways @ two.by_point}), LENGTH
        )
        slopes = np.vstack([across @ turns, sideways @ moves, np.zeros((1, 3))])
        return stack([angles, placed, _radii(placement, two)]), slopes


@dataclass(frozen=True, slots=True, eq=False)
class _MirrorStart:
    """The mirror where the surfaces began, the pairs' frames, and the three misfits that tell most of it."""

    mirror: MirrorPlane
    reach: float
    frames: dict[tuple[int, int], _PairFrame]
    kept: list[int]

    @classmethod
    def of(cls, surfaces: Sequence[int], start: Mapping[int, Placement]) -> _MirrorStart:
        pairs = zip(surfaces[::2], surfaces[1::2], strict=True)
        mirror, reach = mirror_of(surfaces, start), _reach(surfaces, start)
        frames = {(number, two): _PairFrame.of(mirror, start[number], start[two]) for number, two in pairs}
        first, by_mirror = _misfits(*mirror.move(np.zeros(3)), frames, start)
        return cls(mirror, reach, frames, _informative_rows(by_mirror, first.rows, reach))


def _misfits(
    mirror: MirrorPlane,
    by: FloatArray,
    frames: dict[tuple[int, int], _PairFrame],
    at: Mapping[int, Placement],
) -> tuple[Constraint, FloatArray]:
    """The misfits (m,) of all pairs in a mirror, and their derivative (m, 3) by its tilts and offset."""
    parts, slopes = list[Constraint](), list[FloatArray]()
    for (number, two), frame in frames.items():
        part, slope = frame.misfit(mirror, at[number], at[two], by)
        parts.append(Constraint(part.value, {number: part.blocks[0], two: part.blocks[1]}, part.rows))
        slopes.append(slope)
    return stack(parts), np.vstack(slopes)


def _informative_rows(by_mirror: FloatArray, rows: Sequence[int], reach: float) -> list[int]:
    """The three misfits that tell most of the mirror, of their derivatives (m, 3) by it.

    Raises InputError: they leave it open.
    """
    scale = np.where(np.array(rows) == ANGLE, 1.0, 1 / reach)
    unit = by_mirror * scale[:, None] * np.array([1.0, 1.0, reach])
    _, triangle, order = qr(unit.T, mode="economic", pivoting=True)
    size = np.abs(np.diag(triangle))
    if len(size) < 3 or size[2] < LEAST_TOLD * size[0]:
        raise InputError("symmetric: the pairs do not tell where the mirror is")
    return sorted(int(k) for k in order[:3])


def _radii(placement: Placement, two: Placement) -> Constraint:
    return built(
        (np.float64(placement.radius - two.radius), {0: placement.by_radius, 1: -two.by_radius}), RADIUS
    )


def _check_halves(placement: Placement, two: Placement) -> None:
    kinds = []
    for half in (placement, two):
        if half.half_angle > 0 or half.ring_radius > 0:
            raise InputError("symmetric relates pairs of planes, of cylinders or of spheres")
        kinds.append("plane" if half.is_plane else "cylinder" if half.direction.any() else "sphere")
    if kinds[0] != kinds[1]:
        raise InputError(f"symmetric relates halves of one kind, got a {kinds[0]} and a {kinds[1]}")


def constrain(relation: Relation, at: Mapping[int, Placement], frame: RelationFrame) -> Constraint:
    """Return the equations of a relation where its surfaces are `at`.

    Directions count without their sign: of two that are parallel or at an angle, the sign is the one that
    fits best where the surfaces began (`frame.start`), and so is that of a distance. There is no arc cosine
    and no absolute value, so that derivatives exist where the relation holds.

    Raises InputError: a relation that these surfaces cannot have.
    """
    index = relation.surfaces[0]
    kind = relation.kind
    if kind in ("radius", "half_angle", "equal_radius", "equal_ring_radius"):
        return _sizes(relation, at)
    if kind in ("vertical", "horizontal"):
        return _against_gravity(relation, at, frame)
    if kind == "symmetric":
        return symmetric(relation.surfaces, at, frame)
    for number in relation.surfaces:
        if not at[number].direction.any():
            raise InputError(f"a sphere has no direction: it cannot be {kind.replace('_', ' ')}")
    _check_kinds(relation, at)
    if kind == "regular":
        return _regular(relation.surfaces, at, frame)
    two = relation.surfaces[1]
    if kind == "parallel":
        return built(_parallel(index, two, at, frame), ANGLE)
    if kind == "perpendicular":
        return built(_angle_rows(index, two, at, 1.0, 0.0), ANGLE)
    if kind == "angle":
        return built(_angle(relation, at, frame), ANGLE)
    if kind == "axis_in_plane":
        rows = _angle_rows(index, two, at, 1.0, 0.0), _height(index, two, at)
        return stack([built(rows[0], ANGLE), built(rows[1], LENGTH)])
    if kind == "tangent":
        return _tangent(relation.surfaces, at, frame)
    turned = built(_parallel(index, two, at, frame), ANGLE)
    if kind in ("coplanar", "coaxial"):
        beside = _height(index, two, at) if kind == "coplanar" else _offset(index, two, at)
        return stack([turned, built(beside, LENGTH)])
    if kind == "distance":
        apart = _distance(index, two, at, frame)
        return built((apart[0] - float(relation.value or 0.0), apart[1]), LENGTH)
    three, four = relation.surfaces[2:]
    first, second = _distance(index, two, at, frame), _distance(three, four, at, frame)
    return built(weighted_sum([(1.0, first), (-1.0, second)]), LENGTH)


def _check_kinds(relation: Relation, at: Mapping[int, Placement]) -> None:
    """Raise InputError where a relation of planes or of axes is that of others."""
    flat = [at[number].is_plane for number in relation.surfaces]
    if relation.kind == "coplanar" and not all(flat):
        raise InputError("coplanar relates two planes")
    if relation.kind == "coaxial" and any(flat):
        raise InputError("coaxial relates two axes")
    if relation.kind == "tangent" and (
        all(flat) or any(at[number].radius <= 0 or at[number].half_angle > 0 or at[number].ring_radius > 0
                         for number, is_flat in zip(relation.surfaces, flat, strict=True) if not is_flat)
    ):  # fmt: skip
        raise InputError("tangent relates a plane and a cylinder, or two cylinders")
    if relation.kind == "axis_in_plane" and flat != [True, False]:
        raise InputError("axis in plane relates a plane and then an axis")
    if relation.kind == "regular" and any(flat) != all(flat):
        raise InputError("regular relates planes, or axes, not both")


def _sign(first: FloatArray, second: FloatArray) -> float:
    return -1.0 if first @ second < 0 else 1.0


def _parallel(number: int, two: int, at: Mapping[int, Placement], frame: RelationFrame) -> Rows:
    """Both components of the directions' difference across where the first one began."""
    across = frame.start[number].across
    sign = _sign(frame.start[number].direction, frame.start[two].direction)
    value = across @ (at[number].direction - sign * at[two].direction)
    return value, {number: across @ at[number].by_direction, two: -sign * across @ at[two].by_direction}


def _angle_rows(number: int, two: int, at: Mapping[int, Placement], sign: float, cosine: float) -> Rows:
    """The cosine of the angle less that which it shall be."""
    first, second = at[number], at[two]
    value = sign * first.direction @ second.direction - cosine
    blocks = {
        number: sign * second.direction @ first.by_direction,
        two: sign * first.direction @ second.by_direction,
    }
    return value, blocks


def _angle(relation: Relation, at: Mapping[int, Placement], frame: RelationFrame) -> Rows:
    """The cosine's misfit over the sine: to first order the angle's, radians."""
    index, two = relation.surfaces
    angle = float(relation.value or 0.0)
    sine = np.sin(angle)
    if sine < 1e-3:
        raise InputError(f"an angle of {np.degrees(angle):g} deg is the relation parallel")
    sign = 1.0 if np.cos(angle) == 0 else _sign(frame.start[index].direction, frame.start[two].direction)
    sign *= 1.0 if np.cos(angle) >= 0 else -1.0
    value, blocks = _angle_rows(index, two, at, sign, float(np.cos(angle)))
    return value / sine, {number: block / sine for number, block in blocks.items()}


def _height(number: int, two: int, at: Mapping[int, Placement]) -> Rows:
    """How far the second's point is above the first, a plane."""
    normal, step = at[number].direction, at[two].point - at[number].point
    by_direction = step @ at[number].by_direction - normal @ at[number].by_point
    return normal @ step, {number: by_direction, two: normal @ at[two].by_point}


def _offset(number: int, two: int, at: Mapping[int, Placement]) -> Rows:
    """Both components of the way between two parallel axes, across the first."""
    first, step = at[number], at[two].point - at[number].point
    across, along = at[number].across, at[number].direction
    tilt, reach = across @ along, float(along @ step)
    sideways = across - np.outer(tilt, along)  # of the step
    by_direction = -np.outer(tilt, step @ first.by_direction) - reach * across @ first.by_direction
    return sideways @ step, {
        number: by_direction - sideways @ first.by_point,
        two: sideways @ at[two].by_point,
    }


def _regular(surfaces: Sequence[int], at: Mapping[int, Placement], frame: RelationFrame) -> Constraint:
    """All parallel to the first, and the second differences of their places across it."""
    first, *others = surfaces
    turned = [built(_parallel(first, other, at, frame), ANGLE) for other in others]
    beside = _height if at[first].is_plane else _offset
    begin = beside(first, others[0], at)
    places = [(0.0 * np.asarray(begin[0]), dict[int, FloatArray]()), begin]
    places += [beside(first, other, at) for other in others[1:]]
    bends = [
        built(weighted_sum([(1.0, before), (-2.0, here), (1.0, after)]), LENGTH)
        for before, here, after in zip(places, places[1:], places[2:], strict=False)
    ]
    return stack([*turned, *bends])


def spacing_of(surfaces: Sequence[int], at: Mapping[int, Placement]) -> float:
    """How far each surface of a row is from the next, metres, in the mean."""
    first, last = at[surfaces[0]], at[surfaces[-1]]
    step = last.point - first.point
    apart = first.direction @ step if first.is_plane else np.linalg.norm(np.cross(first.direction, step))
    return float(np.abs(apart)) / (len(surfaces) - 1)


def _distance(index: int, two: int, at: Mapping[int, Placement], frame: RelationFrame) -> Rows:
    """How far apart two parallel planes, a plane and an axis, or two axes are."""
    planes = [at[number].is_plane for number in (index, two)]
    if not any(planes):
        value, blocks = _offset(index, two, at)
        length = float(np.linalg.norm(value))
        way = value / length if length > 0 else np.array([1.0, 0.0])
        return np.float64(length), {number: way @ block for number, block in blocks.items()}
    flat, other = (index, two) if planes[0] else (two, index)
    value, blocks = _height(flat, other, at)
    began = frame.start[flat].direction @ (frame.start[other].point - frame.start[flat].point)
    sign = -1.0 if began < 0 else 1.0
    return sign * value, {number: sign * block for number, block in blocks.items()}


def _tangent(surfaces: Sequence[int], at: Mapping[int, Placement], frame: RelationFrame) -> Constraint:
    """A cylinder's axis is as far from a plane as its radius; two, by the sum or difference of theirs.

    Which of both, where the surfaces began says.
    """
    index, two = surfaces
    radii = {number: at[number].radius for number in surfaces if not at[number].is_plane}
    if len(radii) == 1:
        turned, weight = _angle_rows(index, two, at, 1.0, 0.0), dict.fromkeys(radii, 1.0)
    else:
        turned = _parallel(index, two, at, frame)
        start = [frame.start[number] for number in surfaces]
        apart = float(np.linalg.norm(_offset(index, two, frame.start)[0]))
        inner, outer = abs(start[0].radius - start[1].radius), start[0].radius + start[1].radius
        first = (
            1.0 if abs(apart - outer) <= abs(apart - inner) or start[0].radius >= start[1].radius else -1.0
        )
        second = first if abs(apart - outer) <= abs(apart - inner) else -first
        weight = {index: first, two: second}
    reach = [(-weight[number], (np.float64(radius), {number: at[number].by_radius[0]}))
             for number, radius in radii.items()]  # fmt: skip
    return stack(
        [built(turned, ANGLE), built(weighted_sum([(1.0, _distance(index, two, at, frame)), *reach]), LENGTH)]
    )


def _sizes(relation: Relation, at: Mapping[int, Placement]) -> Constraint:
    """Radii and half angles against each other or against a value."""
    if relation.kind == "half_angle":
        (index,) = relation.surfaces
        if at[index].half_angle <= 0:
            raise InputError("only a cone has a half angle")
        value = at[index].half_angle - float(relation.value or 0.0)
        return built((np.float64(value), {index: at[index].by_half_angle}), ANGLE)
    if relation.kind == "equal_ring_radius":
        index, two = relation.surfaces
        if min(at[index].ring_radius, at[two].ring_radius) <= 0:
            raise InputError("only tori have a ring")
        value = at[index].ring_radius - at[two].ring_radius
        return built(
            (np.float64(value), {index: at[index].by_ring_radius, two: -at[two].by_ring_radius}), RADIUS
        )
    for number in relation.surfaces:
        if at[number].radius <= 0 or at[number].half_angle > 0:
            raise InputError("only spheres, cylinders and tubes of tori have one radius")
    index, *others = relation.surfaces
    if not others:
        value = at[index].radius - float(relation.value or 0.0)
        return built((np.float64(value), {index: at[index].by_radius}), RADIUS)
    (two,) = others
    value = at[index].radius - at[two].radius
    return built((np.float64(value), {index: at[index].by_radius, two: -at[two].by_radius}), RADIUS)


def _against_gravity(relation: Relation, at: Mapping[int, Placement], frame: RelationFrame) -> Constraint:
    """A plane that is vertical has a level normal, an axis that is vertical goes along gravity."""
    if frame.up is None:
        raise InputError(f"{relation.kind} needs to know which way is up")
    (number,) = relation.surfaces
    if not at[number].direction.any():
        raise InputError(f"a sphere has no direction: it cannot be {relation.kind}")
    if (relation.kind == "vertical") == at[number].is_plane:
        return built((frame.up @ at[number].direction, {number: frame.up @ at[number].by_direction}), ANGLE)
    across, sign = frame.start[number].across, _sign(frame.start[number].direction, frame.up)
    value = across @ (at[number].direction - sign * frame.up)
    return built((value, {number: across @ at[number].by_direction}), ANGLE)
