# SPDX-License-Identifier: MIT
"""Chains: pieces of walls, which are lines and arcs, in the order in which their ends meet."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, pairwise
from typing import NamedTuple

import numpy as np

from completion.parts.profiles import limits
from scenes.checks import FloatArray, Value
from scenes.surfaces.catalogue import Cylinder, Plane, Surface

AXIS = -1
"""Number of the axis of a revolution among walls."""
_PARALLEL = 0.02  # sine of an angle between lines, below which they have no corner
_CONCENTRIC = 1e-3  # of the lesser radius
_LEAST_POINTS = 4
_Y_0 = Plane((0, 0, 0), (0, 1, 0), (-1, 0, 0))
_End = tuple[int, bool]  # of a piece, by its place: whether its high one


@dataclass(frozen=True, slots=True, eq=False)
class Segment(Value):
    """A line or an arc of a profile.

    Attributes
    ----------
    wall : int
        Place of its line or circle among the profile's walls; -1 for the axis of a revolution.
    start, end : (2,) float
        In the profile, metres; equal where it is a whole circle.
    middle : (2,) float
        On it, halfway.
    centre : (2,) float, optional
        Of an arc.
    radius : float
        Metres; 0 of a line.
    """

    wall: int
    start: FloatArray
    end: FloatArray
    middle: FloatArray
    centre: FloatArray | None = None
    radius: float = 0.0

    @classmethod
    def line(cls, wall: int, start: FloatArray, end: FloatArray) -> Segment:
        """A line between two places (2,), metres."""
        return cls(wall, start, end, (start + end) / 2)

    @property
    def is_whole(self) -> bool:
        """Whether it is a circle."""
        return self.centre is not None and bool((self.start == self.end).all())

    @property
    def sweep_rad(self) -> float:
        """Angle from start to end about the centre, anticlockwise positive; of a line 0."""
        if self.centre is None or self.is_whole:
            return 0.0 if self.centre is None else float(2 * np.pi)
        first, half, last = (np.arctan2(*(place - self.centre)[::-1])
                             for place in (self.start, self.middle, self.end))  # fmt: skip
        to_half, to_last = (half - first) % (2 * np.pi), (last - first) % (2 * np.pi)
        return float(to_last if to_half <= to_last else to_last - 2 * np.pi)

    @property
    def length(self) -> float:
        """Metres."""
        return abs(self.sweep_rad) * self.radius or float(np.linalg.norm(self.end - self.start))

    def places(self, n: int = 24) -> FloatArray:
        """Places (n, 2) from start to end."""
        share = np.linspace(0, 1, n)[:, None]
        if self.centre is None:
            return np.asarray(self.start + share * (self.end - self.start))
        away, turn = self.start - self.centre, self.sweep_rad * share
        return np.asarray(self.centre + np.cos(turn) * away + np.sin(turn) * [-away[1], away[0]])

    def reverse(self) -> Segment:
        """The same, from end to start."""
        return replace(self, start=self.end, end=self.start)


@dataclass(frozen=True, slots=True, eq=False)
class Piece:
    """Part of a wall without a gap: from `low` to `high` along its chart, metres; a whole circle or not."""

    wall: int
    low: float
    high: float
    is_whole: bool = False

    def segment(
        self, surface: Surface, start: FloatArray | None = None, end: FloatArray | None = None
    ) -> Segment:
        """The piece from its own ends, or from corners (2,) of it."""
        first = place_at(surface, self.low) if start is None else start
        last = first if self.is_whole else place_at(surface, self.high) if end is None else end
        if not isinstance(surface, Cylinder):
            return Segment.line(self.wall, first, last)
        middle = place_at(surface, (self.low + self.high) / 2)
        return Segment(self.wall, first, last, middle, surface.point[:2].copy(), radius=surface.radius)


def place_at(surface: Surface, along: float) -> FloatArray:
    """Place (2,) of a wall at a coordinate of its chart, metres."""
    return np.asarray(surface.from_uv(np.array([[along, 0.0]]))[0, :2])


def along_wall(surface: Surface, places: FloatArray) -> FloatArray:
    """Coordinates (n,) along a wall's chart of places (n, 2 or 3), metres."""
    return np.asarray(surface.to_uv(np.column_stack([places[:, :2], np.zeros(len(places))]))[:, 0])


def pieces_of(surface: Surface, wall: int, places: FloatArray, gap_m: float) -> Iterator[Piece]:
    """Pieces of a wall by its points (n, 2): where these are farther apart than a gap, it ends."""
    if len(places) < _LEAST_POINTS:
        return
    along = np.sort(along_wall(surface, places))
    step = np.diff(along)
    cut = np.flatnonzero(step > gap_m) + 1
    if isinstance(surface, Cylinder):
        around = along[0] + surface.period - along[-1]
        if not len(cut) and around <= max(gap_m, float(np.max(step, initial=0.0))):
            yield Piece(wall, 0.0, surface.period, True)
            return
        if around <= gap_m:  # it goes on over the chart's seam
            along = np.concatenate([along[cut[0] :], along[: cut[0]] + surface.period])
            cut = np.flatnonzero(np.diff(along) > gap_m) + 1
    for part in np.split(along, cut):
        if len(part) >= _LEAST_POINTS:
            yield Piece(wall, float(part[0]), float(part[-1]))


def corner_of(
    first: Surface, second: Surface, near: FloatArray, *, touching: bool = False
) -> FloatArray | None:
    """Where two walls meet nearest to a place (2,); None where they do not.

    Those that touch, or miss one another, meet between where they are nearest.
    """
    line, circle = (first, second) if isinstance(first, Plane) else (second, first)
    if not isinstance(circle, Cylinder):
        normals = np.stack([first.normal_direction[:2], second.normal_direction[:2]])  # type: ignore[attr-defined]  # planes
        if abs(float(np.linalg.det(normals))) < _PARALLEL:
            return None
        points = [first.point[:2], second.point[:2]]  # type: ignore[attr-defined]  # planes
        return np.linalg.solve(normals, np.einsum("ij,ij->i", normals, points))
    step = line.point[:2] - circle.point[:2]  # type: ignore[attr-defined]  # plane or cylinder
    if isinstance(line, Cylinder):  # the chord of both
        apart, reach = float(np.linalg.norm(step)), circle.radius
        if apart <= _CONCENTRIC * min(line.radius, reach):
            return None
        normal = step / apart
        above = float(np.clip((apart**2 + reach**2 - line.radius**2) / (2 * apart), -reach, reach))
    else:
        normal = line.normal_direction[:2]  # type: ignore[attr-defined]  # a plane
        above = float(normal @ step)
    foot, half_square = circle.point[:2] + above * normal, circle.radius**2 - above**2
    if touching or half_square <= 0:
        return np.asarray(foot)
    half = np.sqrt(half_square) * np.array([-normal[1], normal[0]])
    return np.asarray(min(foot - half, foot + half, key=lambda place: float(np.linalg.norm(place - near))))


def turn_between(first: Surface, second: Surface, place: FloatArray) -> float:
    """Angle between two walls at their corner (2,), radians, 0 where they touch."""
    normals = [each.normal_direction[:2] if isinstance(each, Plane) else place - each.point[:2]  # type: ignore[attr-defined]  # a cylinder
               for each in (first, second)]  # fmt: skip
    (a, b), (c, d) = normals
    return float(np.arctan2(abs(a * d - b * c), abs(a * c + b * d)))


def fuzz_m(first: Surface, second: Surface, place: FloatArray, noise_m: float) -> float:
    """How far along walls noise hides where they touch at a corner (2,), metres; 0 where they cross."""
    radius = min(float(getattr(surface, "radius", np.inf)) for surface in (first, second))
    if not np.isfinite(radius) or turn_between(first, second, place) > limits.SMOOTH:
        return 0.0
    return limits.FUZZ * float(np.sqrt(noise_m * radius))


@dataclass(frozen=True, slots=True, eq=False)
class Chain:
    """Pieces one after the other.

    Attributes
    ----------
    pieces : tuple of Piece
        In their order.
    is_forward : tuple of bool
        Which are passed from low to high.
    corners : tuple of (2,) float
        Between each and the next; of a chain that is closed in itself the last meets the first.
    is_closed : bool
        Whether it is closed in itself, or by the axis.
    on_axis : bool
        Whether the axis closes it.
    """

    pieces: tuple[Piece, ...]
    is_forward: tuple[bool, ...]
    corners: tuple[FloatArray, ...]
    is_closed: bool
    on_axis: bool = False

    @classmethod
    def circle(cls, wall: int, surface: Surface) -> Chain:
        """A whole circle."""
        return cls((Piece(wall, 0.0, surface.period, True),), (True,), (), True)

    @property
    def walls(self) -> tuple[int, ...]:
        """The wall of each piece."""
        return tuple(piece.wall for piece in self.pieces)

    @property
    def is_ring(self) -> bool:
        """Whether the last piece meets the first."""
        return self.is_closed and not self.on_axis

    @property
    def neighbours(self) -> Iterator[tuple[int, int]]:
        """Walls that meet."""
        walls = self.walls
        yield from pairwise([*walls, walls[0]] if self.is_ring and len(walls) > 1 else walls)

    def renumber(self, among: Mapping[int, int]) -> Chain:
        """The chain with its walls by other numbers."""
        return replace(self, pieces=tuple(replace(piece, wall=among[piece.wall]) for piece in self.pieces))

    def trace(
        self, surfaces: Sequence[Surface], touching: Collection[frozenset[int]] = ()
    ) -> tuple[Segment, ...]:
        """Segments on surfaces as they are now; pairs of walls that touch are `touching`."""
        if self.pieces[0].is_whole:
            return (self.pieces[0].segment(surfaces[self.pieces[0].wall]),)
        between: list[FloatArray | None] = []
        size = [piece.high - piece.low for piece in self.pieces]
        for k, (near, pair) in enumerate(zip(self.corners, self.neighbours, strict=True)):
            one, two = (surfaces[wall] for wall in pair)
            place = corner_of(one, two, near, touching=frozenset(pair) in touching)
            reach = max(size[k], size[(k + 1) % len(size)])  # lines that turn little meet far off
            is_far = place is None or float(np.linalg.norm(place - near)) > reach
            between.append(near if place is None or is_far else place)
        between = between if self.is_ring else [*between, None]
        segments = []
        for k, (piece, forward) in enumerate(zip(self.pieces, self.is_forward, strict=True)):
            ends = between[k - 1], between[k]
            segment = piece.segment(surfaces[piece.wall], *(ends if forward else ends[::-1]))
            segments.append(segment if forward else segment.reverse())
        if not self.on_axis:
            return tuple(segments)
        first, last = segments[0], segments[-1]
        if (place := corner_of(surfaces[first.wall], _Y_0, first.start)) is not None:
            segments[0] = replace(first, start=place)
        if (place := corner_of(surfaces[last.wall], _Y_0, last.end)) is not None:
            segments[-1] = replace(segments[-1], end=place)
        return (*segments, Segment.line(AXIS, segments[-1].end, segments[0].start))


class _Meeting(NamedTuple):
    """Two ends that may meet at a place (2,), how far off the farther one is, metres."""

    off_m: float
    one: _End
    two: _End
    place: FloatArray


def chains_of(
    pieces: Sequence[Piece], surfaces: Sequence[Surface], spacing_m: float, noise_m: float,
    *, axis: bool = False,
) -> list[Chain]:  # fmt: skip
    """Return the chains that pieces of walls make, whole circles first.

    Ends join where both lie near the corner of their walls; the nearest first. `axis`: whether y = 0 is an
    axis, at which chains may end.
    """
    ends = {(number, is_high): place_at(surfaces[piece.wall], piece.high if is_high else piece.low)
            for number, piece in enumerate(pieces) if not piece.is_whole
            for is_high in (False, True)}  # fmt: skip
    at_axis = {end for end, place in ends.items() if axis and place[1] <= limits.REACH * spacing_m}
    partner: dict[_End, tuple[_End, FloatArray]] = {}
    for reach in (limits.REACH, limits.WIDE_REACH):
        free = {end: at for end, at in ends.items() if end not in partner and end not in at_axis}
        for meeting in _meetings(free, pieces, surfaces, reach * spacing_m, noise_m=noise_m):
            if meeting.one not in partner and meeting.two not in partner:
                partner[meeting.one] = meeting.two, meeting.place
                partner[meeting.two] = meeting.one, meeting.place
    whole = [Chain((piece,), (True,), (), True) for piece in pieces if piece.is_whole]
    return whole + list(_followed(pieces, partner, at_axis))


def _meetings(
    ends: Mapping[_End, FloatArray], pieces: Sequence[Piece], surfaces: Sequence[Surface], reach_m: float,
    *, noise_m: float,
) -> list[_Meeting]:  # fmt: skip
    """Pairs of ends that may meet, those nearest to their corner first."""
    found = []
    for one, two in combinations(ends, 2):
        first, second = (pieces[end[0]].wall for end in (one, two))
        walls = surfaces[first], surfaces[second]
        place = None if first == second else corner_of(*walls, (ends[one] + ends[two]) / 2)
        if place is not None:
            off = max(float(np.linalg.norm(place - ends[end])) for end in (one, two))
            if off <= reach_m + fuzz_m(*walls, place, noise_m):
                found.append(_Meeting(off, one, two, place))
    return sorted(found, key=lambda meeting: meeting[:3])


def _followed(
    pieces: Sequence[Piece], partner: Mapping[_End, tuple[_End, FloatArray]], at_axis: Collection[_End]
) -> Iterator[Chain]:
    """Chains from end to end, open ones from their first end."""
    todo = [(number, side) for number, piece in enumerate(pieces) if not piece.is_whole
            for side in (False, True)]  # fmt: skip
    done: set[int] = set()
    for begin in sorted(todo, key=lambda end: end in partner):
        if begin[0] in done:
            continue
        order, corners, here = [begin], list[FloatArray](), begin
        while (there := (here[0], not here[1])) in partner:
            here, place = partner[there]
            corners.append(place)
            if here == begin:
                break
            order.append(here)
        done |= {number for number, _ in order}
        on_axis = there not in partner and begin in at_axis and there in at_axis
        yield Chain(
            tuple(pieces[number] for number, _ in order), tuple(not is_high for _, is_high in order),
            tuple(corners), on_axis or there in partner, on_axis,
        )  # fmt: skip
