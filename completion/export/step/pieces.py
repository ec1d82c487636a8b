# SPDX-License-Identifier: MIT
"""Pieces of fold curves between corners, and the choice of those that bound the regions.

Each piece has the share of its length along which the two regions touch. Chosen are those that together
have most of it, while the boundary of every region comes back to itself: at a corner a region has an even
number of pieces. This is an integer program; where a region has to stay open, that costs.

Corners: where fold curves of one surface meet.
Curves on one surface cross well even where the other two surfaces only touch, as a fillet's end does.

Loops: pieces in order around each region, with the region on their left.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.optimize import Bounds, LinearConstraint, milp
from scipy.sparse import coo_array
from scipy.spatial import cKDTree
from shapely import Point, Polygon

from completion.export.step import limits
from completion.export.step.folds import ContactCurve
from scenes.checks import FloatArray, IntArray
from scenes.surfaces.catalogue import Plane, Surface

_N_STEPS = 25


@dataclass(slots=True, eq=False)
class CurveCorner:
    """A point (3,), millimetres, where curves meet: their parameters by place, how far they are off it.

    Or where one ends that meets none (`is_free`).
    """

    point: FloatArray
    at: dict[int, list[float]] = field(default_factory=dict)
    off: float = 0.0
    is_free: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class _Crossing:
    curves: tuple[int, int]
    point: FloatArray
    gap: float
    is_steep: bool

    @property
    def rank(self) -> tuple[bool, float]:
        """The better known first: curves that cross, before those that run side by side and touch."""
        return not self.is_steep, round(self.gap, 9)


def corners_of(curves: Sequence[ContactCurve], spacing: float) -> list[CurveCorner]:
    """Return the corners of curves, millimetres."""
    crossings = [
        crossing
        for a in range(len(curves))
        for b in range(a + 1, len(curves))
        if set(curves[a].pair) & set(curves[b].pair) and _may_meet(curves[a], curves[b], spacing)
        for crossing in _crossings(a, b, curves, spacing)
    ]
    corners = list[CurveCorner]()
    for group in _groups(crossings, limits.CORNER_REACH * spacing):
        best = min(group, key=lambda crossing: crossing.rank)
        candidates = [crossing for crossing in group if crossing.is_steep == best.is_steep]
        exact = [crossing.point for crossing in candidates if crossing.gap <= max(1e-7, 1.5 * best.gap)]
        near = [point for point in exact if np.linalg.norm(point - best.point) < 1e-3 * spacing]
        corner = CurveCorner(np.mean(near, axis=0))
        for place in sorted({curve for crossing in group for curve in crossing.curves}):
            t, off = curves[place].feet(corner.point[None])
            corner.at[place] = [float(t[0])]
            corner.off = max(corner.off, float(off[0]))
        corners.append(corner)
    return corners


def _may_meet(fold: ContactCurve, two: ContactCurve, spacing: float) -> bool:
    low = np.maximum(fold.points.min(axis=0), two.points.min(axis=0))
    high = np.minimum(fold.points.max(axis=0), two.points.max(axis=0))
    return bool((low <= high + spacing).all())


def _crossings(a: int, b: int, curves: Sequence[ContactCurve], spacing: float) -> Iterator[_Crossing]:
    """Where two curves are nearest to each other, and near enough."""
    fold, two = curves[a], curves[b]
    apart, nearest = two.tree.query(fold.points)
    if (apart < limits.COINCIDENT_REACH * spacing + 1e-9).sum() > max(5, 0.1 * len(apart)):
        return  # one curve twice, between faces of one surface
    step = np.linalg.norm(np.diff(fold.points, axis=0), axis=1).max(initial=0.0)
    other = np.linalg.norm(np.diff(two.points, axis=0), axis=1).max(initial=0.0)
    reach = step + other + limits.SAME_REACH * spacing
    before, after = np.roll(apart, 1), np.roll(apart, -1)
    if not fold.is_closed:
        before[0] = after[-1] = np.inf
    least = np.flatnonzero((apart <= before) & (apart <= after) & (apart <= reach))
    for place in least:
        t, s, gap = _nearest(fold, two, float(fold.t[place]), float(two.t[nearest[place]]))
        if gap <= limits.SAME_REACH * spacing:
            point = (fold.at(np.array([t]))[0] + two.at(np.array([s]))[0]) / 2
            if np.linalg.norm(point - fold.points[place]) <= 2 * reach:
                yield _Crossing((a, b), point, gap, _sine(fold, t, two, s) > limits.STEEP)


def _nearest(fold: ContactCurve, two: ContactCurve, t: float, s: float) -> tuple[float, float, float]:
    """Parameters at which two curves are nearest, from near ones on, and the distance there."""
    for _ in range(_N_STEPS):
        p, u = fold.slope(t)
        q, v = two.slope(s)
        matrix = np.column_stack([u, -v])
        change = np.linalg.lstsq(matrix, q - p, rcond=1e-6)[0]
        t, s = _clamp_parameter(fold, t + float(change[0])), _clamp_parameter(two, s + float(change[1]))
        if np.abs(matrix @ change).max() < 1e-12 and np.linalg.norm(u) * abs(change[0]) < 1e-10:
            break
    return t, s, float(np.linalg.norm(fold.slope(t)[0] - two.slope(s)[0]))


def _sine(fold: ContactCurve, t: float, two: ContactCurve, s: float) -> float:
    """Sine of the angle between two curves at parameters."""
    u, v = fold.slope(t)[1], two.slope(s)[1]
    return float(np.linalg.norm(np.cross(u, v)) / max(float(np.linalg.norm(u) * np.linalg.norm(v)), 1e-300))


def _clamp_parameter(curve: ContactCurve, t: float) -> float:
    return curve.wrap(t) if curve.is_closed else min(max(t, curve.low), curve.high)


def _groups(crossings: Sequence[_Crossing], near: float) -> list[list[_Crossing]]:
    """Crossings that are one corner: the exact ones first, each with those near it, as near as their gaps."""
    order = sorted(range(len(crossings)), key=lambda k: (*crossings[k].rank, k))
    heads, gaps, groups = list[FloatArray](), list[float](), list[list[_Crossing]]()
    for k in order:
        crossing = crossings[k]
        if heads:
            apart = np.linalg.norm(np.array(heads) - crossing.point, axis=1)
            best = int(apart.argmin())
            if apart[best] <= max(near, crossing.gap + gaps[best]):
                groups[best].append(crossing)
                continue
        heads.append(crossing.point)
        gaps.append(crossing.gap)
        groups.append([crossing])
    return groups


@dataclass(frozen=True, slots=True, eq=False)
class CurvePiece:
    """A piece of a fold curve: range, corners (-2: a whole closed curve), support, and length (mm)."""

    curve: int
    low: float
    high: float
    ends: tuple[int, int]
    support: float
    length: float

    @property
    def is_loop(self) -> bool:
        """Whether it is a whole closed curve without a corner."""
        return self.ends == (-2, -2)


def pieces_of(
    curves: Sequence[ContactCurve],
    corners: list[CurveCorner],
    contacts: FloatArray,
    between: IntArray,
    step: float,
) -> list[CurvePiece]:
    """Return all pieces of the curves between their corners, and beyond the last ones as far as measured.

    `contacts` (m, 3) are where regions `between` (m, 2) touch, `step` their sampling distance; mm. Free ends
    are added to `corners`.
    """
    fixed = tuple(corners)
    pieces = list[CurvePiece]()
    for place, curve in enumerate(curves):
        members = contacts[(between == curve.pair).all(axis=1)]
        asked = _CurveSplitter(curve, place, cKDTree(members), step, corners)
        at = sorted((t, k) for k, corner in enumerate(fixed) for t in corner.at.get(place, ()))
        if not at:
            pieces += (
                [asked.whole()]
                if curve.is_closed
                else asked.trim_to_contacts(curve.low, curve.high, (-1, -1))
            )
            continue
        pieces += [asked.piece(t, s, (k, m)) for (t, k), (s, m) in pairwise(at)]
        if curve.is_closed:
            (t, k), (s, m) = at[-1], at[0]
            pieces.append(asked.piece(t, s + curve.high - curve.low, (k, m)))
        else:
            pieces += asked.trim_to_contacts(curve.low, at[0][0], (-1, at[0][1]))
            pieces += asked.trim_to_contacts(at[-1][0], curve.high, (at[-1][1], -1))
    return [piece for piece in pieces if piece.length > 1e-6]


@dataclass(frozen=True, slots=True, eq=False)
class _CurveSplitter:
    curve: ContactCurve
    place: int
    contacts: cKDTree
    step: float
    corners: list[CurveCorner]

    def _samples(self, low: float, high: float) -> tuple[FloatArray, FloatArray, float]:
        """Parameters (n,) between, whether they touch (n,), and the length."""
        coarse = self.curve.at(np.linspace(low, high, 33))
        length = float(np.linalg.norm(np.diff(coarse, axis=0), axis=1).sum())
        n = int(np.clip(np.ceil(length / (limits.SAME_REACH * self.step)), 5, 2000))
        t = low + (np.arange(n) + 0.5) / n * (high - low)
        return t, self.contacts.query(self.curve.at(t))[0] <= self.curve.reach * self.step, length

    def piece(self, low: float, high: float, ends: tuple[int, int]) -> CurvePiece:
        """The piece of a range."""
        _, touches, length = self._samples(low, high)
        return CurvePiece(self.place, low, high, ends, support=float(touches.mean()), length=length)

    def whole(self) -> CurvePiece:
        """All of a closed curve."""
        return self.piece(self.curve.low, self.curve.high, (-2, -2))

    def trim_to_contacts(self, low: float, high: float, ends: tuple[int, int]) -> list[CurvePiece]:
        """The piece of a range, its free ends where contacts end; none where it is a stub."""
        if high - low <= 0:
            return []
        t, touches, _ = self._samples(low, high)
        if not touches.any():
            return []
        on = np.flatnonzero(touches)
        inset = self.step * (1 + self.curve.reach - limits.TOUCH_REACH)  # of the last contacts, about
        inset /= max(float(np.linalg.norm(self.curve.slope(low)[1])), 1e-12)
        first = low if ends[0] >= 0 else min(float(t[on[0]]) + inset, float(t[on[-1]]))
        last = high if ends[1] >= 0 else max(float(t[on[-1]]) - inset, first)
        if last <= first:
            return []
        piece = self.piece(first, last, ends)
        if piece.length < limits.STUB * self.step or piece.support <= 0.5:
            return []
        known = tuple(
            corner if corner >= 0 else self._free(t) for corner, t in zip(ends, (first, last), strict=True)
        )
        return [replace(piece, ends=(known[0], known[1]))]

    def _free(self, t: float) -> int:
        """A new corner at a free end."""
        self.corners.append(CurveCorner(self.curve.at(np.array([t]))[0], {self.place: [t]}, is_free=True))
        return len(self.corners) - 1


def choose_pieces(
    pieces: Sequence[CurvePiece], curves: Sequence[ContactCurve], corners: Sequence[CurveCorner], step: float
) -> list[CurvePiece]:
    """Return the pieces that bound regions."""
    if not pieces:
        return []
    n = len(pieces)
    rows = dict[tuple[int, int], int]()
    entries = list[tuple[int, int, float]]()
    for column, piece in enumerate(pieces):
        for corner in piece.ends:
            for region in curves[piece.curve].pair if corner >= 0 and not corners[corner].is_free else ():
                row = rows.setdefault((region, corner), len(rows))
                entries.append((row, column, 1.0))
    m = len(rows)
    entries += [(row, n + row, -2.0) for row in range(m)] + [(row, n + m + row, -1.0) for row in range(m)]
    worth = np.array([(1 - 2 * piece.support) * piece.length / step + 1e-3 for piece in pieces])
    cost = np.concatenate([worth, np.zeros(m), np.full(m, limits.OPEN_COST)])
    upper = np.concatenate([np.ones(n), np.full(m, 20.0), np.ones(m)])
    constraints = []
    if m:
        places = np.array([entry[:2] for entry in entries]).T
        matrix = coo_array(([entry[2] for entry in entries], tuple(places)), shape=(m, n + 2 * m)).tocsr()
        constraints = [LinearConstraint(matrix, 0, 0)]
    solution = milp(cost, integrality=np.ones(n + 2 * m), bounds=Bounds(0, upper), constraints=constraints)
    taken = solution.x is not None
    is_chosen = (
        np.round(solution.x[:n]).astype(bool) if taken else np.array([p.support > 0.5 for p in pieces])
    )
    kept = [piece for piece, is_kept in zip(pieces, is_chosen, strict=True) if is_kept]
    return _through(kept, curves)


def _through(pieces: list[CurvePiece], curves: Sequence[ContactCurve]) -> list[CurvePiece]:
    """Pieces with those made one that follow each other at a corner where nothing else meets."""
    at = dict[int, list[int]]()
    alive: dict[int, CurvePiece] = dict(enumerate(pieces))
    for place, piece in alive.items():
        for corner in piece.ends:
            if corner >= 0:
                at.setdefault(corner, []).append(place)
    for corner, places in at.items():
        if len(places) != 2:
            continue
        a, b = places
        piece, two = alive[a], alive[b]
        if piece.curve != two.curve:
            continue
        period = curves[piece.curve].high - curves[piece.curve].low
        if a == b:
            alive[a] = replace(piece, ends=(-2, -2))
            continue
        if piece.ends[1] != corner:
            piece, two = two, piece
        if piece.ends[1] != corner or two.ends[0] != corner:
            continue
        turns = round((piece.high - two.low) / period) if curves[piece.curve].is_closed else 0
        length = piece.length + two.length
        support = (piece.support * piece.length + two.support * two.length) / length
        ends = (piece.ends[0], two.ends[1])
        alive[a] = CurvePiece(
            piece.curve, piece.low, two.high + turns * period, ends, support=support, length=length
        )
        del alive[b]
        for others in at.values():
            others[:] = [a if place == b else place for place in others]
    return list(alive.values())


_N_SAMPLES = 24  # of a piece, for telling the side


class LoopSide(NamedTuple):
    """A piece in a loop: its place, and whether it runs as its curve does."""

    piece: int
    is_forward: bool


class RegionLoops(NamedTuple):
    """The closed loops of a region, and the pieces of its boundary that do not close."""

    closed: list[list[LoopSide]]
    open_chains: list[list[LoopSide]]


def loops_of(
    region: int,
    pieces: Sequence[CurvePiece],
    curves: Sequence[ContactCurve],
    surface: Surface,
    near: RegionPoints,
) -> RegionLoops:
    """Return the loops of a region, each with the region's points on its left, seen against the normal."""
    numbers = [k for k, piece in enumerate(pieces) if region in curves[piece.curve].pair]
    left = {k: near.leftness(pieces[k], curves[pieces[k].curve], surface) for k in numbers}
    closed = [[LoopSide(k, left[k] >= 0)] for k in numbers if pieces[k].is_loop]
    open_chains = list[list[LoopSide]]()
    unused = {k for k in numbers if not pieces[k].is_loop}
    ends = {k: pieces[k].ends for k in unused}
    at = dict[int, list[int]]()
    for k in sorted(unused):
        for corner in ends[k]:
            if corner >= 0:
                at.setdefault(corner, []).append(k)
    odd = [k for corner, numbers in sorted(at.items()) if len(numbers) % 2 for k in numbers[:1]]
    for start in (*odd, *sorted(unused)):
        if start not in unused:
            continue
        chain = _chain(start, ends, at, unused, left)
        is_closed = _begin(chain[0], ends) == _end(chain[-1], ends) >= 0
        weight = sum(left[side.piece] * (1 if side.is_forward else -1) for side in chain)
        if weight < 0:
            chain = [LoopSide(side.piece, not side.is_forward) for side in reversed(chain)]
        (closed if is_closed else open_chains).append(chain)
    return RegionLoops(closed, open_chains)


def _begin(side: LoopSide, ends: dict[int, tuple[int, int]]) -> int:
    return ends[side.piece][0 if side.is_forward else 1]


def _end(side: LoopSide, ends: dict[int, tuple[int, int]]) -> int:
    return ends[side.piece][1 if side.is_forward else 0]


def _chain(
    start: int,
    ends: dict[int, tuple[int, int]],
    at: dict[int, list[int]],
    unused: set[int],
    left: dict[int, float],
) -> list[LoopSide]:
    """Pieces that follow each other from one on, until they come back or end."""
    forward = left[start] >= 0
    if len(at[ends[start][0]]) % 2:
        forward = True
    elif len(at[ends[start][1]]) % 2:
        forward = False
    chain = [LoopSide(start, forward)]
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
        chain.append(LoopSide(best, ends[best][0] == here))
        unused.discard(best)


def loop_points(
    loop: Sequence[LoopSide], pieces: Sequence[CurvePiece], curves: Sequence[ContactCurve], n: int = 48
) -> FloatArray:
    """Points (k, 3) along a loop, in order, n of each piece."""
    parts = list[FloatArray]()
    for side in loop:
        piece = pieces[side.piece]
        t = np.linspace(piece.low, piece.high, n, endpoint=False)
        parts.append(curves[piece.curve].at(t if side.is_forward else piece.high + piece.low - t))
    return np.concatenate(parts)


class RegionPoints:
    """The points of a region, by which it is told on which side of a piece it lies."""

    def __init__(self, points: FloatArray, spacing: float) -> None:
        self.points, self.spacing = points, spacing
        self.tree = cKDTree(points)

    def leftness(self, piece: CurvePiece, curve: ContactCurve, surface: Surface) -> float:
        """Positive where the points are on the left of a piece, seen against the surface's normal; in mm."""
        t = piece.low + (np.arange(_N_SAMPLES) + 0.5) / _N_SAMPLES * (piece.high - piece.low)
        value, weight = 0.0, piece.length / _N_SAMPLES
        for t_at in t:
            place, along = curve.slope(float(t_at))
            leftward = np.cross(surface.normal(place[None])[0], along / np.linalg.norm(along))
            near = self.tree.query_ball_point(place, limits.CONTACT_REACH * self.spacing)
            if near:
                side = np.clip((self.points[near] - place) @ leftward / self.spacing, -1, 1)
                value += weight * float(side.mean())
        return value


_N_RING_SAMPLES = 24  # of a piece


def nest_loops(
    surface: Surface,
    loops: Sequence[list[LoopSide]],
    pieces: Sequence[CurvePiece],
    curves: Sequence[ContactCurve],
    points: FloatArray,
) -> list[list[list[LoopSide]]]:
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
    faces = list[list[list[LoopSide]]]()
    for n, around in enumerate(inside):
        if len(around) % 2:
            continue
        holes = [k for k, others in enumerate(inside) if n in others and len(others) == len(around) + 1]
        face = shapes[n]
        for k in holes:
            face = face.difference(shapes[k])
        if not any(face.contains(Point(uv_at)) for uv_at in uv[:: max(1, len(uv) // 2000)]):
            continue
        faces.append(
            [_orient_loop(loops[n], areas[n] < 0), *(_orient_loop(loops[k], areas[k] > 0) for k in holes)]
        )
    return faces


def _orient_loop(loop: list[LoopSide], is_wrong: bool) -> list[LoopSide]:
    return [LoopSide(side.piece, not side.is_forward) for side in reversed(loop)] if is_wrong else loop


def _area(ring: FloatArray) -> float:
    x, y = ring.T
    return float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum()) / 2
