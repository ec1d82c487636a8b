# SPDX-License-Identifier: MIT
"""Walls of a flat with their openings, door leaves, frames, sills, curtains and radiators."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import shapely

from benchmarks.cases.houses.furnishing import Layout, Taken
from benchmarks.cases.houses.plan import Opening, Plan, Room, Shaft, Side, Wall, side_frame, where_below
from benchmarks.cases.houses.solids import (
    STEEL,
    WHITE,
    Colour,
    Part,
    box,
    cloth,
    joined,
    motion,
    moved,
    paint,
    parts_of,
    quads,
    triangles_of,
    tube,
    wood,
)
from benchmarks.cases.houses.things import curtain, radiator, rod
from scenes.checks import FloatArray

_PLASTER: Colour = (0.87, 0.85, 0.81)


def shell(
    plan: Plan, openings: Sequence[Opening], shafts: Sequence[Shaft], rng: np.random.Generator
) -> list[Part]:
    """Return everything of a flat that does not stand in it: all faces are seen from within the rooms."""
    parts = []
    for number, room in enumerate(plan.rooms):
        paints = [_PLASTER if rng.random() < 0.6 else cloth(rng) for _ in room.sides]
        for k, side in enumerate(room.sides):
            held = [one for one in openings if one.wall == side.wall and _is_on(one, side)]
            parts.append(
                Part(f"room {number} wall {k}", _face(plan.walls[side.wall], room, side, held), paints[k])
            )
        parts += _floor_and_ceiling(number, room, [one for one in shafts if one.room == number], rng)
        if rng.random() < 0.8:
            parts.append(_skirting(number, plan, room, openings, rng))
    for number, opening in enumerate(openings):
        parts += _reveal(number, plan.walls[opening.wall], opening)
    return parts + _facades(plan, openings)


def _is_on(opening: Opening, side: Side) -> bool:
    """Tell whether an opening cuts a side; a niche is open to one face alone."""
    reaches = opening.span[0] >= side.start - 1e-9 and opening.span[1] <= side.end + 1e-9
    return reaches and (opening.kind != "niche" or opening.sign == side.sign)


def _face(wall: Wall, room: Room, side: Side, openings: Sequence[Opening]) -> FloatArray:
    """A face up to the ceiling, less its holes."""
    offset = side.sign * wall.thickness / 2
    s = np.array([side.start, side.end])
    ends = wall.place(s, np.zeros(2), offset)[:, :2]
    first, last = ends @ room.ceilings[:, :2].T + room.ceilings[:, 2]
    bends = {0.0, 1.0}
    for i in range(len(first)):
        for j in range(i):
            fall = (first[i] - first[j]) - (last[i] - last[j])
            if abs(fall) > 1e-9 and 0 < (first[i] - first[j]) / fall < 1:
                bends.add(float((first[i] - first[j]) / fall))
    top = [
        (s[0] + t * (s[1] - s[0]), float((first + t * (last - first)).min()))
        for t in sorted(bends, reverse=True)
    ]
    shape = shapely.Polygon([(s[0], 0.0), (s[1], 0.0), *top])
    return _upright(wall, _less(shape, openings), offset, side.sign)


def _less(shape: shapely.Polygon, openings: Sequence[Opening]) -> shapely.geometry.base.BaseGeometry:
    return shape.difference(shapely.union_all([shapely.Polygon(one.outline) for one in openings]))


def _upright(wall: Wall, shape: shapely.geometry.base.BaseGeometry, offset: float, sign: int) -> FloatArray:
    """Triangles of a shape in the plane of a face, seen from the side `sign` of it."""
    flat = triangles_of(shape)
    corners = wall.place(flat[..., 0].ravel(), flat[..., 1].ravel(), offset).reshape(-1, 3, 3)
    return corners if sign < 0 else corners[:, ::-1]


def _reveal(number: int, wall: Wall, opening: Opening) -> list[Part]:
    """What is seen in the depth of a wall around an opening, and the back of a niche."""
    near = opening.sign * wall.thickness / 2
    far = near - opening.sign * opening.depth
    ring = opening.outline
    after = np.roll(ring, -1, axis=0)
    sides = np.stack(
        [
            wall.place(ends[:, 0], ends[:, 1], offset)
            for ends, offset in ((ring, near), (after, near), (after, far), (ring, far))
        ],
        axis=1,
    )
    corners = quads(sides[:, ::-1] if opening.sign > 0 else sides)
    name = f"{opening.kind} {number}"
    parts = [Part(f"{name} reveal", corners, _PLASTER)]
    if opening.kind == "niche":
        back = _upright(wall, shapely.Polygon(ring), far, opening.sign)
        parts.append(Part(f"{name} back", back, _PLASTER))
    return parts


def _floor_and_ceiling(
    number: int, room: Room, shafts: Sequence[Shaft], rng: np.random.Generator
) -> list[Part]:
    flat = triangles_of(room.floor)
    ground = np.concatenate([flat, np.zeros((*flat.shape[:2], 1))], axis=2)
    kinds = (wood(rng), paint(rng), cloth(rng))
    parts = [Part(f"room {number} floor", ground, kinds[rng.integers(3)])]
    holes = shapely.union_all([one.outline for one in shafts])
    for k, plane in enumerate(room.ceilings):
        area = room.floor
        for other in (one for j, one in enumerate(room.ceilings) if j != k):
            area = area.intersection(where_below(plane, other))
        flat = triangles_of(area.difference(holes))
        if len(flat):
            z = flat @ plane[:2] + plane[2]
            parts.append(
                Part(
                    f"room {number} ceiling {k}",
                    np.concatenate([flat, z[..., None]], axis=2)[:, ::-1],
                    (0.9, 0.9, 0.88),
                )
            )
    for shaft in shafts:
        parts += _shaft(number, room, shaft)
    return parts


def _shaft(number: int, room: Room, shaft: Shaft) -> list[Part]:
    ring = np.asarray(shapely.orient_polygons(shaft.outline).exterior.coords)[:-1]
    low = room.height(ring)
    high = np.full(len(ring), low.min() + shaft.depth)
    foot, head = np.column_stack([ring, low]), np.column_stack([ring, high])
    sides = np.stack([foot, head, np.roll(head, -1, axis=0), np.roll(foot, -1, axis=0)], axis=1)
    parts = [Part(f"room {number} shaft", quads(sides), _PLASTER)]
    if shaft.is_closed:
        flat = triangles_of(shaft.outline)
        lid = np.concatenate([flat, np.full((*flat.shape[:2], 1), high[0])], axis=2)[:, ::-1]
        parts.append(Part(f"room {number} shaft ceiling", lid, _PLASTER))
    return parts


def _skirting(
    number: int, plan: Plan, room: Room, openings: Sequence[Opening], rng: np.random.Generator
) -> Part:
    """Boards along the foot of all walls of a room, between its openings."""
    high, deep = rng.uniform(0.05, 0.12), rng.uniform(0.01, 0.018)
    boards = []
    for side in room.sides:
        wall = plan.walls[side.wall]
        held = [one for one in openings if one.wall == side.wall and _is_on(one, side) and one.rise[0] < high]
        free = shapely.LineString([(side.start, 0), (side.end, 0)])
        for one in held:
            margin = 0.0 if one.kind == "niche" else 0.07
            free = free.difference(shapely.box(one.span[0] - margin, -1, one.span[1] + margin, 1))
        for line in shapely.get_parts(free):
            if line.length > 0.02:
                (a, _), (b, _) = line.coords[0], line.coords[-1]
                half = abs(b - a) / 2
                board = Part("", box((-half, 0, 0), (half, deep, high)), _PLASTER)
                boards += [one.corners for one in moved([board], side_frame(wall, side.sign, (a + b) / 2))]
    return joined(f"room {number} skirting", boards, paint(rng) if rng.random() < 0.6 else wood(rng))


def _facades(plan: Plan, openings: Sequence[Opening]) -> list[Part]:
    """Outer faces of the outer walls, which only those see who look in from outside."""
    parts = []
    for number, wall in enumerate(plan.walls):
        sides = [(room, side) for room in plan.rooms for side in room.sides if side.wall == number]
        if not wall.is_outer or not sides:
            continue
        low, high = min(side.start for _, side in sides), max(side.end for _, side in sides)
        ends = wall.place(np.array([low, high]), np.zeros(2), wall.thickness / 2)[:, :2]
        top = float(max(room.height(ends).max() for room, _ in sides)) + 0.3
        shape = shapely.box(low - wall.thickness, -0.2, high + wall.thickness, top)
        held = [one for one in openings if one.wall == number and one.kind != "niche"]
        flat = _less(shape, held)
        if parts_of(flat):
            parts.append(
                Part(f"facade {number}", _upright(wall, flat, -wall.thickness / 2, -1), (0.75, 0.72, 0.66))
            )
    return parts


_BEFORE_DOOR_M = 0.65  # kept free before a way


def fit_way(
    number: int, wall: Wall, opening: Opening, fronts: dict[int, Layout], rng: np.random.Generator
) -> None:
    """Keep the floor before a way free in its rooms, `fronts` by sign; add its frame and its leaf."""
    (a, b), (_, top) = opening.span, opening.rise
    width, tint = b - a, paint(rng) if rng.random() < 0.6 else wood(rng)
    for sign, layout in fronts.items():
        frame = side_frame(wall, sign, (a + b) / 2)
        ring = np.array(
            [
                [-width / 2 - 0.1, 0],
                [width / 2 + 0.1, 0],
                [width / 2, _BEFORE_DOOR_M],
                [-width / 2, _BEFORE_DOOR_M],
            ]
        )
        layout.taken.append(Taken(shapely.Polygon(ring @ frame[:2, :2].T + frame[:2, 3]), 0.0, 2.1))
        if opening.kind in ("door", "entrance", "passage"):
            layout.parts += moved(
                [_casing(width, top, rng, tint)], frame, f"{opening.kind} {number} side {sign} "
            )
    if opening.kind in ("door", "entrance") and opening.sign in fronts:
        _hang(number, wall, opening, fronts[opening.sign], rng, tint=tint)


def _casing(width: float, top: float, rng: np.random.Generator, tint: Colour) -> Part:
    wide, deep, x = rng.uniform(0.05, 0.068), rng.uniform(0.008, 0.02), width / 2
    boards = [
        box((s * x + min(0, s * wide), 0, 0), (s * x + max(0, s * wide), deep, top + wide)) for s in (-1, 1)
    ]
    return joined("frame", [*boards, box((-x, 0, top), (x, deep, top + wide))], tint)


def _hang(
    number: int, wall: Wall, opening: Opening, layout: Layout, rng: np.random.Generator, *, tint: Colour
) -> None:
    """Hang the leaf at one jamb, open as far as its room lets it; mostly ajar."""
    (a, b), (_, top) = opening.span, opening.rise
    width, side = b - a, int(rng.choice([-1, 1]))
    leaf = _leaf(width - 0.01, top - 0.012, rng, tint, side)
    wish = 0.0 if opening.kind == "entrance" or rng.random() < 0.15 else rng.uniform(0.12, 1.75)
    frame = side_frame(wall, opening.sign, (a + b) / 2)
    reach = np.array([[0.0, 0.01], [-side * width, 0.01], [-side * width, -0.05]])
    for angle in np.arange(wish, 0, -0.12):
        turn = -side * angle
        spin = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
        swept = shapely.Polygon(reach @ spin.T + [side * width / 2, 0.0]).buffer(0.06)
        ring = np.asarray(swept.exterior.coords) @ frame[:2, :2].T + frame[:2, 3]
        own = shapely.Polygon(ring).difference(shapely.Point(frame[:2, 3]).buffer(0.02))
        outside = shapely.Polygon(ring).difference(layout.room.floor).area
        if outside < 0.12 * 0.2 + 0.06 * np.cos(angle) * width:
            wish = float(angle)
            layout.taken.append(Taken(own, 0.0, top))
            break
    else:
        wish = 0.0
    x, y, rim = width / 2, -0.045, 0.014
    stops = [box((e * x - (e > 0) * rim, y - 0.03, 0), (e * x + (e < 0) * rim, y, top)) for e in (-1, 1)]
    stops.append(box((rim - x, y - 0.03, top - rim), (x - rim, y, top)))
    layout.parts += moved([joined("stops", stops, tint)], frame, f"{opening.kind} {number} ")
    hinge = motion((side * width / 2, -0.001, 0.008), -side * wish)
    layout.parts += moved(leaf, frame @ hinge, f"{opening.kind} {number} ")


def _leaf(width: float, high: float, rng: np.random.Generator, tint: Colour, side: int) -> tuple[Part, ...]:
    """A leaf from its hinge at x = 0 towards -side, in the wall (y < 0): plain, or with raised panels."""
    thick = 0.04
    near, far = sorted((-side * 0.005, -side * width))
    solids = [box((near, -thick, 0), (far, 0, high))]
    if rng.random() < 0.6:
        rows = np.linspace(0.12, high - 0.12, int(rng.integers(2, 5)))
        for low, top in pairwise(rows):
            for y0, y1 in ((0, 0.008), (-thick - 0.008, -thick)):
                solids.append(box((near + 0.1, y0, low + 0.03), (far - 0.1, y1, top - 0.03)))
    x = -side * (width - 0.06)
    grips = [tube((x, y, 1.03), (x + side * 0.11, y, 1.03), 0.009, n=8) for y in (0.045, -thick - 0.045)]
    grips += [tube((x, -thick - 0.05, 1.03), (x, 0.05, 1.03), 0.008, n=8)]
    return joined("leaf", solids, tint), joined("handle", grips, STEEL)


def fit_window(number: int, wall: Wall, opening: Opening, layout: Layout, rng: np.random.Generator) -> None:
    """Add frame, bars, sill, and perhaps curtains, a blind and a radiator to a window."""
    (a, b), (low, top) = opening.span, opening.rise
    width, frame = b - a, side_frame(wall, opening.sign, (a + b) / 2)
    parts = list(_bars(width, low, top, wall.thickness, rng))
    reach = 0.06
    if low > 0.2 and rng.random() < 0.8:
        reach = rng.uniform(0.02, 0.14)
        sill = box((-width / 2 - 0.04, -wall.thickness * 0.5, low), (width / 2 + 0.04, reach, low + 0.025))
        inner = box((-width / 2, -wall.thickness * 0.5, low), (width / 2, 0.0, low + 0.025))
        ledge = box((-width / 2 - 0.04, 0.0, low - 0.005), (width / 2 + 0.04, reach, low + 0.025))
        parts.append(joined("sill", [inner, ledge], WHITE) if reach > 0.03 else Part("sill", sill, WHITE))
    dressed = rng.random()
    if dressed < 0.55:
        parts += _curtains(layout, opening, frame, rng)
    elif dressed < 0.75:
        drop = rng.uniform(0.15, 0.85) * (top - low)
        at = -wall.thickness * 0.25
        parts.append(
            Part(
                "blind",
                box(
                    (-width / 2 + 0.015, at - 0.004, top - drop), (width / 2 - 0.015, at + 0.004, top - 0.03)
                ),
                cloth(rng),
            )
        )
        parts.append(
            Part(
                "blind roll",
                tube((-width / 2 + 0.01, at, top - 0.03), (width / 2 - 0.01, at, top - 0.03), 0.025),
                WHITE,
            )
        )
    layout.parts += moved(parts, frame, f"{opening.kind} {number} ")
    _reserve(layout, frame, (-width / 2, width / 2, 0.35), (low + 0.03, top))
    if opening.kind == "glazed door":
        _reserve(layout, frame, (-width / 2, width / 2, 0.6), (0, top))
    elif low > 0.55 and rng.random() < 0.6:
        heater = radiator(
            rng, min(max(width * rng.uniform(0.6, 1.1), 0.4), 2.0), low - rng.uniform(0.06, 0.2)
        )
        layout.put("radiator", heater, frame @ motion((0, 1e-4, 0)))


def keep_clear(wall: Wall, opening: Opening, layout: Layout) -> None:
    """Let nothing hang before a niche; furniture may stand there and hide it."""
    (a, b), rise = opening.span, opening.rise
    _reserve(layout, side_frame(wall, opening.sign, (a + b) / 2), ((a - b) / 2, (b - a) / 2, 0.015), rise)


def _bars(
    width: float, low: float, top: float, thickness: float, rng: np.random.Generator
) -> tuple[Part, ...]:
    """A frame in the depth of the wall, mullions, casements, one of them now and then open."""
    y, wide, half = -thickness * rng.uniform(0.45, 0.75), rng.uniform(0.05, 0.075), width / 2
    tint = WHITE if rng.random() < 0.7 else wood(rng)
    solids = [
        box((s * half - (s > 0) * wide, y - 0.03, low), (s * half + (s < 0) * wide, y + 0.03, top))
        for s in (-1, 1)
    ]
    solids += [box((-half + wide, y - 0.03, z), (half - wide, y + 0.03, z + wide)) for z in (low, top - wide)]
    n = max(1, round(width / rng.uniform(0.5, 0.9)))
    for x in np.linspace(-half, half, n + 1)[1:-1]:
        solids.append(box((x - wide / 2, y - 0.025, low + wide), (x + wide / 2, y + 0.025, top - wide)))
    if rng.random() < 0.4:
        z = low + (top - low) * rng.uniform(0.3, 0.75)
        solids.append(box((-half + wide, y - 0.022, z), (half - wide, y + 0.022, z + 0.04)))
    return (joined("frame", solids, tint),)


def _curtains(
    layout: Layout, opening: Opening, frame: FloatArray, rng: np.random.Generator
) -> tuple[Part, ...]:
    """Curtains on a rod above the window; they hide its edges."""
    (a, b), (low, top) = opening.span, opening.rise
    spare = rng.uniform(0.12, 0.35)
    long, out, rail = b - a + 2 * spare, rng.uniform(0.09, 0.13), top + rng.uniform(0.03, 0.09)
    if opening.kind == "glazed door" or rng.random() < 0.5:
        low = 0.03
    else:
        low -= 0.12
    ring = np.array(
        [
            [-long / 2 - 0.03, 0.002],
            [long / 2 + 0.03, 0.002],
            [long / 2 + 0.03, out + 0.07],
            [-long / 2 - 0.03, out + 0.07],
        ]
    )
    plan = shapely.Polygon(ring @ frame[:2, :2].T + frame[:2, 3])
    if not layout.is_free(plan, low, rail + 0.03):
        return ()
    layout.taken.append(Taken(plan, low, rail + 0.03))
    at = motion((-long / 2, 0, 0))
    parts, state = list(moved([rod(long, rail, out)], at)), int(rng.integers(2**32))
    for end in rng.permutation(2)[: 1 if rng.random() < 0.15 else 2]:
        share = rng.uniform(0.14, 0.45)
        drape = curtain(np.random.default_rng(state), long * share, low, rail - 0.015, out)
        parts += moved([drape], motion((-long / 2 if end == 0 else long / 2 - long * share, 0, 0)))
    return tuple(parts)


def _reserve(
    layout: Layout, frame: FloatArray, reach: tuple[float, float, float], rise: tuple[float, float]
) -> None:
    ring = np.array([[reach[0], 0], [reach[1], 0], [reach[1], reach[2]], [reach[0], reach[2]]])
    plan = shapely.Polygon(ring @ frame[:2, :2].T + frame[:2, 3])
    layout.taken.append(Taken(plan, rise[0], rise[1]))
