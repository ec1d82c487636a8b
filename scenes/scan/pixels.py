# SPDX-License-Identifier: MIT
"""Pixels of a scan, checked: a few rows at a time, so that a large image is never in memory whole."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from scenes.checks import BoolArray, FloatArray, InputError, frozen_copy
from scenes.limits import OFF_RANGE
from scenes.pose import Pose
from scenes.run.mapping import LARGE, allocate, is_mapped, release

_BLOCK = 1 << 16  # pixels: what a processor keeps at hand
_ROUNDING = 1e-3  # how far arithmetic may carry a colour out of 0..1
_MOST_M = 1e9  # beyond any scanner: files write such numbers for "no return"


def row_blocks(shape: tuple[int, ...], *arrays: Any) -> Iterator[slice]:
    """Yield slices that cover the rows of an image, at least one row each, some 65,000 pixels.

    What mapped `arrays` have in memory is released behind each; arrays in memory, and None, are left alone.

    Examples
    --------
    >>> list(row_blocks((300, 500)))
    [slice(0, 131, None), slice(131, 262, None), slice(262, 300, None)]
    """
    rows, columns = shape[:2]
    step = max(_BLOCK // max(columns, 1), 1)
    for start in range(0, rows, step):
        yield slice(start, min(start + step, rows))
        release(*arrays)


def frozen_pixels(array: Any, dtype: Any) -> Any:
    """Return a read-only copy of pixels (rows, columns, ...), mapped where there are many.

    An array that is read-only, as is the one whose memory it shows, is returned as it is.
    """
    if not isinstance(array, np.ndarray) or array.ndim < 2 or array.shape[0] * array.shape[1] <= LARGE:
        return frozen_copy(array, dtype)
    owner = array.base if isinstance(array.base, np.ndarray) else array
    is_ours = is_mapped(array) or owner.base is None
    if is_ours and array.dtype == dtype and not (array.flags.writeable or owner.flags.writeable):
        return array
    copy = allocate(array.shape, dtype)
    for rows in row_blocks(copy.shape, copy, array):
        copy[rows] = array[rows]
    copy.setflags(write=False)
    return copy


def mend_pixels(
    array: Any, dtype: Any, wrong: Callable[[slice, Any], BoolArray], value: float, *beside: Any
) -> Any:
    """Return `array` (rows, columns, ...) read-only, as `dtype`, with `value` in the pixels that are wrong.

    `wrong` tells of some rows, and of what `array` holds there, which pixels are; it may look at the arrays
    `beside`. A read-only array without a wrong pixel is returned as it is, not copied.
    """
    held = frozen_pixels(array, dtype)
    for rows in row_blocks(held.shape, held, *beside):
        bad = wrong(rows, held[rows])
        if bad.any():
            if held is array:
                held = copy_pixels(array)
            held.setflags(write=True)
            held[rows][bad] = value
        release(held)
    held.setflags(write=False)
    return held


def copy_pixels(array: Any) -> Any:
    """Return a copy of pixels (rows, columns, ...) that may be written to, mapped where there are many."""
    copy = allocate(array.shape, array.dtype)
    for rows in row_blocks(array.shape, copy, array):
        copy[rows] = array[rows]
    return copy


def crop_pixels(array: Any, rows: slice, columns: slice) -> Any:
    """Return some rows and columns of pixels (rows, columns, ...), read-only; a copy where they lie apart."""
    part = array[rows, columns]
    if part.flags.c_contiguous:
        return part
    copy = copy_pixels(part)
    copy.setflags(write=False)
    return copy


def scale_pixels(array: Any, factor: float) -> FloatArray:
    """Return pixels (rows, columns, ...) times a number, float64 and read-only."""
    out = allocate(array.shape, np.float64)
    for rows in row_blocks(array.shape, out, array):
        np.multiply(array[rows], factor, out=out[rows])
    out.setflags(write=False)
    return out


def move_points(points: Any, pose: Pose) -> FloatArray:
    """Return points (rows, columns, 3) after a pose, float64 and read-only."""
    out = allocate(points.shape, np.float64)
    for rows in row_blocks(points.shape, out, points):
        out[rows] = pose.apply(points[rows])
    out.setflags(write=False)
    return out


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
    away = allocate(points.shape[:-1], np.float64) if points.ndim > 2 else np.empty(points.shape[:-1])
    for rows in row_blocks(points.shape, points, away):
        norm = np.linalg.norm(np.asarray(points[rows], np.float64), axis=-1)
        away[rows] = np.where(is_return(norm), norm, np.inf)
    away.setflags(write=False)
    return away


def is_return(ranges: FloatArray) -> BoolArray:
    """Tell which ranges, of any shape, are those of a return, and no number that files write for none."""
    with np.errstate(invalid="ignore"):
        return np.asarray((ranges > 0) & (ranges <= _MOST_M), dtype=np.bool_)


def check_same(ranges: FloatArray, points: Any) -> None:
    """Raise InputError where measured points (rows, columns, 3) are not as far away as their ranges say."""
    n_valid, n_wrong, first = 0, 0, np.empty((0, 2))
    for rows in row_blocks(ranges.shape, ranges, points):
        valid = np.isfinite(ranges[rows])
        n_valid += int(np.count_nonzero(valid))
        with np.errstate(over="ignore", invalid="ignore"):
            away = np.linalg.norm(np.asarray(points[rows], np.float64), axis=-1)
            wrong = valid & ~(np.abs(away - ranges[rows]) <= OFF_RANGE * ranges[rows])
        if wrong.any():
            n_wrong += int(np.count_nonzero(wrong))
            first = np.concatenate([first, [[away[wrong][0], ranges[rows][wrong][0]]]])
    if n_wrong:
        value, item = first[0]
        raise InputError(
            f"{n_wrong} of {n_valid} measured points are not as far away as their ranges "
            f"say (first {value:.6g} m, its range {item:.6g} m); give both alike"
        )


def is_beside(ranges: FloatArray, points: Any) -> BoolArray:
    """Tell which points (..., 3), though not all NaN, belong to no return."""
    known = ~np.isnan(points)
    beside: BoolArray = ~np.isfinite(ranges) & (known[..., 0] | known[..., 1] | known[..., 2])
    return beside


def checked_colour(colour: Any, ranges: FloatArray) -> Any:
    """Return colours (rows, columns, 3), bytes or real numbers that are finite and 0..1 of returns.

    Those of pixels without a return are made so. Raises InputError: those of returns are not.
    """
    if colour.dtype == np.uint8 or all(
        colour[rows].min() >= 0 and colour[rows].max() <= 1 for rows in row_blocks(colour.shape, colour)
    ):
        return colour
    n_valid, n_bad, low, high = 0, 0, np.inf, -np.inf
    for rows in row_blocks(colour.shape, colour, ranges):
        valid = np.isfinite(ranges[rows])
        known = colour[rows][valid]
        n_valid, n_bad = n_valid + len(known), n_bad + int((~finite_points(known)).sum())
        low, high = min(low, known.min(initial=np.inf)), max(high, known.max(initial=-np.inf))
    if n_bad:
        raise InputError(f"colour of {n_bad} of {n_valid} returns is not finite; leave it out")
    if low < -_ROUNDING or high > 1 + _ROUNDING:
        text = f"{low:.4g}..{high:.4g}"
        raise InputError(f"colour is to be in 0..1, got {text}; divide it by its largest value")
    limited = allocate(colour.shape, np.float32)
    for rows in row_blocks(colour.shape, colour, limited):
        held = colour[rows]
        limited[rows] = np.clip(np.where(finite_points(held)[..., None], held, 0), 0, 1)
    limited.setflags(write=False)
    return limited
