# SPDX-License-Identifier: MIT
"""Kinds of things by which back sides are scored: frames, stands, parts of machines, heaps, by chance."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from benchmarks.cases.backs.shapes import (
    Kind,
    Random,
    around,
    blob,
    block,
    joined,
    rod,
    turned,
)
from benchmarks.cases.houses.solids import capsule, cushion, lathe, tube
from scenes.checks import FloatArray


def _l_desk(rng: Random) -> FloatArray:
    w, d, h = rng.uniform([1.4, 1.1, 0.72], [1.9, 1.6, 0.76])
    tops = [block(w / 2, 0.35, h, (w, 0.7, 0.03)), block(0.3, d / 2, h, (0.6, d, 0.03))]
    legs = [
        block(x, y, 0, (0.05, 0.05, h))
        for x, y in ((0.05, 0.05), (w - 0.05, 0.05), (w - 0.05, 0.65), (0.05, d - 0.05), (0.55, d - 0.05))
    ]
    return joined(*tops, *legs, block(w - 0.3, 0.35, 0.1, (0.4, 0.6, h - 0.1)))


def _piano(rng: Random) -> FloatArray:
    w, h = rng.uniform(1.35, 1.5), rng.uniform(1.05, 1.25)
    legs = [block(s * (w / 2 - 0.06), -0.35, 0, (0.08, 0.08, 0.62)) for s in (-1, 1)]
    return joined(block(0, 0, 0, (w, 0.4, h)), block(0, -0.3, 0.62, (w, 0.3, 0.12)), *legs)


def _park_bench(rng: Random) -> FloatArray:
    w = rng.uniform(1.2, 1.7)
    seat = [block(0, y, 0.42, (w, 0.09, 0.03)) for y in (-0.22, -0.11, 0, 0.11)]
    back = [block(0, 0.2 + 0.04 * k, 0.52 + 0.13 * k, (w, 0.03, 0.09)) for k in range(3)]
    sides = [
        joined(
            block(x, -0.2, 0, (0.06, 0.06, 0.62)),
            tube((x, 0.15, 0), (x, 0.3, 0.9), 0.03, n=4),
            block(x, -0.03, 0.6, (0.06, 0.42, 0.03)),
        )
        for x in (-w * 0.45, w * 0.45)
    ]
    return joined(*seat, *back, *sides)


def _school_desk(rng: Random) -> FloatArray:
    w, d, h = rng.uniform([0.6, 0.45, 0.68], [0.8, 0.55, 0.78])
    legs = [
        joined(block(s * w * 0.42, 0, 0, (0.04, d * 0.9, 0.04)), block(s * w * 0.42, 0.1, 0, (0.04, 0.04, h)))
        for s in (-1, 1)
    ]
    return joined(
        *legs,
        block(0, 0, h - 0.12, (w * 0.9, d * 0.8, 0.1)),
        block(0, 0, h, (w, d, 0.02)),
        block(0, 0.15, 0.25, (w * 0.85, 0.02, 0.25)),
    )


def _step_stool(rng: Random) -> FloatArray:
    w, h = rng.uniform(0.38, 0.5), rng.uniform(0.4, 0.5)
    sides = [
        joined(block(s * w / 2, 0.15, 0, (0.03, 0.2, h)), block(s * w / 2, -0.1, 0, (0.03, 0.3, h / 2)))
        for s in (-1, 1)
    ]
    return joined(*sides, block(0, 0.14, h, (w + 0.06, 0.26, 0.03)), block(0, -0.12, h / 2, (w, 0.26, 0.03)))


def _trestle(rng: Random) -> FloatArray:
    h, n = rng.uniform(0.7, 0.8), rng.uniform(0.5, 0.7)
    legs = [
        tube((s * 0.3, t * n / 2, 0), (s * 0.05, t * n / 2, h), 0.025, n=4) for s in (-1, 1) for t in (-1, 1)
    ]
    return joined(
        *legs,
        block(0, 0, h - 0.03, (0.12, n + 0.1, 0.06)),
        block(0, n / 2, 0.3, (0.4, 0.03, 0.05)),
        block(0, -n / 2, 0.3, (0.4, 0.03, 0.05)),
    )


def _tripod(rng: Random) -> FloatArray:
    h, r, n = rng.uniform(0.9, 1.4), rng.uniform(0.3, 0.45), int(rng.integers(3, 5))
    legs = around(
        lambda a: tube((r * np.cos(a), r * np.sin(a), 0.0), (0.03 * np.cos(a), 0.03 * np.sin(a), h), 0.018),
        n,
        rng.uniform(0, 6),
    )
    return joined(legs, rod(0, 0, h - 0.05, 0.05, 0.1), block(0, 0, h + 0.05, (0.12, 0.16, 0.1)))


def _coat_stand(rng: Random) -> FloatArray:
    h, n = rng.uniform(1.6, 1.8), int(rng.integers(3, 6))
    start = rng.uniform(0, 6)
    feet = around(lambda a: tube((0, 0, 0.25), (0.28 * np.cos(a), 0.28 * np.sin(a), 0.02), 0.02), n, start)
    hooks = around(lambda a: tube((0, 0, h - 0.1), (0.16 * np.cos(a), 0.16 * np.sin(a), h), 0.014), n, start)
    return joined(rod(0, 0, 0.1, 0.022, h - 0.1), feet, hooks)


def _valve(rng: Random) -> FloatArray:
    r = rng.uniform(0.04, 0.06)
    pipe = tube((-0.2, 0, 0.1), (0.2, 0, 0.1), r)
    flanges = [tube((s * 0.2, 0, 0.1), (s * 0.18, 0, 0.1), 1.7 * r) for s in (-1, 1)]
    wheel = around(
        lambda a: tube((0, 0, 0.3), (0.09 * np.cos(a), 0.09 * np.sin(a), 0.3), 0.01), 5, rng.uniform(0, 1)
    )
    rim = lathe([(0.08, 0.29), (0.1, 0.29), (0.1, 0.31), (0.08, 0.31), (0.08, 0.29)], 32)
    return joined(pipe, *flanges, rod(0, 0, 0.1, 0.7 * r, 0.12), rod(0, 0, 0.2, 0.015, 0.12), wheel, rim)


def _hydrant(rng: Random) -> FloatArray:
    h, r = rng.uniform(0.6, 0.8), rng.uniform(0.1, 0.13)
    body = lathe(
        [
            (0, 0),
            (1.4 * r, 0),
            (1.4 * r, 0.06),
            (r, 0.08),
            (r, 0.75 * h),
            (1.2 * r, 0.77 * h),
            (0.8 * r, 0.92 * h),
            (0.2 * r, h),
            (0, h),
        ],
        40,
    )
    side = tube((-1.8 * r, 0, 0.55 * h), (1.8 * r, 0, 0.55 * h), 0.5 * r)
    return joined(body, side, tube((0, 0, 0.5 * h), (0, -1.9 * r, 0.5 * h), 0.6 * r))


def _spanner(rng: Random) -> FloatArray:
    long = rng.uniform(0.2, 0.35)
    jaw = [block(long + 0.02, s * 0.02, 0, (0.05, 0.016, 0.015)) for s in (-1, 1)]
    return joined(
        block(long / 2, 0, 0.002, (long, 0.022, 0.011)),
        *(turned(one - [long, 0, 0], 0.26) + [long, 0, 0] for one in jaw),
        rod(long, 0, 0, 0.028, 0.014),
        rod(0, 0, 0, 0.022, 0.014),
    )


def _kettlebell(rng: Random) -> FloatArray:
    r = rng.uniform(0.07, 0.11)
    loop = [(-0.6 * r, 0, 1.6 * r), (-0.5 * r, 0, 2.4 * r), (0.5 * r, 0, 2.4 * r), (0.6 * r, 0, 1.6 * r)]
    return joined(
        cushion((-r, -r, 0), (r, r, 2 * r), power=0.9),
        *(tube(a, b, 0.016) for a, b in pairwise(loop)),
    )


def _tee(rng: Random) -> FloatArray:
    r, long = rng.uniform(0.04, 0.06), rng.uniform(0.15, 0.25)
    rims = [tube((s * long, 0, 1.5 * r), (s * (long - 0.025), 0, 1.5 * r), 1.5 * r) for s in (-1, 1)]
    return joined(
        tube((-long, 0, 1.5 * r), (long, 0, 1.5 * r), r),
        *rims,
        rod(0, 0, 1.5 * r, r, 0.8 * long),
        rod(0, 0, 1.3 * r + 0.8 * long, 1.5 * r, 0.025),
    )


def _gear(rng: Random) -> FloatArray:
    r, n = rng.uniform(0.08, 0.12), int(rng.integers(9, 16))
    teeth = around(lambda a: turned(block(r, 0, 0, (0.04, 1.5 * r / n, 0.04)), a), n, rng.uniform(0, 1))
    return joined(rod(0, 0, 0, r, 0.04), teeth, rod(0, 0, 0, 0.35 * r, 0.14))


def _u_bracket(rng: Random) -> FloatArray:
    w, d, h, t = *rng.uniform([0.12, 0.06, 0.1], [0.22, 0.12, 0.2]), 0.015
    return joined(
        block(0, 0, 0, (w, d, t)),
        *(block(s * (w - t) / 2, 0, 0, (t, d, h)) for s in (-1, 1)),
        tube((-w * 0.7, 0, 0.75 * h), (w * 0.7, 0, 0.75 * h), 0.018),
    )


def _stepped_block(rng: Random) -> FloatArray:
    w, d = rng.uniform(0.12, 0.25, 2)
    h = rng.uniform(0.03, 0.07, 3)
    return joined(
        block(0, 0, 0, (w, d, h[0])),
        block(0, 0, h[0], (w, 0.66 * d, h[1])),
        block(0, 0, h[0] + h[1], (w, 0.33 * d, h[2])),
    )


def _i_beam(rng: Random) -> FloatArray:
    w, h, long = rng.uniform([0.1, 0.12, 0.3], [0.2, 0.25, 0.7])
    return joined(
        block(0, 0, 0, (w, long, 0.015)),
        block(0, 0, 0.015, (0.01, long, h)),
        block(0, 0, h + 0.015, (w, long, 0.015)),
    )


def _stack(rng: Random) -> FloatArray:
    z, solids = 0.0, []
    for _ in range(4):
        size = rng.uniform([0.1, 0.1, 0.05], [0.3, 0.25, 0.15])
        solids.append(
            turned(block(0, 0, 0, tuple(size)), rng.uniform(0, 3)) + [*rng.uniform(-0.04, 0.04, 2), z]
        )
        z += size[2]
    return joined(*solids)


def _arch(rng: Random) -> FloatArray:
    w, d, h = rng.uniform([0.25, 0.08, 0.2], [0.4, 0.15, 0.35])
    return joined(
        *(block(s * w * 0.4, 0, 0, (0.2 * w, d, h)) for s in (-1, 1)),
        block(0, 0, h, (w, d, 0.25 * h)),
        rod(0, 0, 1.25 * h, 0.4 * d, 0.1, 0.01),
    )


def _spiral(rng: Random) -> FloatArray:
    n, r, side = 14, rng.uniform(0.5, 0.7), rng.choice([-1, 1])
    steps = [turned(block(r / 2, 0, 0, (r, 0.22, 0.04)), side * 0.4 * k) + [0, 0, 0.12 * k] for k in range(n)]
    return joined(rod(0, 0, 0, 0.06, 0.12 * n + 0.4), *steps)


def _statue(rng: Random) -> FloatArray:
    s = rng.uniform(0.25, 0.4)
    solids = [
        block(0, 0, 0, (s, s, 0.2 * s)),
        capsule((0, 0, 0.5 * s), (0.05 * s, 0, 1.2 * s), 0.28 * s, 0.34 * s),
    ]
    arm = [
        capsule((0.3 * s, 0, 1.3 * s), (0.6 * s, 0.15 * s, 1.7 * s), 0.1 * s),
        capsule((-0.3 * s, 0, 1.3 * s), (-0.4 * s, 0.35 * s, 0.8 * s), 0.1 * s),
    ]
    return joined(
        *solids, *arm, capsule((0.05 * s, 0.05 * s, 1.75 * s), (0.08 * s, 0.07 * s, 1.8 * s), 0.19 * s)
    )


def _globe(rng: Random) -> FloatArray:
    r = rng.uniform(0.1, 0.16)
    turn = np.linspace(-0.3, np.pi - 0.3, 10)
    arc = [(1.15 * r * np.sin(a), 0.0, 1.5 * r - 1.15 * r * np.cos(a)) for a in turn]
    return joined(
        cushion((-r, -r, 0.5 * r), (r, r, 2.5 * r), power=1),
        rod(0, 0, 0, 0.7 * r, 0.02),
        rod(0, 0, 0, 0.015, 0.5 * r),
        *(tube(a, b, 0.008) for a, b in pairwise(arc)),
    )


def _trophy(rng: Random) -> FloatArray:
    h, r = rng.uniform(0.25, 0.4), rng.uniform(0.06, 0.1)
    cup = lathe(
        [
            (0, 0),
            (r, 0),
            (r, 0.1 * h),
            (0.2 * r, 0.2 * h),
            (0.2 * r, 0.4 * h),
            (1.1 * r, 0.75 * h),
            (1.1 * r, h),
            (0, h),
        ],
        40,
    )
    loops = []
    for s in (-1, 1):
        path = [
            (s * r, 0, 0.9 * h),
            (s * 1.8 * r, 0, 0.85 * h),
            (s * 1.6 * r, 0, 0.6 * h),
            (s * 0.7 * r, 0, 0.55 * h),
        ]
        loops += [tube(a, b, 0.008) for a, b in pairwise(path)]
    return joined(cup, *loops)


def _bust_of_cubes(rng: Random) -> FloatArray:
    solids = [block(0, 0, 0, (0.3, 0.25, 0.05))]
    for _ in range(7):
        x, y, z = *rng.uniform(-0.15, 0.15, 2), rng.uniform(0, 0.2)
        solids.append(block(x, y, z, tuple(rng.uniform(0.06, 0.2, 3))))
    return joined(*solids)


def _crumpled(rng: Random) -> FloatArray:
    return turned(blob(rng, 0.4), rng.uniform(0, 6)) * [1, 1, 0.7]


PARTS: dict[str, Kind] = {
    "L-desk": _l_desk,
    "piano": _piano,
    "park bench": _park_bench,
    "school desk": _school_desk,
    "step stool": _step_stool,
    "trestle": _trestle,
    "tripod": _tripod,
    "coat stand": _coat_stand,
    "valve": _valve,
    "hydrant": _hydrant,
    "spanner": _spanner,
    "kettlebell": _kettlebell,
    "tee": _tee,
    "gear": _gear,
    "U-bracket": _u_bracket,
    "stepped block": _stepped_block,
    "I-beam": _i_beam,
    "stack": _stack,
    "arch": _arch,
    "spiral stair": _spiral,
    "statue": _statue,
    "globe": _globe,
    "trophy": _trophy,
    "cubes": _bust_of_cubes,
    "crumpled": _crumpled,
}
