# SPDX-License-Identifier: MIT
"""Chains: pieces of walls in the order in which their ends meet, closed where the last meets the first."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, pairwise
from typing import NamedTuple

import numpy as np

from completion.parts.profiles import limits
from completion.parts.profiles.segment import Piece, Segment, corner_of, fuzz_m, place_at
from scenes.checks import FloatArray
from scenes.surfaces.catalogue import Surface

AXIS = -1
"""Number of the axis of a revolution among walls."""


class End(NamedTuple):
    """An end of a piece: which piece, whether it is its high end, and where (2,) it is."""

    piece: int
    is_high: bool
    place: FloatArray


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

    @property
    def walls(self) -> tuple[int, ...]:
        """The wall of each piece."""
        return tuple(piece.wall for piece in self.pieces)

    @property
    def neighbours(self) -> Iterator[tuple[int, int]]:
        """Walls that meet."""
        walls = self.walls
        yield from pairwise(walls)
        if self.is_closed and not self.on_axis and len(walls) > 1:
            yield walls[-1], walls[0]

    def renumber(self, among: Mapping[int, int]) -> Chain:
        """The chain with its walls by other numbers."""
        return replace(self, pieces=tuple(replace(piece, wall=among[piece.wall]) for piece in self.pieces))

    def trace(
        self, surfaces: Sequence[Surface], touching: Collection[frozenset[int]] = ()
    ) -> tuple[Segment, ...]:
        """Segments on surfaces as they are now; pairs of walls that touch are `touching`."""
        if self.pieces[0].is_whole:
            return (self.pieces[0].segment(surfaces[self.pieces[0].wall]),)
        n, ring = len(self.pieces), self.is_closed and not self.on_axis
        between: list[FloatArray | None] = []
        for k, near in enumerate(self.corners):
            pair = self.walls[k], self.walls[(k + 1) % n]
            place = corner_of(surfaces[pair[0]], surfaces[pair[1]], near, touching=frozenset(pair) in touching)
            between.append(near if place is None else place)
        before = [between[-1] if ring else None, *between[: n - 1]]
        after = [*between[: n - 1], between[-1] if ring else None]
        segments = []
        for piece, forward, first, last in zip(self.pieces, self.is_forward, before, after, strict=True):
            ends = (first, last) if forward else (last, first)
            segment = piece.segment(surfaces[piece.wall], *ends)
            segments.append(segment if forward else segment.reverse())
        if self.on_axis:
            segments = _closed_by_axis(segments)
        return tuple(segments)


def _closed_by_axis(segments: list[Segment]) -> list[Segment]:
    """Segments from the axis to the axis, y = 0, and that along it."""
    first, last = segments[0], segments[-1]
    ends = [first.start * [1.0, 0.0], last.end * [1.0, 0.0]]
    if first.centre is None and last.centre is None:
        segments[0] = Segment(first.wall, ends[0], first.end, (ends[0] + first.end) / 2)
        last = segments[-1]
        segments[-1] = Segment(last.wall, last.start, ends[1], (last.start + ends[1]) / 2)
    ends = [segments[0].start, segments[-1].end]
    return [*segments, Segment(AXIS, ends[1], ends[0], (ends[0] + ends[1]) / 2)]


def chains_of(
    pieces: Sequence[Piece],
    surfaces: Sequence[Surface],
    spacing_m: float,
    noise_m: float,
    *,
    axis: bool = False,
) -> list[Chain]:
    """Return the chains that pieces of walls make, the longest first.

    Ends join where both lie near the corner of their walls; the nearest first. `axis`: whether y = 0 is an
    axis, at which chains may end.
    """
    chains = [Chain((piece,), (True,), (), True) for piece in pieces if piece.is_whole]
    ends = [
        End(number, is_high, place_at(surfaces[piece.wall], piece.high if is_high else piece.low))
        for number, piece in enumerate(pieces) if not piece.is_whole for is_high in (False, True)
    ]  # fmt: skip
    partner: dict[tuple[int, bool], tuple[int, bool]] = {}
    corner: dict[tuple[int, bool], FloatArray] = {}
    at_axis = {end[:2] for end in ends if axis and end.place[1] <= limits.REACH * spacing_m}
    for reach in (limits.REACH, limits.WIDE_REACH):
        free = [end for end in ends if end[:2] not in partner and end[:2] not in at_axis]
        for _, one, two, place in _meetings(free, pieces, surfaces, reach * spacing_m, noise_m):
            if one[:2] not in partner and two[:2] not in partner:
                partner[one[:2]], partner[two[:2]] = two[:2], one[:2]
                corner[one[:2]] = corner[two[:2]] = place
    return chains + list(_followed(pieces, partner, corner, at_axis))


def _meetings(
    ends: Sequence[End], pieces: Sequence[Piece], surfaces: Sequence[Surface], reach_m: float, noise_m: float
) -> list[tuple[float, End, End, FloatArray]]:
    """Pairs of ends that may meet, and the corner (2,) where, those nearest to it first."""
    found = []
    for one, two in combinations(ends, 2):
        first, second = pieces[one.piece].wall, pieces[two.piece].wall
        if first == second or (one.piece == two.piece):
            continue
        walls = surfaces[first], surfaces[second]
        place = corner_of(*walls, (one.place + two.place) / 2)
        if place is None:
            continue
        off = max(float(np.linalg.norm(place - end.place)) for end in (one, two))
        if off <= reach_m + fuzz_m(*walls, place, noise_m):
            found.append((off, one, two, place))
    return sorted(found, key=lambda meeting: (meeting[0], meeting[1][:2], meeting[2][:2]))


def _followed(
    pieces: Sequence[Piece],
    partner: dict[tuple[int, bool], tuple[int, bool]],
    corner: dict[tuple[int, bool], FloatArray],
    at_axis: Collection[tuple[int, bool]],
) -> Iterator[Chain]:
    """Chains from end to end, open ones from their first end."""
    todo = [number for number, piece in enumerate(pieces) if not piece.is_whole]
    loose = [(number, side) for number in todo for side in (False, True) if (number, side) not in partner]
    done: set[int] = set()
    for begin in [*loose, *((number, False) for number in todo)]:
        if begin[0] in done:
            continue
        order, forward, corners = list[Piece](), list[bool](), list[FloatArray]()
        here, is_closed = begin, False
        while True:
            done.add(here[0])
            order.append(pieces[here[0]])
            forward.append(not here[1])
            there = (here[0], not here[1])
            if there not in partner:
                break
            corners.append(corner[there])
            here = partner[there]
            if here == begin:
                is_closed = True
                break
        on_axis = not is_closed and begin in at_axis and there in at_axis
        yield Chain(tuple(order), tuple(forward), tuple(corners), is_closed or on_axis, on_axis)
