# SPDX-License-Identifier: MIT
"""Palette: the colours by which surfaces are told apart, in pictures, tables and files."""

from __future__ import annotations

import numpy as np

from scenes.checks import ColourArray, IntArray

_NONE = "#c9c9c6"
_SURFACES = (
    "#4477aa", "#ddaa33", "#228833", "#cc6677", "#66ccee", "#aa3377", "#999933", "#117733",
    "#88ccee", "#882255", "#bbaa55", "#44aa99", "#6655aa", "#ee8866", "#77aadd", "#aaaa00",
)  # fmt: skip


def surface_colour(number: int) -> str:
    """Return the CSS colour of surface `number` (from 1); grey for 0, which is none."""
    return _NONE if number <= 0 else _SURFACES[(number - 1) % len(_SURFACES)]


def surface_rgb(number: int) -> tuple[float, float, float]:
    """Return the same colour as red, green and blue, 0..1."""
    red, green, blue = (int(surface_colour(number)[i : i + 2], 16) / 255 for i in (1, 3, 5))
    return red, green, blue


def surface_bytes(numbers: IntArray) -> ColourArray:
    """Return the colours (n, 3) of surfaces by their numbers (n,), 0..255."""
    table = np.array([surface_rgb(k) for k in range(len(_SURFACES) + 1)])
    place = np.where(numbers > 0, (np.asarray(numbers) - 1) % len(_SURFACES) + 1, 0)
    return np.asarray(np.rint(255 * table[place]), dtype=np.uint8)
