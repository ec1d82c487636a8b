# SPDX-License-Identifier: MIT
"""Thing: what stands in a room, its pixels, its box, and what it stands on, leans at, touches and hides."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scenes.checks import ArrayValue, BoolArray, FloatArray, IntArray, Value


@dataclass(frozen=True, slots=True, eq=False)
class UprightBox(ArrayValue):
    """The least upright box around measured points, world coordinates.

    Attributes
    ----------
    axes : (3, 3) float
        Unit directions in rows; the last one is up.
    low, high : (3,) float
        Corners along them, metres.
    """

    axes: FloatArray
    low: FloatArray
    high: FloatArray

    @property
    def size(self) -> FloatArray:
        """Lengths (3,) of its sides along the axes, metres."""
        return np.asarray(self.high - self.low)

    @property
    def diagonal_m(self) -> float:
        """The size of the thing, metres."""
        return float(np.linalg.norm(self.size))


@dataclass(frozen=True, slots=True, eq=False)
class Cut(Value):
    """Whether a thing goes on, in one scan, past the border of the image or behind an occluder."""

    scan: int
    border: bool
    occluder: bool


@dataclass(frozen=True, slots=True, eq=False)
class Thing(ArrayValue):
    """What stands in a room.

    Attributes
    ----------
    index : int
        From 0, the largest first.
    pixels : tuple of (n,) int64
        Of each scan its flat pixels, ascending.
    box : UprightBox
        Around what was measured of it.
    stands_on : int, optional
        Number of the surface, from 0, on which it stands; None where that was not seen.
    stands_on_thing : int, optional
        The thing of which that surface is.
    support_m : float, optional
        Height of the support along up at the foot, world coordinates, metres.
    leans_at : tuple of int
        Surfaces of walls, from 0, that it touches.
    touches : tuple of int
        Other things at which its outline ends at the same depth.
    occluded_by, hides : tuple of int
        Other things before it and behind it.
    cuts : tuple of Cut
        Of each scan that shows it.
    surfaces : tuple of int
        Completed surfaces, from 0, most of which are of it.
    measured_m2 : float
        Area by the solid angles of pixels, at normal incidence, in the scan that shows most of it.
    """

    index: int
    pixels: tuple[IntArray, ...]
    box: UprightBox
    stands_on: int | None
    stands_on_thing: int | None
    support_m: float | None
    leans_at: tuple[int, ...]
    touches: tuple[int, ...]
    occluded_by: tuple[int, ...]
    hides: tuple[int, ...]
    cuts: tuple[Cut, ...]
    surfaces: tuple[int, ...]
    measured_m2: float

    def mask(self, scan: int, shape: tuple[int, int]) -> BoolArray:
        """Its pixels (rows, columns) in a scan."""
        mask = np.zeros(shape, dtype=np.bool_)
        mask.ravel()[self.pixels[scan]] = True
        return mask
