# SPDX-License-Identifier: MIT
"""Refit: walls fitted anew in their profile, to the points between their corners.

Where a line and an arc touch, a point's face is told by its noise, so that faces bend towards one another.
In the profile its place along the chain tells.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from completion.fitting.limits import MOST_CONDITION
from completion.fitting.result import SurfaceFit, inflated
from completion.parts.profiles import limits
from completion.parts.profiles.chain import Chain, Piece, along_wall, fuzz_m, place_at
from completion.relations.equations import move_surface
from completion.relations.estimate import JointEstimate, wald_test
from completion.relations.relation import Relation, RelationKind
from scenes.checks import BoolArray, FloatArray, InputError
from scenes.surfaces.catalogue import Cylinder, Plane, Surface

_ROUNDS = 3
_LEAST_POINTS = 12


def unfitted(surface: Surface) -> SurfaceFit:
    """A wall that is not fitted yet (`n` = 0): its covariance says which of its parameters are free."""
    free = [1.0, 1.0, 0.0] if isinstance(surface, Plane) else [1.0, 1.0, 0.0, 0.0, 1.0]
    return SurfaceFit(surface, 0.0, np.diag(free), 0)


def line_of(places: FloatArray) -> Plane:
    """The line along which places (n, 2 or 3) are spread, as a plane."""
    middle = places[:, :2].mean(axis=0)
    x, y = np.linalg.eigh(np.cov(places[:, :2].T))[1][:, 0]
    return Plane(np.append(middle, 0.0), (x, y, 0.0), (-y, x, 0.0))


def refitted(
    walls: Sequence[SurfaceFit], chains: Sequence[Chain], places: FloatArray, noise_m: float
) -> list[SurfaceFit]:
    """Return walls (k,) fitted to the places (n, 3) of points on them that lie between their corners.

    A wall with too few of these, as of a model's mesh, stays as it is; its `n` is 0 if it never was fitted.
    """
    inside = [np.zeros(len(places), np.bool_) for _ in walls]
    for chain in chains:
        for k, piece in enumerate(chain.pieces):
            inside[piece.wall] |= _between_corners(chain, k, walls, places, noise_m)
    found = []
    for wall, own in zip(walls, inside, strict=True):
        own &= np.abs(wall.surface.distance(places)) <= limits.CUT * noise_m
        n_free = np.count_nonzero(np.diag(wall.covariance))
        is_enough = np.count_nonzero(own) >= _LEAST_POINTS * n_free
        found.append(_refit(wall, places[own], noise_m) if is_enough else wall)
    return found


def _between_corners(
    chain: Chain, k: int, walls: Sequence[SurfaceFit], places: FloatArray, noise_m: float
) -> BoolArray:
    """Which places (n, 3) lie along a piece between its corners, and not round these."""
    piece, n = chain.pieces[k], len(chain.pieces)
    if piece.is_whole:
        return np.ones(len(places), np.bool_)
    surface, middle = walls[piece.wall].surface, (piece.low + piece.high) / 2
    ends, guards = [piece.low - middle, piece.high - middle], [limits.GUARD * noise_m] * 2
    for other, corner in ((k - 1, k - 1), (k + 1, k)):
        if chain.corners and (chain.is_ring or 0 <= other < n):
            at, beside = chain.corners[corner], walls[chain.walls[other % n]].surface
            side = int((other > k) == chain.is_forward[k])
            ends[side] = _away(surface, at[None], middle)[0]
            guards[side] = max(guards[side], fuzz_m(surface, beside, at, noise_m) / 2)
    if walls[piece.wall].n == 0 and sum(guards) > (ends[1] - ends[0]) / 2:
        guards = [0.0, 0.0]
    away = _away(surface, places, middle)
    return np.asarray((away > ends[0] + guards[0]) & (away < ends[1] - guards[1]))


def _away(surface: Surface, places: FloatArray, middle: float) -> FloatArray:
    """How far along a wall places (n, 2 or 3) are from a coordinate, the shorter way round."""
    away, period = along_wall(surface, places) - middle, surface.period
    return np.asarray(away - period * np.rint(away / period)) if np.isfinite(period) else away


def _refit(wall: SurfaceFit, points: FloatArray, noise_m: float) -> SurfaceFit:
    """A wall fitted to points (n, 3); an arc that never was is a line if that tells them as shortly."""
    fit = _fitted(wall, points, noise_m)
    if wall.n == 0 and isinstance(wall.surface, Cylinder):
        line = _fitted(unfitted(line_of(points)), points, noise_m)
        if fit is None:
            fit = line
        elif line is not None:
            arc, straight = (np.square(each.surface.distance(points)).sum() for each in (fit, line))
            fit = line if straight - arc <= limits.NATS * np.log(len(points)) * noise_m**2 else fit
    return wall if fit is None else fit


def _fitted(wall: SurfaceFit, points: FloatArray, noise_m: float) -> SurfaceFit | None:
    """A wall's free parameters by least squares; None where no surface is left, or points determine none."""
    free, fit = np.flatnonzero(np.diag(wall.covariance) > 0), wall
    for step in range(_ROUNDS + 1):
        slope, height = fit.gradient(points)[:, free], fit.surface.distance(points)
        if step == _ROUNDS:
            break
        sign = -1.0 if getattr(fit.surface, "concave", False) else 1.0
        change = np.zeros(len(wall.covariance))
        change[free] = -np.linalg.lstsq(slope, sign * height, rcond=None)[0]
        try:
            fit = replace(fit, surface=move_surface(fit.surface, change))
        except InputError:
            return None
    scale = np.linalg.norm(slope, axis=0)
    if not scale.all() or np.linalg.cond(slope / scale) ** 2 > MOST_CONDITION:
        return None
    rms = float(np.sqrt(height @ height / max(len(points) - len(free), 1)))
    covariance = np.zeros_like(wall.covariance)
    covariance[np.ix_(free, free)] = max(rms, noise_m) ** 2 * np.linalg.pinv(slope.T @ slope)
    made = replace(fit, rms=rms, covariance=covariance, n=len(points), inflation=1.0, inliers=None)
    return inflated(made, points)


def without_breaks(chain: Chain, walls: Sequence[SurfaceFit], before: Sequence[SurfaceFit]) -> Chain | None:
    """The closed chain of walls as they are fitted, neighbours on one line or circle as one piece.

    `before` are the walls that its pieces are measured along. Those with too few points are left out; None
    where these are half of its length or more: what is there is not swept, as the cones of countersinks
    between a hole and the face over it.
    """
    pieces, forward, corners = list(chain.pieces), list(chain.is_forward), list(chain.corners)
    for k, piece in enumerate(pieces):
        surface, old = walls[piece.wall].surface, before[piece.wall].surface
        if surface.kind != old.kind:
            ends = np.stack([place_at(old, along) for along in (piece.low, piece.high)])
            low, high = along_wall(surface, ends).tolist()
            forward[k] = forward[k] == (high > low)
            pieces[k] = replace(piece, low=min(low, high), high=max(low, high))
    length = np.array([piece.high - piece.low for piece in pieces])
    if 2 * length @ [walls[piece.wall].n == 0 for piece in pieces] >= length.sum():
        return None
    for k in reversed(range(len(pieces))):
        if walls[pieces[k].wall].n == 0 and not chain.on_axis:
            corners[k - 1] = (corners[k - 1] + corners[k]) / 2
            del pieces[k], forward[k], corners[k]
    if len(pieces) == 1 and not chain.on_axis:
        surface = walls[pieces[0].wall].surface
        return Chain.circle(pieces[0].wall, surface) if isinstance(surface, Cylinder) else None
    k = 0
    while len(pieces) > 2 and k < len(corners):
        one, two = pieces[k], pieces[(k + 1) % len(pieces)]
        if one.wall != two.wall and not _are_one(walls[one.wall], walls[two.wall]):
            k += 1
            continue
        if k == len(pieces) - 1:  # so that both stand side by side
            pieces, forward, corners = (
                [*pieces[1:], pieces[0]],
                [*forward[1:], forward[0]],
                [*corners[1:], corners[0]],
            )
            k -= 1
        pieces[k], forward[k] = _joined(one, two, forward[k], forward[k + 1])
        del pieces[k + 1], forward[k + 1], corners[k]
        k = 0
    if len(pieces) == 2 and not chain.on_axis:
        chord = float(np.linalg.norm(corners[0] - corners[1]))
        if (arc := _arc_of_chord(pieces, walls, chord)) is not None:
            return Chain.circle(arc, walls[arc].surface)
    return replace(chain, pieces=tuple(pieces), is_forward=tuple(forward), corners=tuple(corners))


def _arc_of_chord(pieces: Sequence[Piece], walls: Sequence[SurfaceFit], chord_m: float) -> int | None:
    """The wall of an arc that a line closes which noise hides from its circle; None of other pieces."""
    for arc, line in (pieces, pieces[::-1]):
        circle = walls[arc.wall].surface
        if isinstance(circle, Cylinder) and isinstance(walls[line.wall].surface, Plane):
            sag = chord_m**2 / (8 * circle.radius)
            return arc.wall if sag <= limits.CUT * walls[arc.wall].rms else None
    return None


def _joined(one: Piece, two: Piece, one_forward: bool, two_forward: bool) -> tuple[Piece, bool]:
    """Two pieces that follow one another as one, on the longer's wall, and whether it is passed forward."""
    is_first = one.high - one.low >= two.high - two.low
    main, other, forward = (one, two, one_forward) if is_first else (two, one, two_forward)
    length, at_high = other.high - other.low, forward == is_first  # where the other lies
    low, high = main.low - (0.0 if at_high else length), main.high + (length if at_high else 0.0)
    return replace(main, low=low, high=high), forward


def _are_one(wall: SurfaceFit, other: SurfaceFit) -> bool:
    """Whether two walls are one, as far as their points tell."""
    if wall.surface.kind != other.surface.kind:
        return False
    estimate = JointEstimate([wall, other], None, np.zeros(3))
    kinds: tuple[RelationKind, ...] = (
        ("coplanar",) if isinstance(wall.surface, Plane) else ("coaxial", "equal_radius")
    )
    tests = [wald_test(Relation(kind=each, surfaces=(0, 1)), estimate) for each in kinds]
    return all(test.p >= limits.LEAST_P for test in tests)
