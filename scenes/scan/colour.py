# SPDX-License-Identifier: MIT
"""Colours of scans as bytes and as floats, and the palette of reports."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy  # its parts load when they are first used
from numpy.typing import NDArray

from scenes.checks import BoolArray, ColourArray, FloatArray, InputError, IntArray

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


_MOST = np.float32(255)
_MOST_16, _STEP_16 = 65535, 257  # 16-bit colours: bytes times 257


def colour_pixels(colour: ColourArray, is_coloured: BoolArray) -> ColourArray | None:
    """Return pixels (rows, columns, 3), those without a colour as the nearest that has one; None for none."""
    if not is_coloured.any():
        return None
    nearest = scipy.ndimage.distance_transform_edt(~is_coloured, return_distances=False, return_indices=True)
    return np.asarray(colour[tuple(nearest)])


def colour_points(colour: ColourArray, is_coloured: BoolArray, points: FloatArray) -> ColourArray | None:
    """Return colours (n, 3) of points (n, 3), those without as the nearest that has one; None for none."""
    if not is_coloured.any():
        return None
    _, nearest = scipy.spatial.cKDTree(points[is_coloured]).query(points[~is_coloured])
    filled = colour.copy()
    filled[~is_coloured] = colour[is_coloured][nearest]
    return filled


def colour_warnings(n_without: int, n_points: int) -> tuple[str, ...]:
    """Return a warning that `n_without` of `n_points` points have no colour, nothing where all have."""
    if not n_without:
        return ()
    cure = "they take that of the nearest that has one" if n_without < n_points else "colour was left out"
    return (f"{n_without} of {n_points} points have no valid colour: {cure}",)


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


def scaled_bytes(values: Any, what: str = "colours") -> ColourArray:
    """Return colours of any shape as bytes, scaled by what the largest of all shows.

    Real numbers up to 1 are 0..1; others up to 255 are bytes, and up to 65,535 have 16 bits.

    Raises InputError: negative ones, or larger ones.

    Examples
    --------
    >>> scaled_bytes(np.uint16([0, 25700, 65535])).tolist(), scaled_bytes(np.float32([0.2, 1])).tolist()
    ([0, 100, 255], [51, 255])
    """
    colour = np.asarray(values)
    if colour_type(colour) == np.uint8 or not colour.size:
        return np.asarray(colour, dtype=np.uint8)
    least, most = float(colour.min()), float(colour.max())
    if not (least >= 0 and most <= _MOST_16):
        raise InputError(f"{what} are to be in 0..255 or 0..65535, got {least:.6g}..{most:.6g}")
    if colour.dtype.kind in "iu" and most <= _MOST:
        return colour.astype(np.uint8)
    is_unit = colour.dtype.kind == "f" and most <= 1
    scale = 255.0 if is_unit else 1.0 if most <= _MOST else 1 / _STEP_16
    return np.asarray(np.rint(colour * scale), dtype=np.uint8)


def known_colours(values: FloatArray, points: FloatArray) -> tuple[ColourArray | None, tuple[str, ...]]:
    """Return colours (n, 3) as bytes, those that are no number as of the nearest of points (n, 3) with one.

    Beside them a warning how many were not known; None where none was. Raises InputError: as `scaled_bytes`.
    """
    is_known = np.asarray(np.isfinite(values).all(axis=1))
    colour = np.zeros(values.shape, np.uint8)
    colour[is_known] = scaled_bytes(values[is_known])
    held = colour_points(colour, is_known, points)
    return held, colour_warnings(int((~is_known).sum()), len(values))
