# SPDX-License-Identifier: MIT
"""The sample: its 8-bit levels, and the pixels that may be copied, with a margin around them."""

from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

FloatArray: TypeAlias = NDArray[np.float64]
BoolArray: TypeAlias = NDArray[np.bool_]
IntArray: TypeAlias = NDArray[np.int64]
Pixels: TypeAlias = NDArray[Any]  # uint8, or float in 0..1; the dtype is kept from input to result

HIGHEST_LEVEL = 255
ROUNDING = 1e-5  # how far single-precision arithmetic may carry a colour out of 0..1


def quantise(pixels: Pixels, needed: BoolArray) -> IntArray:
    """Round an image (h, w) or (h, w, c), uint8 or float in 0..1, to 8-bit levels (h, w, c), 0..255.

    Only pixels that are needed (h, w) are read; the others become level 0, whatever they hold. Raises
    ValueError: a needed pixel is not finite or lies outside 0..1.

    Examples
    --------
    >>> quantise(np.array([[0.0, 0.4, np.nan]]), np.array([[True, True, False]]))[..., 0]
    array([[  0, 102,   0]])
    """
    channels = pixels if pixels.ndim == 3 else pixels[..., None]
    read = np.where(needed[..., None], channels, np.zeros((), dtype=pixels.dtype))
    if pixels.dtype == np.uint8:
        levels = read.astype(np.int64)
    else:
        _check_range(read)
        levels = np.rint(np.clip(read.astype(np.float64), 0, 1) * HIGHEST_LEVEL).astype(np.int64)
    levels.flags.writeable = False  # so that a sample may keep it as it is
    return levels


def _check_range(read: Pixels) -> None:
    is_bad = ~np.isfinite(read).all(axis=2)
    if is_bad.any():
        row, column = np.argwhere(is_bad)[0]
        raise ValueError(
            f"image: {np.count_nonzero(is_bad)} of {is_bad.size} pixels are known but not finite (first at "
            f"row {row}, column {column}); mask them, or exclude them by `known` (for grow: by `sample_mask`)"
        )
    lowest, highest = float(read.min()), float(read.max())
    if lowest < -ROUNDING or highest > 1 + ROUNDING:
        raise ValueError(
            f"image: expected float values in 0..1, got {lowest:.4g}..{highest:.4g}; "
            "divide by the largest possible value, or pass 8-bit values as uint8"
        )


@dataclass(frozen=True, slots=True, eq=False)
class Sample:
    """The pixels that may be copied, with a margin around them.

    Parameters
    ----------
    levels : array, shape (h, w, c), int64
        8-bit levels.
    usable : array, shape (h, w), bool
        Which pixels may be copied, and be compared with.
    wrap : (bool, bool)
        Whether rows and columns close on themselves.
    radius : int
        How far a window reaches from its centre, pixels, at least 1.

    Attributes
    ----------
    positions : array, shape (n,), int64
        The usable pixels in raster order, row * w + column.
    margin : int
        Width of the margin: one pixel more than the radius.
    padded_levels : array, shape (h + 2 margin, w + 2 margin, c), int64
        The levels with their margin: the other side's where an axis wraps.
    padded_usable : array, shape (h + 2 margin, w + 2 margin), bool
        Which of them may be compared with: outside the sample none.

    Examples
    --------
    >>> sample = Sample(np.arange(6).reshape(1, 6, 1), np.ones((1, 6), bool), (False, True), radius=1)
    >>> sample.padded_levels[sample.margin, :, 0]
    array([4, 5, 0, 1, 2, 3, 4, 5, 0, 1])
    """

    levels: IntArray
    usable: BoolArray
    wrap: tuple[bool, bool]
    radius: int
    margin: int = field(init=False)
    positions: IntArray = field(init=False)
    padded_levels: IntArray = field(init=False)
    padded_usable: BoolArray = field(init=False)

    def __post_init__(self) -> None:
        margin = self.radius + 1
        rows, is_row = _extend(self.usable.shape[0], margin, self.wrap[0])
        columns, is_column = _extend(self.usable.shape[1], margin, self.wrap[1])
        inside = is_row[:, None] & is_column
        derived = {
            "levels": self.levels.copy() if self.levels.flags.writeable else self.levels,
            "usable": self.usable.copy(),
            "positions": np.flatnonzero(self.usable).astype(np.int64),
            "padded_levels": self.levels[rows[:, None], columns],
            "padded_usable": self.usable[rows[:, None], columns] & inside,
        }
        for name, array in derived.items():
            array.flags.writeable = False
            object.__setattr__(self, name, array)
        object.__setattr__(self, "margin", margin)


def _extend(size: int, margin: int, wraps: bool) -> tuple[IntArray, BoolArray]:
    """Return the index of each pixel of an axis with its margin, and whether there is such a pixel."""
    indices = np.arange(-margin, size + margin)
    inside = (indices >= 0) & (indices < size)
    return indices % size, inside | wraps
