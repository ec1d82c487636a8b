# SPDX-License-Identifier: MIT
"""The Gaussian that weighs the pixels of a window, in whole numbers."""

import numpy as np
from numpy.typing import NDArray

WEIGHT_LEVELS = 2**14 - 1  # 14 bits: distances are exact int64 sums, the same on any machine
SIGMA_PER_WINDOW = 1 / 6.4  # Efros's own page: sigma = window / 6.4


def gaussian_weights(window: int) -> NDArray[np.int64]:
    """Return the weights of a window's pixels.

    Parameters
    ----------
    window : int
        Odd side of the window, at most 99 pixels.

    Returns
    -------
    array, shape (window, window), int64
        1..16383, largest in the centre; no pixel of the window counts nothing.

    Examples
    --------
    >>> gaussian_weights(3)
    array([[  173,  1683,   173],
           [ 1683, 16383,  1683],
           [  173,  1683,   173]])
    """
    offsets = np.arange(window) - window // 2
    squared = offsets[:, None] ** 2 + offsets**2
    sigma = window * SIGMA_PER_WINDOW
    weights: NDArray[np.int64] = np.rint(WEIGHT_LEVELS * np.exp(-squared / (2 * sigma**2))).astype(np.int64)
    return weights
