# SPDX-License-Identifier: MIT
"""Field of view: which scans can see anything of a chart at all, told before any of them is looked at."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from completion.evidence.sight import Eye
from completion.observe.triple import Triple, triple
from scenes.checks import BoolArray, FloatArray

_MARGIN = 2.0  # cells around those of a chart that count with it
_PIXELS = 1.0  # around an image
_SLACK = 1e-6  # of lengths, for rounding


class Ball(NamedTuple):
    """A ball around a chart's cells."""

    middle: Triple
    radius: float  # metres


def ball_around(bounds: FloatArray, cell: FloatArray) -> Ball:
    """Return a ball around cells of a size (2,), whose centres have bounds (2, 3), and two cells more."""
    low, high = bounds
    radius = float(np.linalg.norm(high - low)) / 2 + _MARGIN * float(np.hypot(*cell))
    return Ball(triple((low + high) / 2), radius)


class Views(NamedTuple):
    """Where n scans stand and look, so that all are asked at once."""

    origin: FloatArray  # (n, 3) of the sensors, metres
    outside: FloatArray  # (n, 5, 4) how far a place lies outside each of five planes: factors, and a summand
    farthest: FloatArray  # (n,) greatest range, metres; -inf where nothing came back

    @classmethod
    def of(cls, eyes: Iterable[Eye], farthest: Iterable[float]) -> Views:
        """Return the views of scans that measured no farther than `farthest` (n,), metres."""
        known = list(eyes)
        return cls(
            origin=np.array([eye.origin for eye in known]),
            outside=np.array([_outside(eye) for eye in known]),
            farthest=np.array(list(farthest), dtype=np.float64),
        )

    def may_see(self, ball: Ball) -> BoolArray:
        """Tell which scans (n,) have a ray that may meet a ball; a no is sure, turning scanners never say it.

        The pyramid of a camera's rays is the space in front of four planes through the sensor.
        """
        outside = self.outside[:, :, :3] @ np.array(ball.middle) + self.outside[:, :, 3]
        return np.asarray((outside <= ball.radius).all(axis=1), dtype=np.bool_)

    def may_reach(self, ball: Ball) -> BoolArray:
        """Tell which scans (n,) have a beam that may have got into a ball; a no is sure."""
        distance = np.linalg.norm(self.origin - np.array(ball.middle), axis=1)
        reaches = self.farthest >= distance * (1 - _SLACK) - ball.radius - _SLACK
        return np.asarray(self.may_see(ball) & reaches, dtype=np.bool_)


def _outside(eye: Eye) -> FloatArray:
    """How far a place lies behind a sensor, and outside each side of its image (5, 4); -inf without sides."""
    if eye.is_spherical:
        return np.tile([0.0, 0.0, 0.0, -np.inf], (5, 1))
    x, y, z = np.column_stack([np.array(eye.turn), np.array(eye.shift)])
    rows, columns = eye.shape
    fx, fy, cx, cy = eye.lens
    planes = [-z]
    for across, n, focal, centre in ((x, columns, fx, cx), (y, rows, fy, cy)):
        sides = (-0.5 - _PIXELS - centre) / focal, (n - 0.5 + _PIXELS - centre) / focal
        low, high = min(sides), max(sides)
        planes += [(across - high * z) / np.hypot(1.0, high), (low * z - across) / np.hypot(1.0, low)]
    return np.array(planes)
