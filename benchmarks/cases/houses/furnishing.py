# SPDX-License-Identifier: MIT
"""Furnishing of a room by its use, from bare to crammed."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from benchmarks.cases.houses import furniture, things
from benchmarks.cases.houses.plan import Plan, Room, Shaft, side_frame
from benchmarks.cases.houses.solids import Part, Piece, centred, motion, moved, slab, wood
from benchmarks.cases.houses.things import figure, plant
from scenes.checks import FloatArray

STANDING_M = 0.33  # from what one stands beside
_BODY_M = 1.9  # below it, things are in one's way
_LEAST_M2 = 0.35  # of floor to stand on, in any room


@dataclass(frozen=True, slots=True, eq=False)
class Taken:
    """Part of a room that is taken: its plan, and from where to where it reaches, metres."""

    plan: BaseGeometry
    low: float
    high: float


@dataclass(slots=True, eq=False)
class Layout:
    """A room while it is furnished."""

    plan: Plan
    room: Room
    number: int
    parts: list[Part] = field(default_factory=list)
    taken: list[Taken] = field(default_factory=list)
    _counts: dict[str, int] = field(default_factory=dict)

    def is_free(self, plan: BaseGeometry, low: float, high: float, but: Iterable[Taken] = ()) -> bool:
        """Tell whether a part of the room is inside it, below its ceiling, and not taken."""
        if not self.room.floor.contains(plan):
            return False
        if self.room.height(np.asarray(plan.exterior.coords)).min() < high - 1e-6:
            return False
        spared = {id(one) for one in but}
        return not any(
            one.low < high and low < one.high and one.plan.intersects(plan)
            for one in self.taken
            if id(one) not in spared
        )

    def standing_room(self) -> BaseGeometry:
        """Where a person can stand, metres away from walls and things."""
        blocked = [one.plan for one in self.taken if one.low < _BODY_M and one.high > 0.1]
        return (
            self.room.below(_BODY_M)
            .buffer(-STANDING_M)
            .difference(shapely.union_all(blocked).buffer(STANDING_M, quad_segs=3))
        )

    def put(
        self, name: str, piece: Piece, move: FloatArray, *, but: Iterable[Taken] = (), gap: float = 0.0
    ) -> Taken | None:
        """Put a piece there if its place is free and one can still stand in the room; tell what it takes."""
        (x0, y0, low), (x1, y1, high) = piece.bounds.tolist()
        ring = np.array([[x0 - gap, y0], [x1 + gap, y0], [x1 + gap, y1], [x0 - gap, y1]])
        plan = shapely.Polygon(ring @ move[:2, :2].T + move[:2, 3])
        low, high = low + float(move[2, 3]), high + float(move[2, 3])
        if not self.is_free(plan, low, high, but):
            return None
        took = Taken(plan, low, high)
        self.taken.append(took)
        if low < _BODY_M and self.standing_room().area < _LEAST_M2:
            self.taken.pop()
            return None
        self._counts[name] = self._counts.get(name, 0) + 1
        prefix = f"room {self.number} {name} {self._counts[name]}: "
        self.parts += moved(piece.parts, move, prefix)
        return took

    def put_at_wall(
        self, name: str, piece: Piece, rng: np.random.Generator, *, tries: int = 24, corner: bool = False
    ) -> tuple[Taken, FloatArray] | None:
        """Put a piece with its back to some wall, seldom exactly against it; tell what it takes and where."""
        low, high = piece.bounds
        lengths = np.array([side.end - side.start for side in self.room.sides])
        for _ in range(tries):
            side = self.room.sides[int(rng.choice(len(lengths), p=lengths / lengths.sum()))]
            free = side.end - side.start - (high[0] - low[0]) - 0.04
            if free < 0:
                continue
            share = float(rng.integers(2)) if corner or rng.random() < 0.35 else rng.random()
            s = side.start + 0.02 - side.sign * (low[0] if side.sign > 0 else high[0]) + share * free
            gap = 0.02 + (abs(rng.normal(0, 0.02)) if low[2] < 0.3 else -0.02 + 1e-4)
            move = side_frame(self.plan.walls[side.wall], side.sign, s) @ motion(
                (0, gap - low[1], max(0.0, -low[2]))
            )
            took = self.put(name, piece, move)
            if took is not None:
                return took, move
        return None

    def put_free(
        self, name: str, piece: Piece, rng: np.random.Generator, *, tries: int = 24
    ) -> tuple[Taken, FloatArray] | None:
        """Put a piece anywhere, turned along a wall or anyhow; tell what it takes and where."""
        own = centred(piece)
        low, high = np.array(self.room.floor.bounds).reshape(2, 2)
        for _ in range(tries):
            along = self.plan.walls[self.room.sides[int(rng.integers(len(self.room.sides)))].wall].along
            turn = float(np.arctan2(along[1], along[0])) + rng.integers(4) * np.pi / 2 + rng.normal(0, 0.08)
            move = motion((*rng.uniform(low, high), max(0.0, -float(own.bounds[0, 2]))), turn)
            took = self.put(name, own, move)
            if took is not None:
                x, y = piece.bounds.mean(axis=0)[:2]
                return took, move @ motion((-x, -y, 0))
        return None

    def put_on(
        self, piece: Piece, move: FloatArray, things: Iterable[Piece], rng: np.random.Generator, on: Taken
    ) -> None:
        """Put small things at random places of a piece's tops, where they do not touch each other."""
        own: list[Taken] = []
        for thing in things:
            top = piece.tops[int(rng.integers(len(piece.tops)))]
            (x0, y0, low), (x1, y1, high) = thing.bounds
            reach = float(np.hypot(x1 - x0, y1 - y0)) / 2 + 0.01
            area = np.array([[top[0], top[1]], [top[2], top[3]]]) + [[reach], [-reach]]
            if (area[1] <= area[0]).any():
                continue
            at = rng.uniform(*area)
            local = motion((*at, top[4] - low + 0.0005), rng.normal(0, 0.5)) @ motion(
                (-(x0 + x1) / 2, -(y0 + y1) / 2, 0)
            )
            centre = (move @ [*at, 0, 1])[:2]
            plan = shapely.Point(centre).buffer(reach, quad_segs=3)
            base = float(move[2, 3]) + top[4]
            if not self.is_free(plan, base + 0.002, base + high - low, [on]) or any(
                one.plan.intersects(plan) for one in own
            ):
                continue
            own.append(Taken(plan, base, base + high - low))
            self._counts["thing"] = self._counts.get("thing", 0) + 1
            self.parts += moved(
                thing.parts, move @ local, f"room {self.number} thing {self._counts['thing']}: "
            )
        self.taken += own


Maker = Callable[[np.random.Generator], Piece]
Range = tuple[float, float]


def _cabinet(width: Range, depth: Range, height: Range) -> Maker:
    return lambda rng: furniture.cabinet(rng, rng.uniform(*width), rng.uniform(*depth), rng.uniform(*height))


def _sized(make: Callable[[np.random.Generator, float], Piece], width: Range) -> Maker:
    return lambda rng: make(rng, rng.uniform(*width))


def _bookshelf(rng: np.random.Generator) -> Piece:
    w, d, h = rng.uniform([0.4, 0.24, 0.7], [1.6, 0.36, 2.2])
    return furniture.bookshelf(rng, float(w), float(d), float(h))


def _wall_table(rng: np.random.Generator) -> Piece:
    return furniture.table(rng, rng.uniform(0.7, 1.4), rng.uniform(0.4, 0.6))


def _tall_radiator(rng: np.random.Generator) -> Piece:
    return things.radiator(rng, rng.uniform(0.4, 0.6), rng.uniform(1.4, 1.8))


def _podium(rng: np.random.Generator) -> Piece:
    return things.podium(rng, rng.uniform(0.9, 2.0), rng.uniform(0.6, 1.4))


def _armchair(rng: np.random.Generator) -> Piece:
    return furniture.sofa(rng, 1)


def _seated(rng: np.random.Generator) -> Piece:
    """A person on a chair."""
    own = furniture.chair(rng)
    high = max(float(one.corners[..., 2].max()) for one in own.parts if one.name == "chair seat")
    return Piece((*own.parts, *figure(rng, seat_m=high).parts))


AT_WALLS: dict[str, Maker] = {
    "cabinet": _cabinet((0.5, 1.4), (0.32, 0.5), (0.6, 1.4)),
    "sideboard": _cabinet((1.0, 2.0), (0.38, 0.5), (0.5, 0.85)),
    "wardrobe": _cabinet((0.8, 2.4), (0.52, 0.64), (1.8, 2.25)),
    "nightstand": _cabinet((0.35, 0.5), (0.33, 0.42), (0.4, 0.6)),
    "bookshelf": _bookshelf,
    "bed": furniture.bed,
    "sofa": furniture.sofa,
    "desk": furniture.desk,
    "wall table": _wall_table,
    "chair": furniture.chair,
    "radiator": _sized(things.radiator, (0.4, 1.6)),
    "tall radiator": _tall_radiator,
    "counter": _sized(furniture.counter, (1.2, 3.4)),
    "fridge": furniture.fridge,
    "washing machine": furniture.washing_machine,
    "toilet": things.toilet,
    "basin": things.basin,
    "bath": _sized(things.bath, (1.5, 1.8)),
    "shower": things.shower_screen,
    "coats": _sized(things.coats, (0.5, 1.3)),
    "boxes": things.boxes,
    "bag": things.bag,
    "bin": things.bin_,
    "podium": _podium,
    "parapet": _sized(things.parapet, (0.7, 1.5)),
    "floor lamp": things.floor_lamp,
    "plant": plant,
    "rack": things.drying_rack,
}
AMIDST: dict[str, Maker] = {
    "coffee table": furniture.coffee_table,
    "armchair": _armchair,
    "office chair": furniture.office_chair,
    "stool": furniture.stool,
    "chair": furniture.chair,
    "plant": plant,
    "figure": figure,
    "seated figure": _seated,
    "boxes": things.boxes,
    "bag": things.bag,
    "tub": things.tub,
    "rack": things.drying_rack,
}


def _words(text: str) -> tuple[str, ...]:
    return tuple(text.split(", "))


USES = {
    "living": _words(
        "sofa, sideboard, bookshelf, sofa, cabinet, floor lamp, plant, desk, bookshelf, radiator"
    ),
    "bedroom": _words(
        "bed, wardrobe, nightstand, cabinet, chair, nightstand, desk, bookshelf, bag, radiator"
    ),
    "kitchen": _words("counter, fridge, counter, cabinet, washing machine, bin, chair, radiator, wall table"),
    "study": _words("desk, bookshelf, bookshelf, cabinet, chair, boxes, plant, sofa, bookshelf, radiator"),
    "bath": _words("bath, basin, toilet, shower, washing machine, cabinet, tall radiator, bin, rack"),
    "hall": _words("coats, cabinet, nightstand, chair, boxes, bookshelf, bag, radiator, plant"),
    "storage": _words("bookshelf, boxes, bookshelf, boxes, cabinet, rack, washing machine, bag, wardrobe"),
}
AMIDST_BY_USE = {
    "living": _words("coffee table, armchair, figure, plant, stool, seated figure"),
    "bedroom": _words("stool, rack, figure, plant, bag"),
    "kitchen": _words("stool, figure, chair"),
    "study": _words("office chair, seated figure, boxes, plant"),
    "bath": _words("stool, tub, figure"),
    "hall": _words("figure, bag, plant"),
    "storage": _words("boxes, tub, boxes, chair, figure"),
}


def build_in(layout: Layout, rng: np.random.Generator) -> Shaft | None:
    """Add what belongs to the house: stairs, casings, columns, a platform; return the well of the stairs."""
    well = None
    height = float(layout.room.height(layout.room.corners).min())
    is_flat = len(layout.room.ceilings) == 1
    if is_flat and layout.room.floor.area > 8 and rng.random() < 0.6:
        well = _stairs(layout, rng, height)
    if is_flat and rng.random() < 0.35:
        layout.put_at_wall("casing", things.breast(rng, height - 1e-4), rng, corner=rng.random() < 0.5)
    if is_flat and layout.room.floor.area > 10 and rng.random() < 0.25:
        layout.put_free("column", things.pillar(rng, height - 1e-4), rng)
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
    piece = things.flight(rng, wide, n, rise, run)
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
            furniture.wall_cabinet(rng, width * rng.uniform(0.4, 1.0)),
            move @ motion((rng.uniform(-0.1, 0.1), -0.019, 0)),
        )
    if name == "desk" and rng.random() < 0.7:
        layout.put("desk chair", _chair_at(rng), move @ _before(piece, rng), but=[place])
    if name == "basin" and rng.random() < 0.7:
        layout.put(
            "mirror",
            things.picture(rng, rng.uniform(0.4, 0.6), rng.uniform(0.5, 0.8), 1.15, mirror=True),
            move @ motion((0, -0.019, 0)),
        )


def _chair_at(rng: np.random.Generator) -> Piece:
    return furniture.office_chair(rng) if rng.random() < 0.5 else furniture.chair(rng)


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
    small = [things.prop(rng) for _ in range(int(rng.poisson(area * (1 + 9 * density))))]
    if area > 0.3 and rng.random() < 0.35:
        small.insert(0, things.screen(rng, rng.uniform(0.45, 1.0)))
    if rng.random() < 0.25:
        small.insert(0, plant(rng, rng.uniform(0.2, 0.5)))
    layout.put_on(piece, move, small, rng, on)


def _dine(layout: Layout, rng: np.random.Generator, density: float) -> None:
    """A table with chairs half under it."""
    made = furniture.table(rng, rng.uniform(0.7, 1.0 if layout.room.floor.area < 9 else 1.8))
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
            furniture.chair(np.random.default_rng(chairs if rng.random() < 0.8 else rng.integers(2**32)))
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
            things.picture(rng, w, h, rng.uniform(1.1, 1.6), mirror=mirror),
            rng,
            tries=4,
        )
    for _ in range(int(rng.poisson(1.5 * density))):
        layout.put_at_wall(
            "wall shelf",
            furniture.wall_shelf(rng, rng.uniform(0.4, 1.4), rng.uniform(0.9, 1.8)),
            rng,
            tries=4,
        )
    middle = np.array(layout.room.floor.centroid.coords)
    height = float(layout.room.height(middle)[0])
    if rng.random() < 0.6 and height > 2.2:
        lamp = centred(things.ceiling_lamp(rng, height - 0.001))
        if len(layout.room.ceilings) == 1:
            layout.put("ceiling lamp", lamp, motion((*middle[0], 0)))


def _lay_rugs(layout: Layout, rng: np.random.Generator) -> None:
    if layout.room.kind in ("bath", "kitchen") or rng.random() < 0.5:
        return
    low, high = np.array(layout.room.floor.bounds).reshape(2, 2)
    flat = centred(
        furniture.rug(rng.uniform(0.8, 2.4), rng.uniform(0.6, 1.7), rng.uniform(0.006, 0.015), rng)
    )
    ring = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * flat.bounds[1, :2]
    for _ in range(10):
        at, yaw = rng.uniform(low, high), rng.uniform(0, np.pi)
        frame = motion((*at, 0), yaw)
        plan = shapely.Polygon(ring @ frame[:2, :2].T + at)
        solid = [one.plan for one in layout.taken if one.low < 0.01 and one.high > 2.15]
        if layout.room.floor.contains(plan) and not any(plan.intersects(one) for one in solid):
            layout.parts += moved(flat.parts, frame, f"room {layout.number} ")
            return
