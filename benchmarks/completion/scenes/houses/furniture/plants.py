# SPDX-License-Identifier: MIT
"""Plants: leaf clusters on stems, in pots."""

from __future__ import annotations

import numpy as np

from benchmarks.completion.scenes.houses.furniture.parts import Part, Piece, cloth, joined
from benchmarks.completion.scenes.houses.furniture.solids import lathe, sheet, tube
from scenes.checks import FloatArray


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
