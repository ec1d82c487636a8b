# SPDX-License-Identifier: MIT
"""Furniture: seats, tables, beds and storage."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import shapely

from benchmarks.cases.houses.solids import (
    DARK,
    STEEL,
    WHITE,
    Colour,
    Part,
    Piece,
    box,
    cloth,
    cushion,
    joined,
    lathe,
    motion,
    moved,
    paint,
    sheet,
    slab,
    tube,
    wood,
)
from benchmarks.cases.houses.things import book_row, bowl
from scenes.checks import FloatArray


def chair(rng: np.random.Generator) -> Piece:
    """Return a chair with four legs and a back of slats, posts or board; the back is at y = 0."""
    width, depth = rng.uniform(0.38, 0.48), rng.uniform(0.38, 0.46)
    seat, top, lean = rng.uniform(0.43, 0.48), rng.uniform(0.8, 1.05), rng.uniform(0.03, 0.1)
    tint, thick = wood(rng) if rng.random() < 0.8 else STEEL, rng.uniform(0.012, 0.02)
    x, near, far, splay = width / 2 - thick, lean + thick, lean + depth - thick, rng.uniform(0, 0.03)
    legs = [
        _leg((side * (x + splay), y + way * splay, 0), (side * x, y, seat - 0.02), thick, rng)
        for side in (-1, 1)
        for y, way in ((near, -1), (far, 1))
    ]
    parts = [joined("chair legs", legs, tint)]
    board = (-width / 2, lean, seat - 0.02), (width / 2, lean + depth, seat)
    if rng.random() < 0.4:
        parts.append(
            Part("chair seat", cushion(board[0], np.add(board[1], (0, 0, 0.035)), power=0.2), cloth(rng))
        )
    else:
        parts.append(Part("chair seat", box(*board), tint))
    if rng.random() < 0.4:
        height = rng.uniform(0.1, 0.25)
        rails = [tube((s * x, near, height), (s * x, far, height), 0.009) for s in (-1, 1)]
        parts.append(
            joined("chair stretchers", [*rails, tube((-x, far, height), (x, far, height), 0.009)], tint)
        )
    parts.append(joined("chair back", _back(x, near, seat, top, lean, rng), tint))
    if rng.random() < 0.2:
        arms = [box((s * x - 0.022, near, seat + 0.2), (s * x + 0.022, far, seat + 0.225)) for s in (-1, 1)]
        arms += [tube((s * x, far - 0.03, seat), (s * x, far - 0.03, seat + 0.2), 0.012) for s in (-1, 1)]
        parts.append(joined("chair arms", arms, tint))
    return Piece(tuple(parts))


def _leg(
    foot: tuple[float, float, float], head: tuple[float, float, float], thick: float, rng: np.random.Generator
) -> FloatArray:
    return tube(foot, head, thick * 0.75, thick, n=int(rng.choice([4, 10])))


def _back(
    x: float, near: float, seat: float, top: float, lean: float, rng: np.random.Generator
) -> list[FloatArray]:
    """Posts that lean back, and between them slats across, bars upright, or a board."""
    foot, head = np.array([0, near, seat - 0.02]), np.array([0, near - lean, top])
    aside, along = np.array([x, 0, 0]), head - foot
    solids = [tube(foot + s * aside, head + s * aside, 0.016, 0.013) for s in (-1, 1)]
    thin = np.array([0, 0.008, 0])

    def slat(low: float, high: float, across: tuple[float, float] = (-1.0, 1.0)) -> FloatArray:
        at = np.array([foot + along * low, foot + along * high])
        grid = np.stack([at + across[0] * aside, at + across[1] * aside], axis=1)
        return _plank(grid - thin, grid + thin)

    kind = rng.integers(3)
    if kind == 0:
        n = int(rng.integers(2, 5))
        ends = np.linspace(0.35, 1.0, n + 1)
        solids += [slat(a + (b - a) * 0.35, b) for a, b in pairwise(ends)]
    elif kind == 1:
        at = np.linspace(-1, 1, int(rng.integers(5, 8)) + 1)
        solids += [slat(0.1, 0.9, (u - 0.05, u + 0.05)) for u in at[1:-1]] + [slat(0.87, 1.0)]
    else:
        solids.append(slat(rng.uniform(0.15, 0.45), 1.0))
    return solids


def _plank(near: FloatArray, far: FloatArray) -> FloatArray:
    """A board between two quads (2, 2, 3): rows from low to high, columns from left to right."""
    base = box((0, 0, 0), (1, 1, 1))
    x, y, z = (base[..., k : k + 1] for k in range(3))
    low = near[0, 0] * (1 - x) + near[0, 1] * x, near[1, 0] * (1 - x) + near[1, 1] * x
    step = (far - near)[0, 0]
    return np.asarray(low[0] * (1 - z) + low[1] * z + step * y)


def stool(rng: np.random.Generator) -> Piece:
    """Return a round stool with three or four legs."""
    radius, seat, tint = rng.uniform(0.15, 0.2), rng.uniform(0.42, 0.68), wood(rng)
    n, middle = int(rng.integers(3, 5)), np.array([0, radius + 0.03, 0])
    turn = 2 * np.pi * (np.arange(n) + 0.5) / n
    way = np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
    up = np.array([0, 0, seat - 0.03])
    legs = [tube(middle + one * radius, middle + one * radius * 0.7 + up, 0.014) for one in way]
    parts = (
        joined("stool legs", legs, tint),
        Part("stool seat", tube(middle + up, middle + up + [0, 0, 0.03], radius, n=24), tint),
    )
    return Piece(parts)


def office_chair(rng: np.random.Generator) -> Piece:
    """Return a chair on a star of five feet, with padded seat and back."""
    tint, seat, middle = cloth(rng), rng.uniform(0.44, 0.54), np.array([0, 0.32, 0])
    turn = 2 * np.pi * np.arange(5) / 5 + rng.uniform(0, 1)
    tips = middle + np.stack([0.28 * np.cos(turn), 0.28 * np.sin(turn), 0 * turn + 0.06], axis=1)
    feet = [tube(middle + [0, 0, 0.1], tip, 0.022, 0.014) for tip in tips]
    wheels = [cushion(tip - [0.025, 0.025, 0.06], tip + [0.025, 0.025, -0.01], power=1) for tip in tips]
    back = Part("office chair back", cushion((-0.21, -0.03, 0), (0.21, 0.04, 0.52), power=0.3), tint)
    parts = (
        joined("office chair feet", feet + wheels, DARK),
        Part("office chair column", tube(middle + [0, 0, 0.08], middle + [0, 0, seat], 0.025), STEEL),
        Part("office chair seat", cushion((-0.24, 0.1, seat - 0.03), (0.24, 0.56, seat + 0.06)), tint),
        Part("office chair bracket", box((-0.03, 0.07, seat - 0.02), (0.03, 0.3, seat)), DARK),
        Part("office chair spine", tube((0, 0.085, seat - 0.01), (0, 0.075, seat + 0.3), 0.018), DARK),
        *moved([back], motion((0, 0.07, seat + 0.1), pitch=rng.uniform(0.0, 0.15))),
    )
    return Piece(parts)


def sofa(rng: np.random.Generator, n_seats: int | None = None) -> Piece:
    """Return an armchair, or a sofa of two to four seats, with cushions that are soft and leaning."""
    n = int(rng.integers(1, 5)) if n_seats is None else n_seats
    seat_width, depth = rng.uniform(0.55, 0.75), rng.uniform(0.78, 0.98)
    seat, back, arm = rng.uniform(0.38, 0.46), rng.uniform(0.7, 0.95), rng.uniform(0.08, 0.22)
    arm_height, tint = rng.uniform(0.52, 0.66), cloth(rng)
    x, width, feet = n * seat_width / 2, n * seat_width + 2 * arm, rng.uniform(0.03, 0.14)
    soft = 0.15 if rng.random() < 0.5 else 0.3
    legs = [
        box((s * (width / 2 - 0.06) - 0.03, y, 0), (s * (width / 2 - 0.06) + 0.03, y + 0.06, feet))
        for s in (-1, 1)
        for y in (0.04, depth - 0.12)
    ]
    parts = [
        joined("sofa feet", legs, wood(rng)),
        Part("sofa base", box((-x - 0.01, 0.03, feet), (x + 0.01, depth - 0.03, seat - 0.12)), tint),
        Part("sofa back", cushion((-x - arm, 0.0, feet), (x + arm, 0.2, back - 0.06), power=soft), tint),
    ]
    for s, side in ((-1, "left"), (1, "right")):
        low = (min(s * x, s * (x + arm)), 0.0, feet)
        high = (max(s * x, s * (x + arm)), depth, arm_height)
        parts.append(Part(f"sofa {side} arm", cushion(low, high, power=soft), tint))
    for k in range(n):
        left = -x + k * seat_width
        low, high = (left, 0.16, seat - 0.13), (left + seat_width, depth + 0.01, seat + rng.uniform(0, 0.03))
        parts.append(Part(f"sofa seat {k + 1}", cushion(low, high, power=0.2), tint))
        leaning = cushion(
            (0.01 - seat_width / 2, -0.02, 0), (seat_width / 2 - 0.01, 0.15, back - seat + 0.06)
        )
        at = motion((left + seat_width / 2, 0.2, seat - 0.02), pitch=rng.uniform(0.1, 0.22))
        parts += moved([Part(f"sofa back cushion {k + 1}", leaning, tint)], at)
    for k in range(int(rng.integers(0, n + 2))):
        pillow = Part(f"pillow {k + 1}", cushion((-0.2, -0.06, 0), (0.2, 0.06, 0.38), power=0.55), cloth(rng))
        at = motion((rng.uniform(-x + 0.2, x - 0.19), 0.44, seat + 0.01), rng.uniform(-0.6, 0.6), 0.35)
        parts += moved([pillow], at)
    return Piece(tuple(parts))


def table(
    rng: np.random.Generator,
    width: float | None = None,
    depth: float | None = None,
    height: float | None = None,
) -> Piece:
    """Return a table with legs at its corners, on two trestles, or round and on one foot."""
    w = rng.uniform(0.8, 1.8) if width is None else width
    d = min(rng.uniform(0.6, 0.95), w) if depth is None else depth
    h = rng.uniform(0.71, 0.77) if height is None else height
    thick, tint = rng.uniform(0.018, 0.045), wood(rng)
    kind = (
        str(rng.choice(["legs", "legs", "trestles", "foot"]))
        if w < 1.3
        else str(rng.choice(["legs", "trestles"]))
    )
    if kind == "foot":
        return _round_table(min(w, 1.2) / 2, h, rng)
    parts = [Part("table top", box((-w / 2, 0, h - thick), (w / 2, d, h)), tint)]
    x, inset, under = w / 2 - rng.uniform(0.04, 0.1), rng.uniform(0.04, 0.09), h - thick
    if kind == "legs":
        size, n = rng.uniform(0.018, 0.04), int(rng.choice([4, 14]))
        legs = [
            tube((s * x, y, 0), (s * x, y, under), size * rng.uniform(0.7, 1), size, n=n)
            for s in (-1, 1)
            for y in (inset, d - inset)
        ]
        parts.append(joined("table legs", legs, tint if rng.random() < 0.7 else STEEL))
        if rng.random() < 0.6:
            low = under - rng.uniform(0.06, 0.11)
            rails = [box((-x, y - 0.01, low), (x, y + 0.01, under)) for y in (inset, d - inset)]
            rails += [box((s * x - 0.01, inset, low), (s * x + 0.01, d - inset, under)) for s in (-1, 1)]
            parts.append(joined("table apron", rails, tint))
    else:
        legs = [
            tube((s * (x - 0.1) + lean, y, 0), (s * (x - 0.1), d / 2, under), 0.022, n=4)
            for s in (-1, 1)
            for y in (inset, d - inset)
            for lean in (-0.08, 0.08)
        ]
        parts.append(joined("table trestles", legs, tint))
    return Piece(tuple(parts), tops=((-w / 2, 0, w / 2, d, h),))


def _round_table(radius: float, height: float, rng: np.random.Generator) -> Piece:
    tint, base = wood(rng), radius * rng.uniform(0.5, 0.7)
    foot = [(0, 0), (base, 0), (base, 0.02), (0.05, 0.06), (0.04, height - 0.1), (0.12, height - 0.03)]
    parts = (
        Part("table foot", lathe([*foot, (0, height - 0.03)], 20), tint),
        Part("table top", tube((0, 0, height - 0.03), (0, 0, height), radius, n=32), tint),
    )
    inside = radius * 0.65
    return Piece(
        moved(parts, motion((0, radius, 0))),
        tops=((-inside, radius - inside, inside, radius + inside, height),),
    )


def desk(rng: np.random.Generator) -> Piece:
    """Return a desk with a block of drawers under one end, their fronts proud."""
    w, d, h, tint = rng.uniform(1.0, 1.7), rng.uniform(0.55, 0.8), rng.uniform(0.71, 0.76), wood(rng)
    side, block = int(rng.choice([-1, 1])), rng.uniform(0.35, 0.45)
    inner, outer = side * (w / 2 - block), side * (w / 2 - 0.01)
    left, right = min(inner, outer), max(inner, outer)
    parts = [
        Part("desk top", box((-w / 2, 0, h - 0.025), (w / 2, d, h)), tint),
        Part(
            "desk side",
            box(
                (-side * (w / 2 - 0.03) - 0.015, 0.02, 0),
                (-side * (w / 2 - 0.03) + 0.015, d - 0.03, h - 0.025),
            ),
            tint,
        ),
        Part("desk drawers", box((left, 0.05, 0.03), (right, d - 0.05, h - 0.025)), tint),
    ]
    n = int(rng.integers(2, 5))
    edges = np.linspace(0.05, h - 0.04, n + 1)
    fronts = [
        box((left + 0.004, d - 0.05, low + 0.003), (right - 0.004, d - 0.032, high - 0.003))
        for low, high in pairwise(edges)
    ]
    middle = (left + right) / 2
    pulls = [
        tube((middle - 0.05, d - 0.02, z), (middle + 0.05, d - 0.02, z), 0.007)
        for z in (edges[:-1] + edges[1:]) / 2
    ]
    parts += [joined("desk drawer fronts", fronts, tint), joined("desk pulls", pulls, STEEL)]
    if rng.random() < 0.5:
        parts.append(
            Part("desk back", box((-w / 2 + 0.03, 0.05, 0.3), (w / 2 - 0.03, 0.068, h - 0.025)), tint)
        )
    return Piece(tuple(parts), tops=((-w / 2, 0, w / 2, d, h),))


def coffee_table(rng: np.random.Generator) -> Piece:
    """Return a low table, now and then with a shelf under its top."""
    w, d, h = rng.uniform(0.6, 1.2), rng.uniform(0.45, 0.7), rng.uniform(0.32, 0.48)
    made = table(rng, w, d, h)
    if made.parts[0].name != "table top" or rng.random() < 0.5:
        return made
    shelf = Part("table shelf", box((-w / 2 + 0.08, 0.08, 0.12), (w / 2 - 0.08, d - 0.08, 0.135)), wood(rng))
    return Piece((*made.parts, shelf), tops=made.tops)


def bed(rng: np.random.Generator) -> Piece:
    """Return a bed, its head at the wall: frame, mattress, duvet in folds, pillows."""
    w, length, tint = float(rng.choice([0.9, 1.2, 1.4, 1.6, 1.8])), rng.uniform(1.95, 2.1), wood(rng)
    low, high = rng.uniform(0.1, 0.3), rng.uniform(0.42, 0.58)
    x, head = w / 2 + 0.03, rng.uniform(0.75, 1.2)
    legs = [
        box((s * (x - 0.05) - 0.03, y, 0), (s * (x - 0.05) + 0.03, y + 0.06, low))
        for s in (-1, 1)
        for y in (0.06, length - 0.06)
    ]
    rails = [box((-x, 0.05, low), (x, length + 0.08, (low + high) / 2))]
    mattress = cushion((-w / 2, 0.06, (low + high) / 2 - 0.05), (w / 2, length + 0.06, high), power=0.12)
    parts = [
        joined("bed legs", legs, tint),
        joined("bed frame", rails, tint),
        Part("headboard", box((-x - 0.02, 0, 0), (x + 0.02, 0.045, head)), tint),
        Part("mattress", mattress, WHITE),
        Part("duvet", sheet(_folds(w, length, high, rng), 0.035), cloth(rng)),
    ]
    for k in range(1 if w < 1.3 else 2):
        middle = 0.0 if w < 1.3 else (k - 0.5) * w / 2
        pillow = cushion((-0.33, -0.2, 0), (0.33, 0.2, 0.14), power=0.5)
        at = motion((middle, 0.32, high - 0.01), rng.uniform(-0.15, 0.15), rng.uniform(-0.3, 0.05))
        parts += moved([Part(f"bed pillow {k + 1}", pillow, WHITE)], at)
    if rng.random() < 0.3:
        parts.append(Part("footboard", box((-x, length + 0.08, 0), (x, length + 0.12, high + 0.1)), tint))
    return Piece(tuple(parts))


def _folds(w: float, length: float, high: float, rng: np.random.Generator) -> FloatArray:
    """A duvet (16, 21, 3) over the foot end of a mattress; it hangs over both sides."""
    start, hang = rng.uniform(0.55, 0.95), rng.uniform(0.08, 0.25)
    reach = w / 2 + hang
    u, y = np.meshgrid(np.linspace(-reach, reach, 21), np.linspace(start, length + 0.05, 16))
    over = np.maximum(np.abs(u) - w / 2, 0)
    phase = rng.uniform(0, 6, 4)
    waves = 0.02 * (np.sin(3 * u + phase[0]) * np.sin(4 * y + phase[1]) + np.sin(7 * u + 5 * y + phase[2]))
    z = high + 0.075 + waves * (over == 0) - over - 0.03 * (over > 0)
    x = np.clip(u, -w / 2 - 0.035, w / 2 + 0.035) + 0.012 * np.sign(u) * np.sin(9 * y + phase[3]) * (over > 0)
    return np.stack([x, y, z], axis=-1)


def rug(w: float, d: float, high: float, rng: np.random.Generator) -> Piece:
    """Return a rug: a thin slab, rectangular or round; things stand on it."""
    shape = shapely.box(-w / 2, 0, w / 2, d)
    if rng.random() < 0.25:
        shape = shapely.Point(0, d / 2).buffer(min(w, d) / 2, quad_segs=8)
    return Piece((Part("rug", slab(shape, 0.001, high), cloth(rng)),))


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
