# SPDX-License-Identifier: MIT
"""Columns: a round shaft upright on a square base, about one axis."""

from __future__ import annotations

import numpy as np

from completion.templates.engine.measured import Measured
from completion.templates.solids.shafts import Shaft
from completion.templates.solids.upright import Upright
from scenes.checks import FloatArray, IntArray

_WIDTHS, _TURNS, _TOPS = (2.2, 2.8, 3.6), (0.2, 1.0), (15, 30, 50)  # radii, radians, percentiles of height


class Column:
    """A shaft above the top of a base, which goes down to wherever it ends.

    Parameters: x, y (of the axis), heading (of a side, in a quarter turn), width (of the base), top (of the
    base), radius (of the shaft); in an upright frame.
    """

    kind = "column"
    names = ("x", "y", "heading", "width", "top", "radius")
    faces = ("side 1", "side 2", "side 3", "side 4", "top", "shaft")

    def __init__(self, frame: Upright) -> None:
        self.frame = frame

    def bounds(self, measured: Measured) -> tuple[FloatArray, FloatArray]:
        """Return (6,) and (6,): the box of what was measured; widths and radii up to its size."""
        local = self.frame.local(measured.points)
        low, high = local.min(axis=0), local.max(axis=0)
        size = float(np.ptp(local[:, :2], axis=0).max())
        lower = [low[0], low[1], -np.pi / 2, 0.02 * size, low[2], 0.01 * size]
        return np.array(lower), np.array([high[0], high[1], np.pi / 2, 1.5 * size, high[2], 0.75 * size])

    def distance(self, points: FloatArray, x: FloatArray) -> tuple[FloatArray, IntArray]:
        """Return the distance of points (n, 3) from the nearest face (n,), and its number (n,)."""
        place_x, place_y, heading, width, top, radius = x
        local = self.frame.local(points) - [place_x, place_y, top]
        cosine, sine = np.cos(heading), np.sin(heading)
        u = cosine * local[:, 0] + sine * local[:, 1]
        v = cosine * local[:, 1] - sine * local[:, 0]
        up, out, half = local[:, 2], np.hypot(local[:, 0], local[:, 1]), width / 2
        over = np.maximum(up, 0.0)
        beside = [np.maximum(np.abs(one) - half, 0.0) for one in (v, u)]
        sides = [
            np.sqrt((one - sign * half) ** 2 + over**2 + past**2)
            for sign in (1.0, -1.0)
            for one, past in zip((u, v), beside, strict=True)
        ]
        within = np.maximum(radius - out, 0.0)
        flat = np.sqrt(up**2 + beside[0] ** 2 + beside[1] ** 2 + within**2)
        shaft = np.hypot(out - radius, np.minimum(up, 0.0))
        each = np.stack([*sides, flat, shaft])
        return each.min(axis=0), each.argmin(axis=0) + 1


def column_starts(shaft: Shaft, heights: FloatArray) -> FloatArray:
    """Return parameters (s, 6) to begin with, by a shaft and the heights (n,) of what lies about it."""
    tops = np.percentile(heights, _TOPS)
    starts = [
        [shaft.x, shaft.y, turn, wide * shaft.radius, top, shaft.radius]
        for top in tops
        for wide in _WIDTHS
        for turn in _TURNS
    ]
    return np.array(starts)
