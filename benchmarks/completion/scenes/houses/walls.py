# SPDX-License-Identifier: MIT
"""Walls, floors and ceilings: faces with holes, reveals, backs of niches, shafts, skirting boards."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely

from benchmarks.completion.scenes.houses.furniture.parts import (
    Colour,
    Part,
    cloth,
    joined,
    moved,
    paint,
    wood,
)
from benchmarks.completion.scenes.houses.furniture.solids import box, parts_of, quads, triangles_of
from benchmarks.completion.scenes.houses.openings import Opening, Shaft
from benchmarks.completion.scenes.houses.plan import Plan, Room, Side, Wall, side_frame, where_below
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
