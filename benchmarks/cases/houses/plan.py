# SPDX-License-Identifier: MIT
"""Plan of a flat by seed: rooms, walls, openings."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from benchmarks.cases.houses.solids import motion
from scenes.checks import FloatArray

NARROWEST_M, WIDEST_M = 1.8, 8.0
_TRIES = 60
_FAR_M = 100.0


@dataclass(frozen=True, slots=True, eq=False)
class Wall:
    """A wall as a line with a thickness.

    `point`, `along` (2,) float: a place in its middle plane, metres, and the unit vector along it.
    """

    point: FloatArray
    along: FloatArray
    thickness: float  # metres
    is_outer: bool  # whether the flat ends there

    @property
    def normal(self) -> FloatArray:
        """Unit vector (2,) to the left of `along`."""
        return np.array([-self.along[1], self.along[0]])

    def place(self, s: FloatArray, z: FloatArray, offset: float) -> FloatArray:
        """Return world places (n, 3) at `s` along the wall and height `z`, `offset` left of its middle."""
        flat = self.point + np.outer(s, self.along) + offset * self.normal
        return np.column_stack([flat, z])


@dataclass(frozen=True, slots=True)
class Side:
    """A side of a room: the face of a wall, left of it (`sign` 1) or right (-1), from `start` to `end`."""

    wall: int
    sign: int
    start: float
    end: float


@dataclass(frozen=True, slots=True, eq=False)
class Room:
    """A convex room."""

    corners: FloatArray  # (n, 2) float: Its floor, counter-clockwise, metres
    sides: tuple[Side, ...]  # side k goes from corner k to the next
    ceilings: FloatArray  # (m, 3) float: Planes z = a x + b y + c; the lowest counts
    kind: str  # what it is used for

    @property
    def floor(self) -> shapely.Polygon:
        """Its floor."""
        return shapely.Polygon(self.corners)

    def below(self, height: float) -> BaseGeometry:
        """Where the ceiling is at least so high, metres."""
        level = np.array([0.0, 0.0, height])
        return shapely.intersection_all([self.floor, *(where_below(level, one) for one in self.ceilings)])

    def height(self, places: FloatArray) -> FloatArray:
        """Height (n,) of the ceiling above places (n, 2), metres."""
        return np.asarray((places @ self.ceilings[:, :2].T + self.ceilings[:, 2]).min(axis=1))


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """Walls, and the rooms between them."""

    walls: tuple[Wall, ...]
    rooms: tuple[Room, ...]


def side_frame(wall: Wall, sign: int, s: float, z: float = 0.0) -> FloatArray:
    """Return the (4, 4) of a place on a face: x along the face, y away from it into the room, z up."""
    out = sign * wall.normal
    at = wall.place(np.array([s]), np.array([z]), sign * wall.thickness / 2)[0]
    return motion(tuple(at), yaw=float(np.arctan2(out[1], out[0]) - np.pi / 2))


def where_below(plane: FloatArray, other: FloatArray) -> shapely.Polygon:
    """Return a large square, less the part of it where a plane z = a x + b y + c is above another."""
    gap = plane - other
    size = float(np.linalg.norm(gap[:2]))
    if size < 1e-9:
        return shapely.box(-99, -99, 99, 99) if gap[2] <= 0 else shapely.Polygon()
    way = gap[:2] / size
    edge = -gap[2] / size * way
    aside = np.array([-way[1], way[0]])
    return shapely.Polygon(
        [edge + 99 * aside, edge - 99 * aside, edge - 99 * aside - 199 * way, edge + 99 * aside - 199 * way]
    )


Faces = list[tuple[int, int]]  # wall and sign


def random_plan(rng: np.random.Generator) -> Plan:
    """Return a plan of one to four rooms, each 1.8 to 8 m wide and 2.2 to 3.5 m high."""
    for _ in range(_TRIES):
        found = _plan(rng)
        if found is not None:
            return found
    raise AssertionError("no plan after many tries")  # the tries are many: a fault of the generator


def _plan(rng: np.random.Generator) -> Plan | None:
    n_rooms = int(rng.choice([1, 2, 3, 4], p=[0.2, 0.25, 0.3, 0.25]))
    area = float(np.sum(np.clip(rng.lognormal(np.log(9.5), 0.55, n_rooms), 4.0, 36)))
    ratio = rng.uniform(1.0, 1.7)
    size = np.array([np.sqrt(area * ratio), np.sqrt(area / ratio)]) + 0.3
    walls = _outline(size, rng)
    cells: list[Faces] = [[(k, 1) for k in range(len(walls))]]
    while len(cells) < n_rooms:
        largest = max(range(len(cells)), key=lambda k: _floor(walls, cells[k])[0].area)
        parts = _cut(walls, cells[largest], rng)
        if parts is None:
            return None
        cells[largest : largest + 1] = parts
    floors = [_floor(walls, cell) for cell in cells]
    if not all(_is_usable(floor) for floor, _ in floors):
        return None
    return Plan(tuple(walls), _rooms(walls, floors, rng))


def _outline(size: FloatArray, rng: np.random.Generator) -> list[Wall]:
    """Outer walls, counter-clockwise about the flat; some are skew, now and then a corner is cut off."""
    yaw, thickness = rng.uniform(0, 2 * np.pi), rng.uniform(0.2, 0.4)
    angles = yaw + np.pi / 2 * np.arange(4)
    reach = np.array([size[1], size[0], size[1], size[0]]) / 2
    if rng.random() < 0.2:
        angles, reach = np.append(angles, yaw + np.pi / 4), np.append(reach, size.sum() * 0.31)
    skew = np.where(rng.random(len(angles)) < 0.3, rng.normal(0, np.radians(4), len(angles)), 0)
    walls = []
    for angle, away in zip(angles + np.clip(skew, -0.17, 0.17), reach, strict=True):
        along = np.array([np.cos(angle), np.sin(angle)])
        inward = np.array([-along[1], along[0]])
        walls.append(Wall(-(away + thickness / 2) * inward, along, thickness, True))
    return walls


def _floor(walls: list[Wall], faces: Faces, inset: float = 0.5) -> tuple[shapely.Polygon, list[int]]:
    """Return the convex area between walls, and for each of its sides the number of its face."""
    ring = _FAR_M * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1.0]])
    label = [-1] * 4
    for number, (wall, sign) in enumerate(faces):
        one = walls[wall]
        away = sign * (ring - one.point) @ one.normal - inset * one.thickness
        corners: list[FloatArray] = []
        names: list[int] = []
        for k in range(len(ring)):
            after = (k + 1) % len(ring)
            if away[k] >= 0:
                corners.append(ring[k])
                names.append(label[k])
            if (away[k] >= 0) != (away[after] >= 0):
                share = away[k] / (away[k] - away[after])
                corners.append(ring[k] + share * (ring[after] - ring[k]))
                names.append(number if away[k] >= 0 else label[k])
        if len(corners) < 3:
            return shapely.Polygon(), []
        ring, label = np.array(corners), names
    return shapely.Polygon(ring), label


def _is_usable(floor: shapely.Polygon) -> bool:
    if floor.is_empty:
        return False
    ring = np.asarray(floor.minimum_rotated_rectangle.exterior.coords)
    sides = np.linalg.norm(np.diff(ring, axis=0), axis=1)[:2]
    short = np.linalg.norm(np.diff(np.asarray(floor.exterior.coords), axis=0), axis=1).min()
    return bool(sides.min() >= NARROWEST_M and sides.max() <= WIDEST_M and short > 0.25)


def _cut(walls: list[Wall], cell: Faces, rng: np.random.Generator) -> list[Faces] | None:
    """Cut a cell across its longer direction by a new wall; None where that leaves too little."""
    ring = np.asarray(_floor(walls, cell)[0].minimum_rotated_rectangle.exterior.coords)
    edges = np.diff(ring, axis=0)[:2]
    longer = int(np.argmax(np.linalg.norm(edges, axis=1)))
    span, across = edges[longer], edges[1 - longer]
    for _ in range(12):
        skew = rng.uniform(-1, 1) * np.radians(10) if rng.random() < 0.35 else 0.0
        thickness = rng.uniform(0.08, 0.25) if rng.random() < 0.8 else rng.uniform(0.25, 0.4)
        along = across / np.linalg.norm(across)
        turn = np.array([[np.cos(skew), -np.sin(skew)], [np.sin(skew), np.cos(skew)]])
        point = ring[:-1].mean(axis=0) + span * rng.uniform(-0.32, 0.32)
        walls.append(Wall(point, turn @ along, thickness, False))
        parts = [[*cell, (len(walls) - 1, sign)] for sign in (1, -1)]
        if all(_is_usable(_floor(walls, part)[0]) for part in parts):
            return parts
        walls.pop()
    return None


def _rooms(
    walls: list[Wall], floors: list[tuple[shapely.Polygon, list[int]]], rng: np.random.Generator
) -> tuple[Room, ...]:
    """Give each floor its sides, its ceiling and its use."""
    height, slopes = (
        rng.uniform(2.3, 3.5) if rng.random() < 0.5 else rng.uniform(2.3, 2.8),
        _slopes(walls, rng),
    )
    kinds = _kinds([floor.area for floor, _ in floors], rng)
    rooms = []
    for (floor, _), kind in zip(floors, kinds, strict=True):
        corners = np.asarray(floor.exterior.coords)[:-1]
        sides = []
        for k, corner in enumerate(corners):
            pair = np.stack([corner, corners[(k + 1) % len(corners)]])
            sides.append(_side_of(walls, pair))
        own = rng.uniform(2.2, height) if kind in ("bath", "hall") and rng.random() < 0.4 else height
        ceilings = np.array([[0.0, 0.0, own], *slopes])
        rooms.append(Room(corners, tuple(sides), ceilings, kind))
    return tuple(rooms)


def _side_of(walls: list[Wall], ends: FloatArray) -> Side:
    """Find the wall whose face holds both `ends` (2, 2) of a side."""
    for number, wall in enumerate(walls):
        away = (ends - wall.point) @ wall.normal
        if np.abs(np.abs(away) - wall.thickness / 2).max() < 1e-6 and np.ptp(away) < 1e-6:
            s = (ends - wall.point) @ wall.along
            return Side(number, 1 if away[0] > 0 else -1, float(s.min()), float(s.max()))
    raise AssertionError("a side without a wall")


def _slopes(walls: list[Wall], rng: np.random.Generator) -> list[FloatArray]:
    """Planes of a roof that slopes down to one outer wall or two that face each other; often none."""
    if rng.random() > 0.3:
        return []
    first, planes = int(rng.integers(4)), []
    for number in (first, (first + 2) % 4)[: 1 + int(rng.random() < 0.4)]:
        wall, steep, knee = walls[number], np.tan(np.radians(rng.uniform(22, 50))), rng.uniform(0.9, 1.7)
        level = knee - steep * (wall.normal @ wall.point + wall.thickness / 2)
        planes.append(np.array([*(steep * wall.normal), level]))
    return planes


def _kinds(areas: list[float], rng: np.random.Generator) -> list[str]:
    """Uses of rooms by their area: the largest one is lived in."""
    found = []
    order = np.argsort(areas)[::-1]
    pool = ["bedroom", "kitchen", "study", "bedroom", "storage"]
    for rank, number in enumerate(order):
        if len(areas) == 1:
            kind = str(rng.choice(["living", "bedroom", "kitchen", "study", "bath", "storage"]))
        elif rank == 0:
            kind = str(rng.choice(["living", "living", "kitchen", "bedroom"]))
        elif areas[number] < 7.0:
            kind = str(rng.choice(["bath", "hall", "storage", "study"]))
        else:
            kind = str(rng.choice(pool))
        if kind == "bath" and areas[number] > 12:
            kind = "living"
        found.append((number, kind))
    return [kind for _, kind in sorted(found)]


_APART_M = 0.16  # between openings of a wall, and from corners
_BELOW_CEILING_M = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class Opening:
    """A hole in a wall, or a niche in one of its faces."""

    wall: int  # its wall
    outline: FloatArray  # (n, 2) float: Along the wall and height, metres; counter-clockwise, convex
    kind: str  # door, entrance, passage, arch, window, glazed door or niche
    sign: int  # the face from which it is furnished: a door opens to there, a niche is open to there
    depth: float  # of a niche, metres; of others the thickness of the wall

    @property
    def span(self) -> tuple[float, float]:
        """Where along the wall it begins and ends, metres."""
        return float(self.outline[:, 0].min()), float(self.outline[:, 0].max())

    @property
    def rise(self) -> tuple[float, float]:
        """Its lower and upper end, metres."""
        return float(self.outline[:, 1].min()), float(self.outline[:, 1].max())


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
