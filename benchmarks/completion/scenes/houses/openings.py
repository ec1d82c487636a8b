# SPDX-License-Identifier: MIT
"""Openings: doors, passages, arches, windows, skylights and niches, many and small, placed on walls."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely

from benchmarks.completion.scenes.houses.plan import Plan, Room, Side, Wall
from scenes.checks import FloatArray

_APART_M = 0.16  # between openings of a wall, and from corners
_BELOW_CEILING_M = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class Opening:
    """A hole in a wall, or a niche in one of its faces.

    Attributes
    ----------
    wall : int
        Its wall.
    outline : (n, 2) float
        Along the wall and height, metres; counter-clockwise, convex.
    kind : str
        door, entrance, passage, arch, window, glazed door or niche.
    sign : int
        The face from which it is furnished: a door opens to there, a niche is open to there.
    depth : float
        Of a niche, metres; of others the thickness of the wall.
    """

    wall: int
    outline: FloatArray
    kind: str
    sign: int
    depth: float

    @property
    def span(self) -> tuple[float, float]:
        """Where along the wall it begins and ends, metres."""
        return float(self.outline[:, 0].min()), float(self.outline[:, 0].max())

    @property
    def rise(self) -> tuple[float, float]:
        """Its lower and upper end, metres."""
        return float(self.outline[:, 1].min()), float(self.outline[:, 1].max())

    @property
    def is_way(self) -> bool:
        """Whether people go through it."""
        return self.kind in ("door", "entrance", "passage", "arch", "glazed door")


@dataclass(frozen=True, slots=True, eq=False)
class Shaft:
    """A hole in the ceiling of a room: a skylight, open above, or the well of stairs, closed above.

    `outline` is its plan, `depth` how far it goes up from the lowest point of its rim, metres.
    """

    room: int
    outline: shapely.Polygon
    depth: float
    is_closed: bool


def random_openings(plan: Plan, rng: np.random.Generator) -> tuple[Opening, ...]:
    """Return the openings of a plan: ways to all rooms, windows in outer walls, niches."""
    found = _ways(plan, rng)
    found += _entrance(plan, found, rng)
    small = rng.random() < 0.4
    for room in plan.rooms:
        for side in room.sides:
            wall = plan.walls[side.wall]
            if wall.is_outer:
                style = _style(rng, small=small)
                for _ in range(int(rng.poisson((side.end - side.start) / (1.5 if small else 2.4)))):
                    style = style if rng.random() < 0.8 else _style(rng, small=small)
                    found += _window(wall, room, side, found, rng, style)
            if wall.thickness > 0.19:
                for _ in range(int(rng.poisson(0.45))):
                    found += _niche(wall, room, side, found, rng)
    return tuple(found)


def random_skylights(plan: Plan, rng: np.random.Generator) -> tuple[Shaft, ...]:
    """Return skylights in sloping ceilings."""
    found = []
    for number, room in enumerate(plan.rooms):
        for slope in room.ceilings[1:]:
            if rng.random() < 0.6:
                found += _skylight(number, room, slope, rng)
    return tuple(found)


def _ways(plan: Plan, rng: np.random.Generator) -> list[Opening]:
    """Openings between rooms: enough that all are joined, and now and then one more."""
    group = list(range(len(plan.rooms)))
    pairs = [
        (a, b, one, other)
        for a, first in enumerate(plan.rooms)
        for b, second in enumerate(plan.rooms)
        if a != b
        for one in first.sides
        for other in second.sides
        if one.wall == other.wall and one.sign == 1 and other.sign == -1
    ]
    found: list[Opening] = []
    for k in rng.permutation(len(pairs)):
        a, b, one, other = pairs[int(k)]
        if group[a] == group[b] and rng.random() < 0.75:
            continue
        made = _way(plan, (a, b), (one, other), found, rng)
        if made:
            found += made
            group = [group[a] if own == group[b] else own for own in group]
    return found


def _way(
    plan: Plan,
    rooms: tuple[int, int],
    sides: tuple[Side, Side],
    taken: list[Opening],
    rng: np.random.Generator,
) -> list[Opening]:
    wall = plan.walls[sides[0].wall]
    low, high = max(side.start for side in sides), min(side.end for side in sides)
    kind = str(rng.choice(["door", "passage", "arch"], p=[0.6, 0.22, 0.18]))
    if {"bath", "storage"} & {plan.rooms[k].kind for k in rooms}:
        kind = "door"
    for _ in range(10):
        width = rng.uniform(0.65, 0.95) if kind == "door" else rng.uniform(0.8, 2.2)
        top = rng.uniform(1.95, 2.1) if kind == "door" else rng.uniform(2.0, 2.5)
        span = _free_span(low, high, width, sides[0].wall, taken, rng)
        if span is not None and all(
            _fits(plan.rooms[k], wall, side, span, top) for k, side in zip(rooms, sides, strict=True)
        ):
            outline = _arched(span, 0.0, top, rng) if kind == "arch" else _rectangle(span, 0.0, top)
            return [Opening(sides[0].wall, outline, kind, int(rng.choice([1, -1])), wall.thickness)]
        kind = "door"
    return []


def _entrance(plan: Plan, taken: list[Opening], rng: np.random.Generator) -> list[Opening]:
    """The door to the flat, closed, in an outer wall of any room."""
    for k in rng.permutation(len(plan.rooms)):
        room = plan.rooms[int(k)]
        for j in rng.permutation(len(room.sides)):
            side = room.sides[int(j)]
            wall, width, top = plan.walls[side.wall], rng.uniform(0.8, 1.0), rng.uniform(1.98, 2.1)
            if wall.is_outer:
                span = _free_span(side.start, side.end, width, side.wall, taken, rng)
                if span is not None and _fits(room, wall, side, span, top):
                    return [
                        Opening(side.wall, _rectangle(span, 0.0, top), "entrance", side.sign, wall.thickness)
                    ]
    return []


def _style(rng: np.random.Generator, *, small: bool) -> tuple[float, float, float]:
    """Width, lower and upper end of windows that are alike, metres; a glazed door begins at 0."""
    if rng.random() < 0.12:
        return rng.uniform(0.7, 1.8), 0.0, rng.uniform(2.0, 2.3)
    low = rng.uniform(0.7, 1.6) if small else rng.uniform(0.3, 1.1)
    return (
        rng.uniform(0.3, 0.8) if small else rng.uniform(0.5, 2.4),
        low,
        low + rng.uniform(0.4, 1.0) if small else rng.uniform(1.9, 2.4),
    )


def _window(
    wall: Wall,
    room: Room,
    side: Side,
    taken: list[Opening],
    rng: np.random.Generator,
    style: tuple[float, float, float],
) -> list[Opening]:
    width, low, top = style
    span = _free_span(side.start, side.end, width, side.wall, taken, rng)
    if span is None:
        return []
    ends = wall.place(np.array(span), np.zeros(2), side.sign * wall.thickness / 2)[:, :2]
    kind = "glazed door" if low == 0 else "window"
    top = min(float(room.height(ends).min()) - _BELOW_CEILING_M, top)
    low = min(low, top - 0.35)
    if low < 0 or (kind == "glazed door" and top < 1.9):
        return []
    return [Opening(side.wall, _rectangle(span, low, top), kind, side.sign, wall.thickness)]


def _niche(
    wall: Wall, room: Room, side: Side, taken: list[Opening], rng: np.random.Generator
) -> list[Opening]:
    """A recess with a back, on the floor or above it, with a flat or a round top."""
    on_floor = rng.random() < 0.3
    width = rng.uniform(0.5, 1.2) if on_floor else rng.uniform(0.2, 0.8)
    low = 0.0 if on_floor else rng.uniform(0.5, 1.4)
    top = rng.uniform(1.6, 2.1) if on_floor else low + rng.uniform(0.25, 0.9)
    span = _free_span(side.start, side.end, width, side.wall, taken, rng)
    if span is None or not _fits(room, wall, side, span, top):
        return []
    outline = _arched(span, low, top, rng) if rng.random() < 0.3 else _rectangle(span, low, top)
    return [Opening(side.wall, outline, "niche", side.sign, rng.uniform(0.08, wall.thickness - 0.06))]


def _skylight(number: int, room: Room, slope: FloatArray, rng: np.random.Generator) -> list[Shaft]:
    """A hole in the slope, upright to one side of it, that keeps away from the room's edge."""
    x, y = rng.uniform(0.3, 0.6), rng.uniform(0.4, 0.8)
    for _ in range(20):
        inner = room.floor.buffer(-0.75)
        if inner.is_empty:
            return []
        low, high = np.array(inner.bounds).reshape(2, 2)
        at, turn = rng.uniform(low, high), np.arctan2(slope[1], slope[0])
        ring = np.array([[-y, -x], [y, -x], [y, x], [-y, x]]) / 1.4
        ring = at + ring @ np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
        outline = shapely.Polygon(ring)
        own = ring @ slope[:2] + slope[2]
        if room.floor.buffer(-0.1).contains(outline) and np.allclose(room.height(ring), own, atol=1e-9):
            return [Shaft(number, outline, 0.3 + float(np.ptp(own)), is_closed=False)]
    return []


def _free_span(
    low: float, high: float, width: float, wall: int, taken: list[Opening], rng: np.random.Generator
) -> tuple[float, float] | None:
    if high - low < width + 2 * _APART_M:
        return None
    for _ in range(6):
        start = rng.uniform(low + _APART_M, high - _APART_M - width)
        others = [one.span for one in taken if one.wall == wall]
        if all(start > b + _APART_M or start + width < a - _APART_M for a, b in others):
            return start, start + width
    return None


def _fits(room: Room, wall: Wall, side: Side, span: tuple[float, float], top: float) -> bool:
    """Tell whether an opening up to `top` lies on the side and below its ceiling."""
    if span[0] < side.start or span[1] > side.end:
        return False
    ends = wall.place(np.array(span), np.zeros(2), side.sign * wall.thickness / 2)[:, :2]
    return bool(room.height(ends).min() > top + _BELOW_CEILING_M)


def _rectangle(span: tuple[float, float], low: float, top: float) -> FloatArray:
    return np.array([[span[0], low], [span[1], low], [span[1], top], [span[0], top]])


def _arched(span: tuple[float, float], low: float, top: float, rng: np.random.Generator) -> FloatArray:
    """An opening with a round head, from a flat arc to half a circle."""
    half = (span[1] - span[0]) / 2
    rise = min(half * rng.uniform(0.25, 1.0), (top - low) * 0.6)
    turn = np.linspace(0, np.pi, 17)
    arc = np.column_stack([(span[0] + half) + half * np.cos(turn), top - rise + rise * np.sin(turn)])
    return np.array([[span[0], low], [span[1], low], *arc])
