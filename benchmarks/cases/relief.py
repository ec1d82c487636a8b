# SPDX-License-Identifier: MIT
"""Walls with relief under ripple, by seed: those that methods were tuned on, and others."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from scenes.checks import FloatArray

TUNING_RIPPLES = ("smooth", "stripes", "smooth_long")
HELD_OUT_RIPPLES = ("smooth", "stripes", "two_lengths", "warped_stripes", "rows", "rings", "uneven", "steps")
STATIONARY = ("smooth", "smooth_long", "stripes", "two_lengths", "warped_stripes", "rows", "rings")


def ripple_of(
    kind: str, shape: tuple[int, int], cell: float, sd: float, rng: np.random.Generator
) -> FloatArray:
    """A ripple of sd `sd` metres on cells of `cell` metres; see the kinds above."""
    y, x = np.meshgrid(*(cell * np.arange(n) for n in shape), indexing="ij")
    turn, period = rng.uniform(0, np.pi), np.exp(rng.uniform(np.log(0.07), np.log(0.4)))
    across = np.cos(turn) * x + np.sin(turn) * y
    if kind == "smooth":
        ripple = smooth(shape, rng.uniform(0.06, 0.2) / cell, rng)
    elif kind == "smooth_long":
        ripple = smooth(shape, rng.uniform(0.2, 0.5) / cell, rng)
    elif kind == "two_lengths":
        ripple = smooth(shape, rng.uniform(0.25, 0.5) / cell, rng)
        ripple = ripple + rng.uniform(0.3, 0.6) * smooth(shape, rng.uniform(0.05, 0.08) / cell, rng)
    elif kind == "stripes":
        ripple = np.sin(2 * np.pi * across / period + rng.uniform(0, 6))
        ripple = ripple + 0.3 * smooth(shape, 0.3 / cell, rng)
    elif kind == "warped_stripes":  # period and strength drift, with a harmonic
        phase = 2 * np.pi * across / period + 1.0 * smooth(shape, 0.6 / cell, rng)
        ripple = np.sin(phase) + 0.3 * np.sin(2 * phase)
        ripple = ripple * (1 + 0.25 * smooth(shape, 0.5 / cell, rng))
    elif kind == "rows":  # an offset of each row or column of the sensor, slowly varying along it
        size = (rng.uniform(0.02, 0.05) / cell, rng.uniform(0.5, 1.5) / cell)
        ripple = smooth(shape, size if rng.random() < 0.5 else size[::-1], rng)
        ripple = ripple + 0.5 * smooth(shape, 0.3 / cell, rng)
    elif kind == "rings":  # about the optical axis
        centre = rng.uniform(0.2, 0.8, 2) * [x.max(), y.max()]
        ripple = np.sin(2 * np.pi * np.hypot(x - centre[0], y - centre[1]) / period + rng.uniform(0, 6))
        ripple = ripple + 0.5 * smooth(shape, 0.3 / cell, rng)
    elif kind == "uneven":  # three times as strong on one side
        away = np.cos(turn) * x / x.max() + np.sin(turn) * y / y.max()
        ripple = smooth(shape, rng.uniform(0.08, 0.2) / cell, rng) * np.exp(1.1 * away / np.ptp(away))
    elif kind == "steps":  # disparity rounded to steps, softened by the noise of many pixels
        quantum = 2.5
        slope = rng.uniform(1.0, 4.0) * across + smooth(shape, 0.3 / cell, rng)
        rounded = quantum * np.round((slope + 0.25 * rng.normal(size=shape)) / quantum)
        ripple = ndimage.gaussian_filter(rounded - slope, 1.0) + 0.5 * smooth(shape, 0.3 / cell, rng)
    else:
        raise ValueError(f"no ripple is called {kind!r}")
    away = ripple - ripple.mean()
    return np.asarray(sd * away / np.sqrt(np.mean(away**2)))


def smooth(
    shape: tuple[int, int], length: float | tuple[float, float], rng: np.random.Generator
) -> FloatArray:
    """A Gaussian random field of unit sd with correlation exp(-d^2 / 2 length^2), lengths in cells."""
    sigma = np.broadcast_to(np.asarray(length, dtype=float) / np.sqrt(2), 2)
    pad = [int(np.ceil(4 * s)) for s in sigma]
    wide = rng.normal(size=(shape[0] + 2 * pad[0], shape[1] + 2 * pad[1]))
    field = ndimage.gaussian_filter(wide, sigma, mode="wrap")
    gain = np.sqrt(4 * np.pi * sigma[0] * sigma[1])
    out: FloatArray = gain * field[pad[0] : pad[0] + shape[0], pad[1] : pad[1] + shape[1]]
    return out


Distance = Callable[[FloatArray, FloatArray], FloatArray]
"""From coordinates (metres) to the distance from a shape's border, negative inside."""


@dataclass(frozen=True, slots=True)
class Relief:
    """A shape that stands out by `height_m` (negative: a niche); its border slopes over `border_m`."""

    distance: Distance
    height_m: float
    border_m: float
    is_rounded: bool

    def heights(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """By how much the shape stands out at points, metres; the slope lies inside the shape."""
        inside = -self.distance(x, y)
        share = np.clip(inside / max(self.border_m, 1e-9), 0, 1) if self.border_m else (inside > 0) * 1.0
        return np.asarray(self.height_m * (share**2 * (3 - 2 * share) if self.is_rounded else share))


def rectangle(centre: FloatArray, sides: FloatArray, turn: float = 0.0) -> Distance:
    """A rectangle of `sides` (2,) metres about `centre` (2,), turned by `turn` radians."""
    cos, sin = np.cos(turn), np.sin(turn)

    def distance(x: FloatArray, y: FloatArray) -> FloatArray:
        u, v = x - centre[0], y - centre[1]
        p, q = np.abs(cos * u + sin * v) - sides[0] / 2, np.abs(cos * v - sin * u) - sides[1] / 2
        return np.asarray(np.hypot(np.maximum(p, 0), np.maximum(q, 0)) + np.minimum(np.maximum(p, q), 0))

    return distance


def ellipse(centre: FloatArray, sides: FloatArray, turn: float = 0.0) -> Distance:
    """An ellipse in a rectangle; the distance is of first order."""
    cos, sin = np.cos(turn), np.sin(turn)

    def distance(x: FloatArray, y: FloatArray) -> FloatArray:
        u, v = x - centre[0], y - centre[1]
        p, q = 2 * (cos * u + sin * v) / sides[0], 2 * (cos * v - sin * u) / sides[1]
        radius = np.hypot(p, q)
        slope = np.hypot(2 * p / sides[0], 2 * q / sides[1]) / np.maximum(radius, 1e-9)
        return np.asarray((radius - 1) / np.maximum(slope, 1e-3))

    return distance


def without(one: Distance, other: Distance) -> Distance:
    """A shape with another cut out of it: a frame, an L."""
    return lambda x, y: np.maximum(one(x, y), -other(x, y))


def both(one: Distance, other: Distance) -> Distance:
    """Two shapes as one."""
    return lambda x, y: np.minimum(one(x, y), other(x, y))


TUNING_LAYOUTS = ("panels", "door", "switches", "mouldings", "pictures")
HELD_OUT_LAYOUTS = ("wainscot", "niches", "plaques", "skew", "pilasters", "dense")


@dataclass(frozen=True, slots=True, eq=False)
class Wall:
    """A wall as measured, and as it is.

    `layout`, `kind`: of the relief, of the ripple.
    """

    heights: FloatArray  # (rows, columns) float: As measured: relief, ripple and noise, metres over the plane
    relief: FloatArray  # (rows, columns) float: As it is
    ripple: FloatArray  # (rows, columns) float: The systematic error
    cell_m: float  # side of a cell, metres
    layout: str
    kind: str
    noise_m: float  # sd of the white noise of a cell


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
