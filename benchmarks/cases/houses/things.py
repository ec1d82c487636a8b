# SPDX-License-Identifier: MIT
"""Small things, fittings, plants and people."""

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
    capsule,
    cloth,
    cushion,
    joined,
    lathe,
    motion,
    moved,
    sheet,
    slab,
    tube,
    wood,
)
from scenes.checks import FloatArray

_CARTON = (0.72, 0.58, 0.40)


def book_row(rng: np.random.Generator, width: float, high: float, deep: float) -> tuple[Part, ...]:
    """Return a row of books from x = 0 on: upright, some leaning at its end, some lying; with gaps."""
    books: list[FloatArray] = []
    tints: list[FloatArray] = []
    x, end = rng.uniform(0, 0.1) * width, width * rng.uniform(0.4, 1.0)
    tallest, back = min(high, 0.34), rng.uniform(0, 0.03)
    while x < end - 0.06 and high > 0.12:
        thick, tall = rng.uniform(0.012, 0.05), tallest * rng.uniform(0.6, 0.98)
        d = min(deep - back - 0.02, rng.uniform(0.11, 0.22))
        low = (0, back + rng.uniform(0, 0.015), 0)
        if rng.random() < 0.04 and x + 0.25 < end:
            books.append(box((x, 0.01, 0), (x + 0.2, 0.01 + min(d, 0.2), min(0.12, high * 0.6))))
            x += 0.22
        elif x + thick > end - 0.1 and tall * 0.3 + x < width - 0.02:
            lean = motion((x, 0, thick * 0.26), roll=-0.26)
            books += [
                one.corners
                for one in moved([Part("", box(low, (thick, low[1] + d, tall * 0.95)), STEEL)], lean)
            ]
            x = end
        else:
            books.append(box((x, low[1], 0), (x + thick, low[1] + d, tall)))
            x += thick + (rng.uniform(0.03, 0.15) if rng.random() < 0.05 else 0.001)
        tints.append(np.array(cloth(rng)))
    if not books:
        return ()
    tint = np.repeat(np.array(tints), 12, axis=0)
    return (Part("books", np.concatenate(books), tint),)


def bowl(radius: float, height: float) -> FloatArray:
    """Return a bowl with a wall of 8 mm, open above."""
    outer = [(0, 0), (radius * 0.5, 0), (radius * 0.85, height * 0.5), (radius, height)]
    inner = [(radius - 0.008, height), (radius * 0.85 - 0.01, height * 0.5), (radius * 0.45, 0.01), (0, 0.01)]
    return lathe([*outer, *inner], 32)


def vase(rng: np.random.Generator, height: float) -> FloatArray:
    """Return a bottle or vase of revolution."""
    belly, neck = height * rng.uniform(0.18, 0.4), height * rng.uniform(0.06, 0.14)
    z = height * np.array([0, 0, 0.3, 0.6, 0.75, 1, 1])
    return lathe(np.column_stack([[0, belly * 0.7, belly, belly * 0.7, neck, neck, 0], z]), 32)


def screen(rng: np.random.Generator, width: float) -> Piece:
    """Return a flat screen on a foot."""
    high, lift = width * 0.58, rng.uniform(0.05, 0.12)
    parts = (
        Part("screen", box((-width / 2, 0.05, lift), (width / 2, 0.085, lift + high)), DARK),
        Part("screen stem", box((-0.04, 0.03, 0.01), (0.04, 0.05, lift + high * 0.4)), DARK),
        Part("screen foot", box((-width * 0.2, 0.0, 0), (width * 0.2, 0.2, 0.012)), DARK),
    )
    return Piece(parts)


def laptop(rng: np.random.Generator) -> Piece:
    """Return an open laptop."""
    lid = Part("laptop lid", box((-0.16, 0, 0), (0.16, 0.008, 0.22)), STEEL)
    base = Part("laptop", box((-0.16, 0.09, 0), (0.16, 0.32, 0.016)), STEEL)
    return Piece((base, *moved([lid], motion((0, 0.09, 0.014), pitch=rng.uniform(0.1, 0.4)))))


def desk_lamp(rng: np.random.Generator) -> Piece:
    """Return a lamp with a bent arm."""
    knee, tint = (rng.uniform(-0.1, 0.1), 0.02, 0.3), cloth(rng)
    tip = (knee[0], 0.2, 0.42)
    shade = tube((tip[0], tip[1], tip[2] + 0.04), (tip[0], tip[1] + 0.05, tip[2] - 0.09), 0.03, 0.08)
    solids = [
        tube((0, 0.08, 0), (0, 0.08, 0.02), 0.08),
        tube((0, 0.08, 0.02), knee, 0.008),
        tube(knee, tip, 0.008),
        shade,
    ]
    return Piece((joined("desk lamp", solids, tint),))


def prop(rng: np.random.Generator) -> Piece:
    """Return some small thing that stands on a table: its back at y = 0."""
    kind = rng.choice(
        ["box", "books", "bowl", "vase", "mug", "laptop", "lamp", "plate"],
        p=[0.18, 0.2, 0.1, 0.15, 0.2, 0.06, 0.06, 0.05],
    )
    if kind == "laptop":
        return laptop(rng)
    if kind == "lamp":
        return desk_lamp(rng)
    if kind == "books":
        return pile(rng)
    if kind == "box":
        return carton(rng, rng.uniform(0.08, 0.3), rng.uniform(0.06, 0.2), rng.uniform(0.05, 0.25))
    height = {"bowl": 0.1, "vase": rng.uniform(0.18, 0.35), "mug": 0.1, "plate": 0.025}[kind]
    solid = {
        "bowl": lambda: bowl(rng.uniform(0.09, 0.15), height),
        "vase": lambda: vase(rng, height),
        "mug": lambda: bowl(0.043, height),
        "plate": lambda: bowl(0.13, height),
    }[kind]()
    reach = float(np.abs(solid[..., 0]).max())
    solid = solid + [0, reach, 0]
    return Piece((Part(str(kind), solid, cloth(rng)),))


def pile(rng: np.random.Generator) -> Piece:
    """Return a pile of books or papers, each a little turned."""
    parts: tuple[Part, ...] = ()
    z = 0.0
    for _ in range(int(rng.integers(1, 7))):
        half, thick = rng.uniform([0.08, 0.06], [0.16, 0.12]), rng.uniform(0.012, 0.045)
        solid = box((-half[0], -half[1], 0), (half[0], half[1], thick))
        parts += moved([Part("lying book", solid, cloth(rng))], motion((0, 0.18, z), rng.uniform(-0.4, 0.4)))
        z += thick
    return Piece(parts)


def carton(rng: np.random.Generator, w: float, d: float, h: float) -> Piece:
    """Return a closed box; a carton of more than 25 cm may be open, its flaps up."""
    tint = _CARTON if rng.random() < 0.5 else wood(rng) if rng.random() < 0.5 else cloth(rng)
    if w < 0.25 or rng.random() < 0.6:
        return Piece((Part("box", box((-w / 2, 0, 0), (w / 2, d, h)), tint),))
    thin = 0.006
    walls = [
        box((-w / 2, 0, 0), (w / 2, d, thin)),
        box((-w / 2, 0, thin), (w / 2, thin, h)),
        box((-w / 2, d - thin, thin), (w / 2, d, h)),
    ]
    walls += [
        box((s * w / 2 - (s > 0) * thin, thin, thin), (s * w / 2 + (s < 0) * thin, d - thin, h))
        for s in (-1, 1)
    ]
    flap = Part("box flap", box((-w / 2, 0, 0), (w / 2, thin, d * 0.45)), tint)
    flaps = moved([flap], motion((0, 0.001, h), pitch=rng.uniform(-0.1, 0.9)))
    return Piece((joined("open box", walls, tint), *flaps))


def boxes(rng: np.random.Generator) -> Piece:
    """Return a heap of cartons: one or two below, others on them, one leaning or tilted."""
    w, d, h = rng.uniform([0.35, 0.3, 0.25], [0.65, 0.5, 0.5])
    parts = carton(rng, w, d, h).parts
    high = h
    if rng.random() < 0.7:
        u, v, t = rng.uniform([0.2, 0.18, 0.12], [w, d, 0.35])
        upper = Part("box", box((-u / 2, -v / 2, 0), (u / 2, v / 2, t)), _CARTON)
        if len(parts) == 1:
            parts += moved([upper], motion((0, d / 2, h), rng.uniform(-0.5, 0.5)))
            high += t
    if rng.random() < 0.6:
        tilt, thin = rng.uniform(0.15, 0.5), rng.uniform(0.06, 0.2)
        tall = h * rng.uniform(0.8, 1.1)
        leaning = Part("leaning box", box((-w * 0.4, 0, 0), (w * 0.4, thin, tall)), cloth(rng))
        parts += moved([leaning], motion((0, d + tall * np.sin(tilt) + 0.002, 0), pitch=tilt))
        d += tall * np.sin(tilt) + thin
    return Piece(parts)


def bag(rng: np.random.Generator) -> Piece:
    """Return a soft bag or sack on the floor."""
    w, d, h = rng.uniform([0.3, 0.2, 0.25], [0.55, 0.4, 0.6])
    body = cushion((-w / 2, 0, 0), (w / 2, d, h), power=0.6)
    return Piece((Part("bag", body, cloth(rng)),))


def bin_(rng: np.random.Generator) -> Piece:
    """Return an open waste bin."""
    r, h = rng.uniform(0.11, 0.18), rng.uniform(0.26, 0.6)
    solid = lathe([(0, 0), (r * 0.8, 0), (r, h), (r - 0.008, h), (r * 0.78, 0.01), (0, 0.01)], 20) + [0, r, 0]
    return Piece((Part("bin", solid, STEEL),))


def tub(rng: np.random.Generator) -> Piece:
    """Return a tub on the floor."""
    r = rng.uniform(0.18, 0.28)
    return Piece((Part("tub", bowl(r, rng.uniform(0.2, 0.3)) + [0, r, 0], cloth(rng)),))


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


def plant(rng: np.random.Generator, height: float | None = None) -> Piece:
    """Return a plant in a pot, 0.25 to 1.9 m high: upright leaves, a bush, or leaves that hang over."""
    tall = rng.uniform(0.25, 1.9) if height is None else height
    pot_radius, pot = (
        np.clip(tall * rng.uniform(0.12, 0.2), 0.06, 0.24),
        np.clip(tall * rng.uniform(0.2, 0.3), 0.09, 0.4),
    )
    n_stems, n_leaves = int(rng.integers(1, 7)), int(rng.integers(25, 110))
    green = np.array([rng.uniform(0.15, 0.4), rng.uniform(0.4, 0.65), rng.uniform(0.1, 0.3)])
    spread, size = rng.uniform(0.15, 0.4) * tall + 0.05, rng.uniform(0.06, 0.2) * (0.5 + 0.5 * min(tall, 1.4))
    stems, tips = [], []
    for _ in range(n_stems):
        turn = rng.uniform(0, 2 * np.pi)
        tip = np.array([np.cos(turn), np.sin(turn), 0]) * spread * rng.uniform(0.1, 0.6) + [
            0,
            0,
            tall * rng.uniform(0.65, 0.92),
        ]
        tips.append(tip)
        stems.append(tube((0, 0, pot - 0.02), tip, 0.004 + 0.006 * tall, 0.003, n=6))
    leaves, tints = [], []
    for _ in range(n_leaves):
        tip = tips[rng.integers(n_stems)]
        low = np.array([0, 0, pot])
        foot = low + (tip - low) * rng.uniform(0.3, 1.0)
        leaf = _leaf(foot, size * rng.uniform(0.6, 1.3), rng)
        leaves.append(leaf)
        tints.append(np.repeat((green * rng.uniform(0.75, 1.25))[None], len(leaf), axis=0))
    wall = pot_radius - 0.01
    vessel = lathe(
        [(0, 0), (pot_radius * 0.75, 0), (pot_radius, pot), (wall, pot), (wall, pot - 0.03), (0, pot - 0.03)],
        20,
    )
    parts = [
        Part("pot", vessel, cloth(rng)),
        joined("stems", stems, (0.35, 0.3, 0.18)),
        Part("leaves", np.concatenate(leaves), np.concatenate(tints)),
    ]
    # leaves neither go through the floor nor into the wall behind
    corners = parts[2].corners
    reach = float(np.abs(np.concatenate([corners[..., :2].reshape(-1, 2), [[pot_radius, pot_radius]]])).max())
    lift = np.maximum(corners, [-np.inf, -np.inf, 0.005])
    parts[2] = Part("leaves", lift, parts[2].tint)
    placed = tuple(Part(one.name, one.corners + [0, reach, 0], one.tint) for one in parts)
    return Piece(placed)


def _leaf(foot: FloatArray, size: float, rng: np.random.Generator) -> FloatArray:
    """A leaf that bends down towards its tip: a closed sheet of 3 mm, pointed at both ends."""
    turn, rise, bend = rng.uniform(0, 2 * np.pi), rng.uniform(-0.1, 1.2), rng.uniform(0.2, 1.4)
    out = np.array([np.cos(turn), np.sin(turn), 0.0])
    aside = np.array([-out[1], out[0], 0.0])
    t = np.linspace(0, 1, 5)[:, None]
    angle = rise - bend * t
    middle = foot + size * t * (np.cos(angle) * out + np.sin(angle) * np.array([0, 0, 1.0]))
    half = size * rng.uniform(0.15, 0.3) * np.sin(np.pi * (0.08 + 0.84 * t))
    roll = rng.uniform(-0.5, 0.5)
    wide = half * (np.cos(roll) * aside + np.sin(roll) * np.array([0, 0, 1.0]))
    fold = np.array([0, 0, 1.0]) * half * 0.25
    return sheet(np.stack([middle - wide + fold, middle, middle + wide + fold], axis=1), 0.003)


_SKIN = np.array([[0.94, 0.78, 0.66], [0.78, 0.57, 0.43], [0.45, 0.30, 0.22]])
_STAND_Y = 0.3  # where the hips are before the wall or the back of the seat


def figure(rng: np.random.Generator, *, seat_m: float | None = None) -> Piece:
    """Return a person of 1.1 to 1.95 m; with `seat_m`, one who sits on a seat of this height.

    Lengths are shares of the body's height (Winter 2009, Biomechanics and Motor Control, figure 4.1). The
    body faces away from the wall; its feet are on the floor.
    """
    tall = rng.uniform(1.5, 1.95) if seat_m is not None or rng.random() < 0.85 else rng.uniform(1.1, 1.4)
    thigh, shin, trunk = 0.245 * tall, 0.246 * tall, 0.288 * tall
    skin, shirt, trousers = _SKIN[rng.integers(3)] * rng.uniform(0.9, 1.05), cloth(rng), cloth(rng)
    legs, feet, low = [], [], []
    hips = np.array([0, _STAND_Y, 0.53 * tall if seat_m is None else seat_m + 0.055 * tall])
    for s in (-1, 1):
        swing = rng.uniform(-0.25, 0.35) if seat_m is None else np.pi / 2 + rng.uniform(-0.08, 0.03)
        bend = rng.uniform(0.0, 0.35) if seat_m is None else np.pi / 2 + rng.uniform(-0.15, 0.25)
        hip = hips + [s * 0.052 * tall, 0, 0]
        knee = hip + thigh * _down(swing, s * rng.uniform(0.0, 0.12))
        ankle = knee + shin * _down(swing - bend, 0.0)
        legs += [
            capsule(hip, knee, 0.045 * tall, 0.033 * tall),
            capsule(knee, ankle, 0.032 * tall, 0.022 * tall),
        ]
        toe = ankle + [s * 0.02, 0.1 * tall, 0]
        feet.append(
            capsule(ankle + [0, 0, -0.018 * tall], toe + [0, 0, -0.022 * tall], 0.024 * tall, 0.018 * tall)
        )
        low.append(float(feet[-1][..., 2].min()))
    lean = rng.uniform(-0.05, 0.25)
    neck = hips + trunk * np.array([rng.uniform(-0.06, 0.06), np.sin(lean), np.cos(lean)])
    chest = hips + 0.72 * (neck - hips)
    trunk_solids = [capsule(hips, chest, 0.068 * tall, 0.075 * tall)]
    yoke = hips + 0.9 * (neck - hips)
    trunk_solids.append(capsule(yoke - [0.075 * tall, 0, 0], yoke + [0.075 * tall, 0, 0], 0.042 * tall))
    trunk_solids.append(capsule(chest, yoke, 0.072 * tall, 0.045 * tall))
    head = neck + [rng.uniform(-0.02, 0.02), 0.02 * tall, 0.105 * tall]
    half = tall * np.array([0.046, 0.058, 0.072])
    skull = cushion(head - half, head + half, power=1)
    arms, hands = _arms(rng, neck, tall)
    parts = (
        joined("figure legs", legs, trousers),
        joined("figure shoes", feet, (0.2, 0.16, 0.14)),
        joined("figure trunk", trunk_solids, shirt),
        joined("figure arms", arms, shirt),
        joined("figure hands", hands, skin),
        joined("figure head", [capsule(neck, neck + [0, 0, 0.05 * tall], 0.033 * tall), skull], skin),
    )
    drop = min(low) if seat_m is None else 0.0
    placed = tuple(Part(one.name, one.corners - [0, 0, drop], one.tint) for one in parts)
    corners = np.concatenate([one.corners for one in placed]).reshape(-1, 3)
    back = min(0.0, float(corners[:, 1].min()) - 0.02)
    placed = tuple(Part(one.name, one.corners - [0, back, 0], one.tint) for one in placed)
    return Piece(placed)


def _down(swing: float, aside: float) -> FloatArray:
    """The unit vector of a limb that hangs, swung to the front and aside, radians."""
    return np.array([np.sin(aside), np.sin(swing) * np.cos(aside), -np.cos(swing) * np.cos(aside)])


def _arms(
    rng: np.random.Generator, neck: FloatArray, tall: float
) -> tuple[list[FloatArray], list[FloatArray]]:
    upper, fore = 0.186 * tall, 0.146 * tall
    arms, hands = [], []
    for s in (-1, 1):
        shoulder = neck + [s * 0.115 * tall, 0, -0.025 * tall]
        swing, bend = rng.uniform(-0.3, 1.0), rng.uniform(0.1, 1.5)
        if rng.random() < 0.15:
            swing, bend = rng.uniform(1.6, 2.7), rng.uniform(0.0, 0.6)
        elbow = shoulder + upper * _down(swing, s * rng.uniform(0.05, 0.5))
        wrist = elbow + fore * _down(swing + bend, s * rng.uniform(-0.3, 0.2))
        arms += [
            capsule(shoulder, elbow, 0.03 * tall, 0.025 * tall),
            capsule(elbow, wrist, 0.024 * tall, 0.018 * tall),
        ]
        hands.append(capsule(wrist, wrist + 0.06 * tall * _down(swing + bend, 0.0), 0.02 * tall))
    return arms, hands
