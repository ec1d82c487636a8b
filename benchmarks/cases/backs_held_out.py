# SPDX-License-Identifier: MIT
"""Kinds of things by which back sides are scored, never fitted on: triangles (m, 3, 3), metres, z up, by chance."""

from __future__ import annotations

import numpy as np

from benchmarks.cases.backs_tuning import (
    Kind,
    Random,
    around,
    blob,
    block,
    corners4,
    corners_of,
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
    return joined(cup, *(tube(a, b, 0.006) for a, b in zip(loop[:-1], loop[1:], strict=True)))


def _kettle(rng: Random) -> FloatArray:
    r, h = rng.uniform(0.08, 0.11), rng.uniform(0.13, 0.2)
    body = lathe([(0, 0), (r, 0), (1.1 * r, 0.3 * h), (0.6 * r, 0.95 * h), (0.15 * r, h), (0.15 * r, 1.1 * h), (0, 1.1 * h)], 40)
    loop = [(-0.6 * r, 0, 0.9 * h), (-0.5 * r, 0, 1.6 * h), (0.5 * r, 0, 1.6 * h), (0.6 * r, 0, 0.9 * h)]
    handle = [tube(a, b, 0.01) for a, b in zip(loop[:-1], loop[1:], strict=True)]
    return joined(body, tube((r, 0, 0.4 * h), (1.8 * r, 0, 0.9 * h), 0.025, 0.012), *handle)


def _extinguisher(rng: Random) -> FloatArray:
    r, h = rng.uniform(0.06, 0.09), rng.uniform(0.35, 0.5)
    body = lathe([(0, 0), (r, 0), (r, 0.8 * h), (0.4 * r, 0.92 * h), (0.3 * r, h), (0, h)], 40)
    hose = [tube((0, 0, h), (r * 1.3, 0, 0.9 * h), 0.012), tube((r * 1.3, 0, 0.9 * h), (r * 1.3, 0, 0.3 * h), 0.012, 0.02)]
    return joined(body, *hose, tube((-0.09, 0, h + 0.03), (0.03, 0, h + 0.01), 0.01))


def _mailbox(rng: Random) -> FloatArray:
    w, d, h = rng.uniform([0.3, 0.15, 0.3], [0.42, 0.3, 0.5])
    return joined(block(0, 0, 0, (w, d, h)), block(0, -0.02, h, (w * 1.08, d * 1.15, 0.03)), block(0, -d / 2, 0.7 * h, (0.8 * w, 0.03, 0.03)))


def _speaker(rng: Random) -> FloatArray:
    w, d, h = rng.uniform([0.15, 0.18, 0.25], [0.3, 0.35, 0.9])
    cones = [tube((0, -d / 2, z * h), (0, -d / 2 - 0.015, z * h), q * w) for z, q in ((0.35, 0.38), (0.75, 0.2))]
    return joined(block(0, 0, 0, (w, d, h)), *cones)


def _oven(rng: Random) -> FloatArray:
    w, d, h = 0.6, rng.uniform(0.55, 0.65), rng.uniform(0.8, 0.9)
    plates = [rod(x, y, h, 0.08, 0.015) for x, y in corners4(w * 0.22, d * 0.22)]
    knobs = [tube((x, -d / 2, h - 0.06), (x, -d / 2 - 0.03, h - 0.06), 0.02) for x in np.linspace(-0.22, 0.22, 5)]
    return joined(block(0, 0, 0, (w, d, h)), *plates, *knobs, tube((-0.22, -d / 2 - 0.04, 0.65), (0.22, -d / 2 - 0.04, 0.65), 0.01))


def _printer(rng: Random) -> FloatArray:
    w, d, h = rng.uniform([0.38, 0.3, 0.16], [0.5, 0.42, 0.3])
    tray = turned(block(0, 0, 0, (w * 0.6, 0.01, 0.2)), 0, -0.4) + [0, d * 0.35, h]
    return joined(block(0, 0, 0, (w, d, h)), block(0, -d / 2 - 0.08, 0.04, (w * 0.6, 0.18, 0.015)), tray, block(w * 0.35, -d * 0.4, h, (w * 0.2, 0.08, 0.02)))


def _keyboard(rng: Random) -> FloatArray:
    w, d = rng.uniform(0.35, 0.46), rng.uniform(0.12, 0.16)
    keys = [block(x, y, 0.018, (w / 17, d / 7, 0.008)) for x in np.linspace(-0.44, 0.44, 14) * w for y in np.linspace(-0.36, 0.36, 5) * d]
    return joined(block(0, 0, 0, (w, d, 0.018)), *keys)


def _toaster(rng: Random) -> FloatArray:
    w, d, h = rng.uniform([0.25, 0.15, 0.16], [0.32, 0.2, 0.2])
    lever = block(w / 2 + 0.015, 0, h * 0.55, (0.04, 0.03, 0.02))
    return joined(cushion((-w / 2, -d / 2, 0), (w / 2, d / 2, h), power=0.2), lever)


def _drill_press(rng: Random) -> FloatArray:
    h = rng.uniform(0.7, 0.95)
    head = joined(block(0, -0.08, h - 0.25, (0.18, 0.4, 0.22)), rod(0, -0.2, h - 0.45, 0.025, 0.22))
    arms = around(lambda a: tube((0.1, -0.15, h - 0.2), (0.14, -0.15 + 0.15 * np.cos(a), h - 0.2 + 0.15 * np.sin(a)), 0.01), 3)
    return joined(block(0, -0.1, 0, (0.28, 0.45, 0.04)), rod(0, 0.1, 0, 0.04, h), head, arms, block(0, -0.18, 0.35, (0.25, 0.25, 0.025)))


def _l_desk(rng: Random) -> FloatArray:
    w, d, h = rng.uniform([1.4, 1.1, 0.72], [1.9, 1.6, 0.76])
    tops = [block(w / 2, 0.35, h, (w, 0.7, 0.03)), block(0.3, d / 2, h, (0.6, d, 0.03))]
    legs = [block(x, y, 0, (0.05, 0.05, h)) for x, y in ((0.05, 0.05), (w - 0.05, 0.05), (w - 0.05, 0.65), (0.05, d - 0.05), (0.55, d - 0.05))]
    return joined(*tops, *legs, block(w - 0.3, 0.35, 0.1, (0.4, 0.6, h - 0.1)))


def _piano(rng: Random) -> FloatArray:
    w, h = rng.uniform(1.35, 1.5), rng.uniform(1.05, 1.25)
    legs = [block(s * (w / 2 - 0.06), -0.35, 0, (0.08, 0.08, 0.62)) for s in (-1, 1)]
    return joined(block(0, 0, 0, (w, 0.4, h)), block(0, -0.3, 0.62, (w, 0.3, 0.12)), *legs)


def _park_bench(rng: Random) -> FloatArray:
    w = rng.uniform(1.2, 1.7)
    seat = [block(0, y, 0.42, (w, 0.09, 0.03)) for y in (-0.22, -0.11, 0, 0.11)]
    back = [block(0, 0.2 + 0.04 * k, 0.52 + 0.13 * k, (w, 0.03, 0.09)) for k in range(3)]
    sides = [joined(block(x, -0.2, 0, (0.06, 0.06, 0.62)), tube((x, 0.15, 0), (x, 0.3, 0.9), 0.03, n=4), block(x, -0.03, 0.6, (0.06, 0.42, 0.03))) for x in (-w * 0.45, w * 0.45)]
    return joined(*seat, *back, *sides)


def _school_desk(rng: Random) -> FloatArray:
    w, d, h = rng.uniform([0.6, 0.45, 0.68], [0.8, 0.55, 0.78])
    legs = [joined(block(s * w * 0.42, 0, 0, (0.04, d * 0.9, 0.04)), block(s * w * 0.42, 0.1, 0, (0.04, 0.04, h))) for s in (-1, 1)]
    return joined(*legs, block(0, 0, h - 0.12, (w * 0.9, d * 0.8, 0.1)), block(0, 0, h, (w, d, 0.02)), block(0, 0.15, 0.25, (w * 0.85, 0.02, 0.25)))


def _step_stool(rng: Random) -> FloatArray:
    w, h = rng.uniform(0.38, 0.5), rng.uniform(0.4, 0.5)
    sides = [joined(block(s * w / 2, 0.15, 0, (0.03, 0.2, h)), block(s * w / 2, -0.1, 0, (0.03, 0.3, h / 2))) for s in (-1, 1)]
    return joined(*sides, block(0, 0.14, h, (w + 0.06, 0.26, 0.03)), block(0, -0.12, h / 2, (w, 0.26, 0.03)))


def _trestle(rng: Random) -> FloatArray:
    h, n = rng.uniform(0.7, 0.8), rng.uniform(0.5, 0.7)
    legs = [tube((s * 0.3, t * n / 2, 0), (s * 0.05, t * n / 2, h), 0.025, n=4) for s in (-1, 1) for t in (-1, 1)]
    return joined(*legs, block(0, 0, h - 0.03, (0.12, n + 0.1, 0.06)), block(0, n / 2, 0.3, (0.4, 0.03, 0.05)), block(0, -n / 2, 0.3, (0.4, 0.03, 0.05)))


def _tripod(rng: Random) -> FloatArray:
    h, r, n = rng.uniform(0.9, 1.4), rng.uniform(0.3, 0.45), int(rng.integers(3, 5))
    legs = around(lambda a: tube((r * np.cos(a), r * np.sin(a), 0.0), (0.03 * np.cos(a), 0.03 * np.sin(a), h), 0.018), n, rng.uniform(0, 6))
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
    wheel = around(lambda a: tube((0, 0, 0.3), (0.09 * np.cos(a), 0.09 * np.sin(a), 0.3), 0.01), 5, rng.uniform(0, 1))
    rim = lathe([(0.08, 0.29), (0.1, 0.29), (0.1, 0.31), (0.08, 0.31), (0.08, 0.29)], 32)
    return joined(pipe, *flanges, rod(0, 0, 0.1, 0.7 * r, 0.12), rod(0, 0, 0.2, 0.015, 0.12), wheel, rim)


def _hydrant(rng: Random) -> FloatArray:
    h, r = rng.uniform(0.6, 0.8), rng.uniform(0.1, 0.13)
    body = lathe([(0, 0), (1.4 * r, 0), (1.4 * r, 0.06), (r, 0.08), (r, 0.75 * h), (1.2 * r, 0.77 * h), (0.8 * r, 0.92 * h), (0.2 * r, h), (0, h)], 40)
    side = tube((-1.8 * r, 0, 0.55 * h), (1.8 * r, 0, 0.55 * h), 0.5 * r)
    return joined(body, side, tube((0, 0, 0.5 * h), (0, -1.9 * r, 0.5 * h), 0.6 * r))


def _wheelbarrow(rng: Random) -> FloatArray:
    w, l = rng.uniform(0.45, 0.6), rng.uniform(0.7, 0.9)
    tray = _frustum((w * 0.6, l * 0.6), (w, l), 0.3, 0.25)
    handles = [tube((s * 0.1, l * 0.7, 0.2), (s * w * 0.5, -l, 0.55), 0.018) for s in (-1, 1)]
    legs = [tube((s * w * 0.3, -l * 0.35, 0.0), (s * w * 0.3, -l * 0.3, 0.35), 0.018) for s in (-1, 1)]
    return joined(tray, *handles, *legs, tube((-0.04, l * 0.7, 0.18), (0.04, l * 0.7, 0.18), 0.18))


def _frustum(low: tuple[float, float], high: tuple[float, float], z: float, h: float) -> FloatArray:
    """A solid with rectangular ends of two sizes."""
    solid = block(0, 0, 0, (1.0, 1.0, 1.0))
    share = solid[..., 2:]
    size = np.array(low) * (1 - share) + np.array(high) * share
    return np.concatenate([solid[..., :2] * size, z + h * share], axis=-1)


def _cart(rng: Random) -> FloatArray:
    w, l = rng.uniform(0.5, 0.6), rng.uniform(0.8, 1.0)
    wheels = [tube((x - 0.015, y, 0.06), (x + 0.015, y, 0.06), 0.06) for x, y in corners4(w * 0.4, l * 0.4)]
    return joined(*wheels, block(0, 0, 0.12, (w, l, 0.04)), _frustum((w * 0.8, l * 0.75), (w, l), 0.5, 0.4), *(tube((x, -l * 0.45, 0.15), (x, -l * 0.4, 0.95), 0.015) for x in (-w * 0.4, w * 0.4)))


def _bicycle(rng: Random) -> FloatArray:
    r, l = rng.uniform(0.28, 0.35), rng.uniform(0.95, 1.1)
    tyre = lathe([(r - 0.02, -0.02), (r + 0.02, -0.02), (r + 0.02, 0.02), (r - 0.02, 0.02), (r - 0.02, -0.02)], 40)
    wheels = [turned(tyre, 0, 0, np.pi / 2) + [0, y, r] for y in (-l / 2, l / 2)]
    a, b, c, d = (0, -l / 2, r), (0, -0.1, r), (0, -0.18, 0.85), (0, l / 2 - 0.15, 0.8)
    frame = [tube(*one, 0.018) for one in ((a, b), (b, c), (c, d), (b, d), (a, c), (d, (0, l / 2, r)))]
    bar = tube((-0.28, l / 2 - 0.17, 0.95), (0.28, l / 2 - 0.17, 0.95), 0.014)
    return joined(*wheels, *frame, bar, block(0, -0.2, 0.87, (0.14, 0.25, 0.05)), tube(d, (0, l / 2 - 0.17, 0.95), 0.016), tube((0.09, -0.1, r - 0.15), (0.02, -0.1, r), 0.012), tube((-0.09, -0.1, r + 0.15), (-0.02, -0.1, r), 0.012))


def _boat(rng: Random) -> FloatArray:
    l, w, h = rng.uniform([0.4, 0.12, 0.08], [0.6, 0.2, 0.14])
    hull = block(0, 0, 0, (1.0, 1.0, 1.0))
    hull = np.asarray(hull)
    n = 12
    y = np.linspace(-0.5, 0.5, n)
    width = w * (1 - np.maximum(y, 0) ** 2 * 3.2)
    pieces = [_slice(y[k] * l, y[k + 1] * l, width[k], width[k + 1], h) for k in range(n - 1)]
    return joined(*pieces, block(0, -0.1 * l, h, (0.6 * w, 0.3 * l, 0.4 * h)), rod(0, 0.1 * l, h, 0.01, 2.2 * h))


def _slice(y0: float, y1: float, w0: float, w1: float, h: float) -> FloatArray:
    """A slice of a hull: narrower below."""
    solid = block(0, 0.5, 0, (1.0, 1.0, 1.0))
    x, s, z = (solid[..., k : k + 1] for k in range(3))
    wide = (w0 * (1 - s) + w1 * s) * (0.6 + 0.4 * z)
    return np.concatenate([x * wide, y0 + (y1 - y0) * s, h * z], axis=-1)


def _aeroplane(rng: Random) -> FloatArray:
    l, span = rng.uniform(0.5, 0.7), rng.uniform(0.5, 0.8)
    body = capsule((0, -l / 2, 0.12), (0, l / 2, 0.12), 0.025, 0.045)
    legs = [tube((s * 0.08, 0.1, 0.0), (s * 0.04, 0.1, 0.1), 0.012) for s in (-1, 1)]
    return joined(body, block(0, 0.05, 0.12, (span, 0.14, 0.015)), block(0, -l / 2, 0.13, (span * 0.35, 0.08, 0.01)), block(0, -l / 2, 0.13, (0.012, 0.09, 0.12)), *legs, tube((0, -l * 0.45, 0), (0, -l * 0.45, 0.1), 0.01))


def _shoe(rng: Random) -> FloatArray:
    l, bend = rng.uniform(0.24, 0.3), rng.uniform(0.02, 0.035)
    toe = cushion((-0.045 + bend, 0.3 * l, 0), (0.05 + bend, l, 0.06), power=0.6)
    heel = cushion((-0.035, 0, 0), (0.035, 0.55 * l, 0.1), power=0.5)
    middle = cushion((-0.035 + 0.4 * bend, 0.2 * l, 0), (0.04 + 0.5 * bend, 0.75 * l, 0.075), power=0.5)
    return joined(toe, heel, middle)


def _spanner(rng: Random) -> FloatArray:
    l = rng.uniform(0.2, 0.35)
    jaw = [block(l + 0.02, s * 0.02, 0, (0.05, 0.016, 0.015)) for s in (-1, 1)]
    return joined(block(l / 2, 0, 0.002, (l, 0.022, 0.011)), *(turned(one - [l, 0, 0], 0.26) + [l, 0, 0] for one in jaw), rod(l, 0, 0, 0.028, 0.014), rod(0, 0, 0, 0.022, 0.014))


def _kettlebell(rng: Random) -> FloatArray:
    r = rng.uniform(0.07, 0.11)
    loop = [(-0.6 * r, 0, 1.6 * r), (-0.5 * r, 0, 2.4 * r), (0.5 * r, 0, 2.4 * r), (0.6 * r, 0, 1.6 * r)]
    return joined(cushion((-r, -r, 0), (r, r, 2 * r), power=0.9), *(tube(a, b, 0.016) for a, b in zip(loop[:-1], loop[1:], strict=True)))


def _tee(rng: Random) -> FloatArray:
    r, l = rng.uniform(0.04, 0.06), rng.uniform(0.15, 0.25)
    rims = [tube((s * l, 0, 1.5 * r), (s * (l - 0.025), 0, 1.5 * r), 1.5 * r) for s in (-1, 1)]
    return joined(tube((-l, 0, 1.5 * r), (l, 0, 1.5 * r), r), *rims, rod(0, 0, 1.5 * r, r, 0.8 * l), rod(0, 0, 1.3 * r + 0.8 * l, 1.5 * r, 0.025))


def _gear(rng: Random) -> FloatArray:
    r, n = rng.uniform(0.08, 0.12), int(rng.integers(9, 16))
    teeth = around(lambda a: turned(block(r, 0, 0, (0.04, 1.5 * r / n, 0.04)), a), n, rng.uniform(0, 1))
    return joined(rod(0, 0, 0, r, 0.04), teeth, rod(0, 0, 0, 0.35 * r, 0.14))


def _u_bracket(rng: Random) -> FloatArray:
    w, d, h, t = *rng.uniform([0.12, 0.06, 0.1], [0.22, 0.12, 0.2]), 0.015
    return joined(block(0, 0, 0, (w, d, t)), *(block(s * (w - t) / 2, 0, 0, (t, d, h)) for s in (-1, 1)), tube((-w * 0.7, 0, 0.75 * h), (w * 0.7, 0, 0.75 * h), 0.018))


def _stepped_block(rng: Random) -> FloatArray:
    w, d = rng.uniform(0.12, 0.25, 2)
    h = rng.uniform(0.03, 0.07, 3)
    return joined(block(0, 0, 0, (w, d, h[0])), block(0, 0, h[0], (w, 0.66 * d, h[1])), block(0, 0, h[0] + h[1], (w, 0.33 * d, h[2])))


def _i_beam(rng: Random) -> FloatArray:
    w, h, l = rng.uniform([0.1, 0.12, 0.3], [0.2, 0.25, 0.7])
    return joined(block(0, 0, 0, (w, l, 0.015)), block(0, 0, 0.015, (0.01, l, h)), block(0, 0, h + 0.015, (w, l, 0.015)))


def _stack(rng: Random) -> FloatArray:
    z, solids = 0.0, []
    for _ in range(4):
        size = rng.uniform([0.1, 0.1, 0.05], [0.3, 0.25, 0.15])
        solids.append(turned(block(0, 0, 0, tuple(size)), rng.uniform(0, 3)) + [*rng.uniform(-0.04, 0.04, 2), z])
        z += size[2]
    return joined(*solids)


def _arch(rng: Random) -> FloatArray:
    w, d, h = rng.uniform([0.25, 0.08, 0.2], [0.4, 0.15, 0.35])
    return joined(*(block(s * w * 0.4, 0, 0, (0.2 * w, d, h)) for s in (-1, 1)), block(0, 0, h, (w, d, 0.25 * h)), rod(0, 0, 1.25 * h, 0.4 * d, 0.1, 0.01))


def _spiral(rng: Random) -> FloatArray:
    n, r, side = 14, rng.uniform(0.5, 0.7), rng.choice([-1, 1])
    steps = [turned(block(r / 2, 0, 0, (r, 0.22, 0.04)), side * 0.4 * k) + [0, 0, 0.12 * k] for k in range(n)]
    return joined(rod(0, 0, 0, 0.06, 0.12 * n + 0.4), *steps)


def _statue(rng: Random) -> FloatArray:
    s = rng.uniform(0.25, 0.4)
    solids = [block(0, 0, 0, (s, s, 0.2 * s)), capsule((0, 0, 0.5 * s), (0.05 * s, 0, 1.2 * s), 0.28 * s, 0.34 * s)]
    arm = [capsule((0.3 * s, 0, 1.3 * s), (0.6 * s, 0.15 * s, 1.7 * s), 0.1 * s), capsule((-0.3 * s, 0, 1.3 * s), (-0.4 * s, 0.35 * s, 0.8 * s), 0.1 * s)]
    return joined(*solids, *arm, capsule((0.05 * s, 0.05 * s, 1.75 * s), (0.08 * s, 0.07 * s, 1.8 * s), 0.19 * s))


def _duck(rng: Random) -> FloatArray:
    s = rng.uniform(0.15, 0.3)
    return joined(cushion((-0.4 * s, -0.6 * s, 0), (0.4 * s, 0.6 * s, 0.6 * s), power=0.8), capsule((0, 0.4 * s, 0.6 * s), (0, 0.45 * s, 0.75 * s), 0.25 * s), tube((0, 0.6 * s, 0.72 * s), (0, 0.9 * s, 0.68 * s), 0.1 * s, 0.05 * s), tube((0, -0.5 * s, 0.4 * s), (0, -0.75 * s, 0.6 * s), 0.15 * s, 0.03 * s))


def _dog(rng: Random) -> FloatArray:
    l, h = rng.uniform(0.35, 0.6), rng.uniform(0.25, 0.4)
    legs = [capsule((x, y, 0.03), (x, y, h), 0.03) for x, y in corners4(0.07, l * 0.35)]
    turn = rng.uniform(0.3, 0.7)
    head = turned(capsule((0, 0, 0), (0, 0.12, -0.02), 0.08, 0.045), turn) + [0, l * 0.5, h + 0.15]
    return joined(capsule((0, -l * 0.35, h), (0, l * 0.35, h), 0.1), head, tube((0, -l * 0.4, h), (0.08, -l * 0.65, h + 0.12), 0.02), *legs)


def _suitcase(rng: Random) -> FloatArray:
    w, d, h = rng.uniform([0.35, 0.2, 0.5], [0.5, 0.3, 0.75])
    posts = [rod(s * 0.08, d * 0.3, h, 0.008, 0.3) for s in (-1, 1)]
    return joined(cushion((-w / 2, -d / 2, 0.04), (w / 2, d / 2, h), power=0.15), *posts, tube((-0.09, d * 0.3, h + 0.3), (0.09, d * 0.3, h + 0.3), 0.012), *(rod(x, y, 0, 0.02, 0.05) for x, y in corners4(w * 0.4, d * 0.35)))


def _handbag(rng: Random) -> FloatArray:
    w, d, h = rng.uniform([0.25, 0.1, 0.18], [0.4, 0.16, 0.28])
    loops = []
    for s in (-1, 1):
        path = [(-0.25 * w, s * 0.2 * d, h), (-0.18 * w, s * 0.3 * d, 1.5 * h), (0.18 * w, s * 0.3 * d, 1.5 * h), (0.25 * w, s * 0.2 * d, h)]
        loops += [tube(a, b, 0.007) for a, b in zip(path[:-1], path[1:], strict=True)]
    return joined(_frustum((w, d), (0.8 * w, 0.4 * d), 0, h), *loops)


def _high_chair(rng: Random) -> FloatArray:
    h = rng.uniform(0.5, 0.6)
    legs = [tube((x, y, 0), (x * 0.6, y * 0.6, h), 0.018) for x, y in corners4(0.25, 0.25)]
    return joined(*legs, block(0, 0, h, (0.32, 0.3, 0.03)), block(0, 0.14, h, (0.32, 0.03, 0.4)), block(0, -0.22, h + 0.2, (0.42, 0.24, 0.02)), *(block(s * 0.16, 0, h, (0.02, 0.28, 0.2)) for s in (-1, 1)))


def _globe(rng: Random) -> FloatArray:
    r = rng.uniform(0.1, 0.16)
    turn = np.linspace(-0.3, np.pi - 0.3, 10)
    arc = [(1.15 * r * np.sin(a), 0.0, 1.5 * r - 1.15 * r * np.cos(a)) for a in turn]
    return joined(cushion((-r, -r, 0.5 * r), (r, r, 2.5 * r), power=1), rod(0, 0, 0, 0.7 * r, 0.02), rod(0, 0, 0, 0.015, 0.5 * r), *(tube(a, b, 0.008) for a, b in zip(arc[:-1], arc[1:], strict=True)))


def _trophy(rng: Random) -> FloatArray:
    h, r = rng.uniform(0.25, 0.4), rng.uniform(0.06, 0.1)
    cup = lathe([(0, 0), (r, 0), (r, 0.1 * h), (0.2 * r, 0.2 * h), (0.2 * r, 0.4 * h), (1.1 * r, 0.75 * h), (1.1 * r, h), (0, h)], 40)
    loops = []
    for s in (-1, 1):
        path = [(s * r, 0, 0.9 * h), (s * 1.8 * r, 0, 0.85 * h), (s * 1.6 * r, 0, 0.6 * h), (s * 0.7 * r, 0, 0.55 * h)]
        loops += [tube(a, b, 0.008) for a, b in zip(path[:-1], path[1:], strict=True)]
    return joined(cup, *loops)


def _bust_of_cubes(rng: Random) -> FloatArray:
    return joined(*(block(*rng.uniform(-0.15, 0.15, 2), rng.uniform(0, 0.2), tuple(rng.uniform(0.06, 0.2, 3))) for _ in range(7)), block(0, 0, 0, (0.3, 0.25, 0.05)))


def _crumpled(rng: Random) -> FloatArray:
    return turned(blob(rng, 0.4), rng.uniform(0, 6)) * [1, 1, 0.7]


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
    "goblet": lambda rng: profile(rng, [0.3, 0.28, 0.04, 0.04, 0.3, 0.36, 0.3], [0, 0.03, 0.08, 0.45, 0.6, 0.8, 1]),
    "bucket": lambda rng: profile(rng, [0.3, 0.42, 0.45, 0.45], [0, 0.8, 0.81, 0.85], 0.08),
    "funnel": lambda rng: profile(rng, [0.06, 0.08, 0.12, 0.5, 0.5], [0, 0.4, 0.45, 0.85, 0.95], 0.15),
    "bell": lambda rng: profile(rng, [0.45, 0.4, 0.28, 0.22, 0.06, 0.06], [0, 0.1, 0.4, 0.7, 0.8, 1]),
    "bollard": lambda rng: profile(rng, [0.22, 0.2, 0.14, 0.14, 0.19, 0.1], [0, 0.05, 0.1, 1.2, 1.3, 1.5], 0.1),
    "milk can": lambda rng: profile(rng, [0.3, 0.32, 0.32, 0.18, 0.18, 0.24], [0, 0.03, 0.6, 0.78, 0.9, 1]),
    "spool": lambda rng: profile(rng, [0.4, 0.4, 0.18, 0.18, 0.4, 0.4], [0, 0.1, 0.12, 0.7, 0.72, 0.82], 0.08),
    "lantern": lambda rng: profile(rng, [0.25, 0.25, 0.18, 0.2, 0.18, 0.3, 0.05], [0, 0.12, 0.15, 0.5, 0.75, 0.78, 1]),
    "mug": _mug, "kettle": _kettle, "extinguisher": _extinguisher, "mailbox": _mailbox, "speaker": _speaker,
    "oven": _oven, "printer": _printer, "keyboard": _keyboard, "toaster": _toaster, "drill press": _drill_press,
    "L-desk": _l_desk, "piano": _piano, "park bench": _park_bench, "school desk": _school_desk,
    "step stool": _step_stool, "trestle": _trestle, "tripod": _tripod, "coat stand": _coat_stand, "valve": _valve,
    "hydrant": _hydrant, "wheelbarrow": _wheelbarrow, "cart": _cart, "bicycle": _bicycle, "boat": _boat,
    "aeroplane": _aeroplane, "shoe": _shoe, "spanner": _spanner, "kettlebell": _kettlebell, "tee": _tee,
    "gear": _gear, "U-bracket": _u_bracket, "stepped block": _stepped_block, "I-beam": _i_beam, "stack": _stack,
    "arch": _arch, "spiral stair": _spiral, "statue": _statue, "duck": _duck, "dog": _dog, "suitcase": _suitcase,
    "handbag": _handbag, "high chair": _high_chair, "globe": _globe, "trophy": _trophy,
    "cubes": _bust_of_cubes, "crumpled": _crumpled,
}  # fmt: skip
HELD_OUT: dict[str, Kind] = FURNITURE | SHAPES
