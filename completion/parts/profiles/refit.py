# SPDX-License-Identifier: MIT
"""Refit: walls fitted anew in their profile, to the points between their corners.

Where a line and an arc touch, a point's face is told by its noise, so that faces bend towards one another.
In the profile its place along the chain tells.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from completion.fitting.result import SurfaceFit, inflated
from completion.parts.profiles import limits
from completion.parts.profiles.chain import Chain
from completion.parts.profiles.segment import Piece, fuzz_m, place_at
from completion.relations.equations import move_surface
from completion.relations.estimate import JointEstimate, wald_test
from completion.relations.relation import Relation, RelationKind
from scenes.checks import FloatArray, InputError
from scenes.surfaces.catalogue import Cylinder, Plane, Surface

_ROUNDS = 3
_LEAST_POINTS = 12


def refitted(
    walls: Sequence[SurfaceFit], chains: Sequence[Chain], places: FloatArray, noise_m: float
) -> list[SurfaceFit]:
    """Return walls (k,) fitted to the places (n, 3) of points on them that lie between their corners.

    A wall with too few of these, as of a model's mesh, stays as it is; its `n` is 0 if it never was fitted.
    """
    surfaces = [wall.surface for wall in walls]
    spans: list[list[tuple[float, float, float, float]]] = [[] for _ in walls]
    for chain in chains:
        for k, (piece, forward) in enumerate(zip(chain.pieces, chain.is_forward, strict=True)):
            surface = surfaces[piece.wall]
            before, after = _corners(chain, k)
            low, high = (before, after) if forward else (after, before)
            middle = (piece.low + piece.high) / 2
            ends = [
                own if beside is None else middle + _away(surface, beside[1], middle)
                for own, beside in ((piece.low, low), (piece.high, high))
            ]
            guards = [0.0 if piece.is_whole else limits.GUARD * noise_m if beside is None else max(
                limits.GUARD * noise_m, fuzz_m(surface, surfaces[beside[0]], beside[1], noise_m) / 2)
                for beside in (low, high)]  # fmt: skip
            if walls[piece.wall].n == 0 and sum(guards) > (ends[1] - ends[0]) / 2:
                guards = [0.0, 0.0]
            spans[piece.wall].append(
                (middle, ends[0] + guards[0], ends[1] - guards[1], float(piece.is_whole))
            )
    return [_refit(wall, places, span, noise_m) for wall, span in zip(walls, spans, strict=True)]


def _corners(chain: Chain, k: int) -> list[tuple[int, FloatArray] | None]:
    """The walls before and after a piece, and the corners (2,) with them; None at a loose end."""
    n, ring = len(chain.pieces), chain.is_closed and not chain.on_axis
    found: list[tuple[int, FloatArray] | None] = []
    for other, corner in ((k - 1, k - 1), (k + 1, k)):
        is_there = len(chain.corners) > 0 and (ring or 0 <= other < n)
        found.append((chain.walls[other % n], chain.corners[corner % n]) if is_there else None)
    return found


def _along(surface: Surface, places: FloatArray) -> FloatArray:
    """Coordinates (n,) along a wall of places (n, 2 or 3), metres."""
    flat = np.column_stack([places[:, :2], np.zeros(len(places))])
    return np.asarray(surface.to_uv(flat)[:, 0])


def _away(surface: Surface, place: FloatArray, middle: float) -> float:
    """How far along a wall a place (2,) is from a coordinate, the shorter way round."""
    return float(_wrapped(_along(surface, place[None]) - middle, surface)[0])


def _wrapped(away: FloatArray, surface: Surface) -> FloatArray:
    period = surface.period
    return np.asarray(away - period * np.rint(away / period)) if np.isfinite(period) else away


def _refit(
    wall: SurfaceFit, places: FloatArray, spans: Sequence[tuple[float, float, float, float]], noise_m: float
) -> SurfaceFit:
    """A wall fitted to the places within its spans, near it; each a middle, low, high, and whether whole."""
    free = np.flatnonzero(np.diag(wall.covariance) > 0)
    surface = wall.surface
    along = _along(surface, places)
    inside = np.zeros(len(places), np.bool_)
    for middle, low, high, is_whole in spans:
        away = _wrapped(along - middle, surface)
        inside |= (away > low - middle) & (away < high - middle) | bool(is_whole)
    inside &= np.abs(surface.distance(places)) <= limits.CUT * noise_m
    if np.count_nonzero(inside) < _LEAST_POINTS * len(free):
        return wall
    points = places[inside]
    fit = _fitted(wall, points, noise_m)
    if wall.n == 0 and fit is not None and isinstance(wall.surface, Cylinder):  # may it be straight?
        middle, ways = points[:, :2].mean(axis=0), np.linalg.eigh(np.cov(points[:, :2].T))[1]
        (x, y), normal = ways[:, 1], ways[:, 0]
        line = unfitted(Plane(np.append(middle, 0.0), np.append(normal, 0.0), (x, y, 0.0)))
        other = _fitted(line, points, noise_m)
        if other is not None:
            squares = [np.square(each.surface.distance(points)).sum() / noise_m**2 for each in (fit, other)]
            if squares[1] - squares[0] <= limits.NATS * np.log(len(points)):
                fit = other
    return wall if fit is None else fit


def unfitted(surface: Surface) -> SurfaceFit:
    """A wall that is not fitted yet (`n` = 0): its covariance says which of its parameters are free."""
    free = [1.0, 1.0, 0.0] if isinstance(surface, Plane) else [1.0, 1.0, 0.0, 0.0, 1.0]
    return SurfaceFit(surface, 0.0, np.diag(free), 0)


def _fitted(wall: SurfaceFit, points: FloatArray, noise_m: float) -> SurfaceFit | None:
    """A wall's free parameters by least squares; None where no surface is left."""
    free, fit = np.flatnonzero(np.diag(wall.covariance) > 0), wall
    for _ in range(_ROUNDS):
        slope, height = fit.gradient(points)[:, free], fit.surface.distance(points)
        sign = -1.0 if getattr(fit.surface, "concave", False) else 1.0
        change = np.zeros(len(wall.covariance))
        change[free] = -np.linalg.lstsq(slope, sign * height, rcond=None)[0]
        try:
            fit = replace(fit, surface=move_surface(fit.surface, change))
        except InputError:
            return None
    slope, height = fit.gradient(points)[:, free], fit.surface.distance(points)
    rms = float(np.sqrt(height @ height / max(len(points) - len(free), 1)))
    covariance = np.zeros_like(wall.covariance)
    covariance[np.ix_(free, free)] = max(rms, noise_m) ** 2 * np.linalg.pinv(slope.T @ slope)
    return inflated(
        replace(fit, rms=rms, covariance=covariance, n=len(points), inflation=1.0, inliers=None), points
    )


def without_breaks(chain: Chain, walls: Sequence[SurfaceFit], before: Sequence[SurfaceFit]) -> Chain:
    """The closed chain of walls as they are fitted, neighbours on one line or circle as one piece.

    `before` are the walls that its pieces are measured along.
    """
    n, pieces = len(chain.pieces), list[Piece]()
    for piece in chain.pieces:
        ends = [place_at(before[piece.wall].surface, along) for along in (piece.low, piece.high)]
        surface = walls[piece.wall].surface
        if surface.kind == before[piece.wall].surface.kind:
            pieces.append(piece)
            continue
        low, high = _along(surface, np.stack(ends)).tolist()
        pieces.append(replace(piece, low=low, high=high))
    forward = [old == (piece.high > piece.low) for old, piece in zip(chain.is_forward, pieces, strict=True)]
    pieces = [
        replace(piece, low=min(piece.low, piece.high), high=max(piece.low, piece.high)) for piece in pieces
    ]
    corners = list(chain.corners)
    for k in reversed(range(len(pieces))):  # too few points between its corners: none
        if walls[pieces[k].wall].n == 0 and len(pieces) > 1 and not chain.on_axis:
            corners[k - 1] = (corners[k - 1] + corners[k]) / 2
            del pieces[k], forward[k], corners[k]
    if len(pieces) == 1 and isinstance(walls[pieces[0].wall].surface, Cylinder):
        whole = Piece(pieces[0].wall, 0.0, walls[pieces[0].wall].surface.period, True)
        return replace(chain, pieces=(whole,), is_forward=(True,), corners=())
    k = 0
    while len(pieces) > 2 and k < len(corners):
        n = len(pieces)
        one, two = pieces[k], pieces[(k + 1) % n]
        if one.wall != two.wall and not _are_one(walls[one.wall], walls[two.wall]):
            k += 1
            continue
        if k == n - 1:  # so that both stand side by side
            pieces, forward, corners = ([*each[1:], each[0]] for each in (pieces, forward, corners))
            k -= 1
        pieces[k], forward[k] = _joined(one, two, forward[k], forward[k + 1])
        del pieces[k + 1], forward[k + 1], corners[k]
        k = 0
    return replace(chain, pieces=tuple(pieces), is_forward=tuple(forward), corners=tuple(corners))


def _joined(one: Piece, two: Piece, one_forward: bool, two_forward: bool) -> tuple[Piece, bool]:
    """Two pieces that follow one another as one, on the longer's wall, and whether it is passed forward."""
    is_first = one.high - one.low >= two.high - two.low
    main, other = (one, two) if is_first else (two, one)
    forward = one_forward if is_first else two_forward
    length = other.high - other.low
    at_high = forward == is_first  # where the other lies
    return replace(
        main, low=main.low - (0.0 if at_high else length), high=main.high + (length if at_high else 0.0)
    ), forward


def _are_one(wall: SurfaceFit, other: SurfaceFit) -> bool:
    """Whether two walls are one, as far as their points tell."""
    if wall.surface.kind != other.surface.kind:
        return False
    kind: RelationKind = "coplanar" if isinstance(wall.surface, Plane) else "coaxial"
    estimate = JointEstimate([wall, other], None, np.zeros(3))
    kinds: tuple[RelationKind, ...] = (kind,) if kind == "coplanar" else (kind, "equal_radius")
    tests = [wald_test(Relation(kind=each, surfaces=(0, 1)), estimate) for each in kinds]
    return all(test.p >= limits.LEAST_P for test in tests)
