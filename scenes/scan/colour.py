# SPDX-License-Identifier: MIT
"""Colours of pixels: bytes as files have them, or real numbers in 0..1; either is had from both.

Pick the pixels first and convert then: a large scan has more of them than anyone shows.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from scenes.checks import ColourArray

_MOST = np.float32(255)


def colour_type(colour: Any) -> Any:
    """Return how colours are held: as bytes, 0..255, where they are given so, else as float32 in 0..1."""
    return np.uint8 if getattr(colour, "dtype", None) == np.uint8 else np.float32


def unit_colour(colour: Any) -> NDArray[np.float32]:
    """Return colours of any shape, bytes or 0..1, as float32 in 0..1.

    Examples
    --------
    >>> unit_colour(np.array([0, 51, 255], np.uint8)).tolist() == [0.0, np.float32(0.2), 1.0]
    True
    """
    if colour_type(colour) == np.uint8:
        return np.asarray(colour, dtype=np.float32) / _MOST
    return np.asarray(colour, dtype=np.float32)


def colour_bytes(colour: Any) -> ColourArray:
    """Return colours of any shape, bytes or 0..1, as bytes; not a number is black.

    Bytes made real by `unit_colour` come back as they were.

    Examples
    --------
    >>> colour_bytes(np.float32([-0.1, 0.5, 1.0, np.nan])).tolist()
    [0, 128, 255, 0]
    """
    if colour_type(colour) == np.uint8:
        return np.asarray(colour, dtype=np.uint8)
    safe = np.nan_to_num(np.asarray(colour, dtype=np.float64), nan=0.0)
    return np.asarray(np.clip(np.rint(safe * 255), 0, 255), dtype=np.uint8)
