# SPDX-License-Identifier: MIT
"""Pixels of a scan, checked: a few rows of an image at a time, so that a large one needs no second one."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scenes.checks import BoolArray, FloatArray, InputError, frozen_copy

_BLOCK = 1 << 16  # pixels: what a processor keeps at hand
_ROUNDING = 1e-3  # how far arithmetic may carry a colour out of 0..1
_OFF_RANGE = 1e-6  # relative: how far a range may be from its measured point's distance; files round both
_MOST_M = 1e9  # beyond any scanner: files write such numbers for "no return"


def row_blocks(shape: tuple[int, ...]) -> Iterator[slice]:
    """Yield slices that cover the rows of an image, at least one row each, some 65,000 pixels.

    Examples
    --------
    >>> list(row_blocks((300, 500)))
    [slice(0, 131, None), slice(131, 262, None), slice(262, 300, None)]
    """
    rows, columns = shape[:2]
    step = max(_BLOCK // max(columns, 1), 1)
    return (slice(start, min(start + step, rows)) for start in range(0, rows, step))


def mended(array: Any, dtype: Any, wrong: Callable[[slice, Any], BoolArray], value: float) -> Any:
    """Return `array` (rows, columns, ...) read-only, as `dtype`, with `value` in the pixels that are wrong.

    `wrong` tells of some rows, and of what `array` holds there, which pixels are. A read-only array without
    a wrong pixel is returned as it is, not copied.
    """
    held = frozen_copy(array, dtype)
    for rows in row_blocks(held.shape):
        bad = wrong(rows, held[rows])
        if bad.any():
            if held is array:
                held = array.copy()
            held.setflags(write=True)
            held[rows][bad] = value
    held.setflags(write=False)
    return held


def points_type(points: Any) -> Any:
    """Return how measured points are held: as float32 where they are given so."""
    return np.float32 if getattr(points, "dtype", None) == np.float32 else np.float64


def finite_points(points: Any) -> BoolArray:
    """Tell which of points (..., 3) are finite; faster than a reduction over three."""
    finite = np.isfinite(points)
    known: BoolArray = finite[..., 0] & finite[..., 1] & finite[..., 2]
    return known


def ranges_of(points: Any) -> FloatArray:
    """Return how far points (rows, ..., 3) are from the sensor, metres; inf where nothing came back."""
    away = np.empty(points.shape[:-1])
    for rows in row_blocks(points.shape):
        found = np.linalg.norm(np.asarray(points[rows], np.float64), axis=-1)
        away[rows] = np.where(is_return(found), found, np.inf)
    away.setflags(write=False)
    return away


def is_return(ranges: FloatArray) -> BoolArray:
    """Tell which ranges, of any shape, are those of a return, and no number that files write for none."""
    with np.errstate(invalid="ignore"):
        return np.asarray((ranges > 0) & (ranges <= _MOST_M), dtype=np.bool_)


def check_same(ranges: FloatArray, points: Any) -> None:
    """Raise InputError where measured points (rows, columns, 3) are not as far away as their ranges say."""
    n_wrong, first = 0, np.empty((0, 2))
    for rows in row_blocks(ranges.shape):
        valid = np.isfinite(ranges[rows])
        with np.errstate(over="ignore", invalid="ignore"):
            away = np.linalg.norm(np.asarray(points[rows], np.float64), axis=-1)
            wrong = valid & ~(np.abs(away - ranges[rows]) <= _OFF_RANGE * ranges[rows])
        if wrong.any():
            n_wrong += int(np.count_nonzero(wrong))
            first = np.concatenate([first, [[away[wrong][0], ranges[rows][wrong][0]]]])
    if n_wrong:
        n_valid, (found, said) = np.count_nonzero(np.isfinite(ranges)), first[0]
        raise InputError(
            f"{n_wrong} of {n_valid} measured points are not as far away as their ranges "
            f"say (first {found:.6g} m, its range {said:.6g} m); give both alike"
        )


def is_beside(ranges: FloatArray, points: Any) -> BoolArray:
    """Tell which points (..., 3), though not all NaN, belong to no return."""
    known = ~np.isnan(points)
    beside: BoolArray = ~np.isfinite(ranges) & (known[..., 0] | known[..., 1] | known[..., 2])
    return beside


def checked_colour(colour: NDArray[np.float32], ranges: FloatArray) -> NDArray[np.float32]:
    """Return colours (rows, columns, 3) that are finite and, where something came back, in 0..1.

    Raises InputError: they are not, of returns.
    """
    if all(colour[rows].min() >= 0 and colour[rows].max() <= 1 for rows in row_blocks(colour.shape)):
        return colour
    valid = np.isfinite(ranges)
    finite = np.asarray(np.isfinite(colour).all(axis=-1), dtype=np.bool_)
    n_bad = np.count_nonzero(valid & ~finite)
    if n_bad:
        raise InputError(
            f"colour of {n_bad} of {np.count_nonzero(valid)} returns is not finite; leave it out"
        )
    known = colour[valid]
    if known.size and (known.min() < -_ROUNDING or known.max() > 1 + _ROUNDING):
        found = f"{known.min():.4g}..{known.max():.4g}"
        raise InputError(f"colour is to be in 0..1, got {found}; divide it by its largest value")
    limited = np.clip(np.where(finite[..., None], colour, 0), 0, 1)
    return np.asarray(frozen_copy(limited, np.float32), dtype=np.float32)
