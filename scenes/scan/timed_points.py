# SPDX-License-Identifier: MIT
"""Timed points: what a scanner that moves has measured, with times."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scenes.checks import ArrayValue, FloatArray, IntArray


@dataclass(frozen=True, slots=True, eq=False)
class TimedPoints(ArrayValue):
    """Points of one turn of a scanner, or of one image of a camera.

    Attributes
    ----------
    points : (n, 3) float
        World, by the reported track, metres, in the order of their times.
    times : (n,) float
        Seconds on the track's clock, as the scanner has them.
    origins : (n, 3) float
        Where each was measured from, by the reported track.
    intensity : (n,) float32, optional
        Light that came back.
    surface : (n,) int32, optional
        Surface id that each beam's middle met.
    number, count : (n,) int64, optional
        Of each return among those of its beam, from 1, and how many these are; None where all are first ones.
    """

    points: FloatArray
    times: FloatArray
    origins: FloatArray
    intensity: NDArray[np.float32] | None = None
    surface: NDArray[np.int32] | None = None
    number: IntArray | None = None
    count: IntArray | None = None

    def __len__(self) -> int:
        return len(self.times)
