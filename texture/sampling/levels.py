# SPDX-License-Identifier: MIT
"""8-bit levels: what templates and candidates are compared in, whatever the image's own type."""

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

Pixels: TypeAlias = NDArray[Any]  # uint8, or float in 0..1; the dtype is kept from input to result

HIGHEST_LEVEL = 255
ROUNDING = 1e-5  # how far single-precision arithmetic may carry a colour out of 0..1


def quantise(pixels: Pixels, needed: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Round an image to 8-bit levels.

    Parameters
    ----------
    pixels : array, shape (h, w) or (h, w, c)
        uint8, or float in 0..1 where needed.
    needed : array, shape (h, w), bool
        Pixels whose value will be read; the others become level 0, whatever they hold.

    Returns
    -------
    array, shape (h, w, c), int64
        0..255.

    Raises
    ------
    ValueError
        When a needed pixel is not finite or lies outside 0..1.

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
