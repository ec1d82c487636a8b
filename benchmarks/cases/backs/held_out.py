# SPDX-License-Identifier: MIT
"""Kinds of things by which back sides are scored, never fitted on: furniture and props, by chance."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from benchmarks.cases.backs.held_out_parts import PARTS
from benchmarks.cases.backs.shapes import (
    Kind,
    Random,
    around,
    block,
    corners4,
    corners_of,
    frustum,
    joined,
    profile,
    rod,
    turned,
)
from benchmarks.cases.houses import furniture, things
from benchmarks.cases.houses.furnishing import AMIDST, AT_WALLS
from benchmarks.cases.houses.solids import capsule, cushion, lathe, tube
from scenes.checks import FloatArray


def _mug(rng: Random) -> FloatArray:
    r, h = rng.uniform(0.038, 0.05), rng.uniform(0.08, 0.13)
    cup = lathe([(0, 0), (r, 0), (r, h), (r - 0.004, h), (r - 0.004, 0.006), (0, 0.006)], 40)
    loop = [(r, 0, 0.25 * h), (1.7 * r, 0, 0.3 * h), (1.75 * r, 0, 0.7 * h), (r, 0, 0.8 * h)]
    return joined(cup, *(tube(a, b, 0.006) for a, b in pairwise(loop)))


def _kettle(rng: Random) -> FloatArray:
    r, h = rng.uniform(0.08, 0.11), rng.uniform(0.13, 0.2)
    body = lathe(
        [
            (0, 0),
            (r, 0),
            (1.1 * r, 0.3 * h),
            (0.6 * r, 0.95 * h),
            (0.15 * r, h),
            (0.15 * r, 1.1 * h),
            (0, 1.1 * h),
        ],
        40,
    )
    loop = [(-0.6 * r, 0, 0.9 * h), (-0.5 * r, 0, 1.6 * h), (0.5 * r, 0, 1.6 * h), (0.6 * r, 0, 0.9 * h)]
    handle = [tube(a, b, 0.01) for a, b in pairwise(loop)]
    return joined(body, tube((r, 0, 0.4 * h), (1.8 * r, 0, 0.9 * h), 0.025, 0.012), *handle)


def _extinguisher(rng: Random) -> FloatArray:
    r, h = rng.uniform(0.06, 0.09), rng.uniform(0.35, 0.5)
    body = lathe([(0, 0), (r, 0), (r, 0.8 * h), (0.4 * r, 0.92 * h), (0.3 * r, h), (0, h)], 40)
    hose = [
        tube((0, 0, h), (r * 1.3, 0, 0.9 * h), 0.012),
        tube((r * 1.3, 0, 0.9 * h), (r * 1.3, 0, 0.3 * h), 0.012, 0.02),
    ]
    return joined(body, *hose, tube((-0.09, 0, h + 0.03), (0.03, 0, h + 0.01), 0.01))


def _mailbox(rng: Random) -> FloatArray:
    w, d, h = rng.uniform([0.3, 0.15, 0.3], [0.42, 0.3, 0.5])
    return joined(
        block(0, 0, 0, (w, d, h)),
        block(0, -0.02, h, (w * 1.08, d * 1.15, 0.03)),
        block(0, -d / 2, 0.7 * h, (0.8 * w, 0.03, 0.03)),
    )


def _speaker(rng: Random) -> FloatArray:
    w, d, h = rng.uniform([0.15, 0.18, 0.25], [0.3, 0.35, 0.9])
    cones = [
        tube((0, -d / 2, z * h), (0, -d / 2 - 0.015, z * h), q * w) for z, q in ((0.35, 0.38), (0.75, 0.2))
    ]
    return joined(block(0, 0, 0, (w, d, h)), *cones)


def _oven(rng: Random) -> FloatArray:
    w, d, h = 0.6, rng.uniform(0.55, 0.65), rng.uniform(0.8, 0.9)
    plates = [rod(x, y, h, 0.08, 0.015) for x, y in corners4(w * 0.22, d * 0.22)]
    knobs = [
        tube((x, -d / 2, h - 0.06), (x, -d / 2 - 0.03, h - 0.06), 0.02) for x in np.linspace(-0.22, 0.22, 5)
    ]
    return joined(
        block(0, 0, 0, (w, d, h)),
        *plates,
        *knobs,
        tube((-0.22, -d / 2 - 0.04, 0.65), (0.22, -d / 2 - 0.04, 0.65), 0.01),
    )


def _printer(rng: Random) -> FloatArray:
    w, d, h = rng.uniform([0.38, 0.3, 0.16], [0.5, 0.42, 0.3])
    tray = turned(block(0, 0, 0, (w * 0.6, 0.01, 0.2)), 0, -0.4) + [0, d * 0.35, h]
    return joined(
        block(0, 0, 0, (w, d, h)),
        block(0, -d / 2 - 0.08, 0.04, (w * 0.6, 0.18, 0.015)),
        tray,
        block(w * 0.35, -d * 0.4, h, (w * 0.2, 0.08, 0.02)),
    )


def _keyboard(rng: Random) -> FloatArray:
    w, d = rng.uniform(0.35, 0.46), rng.uniform(0.12, 0.16)
    keys = [
        block(x, y, 0.018, (w / 17, d / 7, 0.008))
        for x in np.linspace(-0.44, 0.44, 14) * w
        for y in np.linspace(-0.36, 0.36, 5) * d
    ]
    return joined(block(0, 0, 0, (w, d, 0.018)), *keys)


def _toaster(rng: Random) -> FloatArray:
    w, d, h = rng.uniform([0.25, 0.15, 0.16], [0.32, 0.2, 0.2])
    lever = block(w / 2 + 0.015, 0, h * 0.55, (0.04, 0.03, 0.02))
    return joined(cushion((-w / 2, -d / 2, 0), (w / 2, d / 2, h), power=0.2), lever)


def _drill_press(rng: Random) -> FloatArray:
    h = rng.uniform(0.7, 0.95)
    head = joined(block(0, -0.08, h - 0.25, (0.18, 0.4, 0.22)), rod(0, -0.2, h - 0.45, 0.025, 0.22))
    arms = around(
        lambda a: tube(
            (0.1, -0.15, h - 0.2), (0.14, -0.15 + 0.15 * np.cos(a), h - 0.2 + 0.15 * np.sin(a)), 0.01
        ),
        3,
    )
    return joined(
        block(0, -0.1, 0, (0.28, 0.45, 0.04)),
        rod(0, 0.1, 0, 0.04, h),
        head,
        arms,
        block(0, -0.18, 0.35, (0.25, 0.25, 0.025)),
    )


def _wheelbarrow(rng: Random) -> FloatArray:
    w, long = rng.uniform(0.45, 0.6), rng.uniform(0.7, 0.9)
    tray = frustum((w * 0.6, long * 0.6), (w, long), 0.3, 0.25)
    handles = [tube((s * 0.1, long * 0.7, 0.2), (s * w * 0.5, -long, 0.55), 0.018) for s in (-1, 1)]
    legs = [tube((s * w * 0.3, -long * 0.35, 0.0), (s * w * 0.3, -long * 0.3, 0.35), 0.018) for s in (-1, 1)]
    return joined(tray, *handles, *legs, tube((-0.04, long * 0.7, 0.18), (0.04, long * 0.7, 0.18), 0.18))


def _cart(rng: Random) -> FloatArray:
    w, long = rng.uniform(0.5, 0.6), rng.uniform(0.8, 1.0)
    wheels = [
        tube((x - 0.015, y, 0.06), (x + 0.015, y, 0.06), 0.06) for x, y in corners4(w * 0.4, long * 0.4)
    ]
    return joined(
        *wheels,
        block(0, 0, 0.12, (w, long, 0.04)),
        frustum((w * 0.8, long * 0.75), (w, long), 0.5, 0.4),
        *(tube((x, -long * 0.45, 0.15), (x, -long * 0.4, 0.95), 0.015) for x in (-w * 0.4, w * 0.4)),
    )


def _bicycle(rng: Random) -> FloatArray:
    r, long = rng.uniform(0.28, 0.35), rng.uniform(0.95, 1.1)
    tyre = lathe(
        [(r - 0.02, -0.02), (r + 0.02, -0.02), (r + 0.02, 0.02), (r - 0.02, 0.02), (r - 0.02, -0.02)], 40
    )
    wheels = [turned(tyre, 0, 0, np.pi / 2) + [0, y, r] for y in (-long / 2, long / 2)]
    a, b, c, d = (0, -long / 2, r), (0, -0.1, r), (0, -0.18, 0.85), (0, long / 2 - 0.15, 0.8)
    frame = [tube(*one, 0.018) for one in ((a, b), (b, c), (c, d), (b, d), (a, c), (d, (0, long / 2, r)))]
    bar = tube((-0.28, long / 2 - 0.17, 0.95), (0.28, long / 2 - 0.17, 0.95), 0.014)
    return joined(
        *wheels,
        *frame,
        bar,
        block(0, -0.2, 0.87, (0.14, 0.25, 0.05)),
        tube(d, (0, long / 2 - 0.17, 0.95), 0.016),
        tube((0.09, -0.1, r - 0.15), (0.02, -0.1, r), 0.012),
        tube((-0.09, -0.1, r + 0.15), (-0.02, -0.1, r), 0.012),
    )


def _boat(rng: Random) -> FloatArray:
    long, w, h = rng.uniform([0.4, 0.12, 0.08], [0.6, 0.2, 0.14])
    hull = block(0, 0, 0, (1.0, 1.0, 1.0))
    hull = np.asarray(hull)
    n = 12
    y = np.linspace(-0.5, 0.5, n)
    width = w * (1 - np.maximum(y, 0) ** 2 * 3.2)
    pieces = [_slice(y[k] * long, y[k + 1] * long, width[k], width[k + 1], h) for k in range(n - 1)]
    return joined(
        *pieces,
        block(0, -0.1 * long, h, (0.6 * w, 0.3 * long, 0.4 * h)),
        rod(0, 0.1 * long, h, 0.01, 2.2 * h),
    )


def _slice(y0: float, y1: float, w0: float, w1: float, h: float) -> FloatArray:
    """A slice of a hull: narrower below."""
    solid = block(0, 0.5, 0, (1.0, 1.0, 1.0))
    x, s, z = (solid[..., k : k + 1] for k in range(3))
    wide = (w0 * (1 - s) + w1 * s) * (0.6 + 0.4 * z)
    return np.concatenate([x * wide, y0 + (y1 - y0) * s, h * z], axis=-1)


def _aeroplane(rng: Random) -> FloatArray:
    long, span = rng.uniform(0.5, 0.7), rng.uniform(0.5, 0.8)
    body = capsule((0, -long / 2, 0.12), (0, long / 2, 0.12), 0.025, 0.045)
    legs = [tube((s * 0.08, 0.1, 0.0), (s * 0.04, 0.1, 0.1), 0.012) for s in (-1, 1)]
    return joined(
        body,
        block(0, 0.05, 0.12, (span, 0.14, 0.015)),
        block(0, -long / 2, 0.13, (span * 0.35, 0.08, 0.01)),
        block(0, -long / 2, 0.13, (0.012, 0.09, 0.12)),
        *legs,
        tube((0, -long * 0.45, 0), (0, -long * 0.45, 0.1), 0.01),
    )


def _shoe(rng: Random) -> FloatArray:
    long, bend = rng.uniform(0.24, 0.3), rng.uniform(0.02, 0.035)
    toe = cushion((-0.045 + bend, 0.3 * long, 0), (0.05 + bend, long, 0.06), power=0.6)
    heel = cushion((-0.035, 0, 0), (0.035, 0.55 * long, 0.1), power=0.5)
    middle = cushion((-0.035 + 0.4 * bend, 0.2 * long, 0), (0.04 + 0.5 * bend, 0.75 * long, 0.075), power=0.5)
    return joined(toe, heel, middle)


def _duck(rng: Random) -> FloatArray:
    s = rng.uniform(0.15, 0.3)
    return joined(
        cushion((-0.4 * s, -0.6 * s, 0), (0.4 * s, 0.6 * s, 0.6 * s), power=0.8),
        capsule((0, 0.4 * s, 0.6 * s), (0, 0.45 * s, 0.75 * s), 0.25 * s),
        tube((0, 0.6 * s, 0.72 * s), (0, 0.9 * s, 0.68 * s), 0.1 * s, 0.05 * s),
        tube((0, -0.5 * s, 0.4 * s), (0, -0.75 * s, 0.6 * s), 0.15 * s, 0.03 * s),
    )


def _dog(rng: Random) -> FloatArray:
    long, h = rng.uniform(0.35, 0.6), rng.uniform(0.25, 0.4)
    legs = [capsule((x, y, 0.03), (x, y, h), 0.03) for x, y in corners4(0.07, long * 0.35)]
    turn = rng.uniform(0.3, 0.7)
    head = turned(capsule((0, 0, 0), (0, 0.12, -0.02), 0.08, 0.045), turn) + [0, long * 0.5, h + 0.15]
    return joined(
        capsule((0, -long * 0.35, h), (0, long * 0.35, h), 0.1),
        head,
        tube((0, -long * 0.4, h), (0.08, -long * 0.65, h + 0.12), 0.02),
        *legs,
    )


def _suitcase(rng: Random) -> FloatArray:
    w, d, h = rng.uniform([0.35, 0.2, 0.5], [0.5, 0.3, 0.75])
    posts = [rod(s * 0.08, d * 0.3, h, 0.008, 0.3) for s in (-1, 1)]
    return joined(
        cushion((-w / 2, -d / 2, 0.04), (w / 2, d / 2, h), power=0.15),
        *posts,
        tube((-0.09, d * 0.3, h + 0.3), (0.09, d * 0.3, h + 0.3), 0.012),
        *(rod(x, y, 0, 0.02, 0.05) for x, y in corners4(w * 0.4, d * 0.35)),
    )


def _handbag(rng: Random) -> FloatArray:
    w, d, h = rng.uniform([0.25, 0.1, 0.18], [0.4, 0.16, 0.28])
    loops = []
    for s in (-1, 1):
        path = [
            (-0.25 * w, s * 0.2 * d, h),
            (-0.18 * w, s * 0.3 * d, 1.5 * h),
            (0.18 * w, s * 0.3 * d, 1.5 * h),
            (0.25 * w, s * 0.2 * d, h),
        ]
        loops += [tube(a, b, 0.007) for a, b in pairwise(path)]
    return joined(frustum((w, d), (0.8 * w, 0.4 * d), 0, h), *loops)


def _high_chair(rng: Random) -> FloatArray:
    h = rng.uniform(0.5, 0.6)
    legs = [tube((x, y, 0), (x * 0.6, y * 0.6, h), 0.018) for x, y in corners4(0.25, 0.25)]
    return joined(
        *legs,
        block(0, 0, h, (0.32, 0.3, 0.03)),
        block(0, 0.14, h, (0.32, 0.03, 0.4)),
        block(0, -0.22, h + 0.2, (0.42, 0.24, 0.02)),
        *(block(s * 0.16, 0, h, (0.02, 0.28, 0.2)) for s in (-1, 1)),
    )


FURNITURE: dict[str, Kind] = {
    "stool": lambda rng: corners_of(furniture.stool(rng)),
    "armchair": lambda rng: corners_of(furniture.sofa(rng, 1)),
    "desk": lambda rng: corners_of(furniture.desk(rng)),
    "coffee table": lambda rng: corners_of(furniture.coffee_table(rng)),
    "bed": lambda rng: corners_of(furniture.bed(rng)),
    "wardrobe": lambda rng: corners_of(AT_WALLS["wardrobe"](rng)),
    "nightstand": lambda rng: corners_of(AT_WALLS["nightstand"](rng)),
    "fridge": lambda rng: corners_of(furniture.fridge(rng)),
    "bag": lambda rng: corners_of(things.bag(rng)),
    "bin": lambda rng: corners_of(things.bin_(rng)),
    "bowl": lambda rng: things.bowl(rng.uniform(0.09, 0.15), rng.uniform(0.07, 0.12)),
    "laptop": lambda rng: corners_of(things.laptop(rng)),
    "desk lamp": lambda rng: corners_of(things.desk_lamp(rng)),
    "radiator": lambda rng: corners_of(AT_WALLS["radiator"](rng)),
    "toilet": lambda rng: corners_of(things.toilet(rng)),
    "basin": lambda rng: corners_of(things.basin(rng)),
    "boxes": lambda rng: corners_of(things.boxes(rng)),
    "carton": lambda rng: corners_of(things.carton(rng, *rng.uniform([0.3, 0.25, 0.2], [0.6, 0.4, 0.5]))),
    "drying rack": lambda rng: corners_of(things.drying_rack(rng)),
    "figure": lambda rng: corners_of(AMIDST["figure"](rng)),
}


SHAPES: dict[str, Kind] = {
    "goblet": lambda rng: profile(
        rng, [0.3, 0.28, 0.04, 0.04, 0.3, 0.36, 0.3], [0, 0.03, 0.08, 0.45, 0.6, 0.8, 1]
    ),
    "bucket": lambda rng: profile(rng, [0.3, 0.42, 0.45, 0.45], [0, 0.8, 0.81, 0.85], 0.08),
    "funnel": lambda rng: profile(rng, [0.06, 0.08, 0.12, 0.5, 0.5], [0, 0.4, 0.45, 0.85, 0.95], 0.15),
    "bell": lambda rng: profile(rng, [0.45, 0.4, 0.28, 0.22, 0.06, 0.06], [0, 0.1, 0.4, 0.7, 0.8, 1]),
    "bollard": lambda rng: profile(
        rng, [0.22, 0.2, 0.14, 0.14, 0.19, 0.1], [0, 0.05, 0.1, 1.2, 1.3, 1.5], 0.1
    ),
    "milk can": lambda rng: profile(rng, [0.3, 0.32, 0.32, 0.18, 0.18, 0.24], [0, 0.03, 0.6, 0.78, 0.9, 1]),
    "spool": lambda rng: profile(
        rng, [0.4, 0.4, 0.18, 0.18, 0.4, 0.4], [0, 0.1, 0.12, 0.7, 0.72, 0.82], 0.08
    ),
    "lantern": lambda rng: profile(
        rng, [0.25, 0.25, 0.18, 0.2, 0.18, 0.3, 0.05], [0, 0.12, 0.15, 0.5, 0.75, 0.78, 1]
    ),
    "mug": _mug,
    "kettle": _kettle,
    "extinguisher": _extinguisher,
    "mailbox": _mailbox,
    "speaker": _speaker,
    "oven": _oven,
    "printer": _printer,
    "keyboard": _keyboard,
    "toaster": _toaster,
    "drill press": _drill_press,
    "wheelbarrow": _wheelbarrow,
    "cart": _cart,
    "bicycle": _bicycle,
    "boat": _boat,
    "aeroplane": _aeroplane,
    "shoe": _shoe,
    "duck": _duck,
    "dog": _dog,
    "suitcase": _suitcase,
    "handbag": _handbag,
    "high chair": _high_chair,
}


HELD_OUT: dict[str, Kind] = FURNITURE | SHAPES | PARTS
