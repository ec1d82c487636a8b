# SPDX-License-Identifier: MIT
"""Null walls by seed: the far wall of a room has no opening, but something that looks like one."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from benchmarks.features.wall_rooms import WOOD, Hole, Size, add_shell, clutter_of, hole_of, room_of, scan_of
from benchmarks.features.walls import WallCase
from scenes.checks import FloatArray
from scenes.scan.range_image import RangeImage
from scenes.world.builtin import SceneBuilder
from scenes.world.scene import Scene

Null = Literal[
    "plain", "picture", "wall end", "cupboards", "lost patch", "mirror", "wardrobes", "table", "shelves"
]  # fmt: skip
NULLS: tuple[Null, ...] = (
    "plain", "picture", "wall end", "cupboards", "lost patch", "mirror", "wardrobes", "table", "shelves"
)  # fmt: skip
_BOARD_M = 0.025  # thickness of shelves


def null_case(seed: int, kind: Null, noise_m: float = 0.005) -> WallCase:
    """Return a wall without an opening, but with what looks like one."""
    rng = np.random.default_rng([20271, seed, NULLS.index(kind)])
    room = room_of(rng)
    eye = np.array([rng.uniform(0.8, 1.6), rng.uniform(0.25, 0.75) * room[1], rng.uniform(1.3, 1.7)])
    build = SceneBuilder(f"{kind} {seed}", "room")
    hole = hole_of(rng, "doorway" if rng.random() < 0.5 else "window", room)
    if kind == "wall end":
        end = float(rng.uniform(0.45, 0.7) * room[1])
        add_shell(build, room, [], "plain", 0.1, rng, width=end)
    else:
        add_shell(build, room, [], "plain", 0.1, rng)
    if kind == "picture":
        for _ in range(3):
            at = rng.uniform([0.1 * room[1], 0.8], [0.7 * room[1], 1.4])
            size, thick = rng.uniform(0.3, 1.0, 2), float(rng.uniform(0.01, 0.06))
            low = np.array([room[0] - thick, *at])
            build.add_box("picture", low, low + [thick, size[0], size[1]], WOOD)
    if kind == "cupboards":
        gap, high = float(rng.uniform(0.4, 1.0)), float(rng.uniform(1.2, 2.2))
        middle, deep = float(rng.uniform(0.4, 0.6) * room[1]), float(rng.uniform(0.3, 0.6))
        for y0, y1 in ((0.1, middle - gap / 2), (middle + gap / 2, room[1] - 0.1)):
            build.add_box("cupboard", (room[0] - deep, y0, 0.0), (room[0], y1, high), WOOD)
    if kind in _FURNITURE:
        for low, high in _FURNITURE[kind](rng, room):
            build.add_box(kind, low, high, WOOD)
    for number, (low, up) in enumerate(clutter_of(rng, room, hole, eye, 0.3)):
        build.add_box(f"box {number}", low, up, WOOD)
    scene = build.finish()
    scan = scan_of(scene, eye, room, rng, noise_m)
    if kind == "mirror":
        scan = _with_mirror(scan, scene, room, hole, rng.normal(0.0, noise_m, scan.shape))
    if kind == "lost patch":
        scan = _without_patch(scan, room, hole)
    return WallCase(scan, kind, room[0], None, 0.0, 0.0, {})


def _without_patch(scan: RangeImage, room: Size, hole: Hole) -> RangeImage:
    """The scan without returns from a rectangle of the wall, as dark paint loses them."""
    points = scan.points()
    on = np.abs(points[..., 0] - room[0]) < 0.05
    y0, z0, y1, z1 = hole
    inside = (points[..., 1] > y0) & (points[..., 1] < y1) & (points[..., 2] > z0) & (points[..., 2] < z1)
    return replace(scan, ranges=np.where(on & inside, np.inf, scan.ranges))


def _with_mirror(
    scan: RangeImage,
    scene: Scene,
    room: Size,
    hole: Hole,
    error: FloatArray,
) -> RangeImage:
    """The scan with a mirror on the wall: beams that meet it are reflected, and measure on."""
    points, (y0, z0, y1, z1) = scan.points(), hole
    on = (np.abs(points[..., 0] - room[0]) < 0.05) & (points[..., 1] > y0) & (points[..., 1] < y1)
    on &= (points[..., 2] > z0) & (points[..., 2] < z1)
    rays = scan.rays()[on]
    away = (room[0] - scan.origin[0]) / rays[:, 0]
    places = scan.origin + (away - 1e-4)[:, None] * rays
    onward = scene.ray_caster().first_hit(places, rays * [-1.0, 1.0, 1.0]).ranges
    ranges = scan.ranges.copy()
    ranges[on] = away + onward + error[on]
    return replace(scan, ranges=ranges)


Boxes = list[tuple[FloatArray, FloatArray]]


def _wardrobes(rng: np.random.Generator, room: Size) -> Boxes:
    """Wardrobes side by side with their fronts in one plane, gaps between them, the wall behind."""
    deep, before, start = rng.uniform(0.45, 0.65), rng.uniform(0.0, 0.1), rng.uniform(0.1, 0.5)
    boxes = Boxes()
    while len(boxes) < 4:
        wide, high = rng.uniform(0.6, 1.3), rng.uniform(1.7, min(2.3, room[2] - 0.1))
        if start + wide > room[1] - 0.1:
            break
        low = np.array([room[0] - before - deep, start, 0.0])
        boxes.append((low, np.array([room[0] - before, start + wide, high])))
        start += wide + rng.uniform(0.35, 0.9)
    return boxes


def _table(rng: np.random.Generator, room: Size) -> Boxes:
    """A table on four legs whose apron stands across the view, some way before the wall."""
    wide, deep, high = rng.uniform(1.2, 2.0), rng.uniform(0.7, 0.9), rng.uniform(0.70, 0.76)
    leg, apron, top = rng.uniform(0.05, 0.09), rng.uniform(0.08, 0.14), 0.03
    x, y = room[0] - deep - rng.uniform(0.1, 0.9), rng.uniform(0.2, room[1] - wide - 0.2)
    low = np.array([x, y, 0.0])
    boxes = [(low + [0, 0, high - top], low + [deep, wide, high])]
    for a, b in ((0.0, 0.0), (deep - leg, 0.0), (0.0, wide - leg), (deep - leg, wide - leg)):
        boxes.append((low + [a, b, 0.0], low + [a + leg, b + leg, high - top]))
    under = low + [0.0, leg, high - top - apron], low + [_BOARD_M, wide - leg, high - top]
    return [*boxes, under, (under[0] + [deep - _BOARD_M, 0, 0], under[1] + [deep - _BOARD_M, 0, 0])]


def _shelves(rng: np.random.Generator, room: Size) -> Boxes:
    """Open shelves before the wall, of boards, with things on some of them."""
    wide, deep, high = rng.uniform(1.0, 1.9), rng.uniform(0.28, 0.4), rng.uniform(1.5, 2.1)
    low = np.array([room[0] - deep - 0.005, rng.uniform(0.2, room[1] - wide - 0.2), 0.0])
    n, divided = int(rng.integers(3, 6)), rng.random() < 0.6
    levels = np.linspace(0.05, high, n + 1)
    boxes = [(low + [0, 0, z - _BOARD_M], low + [deep, wide, z]) for z in levels]
    uprights = [0.0, *([wide / 2] if divided else []), wide - _BOARD_M]
    boxes += [(low + [0, y, 0.0], low + [deep, y + _BOARD_M, high]) for y in uprights]
    for z in levels[:-1]:
        if rng.random() < 0.5:
            y, size = rng.uniform(0.05, wide / 2), rng.uniform([0.2, 0.1], [0.45 * wide, 0.6 * high / n])
            front = rng.uniform(0.0, 0.1)
            boxes.append((low + [front, y, z], low + [deep - 0.01, y + size[0], z + size[1]]))
    return boxes


_FURNITURE = {"wardrobes": _wardrobes, "table": _table, "shelves": _shelves}
