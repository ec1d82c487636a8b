# SPDX-License-Identifier: MIT
"""Field of view: whether a camera can see anything of a chart at all, told before its cells are looked at."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from completion.evidence.sight import Eye
from completion.observe.triple import Triple, triple
from scenes.checks import FloatArray

_MARGIN = 2.0  # cells around those of a chart that count with it
_PIXELS = 1.0  # around an image


class Ball(NamedTuple):
    """A ball around a chart's cells."""

    middle: Triple
    radius: float  # metres


def ball_around(centres: FloatArray, cell: FloatArray) -> Ball:
    """Return a ball around cells of a size (2,), with centres (n, 3), and two cells more on all sides."""
    low, high = centres.min(axis=0), centres.max(axis=0)
    radius = float(np.linalg.norm(high - low)) / 2 + _MARGIN * float(np.hypot(*cell))
    return Ball(triple((low + high) / 2), radius)


def may_see(eye: Eye, ball: Ball) -> bool:
    """Tell whether some ray of a sensor may meet a ball; a no is sure, a turning scanner never says it.

    The pyramid of a camera's rays is the space in front of four planes through the sensor.
    """
    if eye.is_spherical:
        return True
    x, y, z = (
        row[0] * ball.middle[0] + row[1] * ball.middle[1] + row[2] * ball.middle[2] + shift
        for row, shift in zip(eye.turn, eye.shift, strict=True)
    )
    if z < -ball.radius:
        return False
    rows, columns = eye.shape
    fx, fy, cx, cy = eye.lens
    for across, n, focal, centre in ((x, columns, fx, cx), (y, rows, fy, cy)):
        sides = (-0.5 - _PIXELS - centre) / focal, (n - 0.5 + _PIXELS - centre) / focal
        low, high = min(sides), max(sides)
        if across - high * z > ball.radius * math.hypot(1.0, high):
            return False
        if low * z - across > ball.radius * math.hypot(1.0, low):
            return False
    return True
