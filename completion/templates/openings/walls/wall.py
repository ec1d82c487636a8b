# SPDX-License-Identifier: MIT
"""Wall: a plane in which openings are sought; floor: a level one that people stand on before it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from completion.fitting.result import SurfaceFit
from scenes.checks import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Wall:
    """A plane in which openings are sought.

    Attributes
    ----------
    fit : SurfaceFit
        The plane, in the frame of the observations.
    points : (n, 3) float
        Some of its measured points.
    number : int
        What it is called in files, and in `owners`, from 1.
    owners : sequence of (rows, columns) int
        Number of the surface that each pixel of each scan is of, 0 for none; empty where that is not known.
    """

    fit: SurfaceFit
    points: FloatArray
    number: int = 0
    owners: Sequence[NDArray[np.int32]] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Floor:
    """A level plane that people stand on.

    Attributes
    ----------
    fit : SurfaceFit
        The plane, in the frame of the observations.
    points : (n, 3) float
        Some of its measured points.
    """

    fit: SurfaceFit
    points: FloatArray
