# SPDX-License-Identifier: MIT
"""Figures: people as articulated capsules, standing, walking, reaching, or sitting."""

from __future__ import annotations

import numpy as np

from benchmarks.completion.scenes.houses.furniture.parts import Part, Piece, cloth, joined
from benchmarks.completion.scenes.houses.furniture.solids import capsule, cushion
from scenes.checks import FloatArray

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
