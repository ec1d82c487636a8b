# SPDX-License-Identifier: MIT
"""Walls with relief, by seed: those that methods were tuned on, and others they were not."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.flattening.ripples import HELD_OUT_RIPPLES, TUNING_RIPPLES, ripple_of
from benchmarks.flattening.shapes import Distance, Relief, both, ellipse, rectangle, without
from scenes.checks import FloatArray

TUNING_LAYOUTS = ("panels", "door", "switches", "mouldings", "pictures")
HELD_OUT_LAYOUTS = ("wainscot", "niches", "plaques", "skew", "pilasters", "dense")


@dataclass(frozen=True, slots=True, eq=False)
class Wall:
    """A wall as measured, and as it is.

    Attributes
    ----------
    heights : (rows, columns) float
        As measured: relief, ripple and noise, metres over the plane.
    relief : (rows, columns) float
        As it is.
    ripple : (rows, columns) float
        The systematic error.
    cell_m : float
        Side of a cell, metres.
    layout, kind : str
        Of the relief, of the ripple.
    noise_m : float
        Sd of the white noise of a cell.
    """

    heights: FloatArray
    relief: FloatArray
    ripple: FloatArray
    cell_m: float
    layout: str
    kind: str
    noise_m: float


def make_wall(seed: int, held_out: bool = False, layout: str | None = None, kind: str | None = None) -> Wall:
    """The wall of a seed; `layout` "plain" has no relief."""
    rng = np.random.default_rng([seed, held_out, 23])
    layouts = HELD_OUT_LAYOUTS if held_out else TUNING_LAYOUTS
    kinds = HELD_OUT_RIPPLES if held_out else TUNING_RIPPLES
    layout = layout or layouts[seed % len(layouts)]
    kind = kind or kinds[(seed // 2) % len(kinds)]
    cell = 0.01
    width, height = rng.uniform(1.8, 3.6), rng.uniform(1.9, 2.7)
    y, x = np.meshgrid(np.arange(0, height, cell), np.arange(0, width, cell), indexing="ij")
    sd = rng.uniform(0.0015, 0.004)
    noise = rng.uniform(0.0002, 0.0008)
    relief = np.zeros(x.shape)
    for one in _layout(layout, np.array([width, height]), sd, rng):
        relief += one.heights(x, y)
    ripple = ripple_of(kind, x.shape, cell, sd, rng)
    texture = np.zeros(x.shape)
    if rng.random() < 0.3 and layout != "plain":  # a patch of rougher plaster
        patch = rectangle(rng.uniform(0.2, 0.8, 2) * [width, height], rng.uniform(0.4, 1.2, 2))(x, y) < 0
        texture = 2 * noise * rng.normal(size=x.shape) * patch
    heights = relief + ripple + texture + noise * rng.normal(size=x.shape)
    return Wall(heights, relief, ripple, cell, layout, kind, noise)


def _layout(layout: str, size: FloatArray, ripple_sd: float, rng: np.random.Generator) -> list[Relief]:
    """The relief of a layout on a wall of `size` (2,) metres."""
    if layout == "plain":
        return []
    width, height = size

    def step() -> float:
        """Heights from 1 to 25 mm, most of them above one and a half times the ripple."""
        least = 0.001 if rng.random() < 0.15 else max(0.003, 1.6 * ripple_sd)
        return float(np.exp(rng.uniform(np.log(least), np.log(0.025))))

    def border(most: float = 0.03) -> tuple[float, bool]:
        """A sharp border, or one that slopes or is rounded."""
        return (0.0 if rng.random() < 0.5 else rng.uniform(0.01, most)), bool(rng.random() < 0.5)

    def place(margin: float = 0.1) -> FloatArray:
        return rng.uniform(margin, 1 - margin, 2) * size

    def relief(
        shape: Distance, sign: float = 1.0, height_m: float | None = None, most: float = 0.03
    ) -> Relief:
        return Relief(shape, sign * (height_m or step()), *border(most))

    found: list[Relief] = []
    if layout == "panels":  # a grid of fields, all alike
        nx, ny, rise, edge = rng.integers(2, 4), rng.integers(1, 3), step(), border()
        gap = rng.uniform(0.08, 0.2)
        sides = np.array([(width - gap) / nx - gap, (height - gap) / ny - gap])
        sign = rng.choice([-1, 1])
        for i in range(nx):
            for j in range(ny):
                centre = gap + sides / 2 + np.array([i, j]) * (sides + gap)
                found.append(Relief(rectangle(centre, sides), sign * rise, *edge))
    elif layout == "door":  # a leaf with a frame and sunk fields
        centre = np.array([rng.uniform(0.35, 0.65) * width, 0.98])
        found.append(relief(rectangle(centre, np.array([0.86, 1.98]))))
        rise, edge = -min(step(), 0.9 * found[0].height_m), border(0.02)
        for k in range(rng.integers(1, 4)):
            sides = np.array([0.5, rng.uniform(0.35, 0.5)])
            found.append(Relief(rectangle(centre + [0, -0.62 + 0.6 * k], sides), rise, *edge))
        found += [relief(rectangle(place(), rng.uniform(0.08, 0.12, 2))) for _ in range(2)]
    elif layout == "switches":
        for _ in range(rng.integers(4, 12)):
            sides = np.array([0.08, 0.08 * rng.integers(1, 4)])
            found.append(relief(rectangle(place(), sides), height_m=max(step(), 0.005), most=0.015))
    elif layout == "mouldings":  # bands along the wall
        for level in rng.uniform(0.1, 0.9, rng.integers(1, 4)):
            sides = np.array([3 * width, rng.uniform(0.05, 0.2)])
            found.append(relief(rectangle(np.array([width / 2, level * height]), sides)))
    elif layout == "pictures":  # frames, and boards
        for _ in range(rng.integers(2, 6)):
            centre, sides = place(0.2), rng.uniform(0.25, 0.8, 2)
            shape = rectangle(centre, sides)
            if rng.random() < 0.5:
                shape = without(shape, rectangle(centre, sides - 2 * rng.uniform(0.04, 0.08)))
            found.append(relief(shape, most=0.02))
    elif layout == "wainscot":  # upright battens below a rail
        rise, edge, pitch = step(), border(0.02), rng.uniform(0.25, 0.5)
        top, broad = rng.uniform(0.4, 0.6) * height, rng.uniform(0.05, 0.1)
        shape = rectangle(np.array([width / 2, top]), np.array([3 * width, rng.uniform(0.06, 0.12)]))
        for at in np.arange(rng.uniform(0.05, pitch), width, pitch):
            shape = both(shape, rectangle(np.array([at, top / 2]), np.array([broad, top])))
        found.append(Relief(shape, rise, *edge))
    elif layout == "niches":
        for _ in range(rng.integers(2, 5)):
            centre, sides = place(0.2), rng.uniform(0.2, 0.9, 2)
            shape = rectangle(centre, sides)
            if rng.random() < 0.5:  # with a round arch
                shape = both(shape, ellipse(centre + [0, sides[1] / 2], np.array([sides[0], sides[0]])))
            found.append(relief(shape, -1))
    elif layout == "plaques":  # ellipses and discs
        for _ in range(rng.integers(3, 8)):
            found.append(relief(ellipse(place(), rng.uniform(0.12, 0.7, 2), rng.uniform(0, 3))))
    elif layout == "skew":  # what hangs at an angle, braces, L shapes
        for _ in range(rng.integers(2, 5)):
            centre, sides, turn = place(0.2), rng.uniform(0.25, 0.9, 2), rng.uniform(0, np.pi)
            shape = rectangle(centre, sides, turn)
            if rng.random() < 0.4:
                away = 0.3 * sides * [np.cos(turn), np.cos(turn)] + 0.3 * sides * [
                    -np.sin(turn),
                    np.sin(turn),
                ]
                shape = without(shape, rectangle(centre + away, 0.6 * sides, turn))
            found.append(relief(shape))
        found.append(
            relief(rectangle(place(0.3), np.array([9.0, rng.uniform(0.06, 0.15)]), rng.uniform(0, 3)))
        )
    elif layout == "pilasters":  # from floor to ceiling, and a chimney breast at one side
        for at in rng.uniform(0.1, 0.6, rng.integers(1, 3)):
            sides = np.array([rng.uniform(0.12, 0.4), 9.0])
            found.append(relief(rectangle(np.array([at * width, 0.0]), sides)))
        broad = rng.uniform(0.4, 0.8)
        found.append(relief(rectangle(np.array([width, height / 2]), np.array([broad, 9.0]))))
    elif layout == "dense":  # much of all, up to half of the wall
        for _ in range(rng.integers(10, 20)):
            shape = rng.choice(np.array([rectangle, ellipse], dtype=object))
            sides = rng.uniform(0.1, 0.45, 2)
            found.append(
                relief(shape(place(0.05), sides, rng.choice([0.0, 0.0, 0.5])), rng.choice([-1, 1, 1]))
            )
    return found
