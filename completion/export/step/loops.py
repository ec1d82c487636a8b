# SPDX-License-Identifier: MIT
"""Loops: pieces in order around each region, with the region on their left."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree
from shapely import Point, Polygon

from completion.export.step.folds import FoldCurve
from completion.export.step.pieces import Piece
from scenes.checks import FloatArray
from scenes.surfaces.catalogue import Plane, Surface

_N_SAMPLES = 24  # of a piece, for telling the side
_ASIDE = 3.0  # sampling distances within which points tell it


class Side(NamedTuple):
    """A piece in a loop: its place, and whether it runs as its curve does."""

    piece: int
    is_forward: bool


class RegionLoops(NamedTuple):
    """The closed loops of a region, and the pieces of its boundary that do not close."""

    closed: list[list[Side]]
    rest: list[list[Side]]


def loops_of(
    region: int, pieces: Sequence[Piece], curves: Sequence[FoldCurve], surface: Surface, near: Nearby
) -> RegionLoops:
    """Return the loops of a region, each with the region's points on its left, seen against the normal."""
    own = [k for k, one in enumerate(pieces) if region in curves[one.curve].pair]
    left = {k: near.leftness(pieces[k], curves[pieces[k].curve], surface) for k in own}
    closed = [[Side(k, left[k] >= 0)] for k in own if pieces[k].is_loop]
    rest = list[list[Side]]()
    unused = {k for k in own if not pieces[k].is_loop}
    ends = {k: pieces[k].ends for k in unused}
    at = dict[int, list[int]]()
    for k in sorted(unused):
        for corner in ends[k]:
            if corner >= 0:
                at.setdefault(corner, []).append(k)
    odd = [k for corner, some in sorted(at.items()) if len(some) % 2 for k in some[:1]]
    for start in (*odd, *sorted(unused)):
        if start not in unused:
            continue
        chain = _chain(start, ends, at, unused, left)
        is_closed = _begin(chain[0], ends) == _end(chain[-1], ends) >= 0
        weight = sum(left[one.piece] * (1 if one.is_forward else -1) for one in chain)
        if weight < 0:
            chain = [Side(one.piece, not one.is_forward) for one in reversed(chain)]
        (closed if is_closed else rest).append(chain)
    return RegionLoops(closed, rest)


def _begin(one: Side, ends: dict[int, tuple[int, int]]) -> int:
    return ends[one.piece][0 if one.is_forward else 1]


def _end(one: Side, ends: dict[int, tuple[int, int]]) -> int:
    return ends[one.piece][1 if one.is_forward else 0]


def _chain(
    start: int,
    ends: dict[int, tuple[int, int]],
    at: dict[int, list[int]],
    unused: set[int],
    left: dict[int, float],
) -> list[Side]:
    """Pieces that follow each other from one on, until they come back or end."""
    forward = left[start] >= 0
    if len(at[ends[start][0]]) % 2:
        forward = True
    elif len(at[ends[start][1]]) % 2:
        forward = False
    chain = [Side(start, forward)]
    unused.discard(start)
    origin = _begin(chain[0], ends)
    while True:
        here = _end(chain[-1], ends)
        if here < 0 or here == origin:
            return chain
        options = [k for k in at[here] if k in unused]
        if not options:
            return chain
        sense = 1 if (left[chain[-1].piece] >= 0) == chain[-1].is_forward else -1
        best = max(options, key=lambda k: sense * left[k] * (1 if ends[k][0] == here else -1))
        chain.append(Side(best, ends[best][0] == here))
        unused.discard(best)


def loop_points(
    loop: Sequence[Side], pieces: Sequence[Piece], curves: Sequence[FoldCurve], n: int = 48
) -> FloatArray:
    """Points (k, 3) along a loop, in order, n of each piece."""
    parts = list[FloatArray]()
    for side in loop:
        one = pieces[side.piece]
        t = np.linspace(one.low, one.high, n, endpoint=False)
        parts.append(curves[one.curve].at(t if side.is_forward else one.high + one.low - t))
    return np.concatenate(parts)


class Nearby:
    """The points of a region, by which it is told on which side of a piece it lies."""

    def __init__(self, points: FloatArray, spacing: float) -> None:
        self.points, self.spacing = points, spacing
        self.tree = cKDTree(points)

    def leftness(self, piece: Piece, curve: FoldCurve, surface: Surface) -> float:
        """Positive where the points are on the left of a piece, seen against the surface's normal; in mm."""
        t = piece.low + (np.arange(_N_SAMPLES) + 0.5) / _N_SAMPLES * (piece.high - piece.low)
        told, weight = 0.0, piece.length / _N_SAMPLES
        for one in t:
            place, along = curve.slope(float(one))
            leftward = np.cross(surface.normal(place[None])[0], along / np.linalg.norm(along))
            near = self.tree.query_ball_point(place, _ASIDE * self.spacing)
            if near:
                side = np.clip((self.points[near] - place) @ leftward / self.spacing, -1, 1)
                told += weight * float(side.mean())
        return told


_N_RING_SAMPLES = 24  # of a piece


def nested(
    surface: Surface,
    loops: Sequence[list[Side]],
    pieces: Sequence[Piece],
    curves: Sequence[FoldCurve],
    points: FloatArray,
) -> list[list[list[Side]]]:
    """Return the loops (outer first) of each face of a region; on surfaces that are no planes it is one.

    On a plane a loop bounds from outside or from inside by how many others it lies in, whatever the region's
    points (n, 3) say of its side; a face without any of these is none.
    """
    if not isinstance(surface, Plane) or not loops:
        return [list(loops)] if loops else []
    rings = [surface.to_uv(loop_points(loop, pieces, curves, _N_RING_SAMPLES)) for loop in loops]
    areas = [_area(ring) for ring in rings]
    shapes = [Polygon(ring).buffer(0) for ring in rings]
    inside = [
        [k for k in range(len(loops)) if k != n and shapes[k].contains(Point(rings[n][0]))]
        for n in range(len(loops))
    ]
    uv = surface.to_uv(points)
    faces = list[list[list[Side]]]()
    for n, around in enumerate(inside):
        if len(around) % 2:
            continue
        holes = [k for k, others in enumerate(inside) if n in others and len(others) == len(around) + 1]
        face = shapes[n]
        for k in holes:
            face = face.difference(shapes[k])
        if not any(face.contains(Point(one)) for one in uv[:: max(1, len(uv) // 2000)]):
            continue
        faces.append([_turned(loops[n], areas[n] < 0), *(_turned(loops[k], areas[k] > 0) for k in holes)])
    return faces


def _turned(loop: list[Side], is_wrong: bool) -> list[Side]:
    return [Side(one.piece, not one.is_forward) for one in reversed(loop)] if is_wrong else loop


def _area(ring: FloatArray) -> float:
    x, y = ring.T
    return float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum()) / 2
