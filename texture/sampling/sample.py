# SPDX-License-Identifier: MIT
"""The sample: the pixels that may be copied, prepared so that any window around them can be read."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray


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

    levels: NDArray[np.int64]
    usable: NDArray[np.bool_]
    wrap: tuple[bool, bool]
    radius: int
    margin: int = field(init=False)
    positions: NDArray[np.int64] = field(init=False)
    padded_levels: NDArray[np.int64] = field(init=False)
    padded_usable: NDArray[np.bool_] = field(init=False)

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


def _extend(size: int, margin: int, wraps: bool) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Return the index of each pixel of an axis with its margin, and whether there is such a pixel."""
    indices = np.arange(-margin, size + margin)
    inside = (indices >= 0) & (indices < size)
    return indices % size, inside | wraps
