# SPDX-License-Identifier: MIT
"""The template: what is known around a pixel when its turn comes, how it weighs, and what resembles it."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

WEIGHT_LEVELS = 2**14 - 1  # 14 bits: distances are exact int64 sums, the same on any machine
SIGMA_PER_WINDOW = 1 / 6.4  # Efros's own page: sigma = window / 6.4


class Template(NamedTuple):
    """The window around an unfilled pixel.

    One is read per pixel and never kept, so it is a plain record without copies.

    Parameters
    ----------
    levels : array, shape (window, window, c), int64
        8-bit levels; meaningless where unknown.
    known : array, shape (window, window), bool
        Which pixels of the window hold a value.
    neighbour_sources : array, shape (3, 3), int64
        Where in the sample the pixel's neighbours came from, row * width + column; -1 for nowhere. Their
        continuations are good first guesses; the candidates do not depend on them.
    """

    levels: NDArray[np.int64]
    known: NDArray[np.bool_]
    neighbour_sources: NDArray[np.int64]

    def narrow(self, window: int) -> "Template":
        """Return the template with nothing known outside its central `window` x `window` pixels."""
        size = self.known.shape[0]
        rim = (size - window) // 2
        known = np.zeros_like(self.known)
        known[rim : size - rim, rim : size - rim] = self.known[rim : size - rim, rim : size - rim]
        return self._replace(known=known)


class Candidates(NamedTuple):
    """The places of the sample that resemble a template nearly as much as the best one.

    Parameters
    ----------
    positions : array, shape (n,), int64
        row * width + column in the sample, in raster order.
    distances : array, shape (n,), int64
        Weighted sum of squared differences of 8-bit levels, exact.
    largest_distance : int
        What the distance would be if every known pixel of the template differed by 255.
    """

    positions: NDArray[np.int64]
    distances: NDArray[np.int64]
    largest_distance: int


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
