# SPDX-License-Identifier: MIT
"""Parts that are swept once: extruded plates with holes, slots and pockets, and turned shafts; millimetres.

Of 6 to 20 segments each: polygons whose corners are sharp, rounded or broken, at right or any angles, some
alike in a mirror; shafts with steps, tapers, fillets, chamfers and bores. No segment is shorter than 5 mm.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import shapely
from scipy.spatial.transform import Rotation

from scenes.checks import FloatArray
from scenes.pose import Pose

LEAST, MOST = 6, 20
"""Segments of a part."""
_LEAST_MM, _CLEAR_MM = 5.0, 6.0  # of a segment; between loops
_N_POINTS = 25_000
_MIRROR = 2  # of so many outlines one is alike in a mirror


@dataclass(frozen=True, slots=True, eq=False)
class TrueSegment:
    """A line or an arc: its ends (2,), of an arc the centre (2,), radius, and angle from start to end."""

    start: FloatArray
    end: FloatArray
    centre: FloatArray | None = None
    radius: float = 0.0
    turn: float = 0.0

    @property
    def length(self) -> float:
        """Millimetres."""
        return abs(self.turn) * self.radius or float(np.linalg.norm(self.end - self.start))

    def places(self, share: FloatArray) -> FloatArray:
        """Places (n, 2) at shares (n,) of its length."""
        if self.centre is None:
            return np.asarray(self.start + share[:, None] * (self.end - self.start))
        away = self.start - self.centre
        angle = np.arctan2(away[1], away[0]) + share * self.turn
        return np.asarray(self.centre + self.radius * np.column_stack([np.cos(angle), np.sin(angle)]))


@dataclass(frozen=True, slots=True, eq=False)
class TrueLoop:
    """A ring of segments, between two heights of an extrusion; `kind` as profiles have it."""

    segments: tuple[TrueSegment, ...]
    kind: str
    low: float = 0.0
    high: float = 0.0

    @property
    def polygon(self) -> shapely.Polygon:
        """The area within."""
        share = np.linspace(0, 1, 24)
        return shapely.Polygon(np.concatenate([one.places(share)[:-1] for one in self.segments]))


@dataclass(frozen=True, slots=True, eq=False)
class SweptCase:
    """A part: its loops, the pairs of segments that a mirror swaps, and where it stands.

    `pairs` are places among all segments, loop by loop. Lengths are millimetres, of `world` metres.
    """

    kind: Literal["extruded", "revolved"]
    loops: tuple[TrueLoop, ...]
    pairs: tuple[tuple[int, int], ...]
    world: Pose

    @property
    def segments(self) -> list[TrueSegment]:
        """All segments."""
        return [one for loop in self.loops for one in loop.segments]


def swept_case(seed: int) -> SweptCase:
    """The part of a seed: even ones are extruded, odd ones turned."""
    rng = np.random.default_rng([494, seed])
    while True:
        loops, pairs = _plate(rng) if seed % 2 == 0 else _shaft(rng)
        segments = [one for loop in loops for one in loop.segments]
        if LEAST <= len(segments) <= MOST and min(one.length for one in segments) >= _LEAST_MM:
            break
    turn = Rotation.random(random_state=int(rng.integers(2**31))).as_matrix()
    pose = Pose.from_parts(turn, rng.uniform(-0.2, 0.2, 3))
    kind: Literal["extruded", "revolved"] = "extruded" if seed % 2 == 0 else "revolved"
    return SweptCase(kind, tuple(loops), tuple(pairs), pose)


def sampled(case: SweptCase, noise_mm: float, seed: int) -> FloatArray:
    """Points (n, 3), metres, spread over the whole surface, with normal noise in all directions."""
    rng = np.random.default_rng([495, seed])
    local = _of_plate(case, rng) if case.kind == "extruded" else _of_shaft(case, rng)
    local = local + noise_mm * rng.normal(size=local.shape)
    return case.world.apply(local * 1e-3)


def ring_of(corners: FloatArray, treatment: Sequence[tuple[str, float]]) -> list[TrueSegment]:
    """A polygon (n, 2) with its corners treated: "sharp", "round" by a radius, or "chamfer" by a length."""
    n, cuts = len(corners), list[tuple[FloatArray, FloatArray, TrueSegment | None]]()
    for k, (how, size) in enumerate(treatment):
        here = corners[k]
        back, ahead = (
            each / np.linalg.norm(each) for each in (corners[k - 1] - here, corners[(k + 1) % n] - here)
        )
        half = np.arccos(np.clip(back @ ahead, -1, 1)) / 2
        reach = {"sharp": 0.0, "chamfer": size}.get(how, size / np.tan(half))
        first, last = here + reach * back, here + reach * ahead
        made = None
        if how == "round":
            centre = here + size / np.sin(half) * (back + ahead) / np.linalg.norm(back + ahead)
            side = np.sign(back[0] * ahead[1] - back[1] * ahead[0])
            made = TrueSegment(first, last, centre, size, float(-side * (np.pi - 2 * half)))
        elif how == "chamfer":
            made = TrueSegment(first, last)
        cuts.append((first, last, made))
    ring = []
    for k, (_, last, made) in enumerate(cuts):
        ring += [made] if made is not None else []
        following = cuts[(k + 1) % n][0]
        ring.append(TrueSegment(last, following))
        if (following - last) @ (corners[(k + 1) % n] - corners[k]) <= 0:
            return [TrueSegment(last, last)]  # no room: too short, so that another is made
    return ring


def _plate(rng: np.random.Generator) -> tuple[list[TrueLoop], list[tuple[int, int]]]:
    height = float(rng.uniform(12, 35))
    if rng.random() < 0.2:
        ring, pairs = _lug(rng), list[tuple[int, int]]()
    else:
        ring, pairs = _outline(rng)
    outer = TrueLoop(tuple(ring), "outer", 0.0, height)
    if min(one.length for one in ring) < _LEAST_MM or not outer.polygon.is_valid:
        return [outer], []
    loops = [outer]
    for inner in _inner(rng, outer, height):
        free = outer.polygon.buffer(-_CLEAR_MM)
        clear = all(inner.polygon.distance(other.polygon) > _CLEAR_MM for other in loops[1:])
        if free.contains(inner.polygon) and clear:
            loops.append(inner)
    return loops, pairs


def _outline(rng: np.random.Generator) -> tuple[list[TrueSegment], list[tuple[int, int]]]:
    """A rectangle, L, T or U, or a polygon of any angles, with treated corners; some alike in a mirror."""
    wide, deep = rng.uniform(70, 110), rng.uniform(45, 80)
    a, b, _ = rng.uniform(0.25, 0.4, 3)
    shape = rng.choice(["rectangle", "L", "T", "U", "any"])
    halves = {
        "rectangle": [(0, 0), (0.5, 0), (0.5, 1), (0, 1)],
        "T": [(0, 0), (a / 2, 0), (a / 2, 1 - b), (0.5, 1 - b), (0.5, 1), (0, 1)],
        "U": [(0, 0), (0.5, 0), (0.5, 1), (0.5 - a, 1), (0.5 - a, b), (0, b)],
    }
    if shape in halves:
        half = np.array(halves[str(shape)][1:-1]) * [wide, deep]
        how = _treatments(rng, len(half))
        corners = np.concatenate([half, half[::-1] * [-1.0, 1.0]])
        if shape in ("T", "U") and rng.random() < 0.5:  # not alike in the mirror
            corners[len(half) :, 0] *= rng.uniform(0.75, 0.95)
            return ring_of(corners, _treatments(rng, len(corners))), []
        ring = ring_of(corners, [*how, *how[::-1]])
        return ring, _mirrored(ring)
    if shape == "L":
        corners = np.array([(0, 0), (1, 0), (1, b), (a, b), (a, 1), (0, 1)]) * [wide, deep]
    else:
        angle = np.sort((np.arange(6) + rng.uniform(-0.3, 0.3, 6)) * np.pi / 3)
        corners = np.column_stack([wide / 2 * np.cos(angle), deep * 0.6 * np.sin(angle)])
    return ring_of(corners, _treatments(rng, len(corners))), []


def _mirrored(ring: Sequence[TrueSegment]) -> list[tuple[int, int]]:
    """Pairs of segments that x -> -x swaps."""
    middle = [one.places(np.array([0.5]))[0] for one in ring]
    flip = np.array([-1.0, 1.0])
    return [(i, j) for i in range(len(ring)) for j in range(i + 1, len(ring))
            if np.linalg.norm(middle[i] * flip - middle[j]) < 1e-9]  # fmt: skip


def _treatments(rng: np.random.Generator, n: int) -> list[tuple[str, float]]:
    radius = float(rng.uniform(4, 10))
    sizes = {"sharp": 0.0, "round": radius, "chamfer": float(rng.uniform(5, 9))}
    hows = rng.choice(list(sizes), n, p=[0.45, 0.4, 0.15])
    other = rng.random(n) < 0.25  # of a radius of its own
    return [
        (str(how), float(rng.uniform(4, 10)) if differs and how == "round" else sizes[str(how)])
        for how, differs in zip(hows, other, strict=True)
    ]


def _lug(rng: np.random.Generator) -> list[TrueSegment]:
    """Two arcs and the lines that touch both."""
    large, small, apart = rng.uniform(22, 32), rng.uniform(10, 18), rng.uniform(50, 75)
    lean = np.arccos((large - small) / apart)
    ways = [np.array([np.cos(angle), np.sin(angle)]) for angle in (-lean, lean)]
    far = np.array([apart, 0.0])
    low, high = [(large * way, far + small * way) for way in ways]
    return [
        TrueSegment(low[0], low[1]),
        TrueSegment(low[1], high[1], far, small, float(2 * lean)),
        TrueSegment(high[1], high[0]),
        TrueSegment(high[0], low[0], np.zeros(2), large, float(2 * np.pi - 2 * lean)),
    ]


def _inner(rng: np.random.Generator, outer: TrueLoop, height: float) -> list[TrueLoop]:
    """Holes, slots and pockets anywhere over an outline, more than there is room for."""
    low, high = np.array(outer.polygon.bounds).reshape(2, 2)
    radius, loops = float(rng.uniform(4, 8)), list[TrueLoop]()
    concentric = [one for one in outer.segments if one.centre is not None and one.radius > 9]
    for one in concentric:
        if rng.random() < 0.7:
            loops.append(TrueLoop(_circle(one.centre, one.radius * 0.4), "hole", 0.0, height))
    for _ in range(int(rng.integers(1, 4))):
        loops.append(TrueLoop(_circle(rng.uniform(low, high), radius), "hole", 0.0, height))
    if rng.random() < 0.5:
        floor = float(rng.choice([0.0, 0.5 * height]))
        loops.append(TrueLoop(tuple(_slot(rng, rng.uniform(low, high))), "slot", floor, height))
    if rng.random() < 0.5:
        floor = float(rng.choice([0.0, 0.4 * height]))
        size, r = rng.uniform(18, 30, 2), float(rng.uniform(4, 6))
        corners = np.array([(0, 0), (1, 0), (1, 1), (0, 1)]) * size + rng.uniform(low, high - size.min())
        loops.append(TrueLoop(tuple(ring_of(corners, [("round", r)] * 4)), "pocket", floor, height))
    return loops


def _circle(centre: FloatArray | None, radius: float) -> tuple[TrueSegment, ...]:
    middle = np.zeros(2) if centre is None else centre
    start = middle + [radius, 0.0]
    return (TrueSegment(start, start, middle, radius, 2 * np.pi),)


def _slot(rng: np.random.Generator, place: FloatArray) -> list[TrueSegment]:
    angle, half, r = (
        rng.choice([0.0, np.pi / 2, rng.uniform(0, np.pi)]),
        rng.uniform(8, 14),
        rng.uniform(4, 6),
    )
    way = np.array([np.cos(angle), np.sin(angle)])
    side, one, two = np.array([-way[1], way[0]]), place - half * way, place + half * way
    return [
        TrueSegment(one - r * side, two - r * side),
        TrueSegment(two - r * side, two + r * side, two, float(r), np.pi),
        TrueSegment(two + r * side, one + r * side),
        TrueSegment(one + r * side, one - r * side, one, float(r), np.pi),
    ]


def _shaft(rng: np.random.Generator) -> tuple[list[TrueLoop], list[tuple[int, int]]]:
    """Steps along x, radii y: some tapered; inner corners may be round, outer ones broken; a bore or none."""
    n = int(rng.integers(2, 5))
    length = np.concatenate([[0.0], np.cumsum(rng.uniform(16, 32, n))])
    radius = rng.uniform(16, 42, n)
    bore = float(rng.uniform(6, 10)) if rng.random() < 0.5 else 0.0
    corners, how = [(0.0, bore)], [("sharp", 0.0)]
    fillet, chamfer = float(rng.uniform(4, 6)), float(rng.uniform(4, 6))
    for k in range(n):
        ends = (radius[k], radius[k] * (rng.uniform(0.75, 0.9) if rng.random() < 0.25 else 1.0))
        for side in (0, 1):
            corners.append((length[k + side], ends[side]))
            beside = radius[k - 1] if side == 0 and k else radius[k + 1] if side and k + 1 < n else 0.0
            broken = ("chamfer", chamfer) if rng.random() < 0.4 else ("sharp", 0.0)
            how.append(
                (("round", fillet) if rng.random() < 0.5 else ("sharp", 0.0))
                if beside > ends[side]
                else broken
            )
    corners.append((length[-1], bore))
    how.append(("sharp", 0.0))
    ring = ring_of(np.array(corners)[::-1], how[::-1])
    if len(ring) < LEAST or not shapely.Polygon([one.start for one in ring]).is_valid:
        return [], []
    faces = [one for one in ring if max(one.start[1], one.end[1]) > 0]  # not the axis
    return [TrueLoop(tuple(faces), "turned")], []


def _of_plate(case: SweptCase, rng: np.random.Generator) -> FloatArray:
    """Points (n, 3) on walls and caps."""
    outer, *inner = case.loops
    parts: list[tuple[float, Any]] = [
        (one.length * (loop.high - loop.low), (one, loop.low, loop.high))
        for loop in case.loops
        for one in loop.segments
    ]
    through = shapely.union_all([loop.polygon for loop in inner if loop.low == 0.0])
    every = shapely.union_all([loop.polygon for loop in inner])
    flats = [(outer.polygon.difference(every), outer.high), (outer.polygon.difference(through), 0.0)]
    flats += [(loop.polygon, loop.low) for loop in inner if loop.low > 0.0]
    parts += [(flat.area, (flat, height)) for flat, height in flats]
    total, points = sum(area for area, _ in parts), []
    for area, what in parts:
        n = round(_N_POINTS * area / total)
        if len(what) == 3:
            places, heights = what[0].places(rng.random(n)), rng.uniform(what[1], what[2], n)
        else:
            places, heights = _within(what[0], n, rng), np.full(n, what[1])
        points.append(np.column_stack([places, heights]))
    return np.concatenate(points)


def _within(area: shapely.Geometry, n: int, rng: np.random.Generator) -> FloatArray:
    """Places (n, 2) spread over an area."""
    low_x, low_y, high_x, high_y = area.bounds
    found = np.zeros((0, 2))
    while len(found) < n:
        some = rng.uniform((low_x, low_y), (high_x, high_y), (2 * n, 2))
        found = np.concatenate([found, some[shapely.contains_xy(area, some)]])
    return found[:n]


def _of_shaft(case: SweptCase, rng: np.random.Generator) -> FloatArray:
    """Points (n, 3) on a body turned about x."""
    fine, points = np.linspace(0, 1, 400), []
    segments = case.segments
    area = [one.length * float(one.places(fine)[:, 1].mean()) for one in segments]
    for one, share in zip(segments, np.array(area) / sum(area), strict=True):
        n = round(_N_POINTS * float(share))
        weight = np.cumsum(one.places(fine)[:, 1])
        place = one.places(np.interp(rng.random(n), weight / weight[-1], fine))
        angle = rng.uniform(0, 2 * np.pi, n)
        points.append(
            np.column_stack([place[:, 0], place[:, 1] * np.cos(angle), place[:, 1] * np.sin(angle)])
        )
    return np.concatenate(points)
