# SPDX-License-Identifier: MIT
"""Furnishing: boxes, tables, posts, columns and pipes at random free places of a room."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from scenes.checks import FloatArray
from scenes.world.builtin import PLASTER, Finish, SceneBuilder

_TRIES = 40
_GAP_M = 0.12
_NEAR_CORNER_M = 1.3  # the corner at the origin is left to the scanner
_WOOD, _STEEL = Finish((0.62, 0.42, 0.24)), Finish((0.55, 0.62, 0.70))


@dataclass(frozen=True, slots=True)
class Footprint:
    """A rectangle of floor that is taken: x and y of its low and high corner, metres."""

    x0: float
    y0: float
    x1: float
    y1: float

    def touches(self, other: Footprint, gap: float) -> bool:
        """Tell whether the two are nearer to each other than `gap` along x and along y."""
        return (
            self.x0 < other.x1 + gap
            and other.x0 < self.x1 + gap
            and self.y0 < other.y1 + gap
            and other.y0 < self.y1 + gap
        )


Piece = Callable[[SceneBuilder, str, FloatArray, float, np.random.Generator], None]


def furnish(
    build: SceneBuilder,
    size: FloatArray,
    rng: np.random.Generator,
    taken: list[Footprint],
    *,
    ends_hidden: bool,
) -> list[FloatArray]:
    """Add furniture to the room `size` (x, y, z); `taken` grows by it.

    With `ends_hidden` a column that looks as if it stood on the floor ends behind a box before it.

    Returns
    -------
    list of (2, 3) float
        Boxes in which what was added breaks the prior.
    """
    breaks = [_ending_column(build, size, rng, taken)] if ends_hidden else []
    pieces: list[tuple[str, Piece, float]] = [("column", _column, rng.uniform(0.24, 0.4))]
    pieces += [(f"box {k}", _box, rng.uniform(0.4, 0.8)) for k in range(int(rng.integers(1, 4)))]
    pieces += [(f"post {k}", _post, rng.uniform(0.08, 0.16)) for k in range(int(rng.integers(0, 3)))]
    pieces += [("table", _table, rng.uniform(0.9, 1.3))] * int(rng.random() < 0.7)
    pieces += [("drum", _drum, rng.uniform(0.4, 0.6))] * int(rng.random() < 0.5)
    for name, piece, width in pieces:
        centre = _free_place(size, width * 0.75, rng, taken)
        if centre is not None:
            piece(build, name, np.array([*centre, size[2]]), width, rng)
    _add_pipes(build, size, rng)
    return breaks


def _free_place(
    size: FloatArray, half: float, rng: np.random.Generator, taken: list[Footprint]
) -> FloatArray | None:
    """Find a centre (x, y) with room for `half` to all sides, and take the place; None if there is none."""
    for _ in range(_TRIES):
        centre = rng.uniform([half + 0.1] * 2, size[:2] - half - 0.1)
        place = Footprint(*(centre - half), *(centre + half))
        free = not any(place.touches(other, _GAP_M) for other in taken)
        if free and (centre - half > _NEAR_CORNER_M).any() and np.linalg.norm(centre) > _NEAR_CORNER_M + half:
            taken.append(place)
            return np.asarray(centre, dtype=np.float64)
    return None


def _box(build: SceneBuilder, name: str, at: FloatArray, width: float, rng: np.random.Generator) -> None:
    half = np.array([width, width * rng.uniform(0.6, 1.0)]) / 2
    colour = Finish(tuple(rng.uniform(0.35, 0.85, 3)))
    low, high = np.array([*(at[:2] - half), 0.0]), np.array([*(at[:2] + half), rng.uniform(0.5, 1.3)])
    build.add_box(name, low, high, colour, yaw=rng.uniform(-0.6, 0.6))


def _post(build: SceneBuilder, name: str, at: FloatArray, width: float, rng: np.random.Generator) -> None:
    low, high = np.array([*(at[:2] - width / 2), 0.0]), np.array([*(at[:2] + width / 2), 0.0])
    high[2] = at[2] if rng.random() < 0.3 else rng.uniform(1.0, 1.8)
    build.add_box(name, low, high, Finish((0.36, 0.50, 0.72)), yaw=rng.uniform(-0.6, 0.6))


def _column(build: SceneBuilder, name: str, at: FloatArray, width: float, _rng: np.random.Generator) -> None:
    build.add_cylinder(name, (*at[:2], 0.0), (0, 0, at[2]), width / 2, PLASTER, caps=False)


def _drum(build: SceneBuilder, name: str, at: FloatArray, width: float, rng: np.random.Generator) -> None:
    build.add_cylinder(name, (*at[:2], 0.0), (0, 0, rng.uniform(0.7, 1.2)), width / 2, _STEEL)


def _table(build: SceneBuilder, name: str, at: FloatArray, width: float, rng: np.random.Generator) -> None:
    half, height = np.array([width, width * 0.6]) / 2, rng.uniform(0.68, 0.78)
    build.add_box(
        f"{name} top",
        (*(at[:2] - half), height - 0.04),
        (*(at[:2] + half), height),
        _WOOD,
        yaw=rng.uniform(-0.4, 0.4),
    )
    build.add_cylinder(f"{name} leg", (*at[:2], 0.0), (0, 0, height - 0.04), 0.05, _STEEL, caps=False)


def _add_pipes(build: SceneBuilder, size: FloatArray, rng: np.random.Generator) -> None:
    """Add up to three level pipes along the wall y = far, from wall to wall."""
    if rng.random() < 0.5:
        return
    height = rng.uniform(0.25, 0.5)
    for index in range(int(rng.integers(1, 4))):
        radius = rng.uniform(0.03, 0.08)
        foot = (0.0, size[1] - radius - 0.04, height)
        build.add_cylinder(f"pipe {index + 1}", foot, (size[0], 0, 0), radius, _STEEL, caps=False)
        height += radius + rng.uniform(0.15, 0.3)


def _ending_column(
    build: SceneBuilder, size: FloatArray, rng: np.random.Generator, taken: list[Footprint]
) -> FloatArray:
    """Add a pipe that hangs from the ceiling and ends behind a box, clear of the floor."""
    radius, end = rng.uniform(0.1, 0.16), rng.uniform(0.35, 0.6)
    centre = size[:2] * rng.uniform(0.6, 0.72, 2)
    build.add_cylinder("hanging column", (*centre, end), (0, 0, size[2] - end), radius, PLASTER)
    before = centre - 0.5 * centre / np.linalg.norm(centre)
    half = radius + 0.22
    low, high = np.array([*(before - half), 0.0]), np.array([*(before + half), end + 0.45])
    build.add_box("hiding box", low, high, _WOOD, yaw=float(np.arctan2(centre[1], centre[0])))
    taken.append(
        Footprint(*np.minimum(before - 1.3 * half, centre - half), *np.maximum(before + half, centre + half))
    )
    return np.array([[*(centre - radius - 0.02), 0.0], [*(centre + radius + 0.02), end + 0.02]])
