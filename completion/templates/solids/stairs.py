# SPDX-License-Identifier: MIT
"""Stairs: a straight flight of equal steps."""

from __future__ import annotations

import numpy as np

from completion.templates.engine.measured import Measured
from completion.templates.solids.upright import Upright
from scenes.checks import FloatArray, IntArray


class Stairs:
    """A straight flight of n treads and the n risers before them, between two places across the way.

    Parameters: heading (of the way up), forward and height (of the nose of the first tread, along the way
    and up), going, rise; in an upright frame.
    """

    kind = "stairs"
    names = ("heading", "forward", "height", "going", "rise")

    def __init__(self, frame: Upright, count: int, about: FloatArray, sides: FloatArray) -> None:
        self.frame, self.count, self.about, self.sides = frame, count, about, sides
        numbers = range(1, count + 1)
        self.faces = (*(f"tread {k}" for k in numbers), *(f"riser {k}" for k in numbers))

    def bounds(self, measured: Measured) -> tuple[FloatArray, FloatArray]:
        """Return (5,) and (5,): a step round what structure says; steps longer than the spacing of points."""
        _, _, _, going, rise = self.about
        reach = np.array([np.pi / 6, going, rise, 0.4 * going, 0.3 * rise])
        lower = self.about - reach
        lower[3:] = np.maximum(lower[3:], np.minimum(measured.spacing, self.about[3:]))
        return lower, self.about + reach

    def distance(self, points: FloatArray, x: FloatArray) -> tuple[FloatArray, IntArray]:
        """Return the distance of points (n, 3) from the nearest tread or riser (n,), and its number (n,)."""
        heading, forward, height, going, rise = x
        local = self.frame.local(points)
        along = local[:, :2] @ [np.cos(heading), np.sin(heading)] - forward
        up = local[:, 2] - height
        near = np.round((along / going + up / rise) / 2).astype(np.int64)
        step = np.clip(near[:, None] + np.arange(-1, 2), 0, self.count - 1)
        u, v = along[:, None] - step * going, up[:, None] - step * rise
        across = local[:, :2] @ [-np.sin(heading), np.cos(heading)]
        beside = np.abs(across - np.clip(across, *self.sides))
        each = np.hstack([np.hypot(v, u - np.clip(u, 0.0, going)), np.hypot(u, v - np.clip(v, -rise, 0.0))])
        numbers = np.hstack([step + 1, step + 1 + self.count])
        best = each.argmin(axis=1)[:, None]
        nearest, number = (np.take_along_axis(one, best, 1)[:, 0] for one in (each, numbers))
        return np.hypot(nearest, beside), number
