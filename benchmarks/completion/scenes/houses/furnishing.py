# SPDX-License-Identifier: MIT
"""Furnishing: what stands in a room by its use, from bare to crammed."""

from __future__ import annotations

import numpy as np
import shapely

from benchmarks.completion.scenes.houses.catalogue import AMIDST, AMIDST_BY_USE, AT_WALLS, USES
from benchmarks.completion.scenes.houses.furniture import fittings, props, seats, storage, tables
from benchmarks.completion.scenes.houses.furniture.parts import Part, Piece, centred, motion, moved, wood
from benchmarks.completion.scenes.houses.furniture.plants import plant
from benchmarks.completion.scenes.houses.furniture.solids import slab
from benchmarks.completion.scenes.houses.openings import Shaft
from benchmarks.completion.scenes.houses.placing import Layout, Taken
from benchmarks.completion.scenes.houses.plan import side_frame
from scenes.checks import FloatArray


def build_in(layout: Layout, rng: np.random.Generator) -> Shaft | None:
    """Add what belongs to the house: stairs, casings, columns, a platform; return the well of the stairs."""
    well = None
    height = float(layout.room.height(layout.room.corners).min())
    is_flat = len(layout.room.ceilings) == 1
    if is_flat and layout.room.floor.area > 8 and rng.random() < 0.6:
        well = _stairs(layout, rng, height)
    if is_flat and rng.random() < 0.35:
        layout.put_at_wall("casing", fittings.breast(rng, height - 1e-4), rng, corner=rng.random() < 0.5)
    if is_flat and layout.room.floor.area > 10 and rng.random() < 0.25:
        layout.put_free("column", fittings.pillar(rng, height - 1e-4), rng)
    if is_flat and well is None and rng.random() < 0.12:
        layout.parts += _beams(layout, rng, height)
    if layout.room.floor.area > 10:
        for name, chance in (("podium", 0.12), ("parapet", 0.15)):
            if rng.random() < chance:
                _put(layout, name, AT_WALLS[name](rng), rng, density=0.4)
    return well


def _stairs(layout: Layout, rng: np.random.Generator, height: float) -> Shaft | None:
    """A flight along a wall that goes up through the ceiling."""
    rise, run, wide = rng.uniform(0.17, 0.21), rng.uniform(0.19, 0.27), rng.uniform(0.6, 0.9)
    n = int((height + 0.15) / rise)
    low_part = int((height - 1.0) / rise)  # below the well
    piece = fittings.flight(rng, wide, n, rise, run)
    (x0, y0, _), (x1, y1, _) = piece.bounds
    gap = 0.02
    for side in rng.permutation(np.array(layout.room.sides, dtype=object)):
        if side.end - side.start < x1 - x0 + 0.2:
            continue
        s = side.end - x1 - 0.03 if side.sign > 0 else side.start + x1 + 0.03
        frame = side_frame(layout.plan.walls[side.wall], side.sign, s) @ motion((0, gap - y0, 0))
        ring = np.array(
            [
                [x0 + low_part * run, -0.005],
                [x1 + 0.01, -0.005],
                [x1 + 0.01, y1 + 0.02],
                [x0 + low_part * run, y1 + 0.02],
            ]
        )
        well = shapely.Polygon(ring @ frame[:2, :2].T + frame[:2, 3])
        plan = shapely.Polygon(
            np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]]) @ frame[:2, :2].T + frame[:2, 3]
        )
        clear = shapely.Polygon(
            np.array([[x0 - 0.6, y0], [x0, y0], [x0, y1], [x0 - 0.6, y1]]) @ frame[:2, :2].T + frame[:2, 3]
        )
        if not layout.room.floor.buffer(-0.001).contains(well) or not layout.is_free(plan, 0, height - 1e-3):
            continue
        layout.taken += [Taken(plan, 0.0, height), Taken(clear, 0.0, 1.9)]
        if layout.standing_room().area < 1.0:
            del layout.taken[-2:]
            continue
        layout.parts += moved(piece.parts, frame, f"room {layout.number} stairs: ")
        return Shaft(layout.number, well, rng.uniform(2.2, 2.6), is_closed=True)
    return None


def _beams(layout: Layout, rng: np.random.Generator, height: float) -> list[Part]:
    """Beams below the ceiling, from wall to wall, side by side."""
    room, tint = layout.room, wood(rng)
    wide, low = rng.uniform(0.08, 0.2), height - rng.uniform(0.08, 0.2)
    wall = layout.plan.walls[room.sides[int(rng.integers(len(room.sides)))].wall]
    reach = 12.0
    parts: list[Part] = []
    for at in np.arange(-reach, reach, rng.uniform(0.5, 1.1)):
        middle = room.floor.centroid.coords[0] + at * wall.normal
        ends = np.stack([middle - reach * wall.along, middle + reach * wall.along])
        plan = shapely.LineString(ends).buffer(wide / 2, cap_style="flat").intersection(room.floor)
        if plan.area > 0.05 and low > 2.0:
            parts.append(
                Part(f"room {layout.number} beam {len(parts) + 1}", slab(plan, low, height - 1e-4), tint)
            )
            layout.taken.append(Taken(plan, low, height))
    return parts


def furnish(layout: Layout, rng: np.random.Generator, density: float) -> None:
    """Fill a room: `density` 0 is bare, 1 crammed."""
    area, kind = layout.room.floor.area, layout.room.kind
    if kind in ("living", "kitchen") and density > 0.15 and rng.random() < 0.8:
        _dine(layout, rng, density)
    wanted = list(USES[kind])
    n = max(1, round((2.0 + 1.1 * area) * (0.1 + 1.2 * density)))
    for name in (wanted * 4)[:n]:
        if rng.random() < 0.92:
            _put(layout, name, AT_WALLS[name](rng), rng, density=density)
    for name in rng.choice(AMIDST_BY_USE[kind], int(rng.poisson(0.3 + density * area / 2.5))).tolist():
        made = AMIDST[name](rng)
        took = layout.put_free(name, made, rng)
        if took is not None and made.tops:
            _strew(layout, made, took[1], rng, density, took[0])
    _hang(layout, rng, density)
    _lay_rugs(layout, rng)


def _put(layout: Layout, name: str, piece: Piece, rng: np.random.Generator, *, density: float) -> None:
    took = layout.put_at_wall(name, piece, rng, corner=name in ("bath", "shower", "wardrobe", "fridge"))
    if took is None:
        return
    place, move = took
    if piece.tops:
        _strew(layout, piece, move, rng, density, place)
    if name == "counter" and rng.random() < 0.75:
        width = float(np.ptp(piece.bounds[:, 0]))
        layout.put(
            "wall cabinet",
            storage.wall_cabinet(rng, width * rng.uniform(0.4, 1.0)),
            move @ motion((rng.uniform(-0.1, 0.1), -0.019, 0)),
        )
    if name == "desk" and rng.random() < 0.7:
        layout.put("desk chair", _chair_at(rng), move @ _before(piece, rng), but=[place])
    if name == "basin" and rng.random() < 0.7:
        layout.put(
            "mirror",
            fittings.picture(rng, rng.uniform(0.4, 0.6), rng.uniform(0.5, 0.8), 1.15, mirror=True),
            move @ motion((0, -0.019, 0)),
        )


def _chair_at(rng: np.random.Generator) -> Piece:
    return seats.office_chair(rng) if rng.random() < 0.5 else seats.chair(rng)


def _before(desk: Piece, rng: np.random.Generator) -> FloatArray:
    """Where a chair stands that faces the wall, partly under the desk, beside its drawers."""
    drawers = next(one for one in desk.parts if one.name == "desk drawers")
    aside = -0.3 * float(np.sign(drawers.corners[..., 0].mean())) * float(desk.bounds[1, 0])
    return motion(
        (aside + rng.normal(0, 0.03), desk.bounds[1, 1] + rng.uniform(0.35, 0.7), 0),
        np.pi + rng.normal(0, 0.2),
    )


def _strew(
    layout: Layout, piece: Piece, move: FloatArray, rng: np.random.Generator, density: float, on: Taken
) -> None:
    """Put small things on a piece."""
    area = sum((top[2] - top[0]) * (top[3] - top[1]) for top in piece.tops)
    things = [props.prop(rng) for _ in range(int(rng.poisson(area * (1 + 9 * density))))]
    if area > 0.3 and rng.random() < 0.35:
        things.insert(0, props.screen(rng, rng.uniform(0.45, 1.0)))
    if rng.random() < 0.25:
        things.insert(0, plant(rng, rng.uniform(0.2, 0.5)))
    layout.put_on(piece, move, things, rng, on)


def _dine(layout: Layout, rng: np.random.Generator, density: float) -> None:
    """A table with chairs half under it."""
    made = tables.table(rng, rng.uniform(0.7, 1.0 if layout.room.floor.area < 9 else 1.8))
    took = (
        layout.put_free("table", made, rng) if rng.random() < 0.75 else layout.put_at_wall("table", made, rng)
    )
    if took is None:
        return
    place, move = took
    (x0, y0, _), (x1, y1, _) = made.bounds
    _strew(layout, made, move, rng, density, place)
    slots = []
    for x in np.linspace(x0, x1, max(1, int((x1 - x0) / 0.6)) * 2 + 1)[1::2]:
        slots += [(x, y0, 0.0), (x, y1, np.pi)]
    slots += [(x0, (y0 + y1) / 2, -np.pi / 2), (x1, (y0 + y1) / 2, np.pi / 2)] * int(x1 - x0 > 0.9)
    chairs = rng.integers(2**32)
    for x, y, yaw in slots:
        if rng.random() < 0.15:
            continue
        own = centred(
            seats.chair(np.random.default_rng(chairs if rng.random() < 0.8 else rng.integers(2**32)))
        )
        far = float(own.bounds[1, 1]) - rng.uniform(0.0, 0.3) if rng.random() < 0.85 else 0.6
        turn = yaw + rng.normal(0, 0.12)
        at = motion((x, y, 0), yaw) @ motion((0, -far, 0), turn - yaw)
        layout.put("table chair", own, move @ at, but=[place])


def _hang(layout: Layout, rng: np.random.Generator, density: float) -> None:
    """Pictures, shelves, mirrors and lamps."""
    for _ in range(int(rng.poisson(1 + 4 * density))):
        w = rng.uniform(0.18, 1.0)
        h = float(np.clip(w * rng.uniform(0.6, 1.6), 0.15, 0.9))
        mirror = rng.random() < 0.08
        layout.put_at_wall(
            "mirror" if mirror else "picture",
            fittings.picture(rng, w, h, rng.uniform(1.1, 1.6), mirror=mirror),
            rng,
            tries=4,
        )
    for _ in range(int(rng.poisson(1.5 * density))):
        layout.put_at_wall(
            "wall shelf", storage.wall_shelf(rng, rng.uniform(0.4, 1.4), rng.uniform(0.9, 1.8)), rng, tries=4
        )
    middle = np.array(layout.room.floor.centroid.coords)
    height = float(layout.room.height(middle)[0])
    if rng.random() < 0.6 and height > 2.2:
        lamp = centred(fittings.ceiling_lamp(rng, height - 0.001))
        if len(layout.room.ceilings) == 1:
            layout.put("ceiling lamp", lamp, motion((*middle[0], 0)))


def _lay_rugs(layout: Layout, rng: np.random.Generator) -> None:
    if layout.room.kind in ("bath", "kitchen") or rng.random() < 0.5:
        return
    low, high = np.array(layout.room.floor.bounds).reshape(2, 2)
    flat = centred(tables.rug(rng.uniform(0.8, 2.4), rng.uniform(0.6, 1.7), rng.uniform(0.006, 0.015), rng))
    ring = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * flat.bounds[1, :2]
    for _ in range(10):
        at, yaw = rng.uniform(low, high), rng.uniform(0, np.pi)
        frame = motion((*at, 0), yaw)
        plan = shapely.Polygon(ring @ frame[:2, :2].T + at)
        solid = [one.plan for one in layout.taken if one.low < 0.01 and one.high > 2.15]
        if layout.room.floor.contains(plan) and not any(plan.intersects(one) for one in solid):
            layout.parts += moved(flat.parts, frame, f"room {layout.number} ")
            return
