# SPDX-License-Identifier: MIT
"""Fittings: radiators, frames, mirrors, lamps, curtains, sanitary ware, stairs, clothes on hooks."""

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
    cloth,
    joined,
    motion,
    moved,
    wood,
)
from benchmarks.completion.scenes.houses.furniture.solids import box, cushion, lathe, sheet, slab, tube
from scenes.checks import FloatArray

MIRROR = "mirror"  # parts of this name are mirrors


def radiator(rng: np.random.Generator, w: float, h: float | None = None) -> Piece:
    """Return a radiator of columns, or a panel with ribs, held off the wall, with its pipes."""
    top = rng.uniform(0.5, 0.75) if h is None else h
    low, off, deep = rng.uniform(0.08, 0.14), 0.035, rng.uniform(0.05, 0.1)
    n = max(3, round(w / rng.uniform(0.045, 0.08)))
    edges = np.linspace(-w / 2, w / 2, n + 1)
    ribs = [box((a + 0.006, off, low), (b - 0.006, off + deep, top)) for a, b in pairwise(edges)]
    core = [box((-w / 2, off + deep * 0.3, low + 0.02), (w / 2, off + deep * 0.7, top - 0.02))]
    pipes = [tube((x, 0.05, 0), (x, 0.05, low + 0.03), 0.009) for x in (w / 2 - 0.05, w / 2 - 0.12)]
    parts = (joined("radiator", core + ribs, WHITE), joined("radiator pipes", pipes, WHITE))
    return Piece(parts)


def picture(rng: np.random.Generator, w: float, h: float, low: float, *, mirror: bool = False) -> Piece:
    """Return a framed picture on the wall, its lower edge at `low`; with `mirror`, a mirror."""
    rim, deep = rng.uniform(0.015, 0.06), rng.uniform(0.015, 0.035)
    shape = shapely.box(-w / 2, low, w / 2, low + h)
    frame = slab(shape.difference(shape.buffer(-rim, join_style="mitre")), 0.0, deep)
    lie = np.array([[1, 0, 0], [0, 0, 1], [0, 1, 0.0]])  # x, z, y: the slab stands before the wall
    standing = (frame @ lie)[:, ::-1]
    board = box((-w / 2 + rim, 0, low + rim), (w / 2 - rim, deep * 0.4, low + h - rim))
    name = MIRROR if mirror else "picture"
    tint: Colour = STEEL if mirror else cloth(rng)
    return Piece((Part("picture frame", standing, wood(rng)), Part(name, board, tint)))


def ceiling_lamp(rng: np.random.Generator, height: float) -> Piece:
    """Return a lamp that hangs from the ceiling at `height`."""
    drop, r = rng.uniform(0.12, min(0.9, height - 1.75)), rng.uniform(0.12, 0.28)
    low = height - drop
    profiles = (
        [(0, low), (r, low), (r * 0.5, low + 0.12), (0, low + 0.12)],
        [(0, low), (r * 0.6, low + r * 0.2), (r * 0.7, low + r * 0.6), (0, low + r)],
        [(0, low), (r, low), (r, low + 0.1), (0, low + 0.1)],
    )
    shade = lathe(profiles[rng.integers(3)], 20)
    cord = tube((0, 0, low + 0.05), (0, 0, height), 0.006, n=6)
    rose = tube((0, 0, height - 0.03), (0, 0, height), 0.05)
    parts = (Part("ceiling lamp", shade, cloth(rng)), joined("lamp cord", [cord, rose], WHITE))
    return Piece(moved(parts, motion((0, r, 0))))


def floor_lamp(rng: np.random.Generator) -> Piece:
    """Return a lamp on a pole."""
    h, r = rng.uniform(1.3, 1.8), rng.uniform(0.14, 0.25)
    base = [tube((0, 0, 0), (0, 0, 0.025), 0.14, n=20), tube((0, 0, 0.02), (0, 0, h - 0.1), 0.011)]
    shade = lathe([(0, h - 0.28), (r, h - 0.28), (r * 0.65, h), (0, h)], 20)
    parts = (joined("lamp pole", base, DARK), Part("lamp shade", shade, WHITE))
    r = max(r, 0.14)
    return Piece(moved(parts, motion((0, r, 0))))


def curtain(rng: np.random.Generator, w: float, low: float, top: float, out: float) -> Part:
    """Return one curtain in folds, x from 0 to w, from `low` to `top`, its middle `out` from the wall."""
    n = max(24, int(w / 0.02))
    x, z = np.meshgrid(np.linspace(0, w, n), np.linspace(low, top, 7))
    fold, phase = w / max(2, round(w / rng.uniform(0.09, 0.18))), rng.uniform(0, 6)
    deep = rng.uniform(0.02, 0.045) * (1.15 - 0.3 * (z - low) / (top - low))
    y = out + deep * np.sin(2 * np.pi * x / fold + phase + 0.4 * np.sin(2 * z))
    return Part(
        "curtain", sheet(np.stack([x + 0.01 * np.sin(3 * z + phase), y, z], axis=-1), 0.006), cloth(rng)
    )


def rod(w: float, top: float, out: float) -> Part:
    """Return a curtain rod with its knobs and brackets, x from 0 to w."""
    ends = [
        cushion((x - 0.025, out - 0.025, top - 0.025), (x + 0.025, out + 0.025, top + 0.025), power=1)
        for x in (0, w)
    ]
    arms = [tube((x, 0, top), (x, out, top), 0.007) for x in (0.06, w - 0.06)]
    return joined("curtain rod", [tube((0, out, top), (w, out, top), 0.012), *ends, *arms], STEEL)


def toilet(_rng: np.random.Generator) -> Piece:
    """Return a toilet with cistern and closed lid."""
    solids = [
        box((-0.19, 0, 0.4), (0.19, 0.17, 0.8)),
        cushion((-0.12, 0.12, 0.0), (0.12, 0.55, 0.36), power=0.5),
        cushion((-0.18, 0.16, 0.24), (0.18, 0.66, 0.41), power=0.5),
    ]
    lid = slab(
        shapely.affinity.scale(shapely.Point(0, 0.42).buffer(1, quad_segs=6), 0.185, 0.25), 0.405, 0.43
    )
    return Piece((joined("toilet", solids, WHITE), Part("toilet lid", lid, WHITE)))


def basin(rng: np.random.Generator) -> Piece:
    """Return a wash basin with a hollow, on a column or hung, and its tap."""
    w, d, h = rng.uniform(0.4, 0.65), rng.uniform(0.36, 0.48), rng.uniform(0.8, 0.87)
    rim = shapely.box(-w / 2, 0, w / 2, d).buffer(-0.05).buffer(0.05, quad_segs=4)
    hole = shapely.affinity.scale(shapely.Point(0, d * 0.57).buffer(1, quad_segs=6), w * 0.38, d * 0.32)
    shell = [
        slab(rim.difference(hole), h - 0.05, h),
        slab(rim.buffer(-0.02).difference(hole), h - 0.16, h - 0.05),
    ]
    shell.append(slab(rim.buffer(-0.02), h - 0.18, h - 0.16))
    if rng.random() < 0.5:
        shell.append(tube((0, 0.15, 0), (0, 0.15, h - 0.18), 0.09, 0.12, n=18))
    tap = [
        tube((0, 0.06, h), (0, 0.06, h + 0.12), 0.015),
        tube((0, 0.06, h + 0.1), (0, 0.17, h + 0.08), 0.012),
    ]
    return Piece((joined("basin", shell, WHITE), joined("tap", tap, STEEL)))


def bath(rng: np.random.Generator, w: float) -> Piece:
    """Return a bath tub with a hollow, its long side at the wall."""
    d, h = rng.uniform(0.68, 0.78), rng.uniform(0.52, 0.6)
    plan = shapely.box(-w / 2, 0, w / 2, d)
    hole = shapely.box(-w / 2 + 0.25, 0.27, w / 2 - 0.25, d - 0.27).buffer(0.19, quad_segs=5)
    parts = (
        Part("bath", slab(plan.difference(hole), 0.12, h), WHITE),
        Part("bath bottom", slab(plan, 0.0, 0.12), WHITE),
    )
    return Piece(parts)


def shower_screen(rng: np.random.Generator) -> Piece:
    """Return a tray with a curtain on a rod before it."""
    w, d, top = rng.uniform(0.8, 1.1), rng.uniform(0.75, 0.95), rng.uniform(1.9, 2.1)
    drape = moved([curtain(rng, w * rng.uniform(0.4, 0.9), 0.14, top, 0.0)], motion((-w / 2, d - 0.06, 0)))
    pole = Part("shower rod", tube((-w / 2, d - 0.06, top), (w / 2, d - 0.06, top), 0.012), STEEL)
    floor = Part("shower tray", box((-w / 2, 0, 0), (w / 2, d, 0.1)), WHITE)
    return Piece((floor, pole, *drape))


def coats(rng: np.random.Generator, w: float) -> Piece:
    """Return a rail with hooks and coats on them."""
    top = rng.uniform(1.55, 1.8)
    parts = [Part("coat rail", box((-w / 2, 0, top), (w / 2, 0.025, top + 0.09)), wood(rng))]
    for x in np.linspace(-w / 2 + 0.12, w / 2 - 0.12, max(1, int(w / 0.2))):
        hook = tube((x, 0.02, top + 0.04), (x, 0.09, top + 0.06), 0.007, n=6)
        parts.append(Part("hook", hook, STEEL))
        if rng.random() < 0.65:
            long, wide = rng.uniform(0.5, 1.1), rng.uniform(0.14, 0.22)
            body = cushion(
                (x - wide, 0.03, top - long), (x + wide, rng.uniform(0.16, 0.28), top + 0.05), power=0.45
            )
            parts.append(Part("coat", body, cloth(rng)))
    return Piece(tuple(parts))


def flight(rng: np.random.Generator, w: float, n: int, rise: float, run: float) -> Piece:
    """Return a flight of `n` steps along the wall, up towards +x, treads with a nosing; solid below."""
    tint, nose = wood(rng), 0.02
    steps = [box((k * run, 0, 0), ((k + 1) * run, w, (k + 1) * rise - 0.03)) for k in range(n)]
    treads = [
        box((k * run - nose, 0, (k + 1) * rise - 0.03), ((k + 1) * run, w + 0.01, (k + 1) * rise))
        for k in range(n)
    ]
    half = n * run / 2
    parts = (joined("stair body", steps, WHITE), joined("stair treads", treads, tint))
    return Piece(moved(parts, motion((-half, 0, 0))))


def podium(rng: np.random.Generator, w: float, d: float) -> Piece:
    """Return a step or platform at the wall on which things stand."""
    h = rng.uniform(0.12, 0.4)
    solids = [box((-w / 2, 0, 0), (w / 2, d, h))]
    if h > 0.22:
        solids.append(box((-w * 0.3, d, 0), (w * 0.3, d + 0.28, h / 2)))
    return Piece((joined("podium", solids, wood(rng)),), tops=((-w / 2, 0, w / 2, d, h),))


def parapet(rng: np.random.Generator, length: float) -> Piece:
    """Return a half-high wall that stands out from the wall into the room."""
    t, h = rng.uniform(0.1, 0.2), rng.uniform(0.85, 1.35)
    solids = [box((-t / 2, 0, 0), (t / 2, length, h))]
    cap = box((-t / 2 - 0.02, 0, h), (t / 2 + 0.02, length + 0.02, h + 0.03))
    return Piece((joined("parapet", solids, WHITE), Part("parapet cap", cap, wood(rng))))


def pillar(rng: np.random.Generator, height: float) -> Piece:
    """Return a column, round or square, from floor to ceiling."""
    r = rng.uniform(0.08, 0.2)
    plan: FloatArray = (
        tube((0, 0, 0), (0, 0, height), r, n=32) if rng.random() < 0.5 else box((-r, -r, 0), (r, r, height))
    )
    return Piece(moved([Part("column", plan, WHITE)], motion((0, r, 0))))


def breast(rng: np.random.Generator, height: float) -> Piece:
    """Return a chimney breast or pipe casing at the wall, from floor to ceiling."""
    w, d = rng.uniform(0.25, 1.3), rng.uniform(0.12, 0.45)
    return Piece((Part("casing", box((-w / 2, 0, 0), (w / 2, d, height)), WHITE),))


def drying_rack(rng: np.random.Generator) -> Piece:
    """Return a folding rack of rods with cloths over some of them."""
    w, d, h = rng.uniform(0.8, 1.2), 0.55, rng.uniform(0.85, 1.0)
    rods = [tube((-w / 2, y, h), (w / 2, y, h), 0.005, n=6) for y in np.linspace(0.05, d - 0.05, 6)]
    legs = [
        tube((s * w / 2, y, 0), (s * w / 2, d - y, h), 0.009, n=8) for s in (-1, 1) for y in (0.03, d - 0.03)
    ]
    parts = [joined("drying rack", rods + legs, STEEL)]
    for y in np.linspace(0.05, d - 0.05, 6)[:: int(rng.integers(1, 4))]:
        u, z = np.meshgrid(
            np.linspace(0, rng.uniform(0.25, 0.6), 9), np.linspace(h - rng.uniform(0.2, 0.7), h + 0.01, 6)
        )
        x = u - w / 2 + rng.uniform(0.03, max(0.04, w - 0.65))
        wave = y + 0.015 + 0.012 * np.sin(14 * u + 3 * z)
        parts.append(Part("cloth", sheet(np.stack([x, wave, z], axis=-1), 0.005), cloth(rng)))
    return Piece(tuple(parts))
