# SPDX-License-Identifier: MIT
"""Solids of which things are made whose back sides are inferred: triangles (m, 3, 3), metres, z up."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from benchmarks.cases.houses.solids import Piece, box, capsule, cushion, grid_triangles, lathe, motion, tube
from scenes.checks import FloatArray

Random = np.random.Generator
Kind = Callable[[Random], FloatArray]


def joined(*solids: FloatArray) -> FloatArray:
    """Return several solids as one array of triangles."""
    return np.concatenate(solids)


def corners_of(piece: Piece) -> FloatArray:
    """Return the triangles of a piece of furniture."""
    return np.concatenate([one.corners for one in piece.parts])


def block(x: float, y: float, z: float, size: tuple[float, float, float]) -> FloatArray:
    """Return a box whose foot has its middle at (x, y, z)."""
    w, d, h = size
    return box((x - w / 2, y - d / 2, z), (x + w / 2, y + d / 2, z + h))


def rod(x: float, y: float, z: float, radius: float, height: float, top: float | None = None) -> FloatArray:
    """Return an upright rod or blunt cone whose foot has its middle at (x, y, z)."""
    return tube((x, y, z), (x, y, z + height), radius, top, n=32)


def turned(solid: FloatArray, yaw: float, pitch: float = 0.0, roll: float = 0.0) -> FloatArray:
    """Return a solid turned about the origin."""
    move = motion((0, 0, 0), yaw, pitch, roll)
    return np.asarray(solid @ move[:3, :3].T)


def around(make: Callable[[float], FloatArray], n: int, start: float = 0.0) -> FloatArray:
    """Return n solids at equal angles about z; `make` takes the angle."""
    return joined(*(make(start + 2 * np.pi * k / n) for k in range(n)))


def corners4(x: float, y: float) -> list[tuple[float, float]]:
    """Return the four corners (+-x, +-y)."""
    return [(s * x, t * y) for s in (-1, 1) for t in (-1, 1)]


def profile(rng: Random, radii: list[float], heights: list[float], loose: float = 0.2) -> FloatArray:
    """Return a closed vessel of revolution: radii and heights, each varied by a share."""
    scale = rng.uniform(0.12, 0.4)
    radius = np.array(radii) * rng.uniform(1 - loose, 1 + loose, len(radii))
    height = np.array(heights) * rng.uniform(0.8, 1.25)
    points = [(0.0, height[0]), *zip(radius, height, strict=True), (0.0, height[-1])]
    return lathe(np.array(points) * scale, 48)


def prism_x(outline: FloatArray, length: float) -> FloatArray:
    """Return a prism along x over an outline (k, 2) in (y, z), counter-clockwise, convex."""
    k = len(outline)
    near = np.column_stack([np.full(k, -length / 2), outline])
    far = np.column_stack([np.full(k, length / 2), outline])
    caps = [[near[0], near[i + 1], near[i]] for i in range(1, k - 1)]
    caps += [[far[0], far[i], far[i + 1]] for i in range(1, k - 1)]
    sides = []
    for i in range(k):
        j = (i + 1) % k
        sides += [[near[i], near[j], far[j]], [near[i], far[j], far[i]]]
    return np.array(caps + sides)


def blob(rng: Random, rough: float, n: int = 40) -> FloatArray:
    """Return an irregular body: a ball whose radius varies by smooth waves; it has no symmetry."""
    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, n + 1), np.linspace(-np.pi / 2, np.pi / 2, n // 2 + 1))
    way = np.stack([np.cos(v) * np.cos(u), np.cos(v) * np.sin(u), np.sin(v)], axis=-1)
    radius = np.ones(u.shape)
    for _ in range(8):
        radius += rough * rng.normal() * np.sin(way @ rng.normal(0, 2.2, 3) + rng.uniform(0, 6))
    grid = way * np.maximum(radius, 0.3)[..., None] * rng.uniform(0.1, 0.2, 3)
    grid[:, -1] = grid[:, 0]
    grid[0], grid[-1] = grid[0].mean(axis=0), grid[-1].mean(axis=0)
    grid[..., 2] -= np.quantile(grid[..., 2], 0.06)
    grid[..., 2] = np.maximum(grid[..., 2], 0.0)
    return grid_triangles(grid)


def frustum(low: tuple[float, float], high: tuple[float, float], z: float, h: float) -> FloatArray:
    """Return a solid with rectangular ends of two sizes."""
    solid = block(0, 0, 0, (1.0, 1.0, 1.0))
    share = solid[..., 2:]
    size = np.array(low) * (1 - share) + np.array(high) * share
    return np.concatenate([solid[..., :2] * size, z + h * share], axis=-1)


def heap(rng: Random) -> FloatArray:
    """Return seven balls in a heap, one in another."""
    balls = []
    for _ in range(7):
        x, y, r = *rng.uniform(-0.15, 0.15, 2), rng.uniform(0.04, 0.1)
        z = rng.uniform(0, 0.1)
        balls.append(cushion((x - r, y - r, z), (x + r, y + r, z + 2 * r), power=1))
    return joined(*balls)


def driftwood(rng: Random) -> FloatArray:
    """Return branches that lie on the floor."""
    at, limbs = np.array([0, 0, 0.05]), []
    for _ in range(5):
        to = at + rng.normal(0, 0.15, 3)
        to[2] = np.clip(to[2], 0.03, 0.5)
        limbs.append(capsule(at, to, rng.uniform(0.02, 0.05)))
        at = to if rng.random() < 0.6 else at
    return joined(*limbs)
