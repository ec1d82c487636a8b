# SPDX-License-Identifier: MIT
"""Kinds of things on which the models of back sides are fitted, by chance.

Never used to score them; kinds that score stand in `held_out.py` and `held_out_parts.py`.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from benchmarks.cases.backs.shapes import (
    Kind,
    Random,
    around,
    blob,
    block,
    corners4,
    corners_of,
    driftwood,
    heap,
    joined,
    prism_x,
    profile,
    rod,
    turned,
)
from benchmarks.cases.houses import furniture, things
from benchmarks.cases.houses.furnishing import AMIDST, AT_WALLS
from benchmarks.cases.houses.solids import capsule, cushion, lathe, tube
from scenes.checks import FloatArray


def _jug(rng: Random) -> FloatArray:
    r, h = rng.uniform(0.06, 0.09), rng.uniform(0.2, 0.3)
    body = lathe([(0, 0), (r, 0), (1.25 * r, 0.4 * h), (0.7 * r, 0.85 * h), (0.8 * r, h), (0, h)], 40)
    a, b, c = (r, 0, 0.2 * h), (2.1 * r, 0, 0.5 * h), (0.7 * r, 0, 0.9 * h)
    spout = tube((-0.6 * r, 0, 0.9 * h), (-1.3 * r, 0, 1.05 * h), 0.02, 0.012)
    return joined(body, tube(a, b, 0.01), tube(b, c, 0.01), spout)


def _saucepan(rng: Random) -> FloatArray:
    r, h = rng.uniform(0.08, 0.14), rng.uniform(0.07, 0.14)
    pan = lathe([(0, 0), (r, 0), (r, h), (r - 0.005, h), (r - 0.005, 0.006), (0, 0.006)], 40)
    return joined(pan, tube((r, 0, 0.8 * h), (r + rng.uniform(0.12, 0.2), 0, h), 0.012))


def _watering_can(rng: Random) -> FloatArray:
    r, h = rng.uniform(0.08, 0.12), rng.uniform(0.18, 0.26)
    loop = [(-r, 0, 0.3 * h), (-2 * r, 0, 0.7 * h), (-r * 0.8, 0, 1.2 * h), (0, 0, h)]
    handle = [tube(a, b, 0.009) for a, b in pairwise(loop)]
    return joined(rod(0, 0, 0, r, h), tube((0.8 * r, 0, 0.2 * h), (2.6 * r, 0, h), 0.02, 0.03), *handle)


def _crate(rng: Random) -> FloatArray:
    w, d, h, t = *rng.uniform([0.3, 0.25, 0.2], [0.6, 0.4, 0.35]), 0.015
    slats = [block(0, s * (d - t) / 2, z * h, (w, t, 0.2 * h)) for s in (-1, 1) for z in (0, 0.4, 0.8)]
    sides = [block(s * (w - t) / 2, 0, 0, (t, d - 2 * t, h)) for s in (-1, 1)]
    return joined(block(0, 0, 0, (w, d, t)), *slats, *sides)


def _model_house(rng: Random) -> FloatArray:
    w, d, h = rng.uniform([0.3, 0.2, 0.15], [0.5, 0.35, 0.3])
    ends = np.array([[-d / 2 - 0.02, h], [d / 2 + 0.02, h], [0, h + rng.uniform(0.1, 0.2)]])
    roof = prism_x(ends, w + 0.04)
    return joined(block(0, 0, 0, (w, d, h)), roof, block(w * 0.25, d * 0.2, h, (0.04, 0.04, 0.2)))


def _microwave(rng: Random) -> FloatArray:
    w, d, h = rng.uniform([0.42, 0.3, 0.24], [0.55, 0.42, 0.32])
    handle = tube((w * 0.2, -d / 2 - 0.03, 0.05), (w * 0.2, -d / 2 - 0.03, h - 0.05), 0.008)
    knobs = [tube((w * 0.38, -d / 2, z), (w * 0.38, -d / 2 - 0.02, z), 0.02) for z in (0.35 * h, 0.65 * h)]
    return joined(
        block(0, 0, 0.01, (w, d, h)), block(-0.1 * w, -d / 2, 0.03, (0.7 * w, 0.02, h - 0.05)), handle, *knobs
    )


def _bench(rng: Random) -> FloatArray:
    w, d, h = rng.uniform([0.9, 0.28, 0.4], [1.6, 0.4, 0.48])
    legs = [block(s * w * 0.4, 0, 0, (0.05, d * 0.9, h - 0.04)) for s in (-1, 1)]
    return joined(block(0, 0, h - 0.04, (w, d, 0.04)), *legs, block(0, 0, 0.15, (w * 0.8, 0.03, 0.06)))


def _picnic_table(rng: Random) -> FloatArray:
    w = rng.uniform(1.2, 1.8)
    boards = [block(0, 0, 0.7, (w, 0.7, 0.04)), *(block(0, s * 0.65, 0.42, (w, 0.25, 0.04)) for s in (-1, 1))]
    legs = [
        tube((x, s * 0.6, 0), (x, s * 0.25, 0.7), 0.035, n=4) for x in (-w * 0.38, w * 0.38) for s in (-1, 1)
    ]
    return joined(*boards, *legs, *(block(x, 0, 0.38, (0.05, 1.4, 0.06)) for x in (-w * 0.38, w * 0.38)))


def _ladder(rng: Random) -> FloatArray:
    h, w, out = rng.uniform(1.2, 1.8), rng.uniform(0.4, 0.55), rng.uniform(0.3, 0.5)
    rails = [
        tube((s * w / 2, t * out, 0), (s * w * 0.35, 0, h), 0.025, n=4) for s in (-1, 1) for t in (-1, 1)
    ]
    steps = [block(0, -out * (1 - z / h), z, (w * 0.9, 0.09, 0.025)) for z in np.arange(0.25, h - 0.1, 0.25)]
    return joined(*rails, *steps, block(0, 0, h, (w * 0.8, 0.2, 0.03)))


def _sawhorse(rng: Random) -> FloatArray:
    w, h, out = rng.uniform(0.7, 1.1), rng.uniform(0.6, 0.85), rng.uniform(0.2, 0.3)
    legs = [
        tube((s * w * 0.45, t * out, 0), (s * w * 0.35, 0, h), 0.03, n=4) for s in (-1, 1) for t in (-1, 1)
    ]
    return joined(block(0, 0, h - 0.05, (w, 0.09, 0.1)), *legs)


def _easel(rng: Random) -> FloatArray:
    h = rng.uniform(1.2, 1.6)
    legs = [tube((s * 0.3, 0, 0), (s * 0.04, 0.2, h), 0.02) for s in (-1, 1)]
    board = turned(block(0, 0, 0, (rng.uniform(0.5, 0.7), 0.02, 0.6)), 0, -0.12) + [0, 0.0, h * 0.4]
    return joined(
        *legs, tube((0, 0.7, 0), (0, 0.2, h), 0.02), board, block(0, 0.02, h * 0.38, (0.6, 0.1, 0.02))
    )


def _star_stool(rng: Random) -> FloatArray:
    n, h, reach = int(rng.integers(3, 7)), rng.uniform(0.45, 0.75), rng.uniform(0.2, 0.28)
    feet = around(
        lambda a: tube((0, 0, 0.08), (reach * np.cos(a), reach * np.sin(a), 0.02), 0.02), n, rng.uniform(0, 6)
    )
    return joined(
        feet, rod(0, 0, 0.05, 0.025, h - 0.05), cushion((-0.18, -0.18, h), (0.18, 0.18, h + 0.08), power=1)
    )


def _fan(rng: Random) -> FloatArray:
    h, r = rng.uniform(0.4, 1.1), rng.uniform(0.15, 0.22)
    blades = around(
        lambda a: turned(block(r * 0.5, 0, -0.006, (r * 0.9, r * 0.45, 0.012)), a), 3, rng.uniform(0, 2)
    )
    head = turned(blades, 0, np.pi / 2) + [0, -0.1, h]
    guard = turned(
        lathe([(r, -0.01), (r + 0.015, 0), (r, 0.01), (r - 0.01, 0), (r, -0.01)], 32), 0, np.pi / 2
    )
    return joined(
        rod(0, 0, 0, 0.15, 0.03),
        rod(0, 0, 0, 0.02, h),
        tube((0, -0.12, h), (0, 0.1, h), 0.05),
        head,
        guard + [0, -0.1, h],
    )


def _corner_sofa(rng: Random) -> FloatArray:
    w, d, s = rng.uniform(1.6, 2.2), rng.uniform(1.2, 1.5), 0.75
    seats = [cushion((0, 0, 0.05), (w, s, 0.42), power=0.15), cushion((0, 0, 0.05), (s, d, 0.43), power=0.15)]
    return joined(
        *seats, cushion((0, 0, 0.1), (w, 0.2, 0.8), power=0.2), cushion((0, 0, 0.1), (0.2, d, 0.8), power=0.2)
    )


def _trolley(rng: Random) -> FloatArray:
    w, d, h = rng.uniform([0.5, 0.35, 0.7], [0.8, 0.5, 0.9])
    posts = [rod(x, y, 0.06, 0.015, h) for x, y in corners4(w / 2 - 0.02, d / 2 - 0.02)]
    wheels = [
        tube((x, y - 0.015, 0.04), (x, y + 0.015, 0.04), 0.04)
        for x, y in corners4(w / 2 - 0.05, d / 2 - 0.04)
    ]
    shelves = [block(0, 0, z, (w, d, 0.02)) for z in (0.12, 0.12 + 0.5 * h, h)]
    return joined(*posts, *wheels, *shelves, tube((w / 2 + 0.08, -d / 2, h), (w / 2 + 0.08, d / 2, h), 0.015))


def _toy_car(rng: Random) -> FloatArray:
    w, long, h = rng.uniform([0.14, 0.32, 0.07], [0.2, 0.5, 0.12])
    body = cushion((-w / 2, -long / 2, 0.03), (w / 2, long / 2, h), power=0.25)
    cabin = cushion((-w * 0.42, -long * 0.3, h * 0.7), (w * 0.42, long * 0.15, h * 1.7), power=0.4)
    wheels = [tube((x - 0.02, y, 0.035), (x + 0.02, y, 0.035), 0.035) for x, y in corners4(w / 2, long * 0.3)]
    return joined(body, cabin, *wheels)


def _scooter(rng: Random) -> FloatArray:
    long, h = rng.uniform(0.7, 0.9), rng.uniform(0.8, 1.0)
    wheels = [tube((-0.02, y, 0.1), (0.02, y, 0.1), 0.1) for y in (-long / 2, long / 2)]
    bar = tube((-0.25, long / 2 - 0.1, h), (0.25, long / 2 - 0.1, h), 0.015)
    return joined(
        *wheels,
        block(0, -0.05, 0.08, (0.14, long * 0.8, 0.04)),
        tube((0, long / 2, 0.1), (0, long / 2 - 0.1, h), 0.025),
        bar,
    )


def _hammer(rng: Random) -> FloatArray:
    long = rng.uniform(0.25, 0.4)
    head = joined(
        tube((long, -0.06, 0.03), (long, 0.03, 0.03), 0.022),
        prism_x(np.array([[0.03, 0.01], [0.09, 0.025], [0.03, 0.05]]), 0.03) + [long, 0, 0],
    )
    return joined(tube((0, 0, 0.03), (long, 0, 0.03), 0.014), head)


def _dumbbell(rng: Random) -> FloatArray:
    long, r = rng.uniform(0.2, 0.35), rng.uniform(0.05, 0.09)
    discs = [tube((s * long * 0.5, 0, r), (s * long * 0.35, 0, r), r) for s in (-1, 1)]
    return joined(tube((-long * 0.4, 0, r), (long * 0.4, 0, r), 0.016), *discs)


def _elbow(rng: Random) -> FloatArray:
    r, n = rng.uniform(0.03, 0.05), 10
    turn = np.linspace(0, np.pi / 2, n)
    path = [(0.15 * (1 - np.cos(a)), 0.0, 0.1 + 0.15 * np.sin(a)) for a in turn]
    bent = [tube(a, b, r) for a, b in pairwise(path)]
    end = (path[-1][0] + 0.1, 0.0, path[-1][2])
    return joined(
        rod(0, 0, 0, 2 * r, 0.02),
        rod(0, 0, 0, r, 0.1),
        *bent,
        tube(path[-1], end, r),
        tube(end, (end[0] + 0.02, 0, end[2]), 2 * r),
    )


def _flange(rng: Random) -> FloatArray:
    r, n = rng.uniform(0.08, 0.14), int(rng.integers(4, 9))
    bolts = around(
        lambda a: rod(0.8 * r * np.cos(a), 0.8 * r * np.sin(a), 0, 0.012, 0.05), n, rng.uniform(0, 1)
    )
    return joined(rod(0, 0, 0, r, 0.025), rod(0, 0, 0, 0.5 * r, rng.uniform(0.1, 0.25)), bolts)


def _angle_bracket(rng: Random) -> FloatArray:
    w, d, h, t = *rng.uniform([0.1, 0.12, 0.12], [0.25, 0.2, 0.25]), 0.02
    rib = prism_x(np.array([[0, t], [d * 0.8, t], [0, h * 0.8]]), 0.02)
    return joined(block(0, d / 2, 0, (w, d, t)), block(0, -t / 2, 0, (w, t, h)), rib)


def _pillow_block(rng: Random) -> FloatArray:
    r = rng.uniform(0.04, 0.07)
    hub = tube((0, -0.05, 0.11), (0, 0.05, 0.11), r)
    return joined(
        block(0, 0, 0, (4.5 * r, 0.09, 0.03)),
        block(0, 0, 0.03, (1.6 * r, 0.08, 0.08)),
        hub,
        tube((0, -0.15, 0.11), (0, 0.12, 0.11), 0.4 * r),
    )


def _v_block(rng: Random) -> FloatArray:
    w, h = rng.uniform(0.1, 0.2), rng.uniform(0.08, 0.12)
    long = rng.uniform(0.1, 0.25)
    left = np.array([[-w / 2, 0], [0, 0], [0, h * 0.4], [-w * 0.35, h], [-w / 2, h]])
    right = np.array([[0, 0], [w / 2, 0], [w / 2, h], [w * 0.35, h], [0, h * 0.4]])
    return joined(prism_x(left, long), prism_x(right, long))


def _two_blocks(rng: Random) -> FloatArray:
    a, b = rng.uniform(0.1, 0.3, (2, 3))
    low = block(0, 0, 0, (a[0], a[1], a[2]))
    return joined(
        low,
        turned(block(0, 0, 0, (b[0], b[1], b[2])), rng.uniform(0, 3)) + [*rng.uniform(-0.05, 0.05, 2), a[2]],
    )


def _tree(rng: Random) -> FloatArray:
    h = rng.uniform(0.5, 1.2)
    crown = [rod(0, 0, z * h, r * h, 0.35 * h, 0.02) for z, r in ((0.2, 0.3), (0.42, 0.24), (0.64, 0.16))]
    return joined(rod(0, 0, 0, 0.04 * h, 0.3 * h), *crown)


def _teddy(rng: Random) -> FloatArray:
    s = rng.uniform(0.8, 1.4)
    parts = [capsule((0, 0, 0.1), (0, 0, 0.16), 0.09), capsule((0, 0.01, 0.3), (0, 0.01, 0.31), 0.075)]
    for k in (-1, 1):
        parts += [
            capsule((k * 0.06, 0.05, 0.04), (k * 0.08, 0.17, 0.04), 0.04),
            capsule((k * 0.08, 0, 0.2), (k * 0.15, 0.05, 0.12), 0.03),
        ]
        parts.append(capsule((k * 0.055, 0, 0.37), (k * 0.06, 0, 0.375), 0.025))
    return joined(*parts, capsule((0, 0.07, 0.29), (0, 0.08, 0.29), 0.03)) * s


def _robot(rng: Random) -> FloatArray:
    w, d, h = rng.uniform([0.15, 0.1, 0.2], [0.25, 0.16, 0.3])
    legs = [block(s * w * 0.28, 0, 0, (w * 0.3, d * 0.8, 0.15)) for s in (-1, 1)]
    arms = [block(s * (w * 0.5 + 0.03), 0, 0.15 + h * 0.2, (0.05, 0.06, h * 0.75)) for s in (-1, 1)]
    return joined(
        *legs,
        *arms,
        block(0, 0, 0.15, (w, d, h)),
        block(0, 0.01, 0.16 + h, (w * 0.6, d * 0.8, 0.12)),
        rod(0, 0, 0.28 + h, 0.008, 0.08),
    )


def _horse(rng: Random) -> FloatArray:
    long, h = rng.uniform(0.3, 0.5), rng.uniform(0.25, 0.35)
    legs = [tube((x, y, 0), (x, y * 0.9, h), 0.02, 0.03) for x, y in corners4(0.05, long * 0.4)]
    return joined(
        capsule((0, -long * 0.4, h), (0, long * 0.4, h), 0.08),
        capsule((0, long * 0.4, h), (0, long * 0.6, h + 0.2), 0.05),
        capsule((0, long * 0.6, h + 0.2), (0, long * 0.8, h + 0.14), 0.04),
        *legs,
    )


def _tent(rng: Random) -> FloatArray:
    w, h = rng.uniform(0.8, 1.2), rng.uniform(0.7, 1.0)
    return prism_x(np.array([[-w / 2, 0], [w / 2, 0], [0, h]]), rng.uniform(1.2, 1.9))


def _backpack(rng: Random) -> FloatArray:
    w, d, h = rng.uniform([0.26, 0.14, 0.38], [0.34, 0.2, 0.5])
    straps = [
        tube((s * w * 0.25, d / 2, 0.05), (s * w * 0.25, d / 2 + 0.06, h * 0.6), 0.015) for s in (-1, 1)
    ]
    return joined(
        cushion((-w / 2, -d / 2, 0), (w / 2, d / 2, h), power=0.4),
        cushion((-w * 0.35, -d / 2 - 0.07, 0.03), (w * 0.35, -d / 2 + 0.03, h * 0.5), power=0.4),
        *straps,
    )


def _aquarium(rng: Random) -> FloatArray:
    w, d = rng.uniform([0.6, 0.3], [1.0, 0.4])
    legs = [block(x, y, 0, (0.05, 0.05, 0.65)) for x, y in corners4(w / 2 - 0.03, d / 2 - 0.03)]
    return joined(
        *legs,
        block(0, 0, 0.65, (w + 0.04, d + 0.04, 0.04)),
        block(0, 0, 0.69, (w, d, 0.4)),
        block(w * 0.3, 0, 1.09, (0.2, d, 0.05)),
    )


def _clock(rng: Random) -> FloatArray:
    w, d, h = rng.uniform([0.22, 0.1, 0.2], [0.35, 0.15, 0.3])
    face = tube((0, -d / 2 - 0.01, 0.6 * h), (0, -d / 2 + 0.02, 0.6 * h), 0.3 * w)
    return joined(
        block(0, 0, 0, (w * 1.3, d * 1.3, 0.03)),
        block(0, 0, 0.03, (w, d, h)),
        face,
        block(0, 0, h + 0.03, (w * 1.2, d * 1.2, 0.025)),
    )


def _post(rng: Random) -> FloatArray:
    h = rng.uniform(0.9, 1.3)
    return joined(rod(0, 0, 0, 0.05, h), block(0, -0.02, h, (0.25, 0.35, 0.25)), rod(0, 0, 0, 0.15, 0.03))


def _sewing_machine(rng: Random) -> FloatArray:
    long = rng.uniform(0.34, 0.45)
    base, post = block(0, 0, 0, (long, 0.18, 0.06)), block(long * 0.38, 0, 0.06, (0.1, 0.12, 0.2))
    return joined(
        base,
        post,
        block(0, 0, 0.2, (long * 0.9, 0.1, 0.08)),
        block(-long * 0.38, 0, 0.1, (0.07, 0.08, 0.16)),
        tube((long * 0.47, 0, 0.2), (long * 0.53, 0, 0.2), 0.06),
    )


FURNITURE: dict[str, Kind] = {
    "chair": lambda rng: corners_of(furniture.chair(rng)),
    "office chair": lambda rng: corners_of(furniture.office_chair(rng)),
    "sofa": lambda rng: corners_of(furniture.sofa(rng, int(rng.integers(2, 4)))),
    "table": lambda rng: corners_of(furniture.table(rng)),
    "cabinet": lambda rng: corners_of(AT_WALLS["cabinet"](rng)),
    "bookshelf": lambda rng: corners_of(AT_WALLS["bookshelf"](rng)),
    "washing machine": lambda rng: corners_of(furniture.washing_machine(rng)),
    "pile": lambda rng: corners_of(things.pile(rng)),
    "vase": lambda rng: things.vase(rng, rng.uniform(0.18, 0.4)),
    "tub": lambda rng: corners_of(things.tub(rng)),
    "bath": lambda rng: corners_of(things.bath(rng, rng.uniform(1.5, 1.8))),
    "floor lamp": lambda rng: corners_of(things.floor_lamp(rng)),
    "plant": lambda rng: corners_of(AMIDST["plant"](rng)),
    "screen": lambda rng: corners_of(things.screen(rng, rng.uniform(0.45, 1.2))),
    "podium": lambda rng: corners_of(AT_WALLS["podium"](rng)),
    "flight": lambda rng: corners_of(things.flight(rng, 0.8, 4, 0.17, 0.26)),
    "seated figure": lambda rng: corners_of(AMIDST["seated figure"](rng)),
}


SHAPES: dict[str, Kind] = {
    "bottle": lambda rng: profile(rng, [0.2, 0.22, 0.2, 0.07, 0.07], [0, 0.1, 0.55, 0.75, 1]),
    "barrel": lambda rng: profile(rng, [0.35, 0.42, 0.35], [0, 0.5, 1], 0.1),
    "jar": lambda rng: profile(rng, [0.3, 0.4, 0.4, 0.28, 0.32, 0.32], [0, 0.1, 0.6, 0.75, 0.76, 0.9]),
    "hourglass": lambda rng: profile(
        rng, [0.3, 0.3, 0.25, 0.06, 0.25, 0.3, 0.3], [0, 0.06, 0.1, 0.5, 0.9, 0.94, 1]
    ),
    "traffic cone": lambda rng: joined(
        block(0, 0, 0, (0.38, 0.38, 0.03)), rod(0, 0, 0.03, 0.14, rng.uniform(0.4, 0.7), 0.03)
    ),
    "gas bottle": lambda rng: profile(
        rng, [0.2, 0.25, 0.25, 0.1, 0.06, 0.14, 0.14], [0, 0.05, 0.7, 0.85, 0.86, 0.87, 1]
    ),
    "flower pot": lambda rng: profile(rng, [0.28, 0.4, 0.45, 0.45], [0, 0.75, 0.76, 0.9], 0.1),
    "candle holder": lambda rng: profile(
        rng, [0.35, 0.3, 0.06, 0.06, 0.15, 0.1, 0.1], [0, 0.05, 0.1, 0.5, 0.55, 0.56, 1]
    ),
    "pawn": lambda rng: profile(
        rng, [0.3, 0.3, 0.15, 0.12, 0.2, 0.12, 0.2, 0.1], [0, 0.1, 0.2, 0.6, 0.65, 0.68, 0.85, 1]
    ),
    "jug": _jug,
    "saucepan": _saucepan,
    "watering can": _watering_can,
    "crate": _crate,
    "model house": _model_house,
    "microwave": _microwave,
    "bench": _bench,
    "picnic table": _picnic_table,
    "ladder": _ladder,
    "sawhorse": _sawhorse,
    "easel": _easel,
    "star stool": _star_stool,
    "fan": _fan,
    "corner sofa": _corner_sofa,
    "trolley": _trolley,
    "toy car": _toy_car,
    "scooter": _scooter,
    "hammer": _hammer,
    "dumbbell": _dumbbell,
    "elbow": _elbow,
    "flange": _flange,
    "angle bracket": _angle_bracket,
    "pillow block": _pillow_block,
    "v block": _v_block,
    "two blocks": _two_blocks,
    "rock": lambda rng: blob(rng, 0.25),
    "heap": heap,
    "driftwood": driftwood,
    "tree": _tree,
    "teddy": _teddy,
    "robot": _robot,
    "horse": _horse,
    "tent": _tent,
    "backpack": _backpack,
    "aquarium": _aquarium,
    "mantel clock": _clock,
    "post": _post,
    "sewing machine": _sewing_machine,
}


TUNING: dict[str, Kind] = FURNITURE | SHAPES
