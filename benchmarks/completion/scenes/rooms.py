# SPDX-License-Identifier: MIT
"""Rooms by seed: walls with openings, furniture, columns and pipes; some of them break the prior."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from benchmarks.completion.scenes.cases import Case
from benchmarks.completion.scenes.furnishing import Footprint, furnish
from benchmarks.completion.scenes.stations import stations
from scenes.checks import FloatArray
from scenes.world.builtin import PLASTER, Finish, SceneBuilder, brick, grass, gravel

Break = Literal["niche", "step", "hidden door", "ending cylinder"]
BREAKS: tuple[Break, ...] = ("niche", "step", "hidden door", "ending cylinder")
_BREAK_SHARE = 0.3
_OUTSIDE_M = 2.0  # how far beyond the wall lies what is seen through its openings


@dataclass(frozen=True, slots=True, eq=False)
class Shell:
    """The room itself: metres along x, y, z, and the wall x = size[0] with holes as (y, z) rectangles."""

    size: FloatArray
    window: tuple[float, float, float, float] | None
    door: tuple[float, float, float, float] | None


def random_case(seed: int, *, breaks: Break | None = None) -> Case:
    """Return the room with this seed.

    Of every ten seeds in a row three break the prior, each in another way in turn: a niche or a step in a
    wall, a door wholly hidden behind a cabinet, or a cylinder that ends behind its occluder.

    Parameters
    ----------
    seed : int
        The same seed gives the same bytes.
    breaks : str, optional
        Break the prior in this way, whatever the seed says.
    """
    kind = breaks or break_of(seed)
    rng = np.random.default_rng([20260, seed])
    shell = _shell(rng)
    build = SceneBuilder(f"room_{seed}", "room")
    taken: list[Footprint] = []
    boxes = _build_shell(build, shell, kind, rng, taken)
    boxes += furnish(build, shell.size, rng, taken, ends_hidden=kind == "ending cylinder")
    broken = np.array(boxes).reshape(-1, 2, 3)
    name = f"room {seed}" + (f", {kind}" if kind else "")
    return Case(name, build.finish(), stations(shell.size, taken, rng, broken), broken)


def break_of(seed: int) -> Break | None:
    """Return how the room with this seed breaks the prior: three of any ten seeds in a row do."""
    place = seed % 10
    if place not in (2, 5, 8):
        return None
    return BREAKS[(3 * (seed // 10) + (2, 5, 8).index(place)) % len(BREAKS)]


def _shell(rng: np.random.Generator) -> Shell:
    size = np.array([rng.uniform(3.6, 5.5), rng.uniform(3.4, 5.0), rng.uniform(2.4, 3.0)])
    window = door = None
    if rng.random() < 0.7:
        width, low = rng.uniform(0.7, 1.3), rng.uniform(0.7, 1.0)
        start = rng.uniform(0.25, size[1] / 2 + 0.15 - width)
        window = (start, low, start + width, low + rng.uniform(0.8, 1.2))
    if rng.random() < 0.5:
        start = rng.uniform(size[1] / 2 + 0.3, size[1] - 1.05)
        door = (start, 0.0, start + rng.uniform(0.7, 0.9), rng.uniform(1.95, 2.1))
    return Shell(size, window, door)


def _build_shell(
    build: SceneBuilder, shell: Shell, kind: Break | None, rng: np.random.Generator, taken: list[Footprint]
) -> list[FloatArray]:
    """Add floor, ceiling and walls; return the boxes where they break the prior."""
    x, y, z = np.diag(shell.size)
    paint = brick() if rng.random() < 0.5 else PLASTER
    build.add_rectangle("floor", np.zeros(3), x, y, gravel())
    build.add_rectangle("ceiling", z + y, x, -y, PLASTER)
    build.add_rectangle("wall x=0", np.zeros(3), y, z, PLASTER)
    build.add_rectangle("wall y=0", x, -x, z, paint)
    openings = [hole for hole in (shell.window, shell.door) if hole is not None]
    width = float(shell.size[1])
    from_far_end = [(width - high, low, width - near, top) for near, low, high, top in openings]
    build.add_panel("wall x=far", x + y, u=-y, v=z, finish=paint, holes=from_far_end)
    if openings:
        reach = np.array([_OUTSIDE_M, 0, 0])
        low, high = -3 * y / width, (width + 3) * y / width
        build.add_rectangle("outside", x + reach + high - z, low - high, 3 * z, grass(4.0))
    if kind in ("niche", "hidden door"):
        return [_recess(build, shell, kind, rng, taken)]
    if kind == "step":
        return [_step(build, shell, rng, taken)]
    build.add_rectangle("wall y=far", y, x, z, PLASTER)
    return []


def _recess(
    build: SceneBuilder, shell: Shell, kind: Break, rng: np.random.Generator, taken: list[Footprint]
) -> FloatArray:
    """Build the wall y = far with a niche or a closed-off door, and the cabinet that hides all of it."""
    x, y, z = np.diag(shell.size)
    width = rng.uniform(0.5, 0.8) if kind == "niche" else rng.uniform(0.75, 0.9)
    bottom, top = (rng.uniform(0.3, 0.6), rng.uniform(1.1, 1.4)) if kind == "niche" else (0.0, 2.0)
    depth = rng.uniform(0.12, 0.3) if kind == "niche" else 0.8
    start = rng.uniform(1.6, shell.size[0] - width - 1.0)
    build.add_panel(
        "wall y=far",
        y,
        u=x,
        v=z,
        finish=PLASTER,
        holes=[(start, bottom, start + width, top)],
        are_openings=False,
    )
    low = np.array([start, shell.size[1], bottom])
    high = np.array([start + width, shell.size[1] + depth, top])
    across, deep, up = np.diag(high - low)
    name, finish = kind, Finish((0.66, 0.60, 0.55))
    build.add_rectangle(f"{name} back", low + deep, across, up, finish)
    build.add_rectangle(f"{name} bottom", low, across, deep, finish)
    build.add_rectangle(f"{name} top", low + up + deep, across, -deep, finish)
    build.add_rectangle(f"{name} west", low, deep, up, finish)
    build.add_rectangle(f"{name} east", low + across + deep, -deep, up, finish)
    gap = rng.uniform(0.05, 0.2)
    front = np.array([start - 0.25, shell.size[1] - gap - 0.45, 0.0])
    back = np.array([start + width + 0.25, shell.size[1] - gap, top + 0.12])
    build.add_box("cabinet", front, back, Finish((0.72, 0.58, 0.40)))
    taken.append(Footprint(*front[:2], *back[:2]))
    margin = 0.02
    return np.stack([low - margin, high + margin])


def _step(build: SceneBuilder, shell: Shell, rng: np.random.Generator, taken: list[Footprint]) -> FloatArray:
    """Build the wall y = far in two halves, one farther away, and the screen that hides the step."""
    width, length, height = (float(value) for value in shell.size)
    at, depth = rng.uniform(1.8, width - 1.4), rng.uniform(0.06, 0.2)
    up = np.array([0, 0, height])
    build.add_rectangle("wall y=far", (0, length, 0), (at, 0, 0), up, PLASTER)
    build.add_rectangle("wall y=farther", (at, length + depth, 0), (width - at, 0, 0), up, PLASTER)
    build.add_rectangle("step", (at, length, 0), (0, depth, 0), up, PLASTER)
    build.add_rectangle("step floor", (at, length, 0), (width - at, 0, 0), (0, depth, 0), gravel())
    build.add_rectangle(
        "step ceiling", (at, length + depth, height), (width - at, 0, 0), (0, -depth, 0), PLASTER
    )
    build.add_rectangle("step end", (width, length + depth, 0), (0, -depth, 0), up, PLASTER)
    low, high = np.array([at - 0.3, length - 0.4, 0.0]), np.array([at + 0.3, length - 0.1, height - 0.05])
    build.add_box("screen", low, high, Finish((0.45, 0.52, 0.58)))
    taken.append(Footprint(*low[:2], *high[:2]))
    return np.array([[at - 0.35, length - 0.02, 0.0], [at + 0.35, length + depth + 0.02, height]])
