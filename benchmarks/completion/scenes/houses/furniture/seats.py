# SPDX-License-Identifier: MIT
"""Seats: chairs with legs and backs, office chairs, stools, armchairs and sofas."""

from __future__ import annotations

from itertools import pairwise

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
from benchmarks.completion.scenes.houses.furniture.solids import box, cushion, tube
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
