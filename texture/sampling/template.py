# SPDX-License-Identifier: MIT
"""The template: what is known around a pixel when its turn comes, and the candidates that resemble it."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


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
