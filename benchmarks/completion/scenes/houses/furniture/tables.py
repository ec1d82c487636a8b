# SPDX-License-Identifier: MIT
"""Tables and beds: on legs, trestles or a foot, and with bedding that is not flat."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import shapely

from benchmarks.completion.scenes.houses.furniture.parts import (
    STEEL,
    WHITE,
    Part,
    Piece,
    cloth,
    joined,
    motion,
    moved,
    wood,
)
from benchmarks.completion.scenes.houses.furniture.solids import box, cushion, lathe, sheet, slab, tube
from scenes.checks import FloatArray


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
