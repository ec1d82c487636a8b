# SPDX-License-Identifier: MIT
"""Storage: cabinets with doors and drawers that stand proud, shelves with books, counters, wall cabinets."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import shapely

from benchmarks.completion.scenes.houses.furniture.parts import (
    DARK,
    STEEL,
    WHITE,
    Colour,
    Part,
    Piece,
    joined,
    motion,
    moved,
    paint,
    wood,
)
from benchmarks.completion.scenes.houses.furniture.props import book_row, bowl
from benchmarks.completion.scenes.houses.furniture.solids import box, slab, tube
from scenes.checks import FloatArray

_PROUD_M = 0.019  # of a front before its cabinet
_GAP_M = 0.003  # half of that between fronts


def cabinet(rng: np.random.Generator, w: float, d: float, h: float, name: str = "cabinet") -> Piece:
    """Return a closed cabinet on a plinth or on feet, its front divided into doors and drawers."""
    tint = wood(rng) if rng.random() < 0.5 else paint(rng)
    foot, body = rng.uniform(0.04, 0.16), d - _PROUD_M
    parts = [Part(name, box((-w / 2, 0, foot), (w / 2, body, h)), tint)]
    if rng.random() < 0.5:
        plinth = box((-w / 2 + 0.01, 0.01, 0), (w / 2 - 0.01, body - 0.05, foot))
        parts.append(Part(f"{name} plinth", plinth, DARK))
    else:
        legs = [
            tube((s * (w / 2 - 0.05), y, 0), (s * (w / 2 - 0.05), y, foot), 0.015, 0.02)
            for s in (-1, 1)
            for y in (0.05, body - 0.05)
        ]
        parts.append(joined(f"{name} feet", legs, tint))
    parts += fronts(rng, (-w / 2, foot, w / 2, h), body, name, tint)
    if rng.random() < 0.5:
        top = box((-w / 2 - 0.015, 0, h), (w / 2 + 0.015, d + 0.015, h + 0.022))
        parts.append(Part(f"{name} top", top, tint))
        h += 0.022
    tops = ((-w / 2, 0.0, w / 2, d, h),) if h < 1.6 else ()
    return Piece(tuple(parts), tops=tops)


def fronts(
    rng: np.random.Generator, face: tuple[float, float, float, float], y: float, name: str, tint: Colour
) -> list[Part]:
    """Return doors, and drawers unless it hangs, over `face` (x0, z0, x1, z1), the cabinet's front at y."""
    x0, z0, x1, z1 = face
    columns = np.linspace(x0, x1, max(1, round((x1 - x0) / rng.uniform(0.4, 0.6))) + 1)
    boards, pulls, long_pulls = [], [], rng.random() < 0.5
    for left, right in pairwise(columns):
        high = z1 - z0
        n = (
            int(rng.integers(2, 5))
            if high < 1.3 and z0 < 1.0 and rng.random() < 0.4
            else 1
            if high < 1.2
            else 2
        )
        rows = np.linspace(z0, z1, n + 1)
        if n == 2:
            rows[1] = z0 + high * rng.uniform(0.3, 0.75)
        for low, top in pairwise(rows):
            boards.append(box((left + _GAP_M, y, low + _GAP_M), (right - _GAP_M, y + _PROUD_M, top - _GAP_M)))
            wide, out = top - low < right - left, y + _PROUD_M
            middle = np.array([(left + right) / 2 if wide else right - 0.05, out + 0.018, (low + top) / 2])
            half = np.array([0.06, 0, 0]) if wide else np.array([0, 0, min(0.08, (top - low) / 3)])
            if long_pulls:
                pulls.append(tube(middle - half, middle + half, 0.006, n=8))
                pulls += [
                    tube(e - [0, 0.02, 0], e, 0.005, n=6) for e in (middle - half * 0.9, middle + half * 0.9)
                ]
            else:
                pulls.append(tube(middle - [0, 0.019, 0], middle, 0.012, 0.016, n=10))
    return [joined(f"{name} fronts", boards, tint), joined(f"{name} pulls", pulls, STEEL)]


def bookshelf(rng: np.random.Generator, w: float, d: float, h: float, *, fullness: float = 0.8) -> Piece:
    """Return open shelves with books and things on them, now and then with a door ajar below."""
    tint, thick = wood(rng) if rng.random() < 0.6 else paint(rng), rng.uniform(0.016, 0.028)
    boards = [box((s * w / 2 - (s > 0) * thick, 0, 0), (s * w / 2 + (s < 0) * thick, d, h)) for s in (-1, 1)]
    parts = [joined("shelf sides", boards, tint)]
    if rng.random() < 0.75:
        parts.append(
            Part("shelf back", box((-w / 2 + thick, 0, 0.03), (w / 2 - thick, 0.006, h - thick)), tint)
        )
    levels, z = [0.05], 0.05
    while z + 0.5 < h:
        z += rng.uniform(0.26, 0.42)
        levels.append(z)
    levels.append(h)
    inner = (-w / 2 + thick, w / 2 - thick)
    parts.append(
        joined("shelf boards", [box((inner[0], 0.006, at - thick), (inner[1], d, at)) for at in levels], tint)
    )
    for number, (low, high) in enumerate(pairwise(levels)):
        room = high - low - thick - 0.015
        if rng.random() < fullness:
            parts += moved(
                book_row(rng, inner[1] - inner[0], room, d),
                motion((inner[0], 0.012, low)),
                f"row {number + 1} ",
            )
    if len(levels) > 3 and rng.random() < 0.3:
        parts += _ajar_doors(rng, inner, d, levels, tint)
    tops = ((-w / 2, 0.0, w / 2, d, h),) if h < 1.6 else ()
    return Piece(tuple(parts), tops=tops)


def _ajar_doors(
    rng: np.random.Generator, inner: tuple[float, float], d: float, levels: list[float], tint: Colour
) -> tuple[Part, ...]:
    """Two doors before the lowest shelf, one of them now and then open."""
    half, high = (inner[1] - inner[0]) / 2, levels[1] - levels[0] - 0.03
    if half > 0.6:
        return ()
    found: tuple[Part, ...] = ()
    for s, x in ((1, inner[0]), (-1, inner[1])):
        angle = rng.uniform(0.15, 1.4) if rng.random() < 0.5 else 0.0
        low, top = (min(0.0, s * (half - 0.003)), 0, 0), (max(0.0, s * (half - 0.003)), 0.018, high)
        door = Part("shelf door", box(low, top), tint)
        found += moved([door], motion((x, d, levels[0] + 0.005), s * angle))
    return found


def wall_shelf(rng: np.random.Generator, w: float, low: float) -> Piece:
    """Return a board on brackets at height `low`, with books or things on it."""
    d, tint, thick = rng.uniform(0.16, 0.3), wood(rng), rng.uniform(0.018, 0.035)
    parts = [Part("wall shelf", box((-w / 2, 0, low), (w / 2, d, low + thick)), tint)]
    arms = [box((s * w * 0.35 - 0.01, 0, low - 0.12), (s * w * 0.35 + 0.01, 0.02, low)) for s in (-1, 1)]
    parts.append(joined("shelf brackets", arms, STEEL))
    if rng.random() < 0.8:
        parts += moved(book_row(rng, w, 0.3, d), motion((-w / 2, 0.01, low + thick)))
    return Piece(tuple(parts))


def counter(rng: np.random.Generator, w: float) -> Piece:
    """Return a run of kitchen cabinets with a worktop, sink, hob and tap."""
    d, h, over = rng.uniform(0.58, 0.64), rng.uniform(0.84, 0.93), 0.02
    tint, body = paint(rng) if rng.random() < 0.7 else wood(rng), d - _PROUD_M - over
    top = shapely.box(-w / 2, 0, w / 2, d)
    parts = [
        Part("counter plinth", box((-w / 2 + 0.01, 0.02, 0), (w / 2 - 0.01, body - 0.05, 0.12)), DARK),
        Part("counter body", box((-w / 2, 0, 0.12), (w / 2, body, h - 0.19)), tint),
        *fronts(rng, (-w / 2, 0.12, w / 2, h - 0.04), body, "counter", tint),
    ]
    skin = [
        box((-w / 2, 0, h - 0.19), (w / 2, 0.02, h - 0.04)),
        box((-w / 2, body - 0.02, h - 0.19), (w / 2, body, h - 0.04)),
    ]
    skin += [
        box((s * w / 2 - (s > 0) * 0.02, 0.02, h - 0.19), (s * w / 2 + (s < 0) * 0.02, body - 0.02, h - 0.04))
        for s in (-1, 1)
    ]
    parts.append(joined("counter box", skin, tint))
    x, side = rng.uniform(-w / 2 + 0.35, w / 2 - 0.35), 0.24
    sink = shapely.box(x - side, 0.12, x + side, d - 0.12)
    if w > 1.0:
        parts += _sink(sink, h)
        top = top.difference(sink)
        away = x + 0.9 if x + 1.2 < w / 2 else x - 0.9
        if abs(away) + 0.3 < w / 2:
            parts.append(Part("hob", box((away - 0.29, 0.06, h), (away + 0.29, d - 0.08, h + 0.006)), DARK))
    parts.append(Part("worktop", slab(top, h - 0.038, h), wood(rng)))
    clear = (x + side + 0.05, w / 2) if x < 0 else (-w / 2, x - side - 0.05)
    tops = ((clear[0], 0.0, clear[1], d, h + 0.006),) if clear[1] - clear[0] > 0.2 else ()
    return Piece(tuple(parts), tops=tops)


def _sink(plan: shapely.Polygon, h: float) -> list[Part]:
    """A basin that hangs from the rim of a hole, and a tap behind it."""
    x0, y0, x1, y1 = plan.bounds
    rim = slab(shapely.box(x0 - 0.015, y0 - 0.015, x1 + 0.015, y1 + 0.015).difference(plan), h, h + 0.004)
    wall = slab(plan.difference(plan.buffer(-0.01)), h - 0.17, h)
    bottom = box((x0, y0, h - 0.18), (x1, y1, h - 0.17))
    middle, back = (x0 + x1) / 2, y0 - 0.04
    neck = [
        tube((middle, back, h), (middle, back, h + 0.25), 0.014),
        tube((middle, back, h + 0.24), (middle, back + 0.17, h + 0.2), 0.011),
    ]
    return [joined("sink", [rim, wall, bottom], STEEL), joined("tap", neck, STEEL)]


def wall_cabinet(rng: np.random.Generator, w: float) -> Piece:
    """Return cabinets that hang above a counter, now and then with a hood between them."""
    low, d = rng.uniform(1.35, 1.5), rng.uniform(0.3, 0.37)
    h, tint = rng.uniform(0.5, 0.8), paint(rng)
    body = d - _PROUD_M
    parts = [Part("wall cabinet", box((-w / 2, 0, low), (w / 2, body, low + h)), tint)]
    parts += fronts(rng, (-w / 2, low, w / 2, low + h), body, "wall cabinet", tint)
    return Piece(tuple(parts))


def fridge(rng: np.random.Generator) -> Piece:
    """Return a refrigerator: two doors that stand proud, with long grips."""
    w, d, h, split = (
        rng.uniform(0.54, 0.7),
        rng.uniform(0.58, 0.68),
        rng.uniform(1.3, 1.95),
        rng.uniform(0.3, 0.7),
    )
    tint = WHITE if rng.random() < 0.6 else STEEL
    parts = [Part("fridge", box((-w / 2, 0.02, 0.03), (w / 2, d - 0.06, h)), tint)]
    parts.append(Part("fridge foot", box((-w / 2 + 0.02, 0.05, 0), (w / 2 - 0.02, d - 0.1, 0.03)), DARK))
    doors = [(0.04, split * h - 0.004), (split * h + 0.004, h - 0.002)]
    parts.append(joined("fridge doors", [box((-w / 2, d - 0.056, a), (w / 2, d, b)) for a, b in doors], tint))
    grips = [
        tube((w / 2 - 0.05, d + 0.02, a), (w / 2 - 0.05, d + 0.02, a + 0.25), 0.01)
        for a in (split * h - 0.3, split * h + 0.05)
    ]
    parts.append(joined("fridge grips", grips, STEEL))
    return Piece(tuple(parts))


def washing_machine(rng: np.random.Generator) -> Piece:
    """Return a washing machine with a round door."""
    w, d, h = 0.6, rng.uniform(0.52, 0.62), 0.85
    parts = [Part("washing machine", box((-w / 2, 0.03, 0), (w / 2, d - 0.03, h)), WHITE)]
    ring: FloatArray = tube((0, d - 0.03, 0.42), (0, d + 0.01, 0.42), 0.2, 0.17, n=28)
    parts.append(Part("washing machine door", ring, STEEL))
    parts.append(
        Part(
            "washing machine panel",
            box((-w / 2 + 0.01, d - 0.03, 0.72), (w / 2 - 0.01, d - 0.015, 0.84)),
            STEEL,
        )
    )
    parts += moved([Part("laundry bowl", bowl(0.2, 0.14), paint(rng))], motion((0.0, d / 2, h)))
    return Piece(tuple(parts))
