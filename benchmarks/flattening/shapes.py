# SPDX-License-Identifier: MIT
"""Shapes of relief on a wall: signed distances, and what stands out behind a border of some profile."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from scenes.checks import FloatArray

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
        return self.height_m * (share**2 * (3 - 2 * share) if self.is_rounded else share)


def rectangle(centre: FloatArray, sides: FloatArray, turn: float = 0.0) -> Distance:
    """A rectangle of `sides` (2,) metres about `centre` (2,), turned by `turn` radians."""
    cos, sin = np.cos(turn), np.sin(turn)

    def distance(x: FloatArray, y: FloatArray) -> FloatArray:
        u, v = x - centre[0], y - centre[1]
        p, q = np.abs(cos * u + sin * v) - sides[0] / 2, np.abs(cos * v - sin * u) - sides[1] / 2
        return np.hypot(np.maximum(p, 0), np.maximum(q, 0)) + np.minimum(np.maximum(p, q), 0)

    return distance


def ellipse(centre: FloatArray, sides: FloatArray, turn: float = 0.0) -> Distance:
    """An ellipse in a rectangle; the distance is of first order."""
    cos, sin = np.cos(turn), np.sin(turn)

    def distance(x: FloatArray, y: FloatArray) -> FloatArray:
        u, v = x - centre[0], y - centre[1]
        p, q = 2 * (cos * u + sin * v) / sides[0], 2 * (cos * v - sin * u) / sides[1]
        radius = np.hypot(p, q)
        slope = np.hypot(2 * p / sides[0], 2 * q / sides[1]) / np.maximum(radius, 1e-9)
        return (radius - 1) / np.maximum(slope, 1e-3)

    return distance


def without(one: Distance, other: Distance) -> Distance:
    """A shape with another cut out of it: a frame, an L."""
    return lambda x, y: np.maximum(one(x, y), -other(x, y))


def both(one: Distance, other: Distance) -> Distance:
    """Two shapes as one."""
    return lambda x, y: np.minimum(one(x, y), other(x, y))
