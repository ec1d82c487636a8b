# SPDX-License-Identifier: MIT
"""Walls by seed: a room whose far wall has one opening behind clutter."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.features.wall_rooms import (
    WOOD,
    Hole,
    Size,
    add_shell,
    clutter_of,
    hole_of,
    room_of,
    scan_of,
)
from scenes.checks import FloatArray
from scenes.scan.range_image import RangeImage
from scenes.world.builtin import SceneBuilder
from scenes.world.scene import Scene

KINDS = ("doorway", "window", "niche")


@dataclass(frozen=True, slots=True, eq=False)
class WallCase:
    """A scan of a wall, and what is in it.

    Attributes
    ----------
    scan : RangeImage
        From one station, with noise and a share of strays.
    kind : str
        "doorway", "window", "niche", or what the null is.
    x : float
        Where the wall is.
    hole : tuple, optional
        The true rectangle.
    depth : float
        Of its reveals.
    hidden : float
        Share of the opening's area that the clutter hides from the station.
    seen : dict of str to float
        For each side, the share along which beams pass just inside and end just outside it.
    """

    scan: RangeImage
    kind: str
    x: float
    hole: Hole | None
    depth: float
    hidden: float
    seen: dict[str, float]


def opening_case(seed: int, kind: str, hidden: float, noise_m: float = 0.005) -> WallCase:
    """Return an opening of a kind, about `hidden` of which stands behind boxes."""
    for attempt in range(40):
        rng = np.random.default_rng([20270, seed, KINDS.index(kind), round(100 * hidden), attempt])
        room, hole, depth = room_of(rng), (0.0, 0.0, 0.0, 0.0), float(rng.uniform(0.08, 0.35))
        hole = hole_of(rng, kind, room)
        eye = np.array([rng.uniform(0.8, 1.6), rng.uniform(0.2, 0.8) * room[1], rng.uniform(1.3, 1.7)])
        build = SceneBuilder(f"{kind} {seed}", "room")
        add_shell(build, room, [hole], kind, depth, rng)
        boxes = clutter_of(rng, room, hole, eye, hidden)
        for number, (low, high) in enumerate(boxes):
            build.add_box(f"box {number}", low, high, WOOD)
        scene = build.finish()
        share, seen = _visible(scene, eye, room, hole)
        if abs(share - hidden) <= 0.1:
            return WallCase(scan_of(scene, eye, room, rng, noise_m), kind, room[0], hole, depth, share, seen)
    raise RuntimeError(f"no clutter hides {hidden:.0%} of {kind} {seed}")


def _visible(scene: Scene, eye: FloatArray, room: Size, hole: Hole) -> tuple[float, dict[str, float]]:
    """Share of the hole that is hidden, and of each side that is seen: its inside and its outside."""
    y0, z0, y1, z1 = hole
    caster = scene.ray_caster()

    def reached(y: FloatArray, z: FloatArray) -> FloatArray:
        places = np.column_stack([np.full(y.size, room[0]), y.ravel(), z.ravel()])
        away = places - eye
        far = np.linalg.norm(away, axis=1)
        hit = caster.first_hit(np.broadcast_to(eye, away.shape), away / far[:, None])
        return np.asarray(hit.ranges > far - 1e-3)

    grid = np.meshgrid(np.linspace(y0, y1, 42)[1:-1], np.linspace(z0, z1, 42)[1:-1])
    hidden = 1 - reached(*grid).mean()
    t, near, seen = np.linspace(0.02, 0.98, 60), 0.02, {}
    for name, axis, at, sign in (
        ("left", 0, y1, 1), ("right", 0, y0, -1), ("bottom", 1, z0, -1), ("top", 1, z1, 1)
    ):  # fmt: skip
        along = (z0 + t * (z1 - z0)) if axis == 0 else (y0 + t * (y1 - y0))
        both = np.ones(len(t), dtype=bool)
        for shift in (sign * near, -sign * near):
            across = np.full(len(t), at + shift)
            both &= reached(*((across, along) if axis == 0 else (along, across)))
        seen[name] = float(both.mean())
    return float(hidden), seen
