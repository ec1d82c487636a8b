# SPDX-License-Identifier: MIT
"""Props: small things on shelves, tables and floors: books, boxes, bowls, mugs, bottles, screens."""

from __future__ import annotations

import numpy as np

from benchmarks.completion.scenes.houses.furniture.parts import (
    DARK,
    STEEL,
    Part,
    Piece,
    cloth,
    joined,
    motion,
    moved,
    wood,
)
from benchmarks.completion.scenes.houses.furniture.solids import box, cushion, lathe, tube
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
