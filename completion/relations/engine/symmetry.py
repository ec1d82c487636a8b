# SPDX-License-Identifier: MIT
"""Symmetry: pairs of surfaces that are images of each other in one mirror, which itself is eliminated.

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

from completion.relations.engine.equation import (
    ANGLE,
    LENGTH,
    RADIUS,
    Constraint,
    Frame,
    built,
    stacked,
)
from completion.relations.engine.mirror import Mirror, mirrors_between
from completion.relations.engine.placement import Placement
from scenes.checks import FloatArray, InputError
from scenes.surfaces.surface import perpendicular

_LEAST_TOLD = 1e-3  # of what is told best, below which a direction or a mirror is not told
_N_ROUNDS = 30
_SMALL = 1e-14  # radians, and shares of the surfaces' reach: a step of the mirror that is the last
_MOST = 2.0  # radians and shares: a step beyond it is cut, so that pairs of no mirror do not lead away
_STILL = np.zeros((3, 3))


def symmetric(surfaces: tuple[int, ...], at: Mapping[int, Placement], frame: Frame) -> Constraint:
    """Return the equations of pairs (a, a', b, b', ...) that are images in one mirror.

    Raises InputError: halves of different kinds, cones, tori; pairs that do not tell the mirror.
    """
    pairs = list(zip(surfaces[::2], surfaces[1::2], strict=True))
    for one, two in pairs:
        _check_halves(at[one], at[two])
    if surfaces not in frame.kept:
        frame.kept[surfaces] = _Beginning.of(surfaces, frame.start)
    begun: _Beginning = frame.kept[surfaces]
    begin, frames, kept, change = begun.mirror, begun.frames, begun.kept, np.zeros(3)
    for _ in range(_N_ROUNDS):
        found, by_mirror = _misfits(*begin.moved(change), frames, at)
        step = np.linalg.solve(by_mirror[kept], found.value[kept])
        largest = float(np.abs(step * np.array([1.0, 1.0, 1 / begun.reach])).max())
        if largest < _SMALL:
            break
        change = change - step * min(1.0, _MOST / largest)
    rest = [k for k in range(len(found.rows)) if k not in kept]
    by = by_mirror[rest] @ np.linalg.inv(by_mirror[kept])
    blocks = {number: block[rest] - by @ block[kept] for number, block in found.blocks.items()}
    value = found.value[rest] - by @ found.value[kept]
    return Constraint(value, blocks, tuple(found.rows[k] for k in rest))


def _reach(surfaces: Sequence[int], at: Mapping[int, Placement]) -> float:
    """How far the surfaces' points are from their middle, root mean square, metres."""
    points = np.array([at[number].point for number in surfaces])
    return float(np.sqrt(np.square(points - points.mean(axis=0)).sum(axis=1).mean())) or 1.0


def mirror_of(surfaces: Sequence[int], at: Mapping[int, Placement]) -> Mirror:
    """The mirror between the halves of one of the pairs that suits all pairs best where the surfaces are.

    Raises InputError: no pair tells one.
    """
    pairs = [(at[one], at[two]) for one, two in zip(surfaces[::2], surfaces[1::2], strict=True)]
    centre, reach = np.mean([at[number].point for number in surfaces], axis=0), _reach(surfaces, at)
    least, best = np.inf, None
    for one, two in pairs:
        for mirror in mirrors_between(one, two):
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
    return Mirror.of(best.normal, best.point, centre)


@dataclass(frozen=True, slots=True, eq=False)
class _PairFrame:
    """What a pair is measured in: two unit vectors (2, 3) across the second half, and the image's sign."""

    across: FloatArray
    sign: float

    @classmethod
    def of(cls, mirror: Mirror, one: Placement, two: Placement) -> _PairFrame:
        if not two.direction.any():
            return cls(np.vstack([mirror.normal, mirror.tilts]), 1.0)
        image, _ = mirror.turned(one.direction, _STILL)
        first = mirror.normal - float(mirror.normal @ two.direction) * two.direction
        length = float(np.linalg.norm(first))
        first = first / length if length > _LEAST_TOLD else perpendicular(two.direction)
        across = np.stack([first, np.cross(two.direction, first)])
        return cls(across, -1.0 if image @ two.direction < 0 else 1.0)

    def misfit(
        self, mirror: Mirror, one: Placement, two: Placement, by: FloatArray
    ) -> tuple[Constraint, FloatArray]:
        """How far the first half's image is off the second, and its derivative (m, 3) by the mirror.

        Blocks are 0 for the first half and 1 for the second; `by` (3, 3) is the derivative of the normal.
        """
        turn = np.eye(3) - 2 * np.outer(mirror.normal, mirror.normal)
        image, moves = mirror.image(one.point, by)
        apart, across, axis = image - two.point, self.across, two.direction
        own_point = turn @ one.by_point
        if not axis.any():
            blocks = {0: across @ own_point, 1: -across @ two.by_point}
            placed, slopes = built((across @ apart, blocks), LENGTH), across @ moves
            return stacked([placed, _radii(one, two)]), np.vstack([slopes, np.zeros((1, 3))])
        turned, turns = mirror.turned(one.direction, by)
        blocks = {0: across @ turn @ one.by_direction, 1: -self.sign * across @ two.by_direction}
        angles = built((across @ (turned - self.sign * axis), blocks), ANGLE)
        if two.is_plane:
            blocks = {0: axis @ own_point, 1: apart @ two.by_direction - axis @ two.by_point}
            placed = built((axis @ apart, blocks), LENGTH)
            return stacked([angles, placed]), np.vstack([across @ turns, axis @ moves])
        tilt, reach = across @ axis, float(axis @ apart)
        sideways = across - np.outer(tilt, axis)
        own = -np.outer(tilt, apart @ two.by_direction) - reach * across @ two.by_direction
        placed = built(
            (sideways @ apart, {0: sideways @ own_point, 1: own - sideways @ two.by_point}), LENGTH
        )
        slopes = np.vstack([across @ turns, sideways @ moves, np.zeros((1, 3))])
        return stacked([angles, placed, _radii(one, two)]), slopes


@dataclass(frozen=True, slots=True, eq=False)
class _Beginning:
    """The mirror where the surfaces began, the pairs' frames, and the three misfits that tell most of it."""

    mirror: Mirror
    reach: float
    frames: dict[tuple[int, int], _PairFrame]
    kept: list[int]

    @classmethod
    def of(cls, surfaces: Sequence[int], start: Mapping[int, Placement]) -> _Beginning:
        pairs = zip(surfaces[::2], surfaces[1::2], strict=True)
        mirror, reach = mirror_of(surfaces, start), _reach(surfaces, start)
        frames = {(one, two): _PairFrame.of(mirror, start[one], start[two]) for one, two in pairs}
        first, by_mirror = _misfits(*mirror.moved(np.zeros(3)), frames, start)
        return cls(mirror, reach, frames, _telling(by_mirror, first.rows, reach))


def _misfits(
    mirror: Mirror, by: FloatArray, frames: dict[tuple[int, int], _PairFrame], at: Mapping[int, Placement]
) -> tuple[Constraint, FloatArray]:
    """The misfits (m,) of all pairs in a mirror, and their derivative (m, 3) by its tilts and offset."""
    parts, slopes = list[Constraint](), list[FloatArray]()
    for (one, two), own in frames.items():
        part, slope = own.misfit(mirror, at[one], at[two], by)
        parts.append(Constraint(part.value, {one: part.blocks[0], two: part.blocks[1]}, part.rows))
        slopes.append(slope)
    return stacked(parts), np.vstack(slopes)


def _telling(by_mirror: FloatArray, rows: Sequence[int], reach: float) -> list[int]:
    """The three misfits that tell most of the mirror, of their derivatives (m, 3) by it.

    Raises InputError: they leave it open.
    """
    scale = np.where(np.array(rows) == ANGLE, 1.0, 1 / reach)
    unit = by_mirror * scale[:, None] * np.array([1.0, 1.0, reach])
    _, triangle, order = qr(unit.T, mode="economic", pivoting=True)
    size = np.abs(np.diag(triangle))
    if len(size) < 3 or size[2] < _LEAST_TOLD * size[0]:
        raise InputError("symmetric: the pairs do not tell where the mirror is")
    return sorted(int(k) for k in order[:3])


def _radii(one: Placement, two: Placement) -> Constraint:
    return built((np.float64(one.radius - two.radius), {0: one.by_radius, 1: -two.by_radius}), RADIUS)


def _check_halves(one: Placement, two: Placement) -> None:
    kinds = []
    for half in (one, two):
        if half.half_angle > 0 or half.ring_radius > 0:
            raise InputError("symmetric relates pairs of planes, of cylinders or of spheres")
        kinds.append("plane" if half.is_plane else "cylinder" if half.direction.any() else "sphere")
    if kinds[0] != kinds[1]:
        raise InputError(f"symmetric relates halves of one kind, got a {kinds[0]} and a {kinds[1]}")
