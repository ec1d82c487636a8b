# SPDX-License-Identifier: MIT
"""The matching rule: which places of the sample are candidates for a pixel; oracle of every faster engine.

All distances are whole numbers, so "the same candidates" means equal, not close.
"""

from typing import NamedTuple

import numpy as np

from texture.sampling.sample import HIGHEST_LEVEL, BoolArray, IntArray, Sample

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
    """

    levels: IntArray
    known: BoolArray

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

    positions: IntArray
    distances: IntArray
    largest_distance: int


def gaussian_weights(window: int) -> IntArray:
    """Return the weights (window, window) of a window's pixels, its side odd and at most 99.

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
    weights: IntArray = np.rint(WEIGHT_LEVELS * np.exp(-squared / (2 * sigma**2))).astype(np.int64)
    return weights


def find_candidates(template: Template, sample: Sample) -> Candidates:
    """Find the candidates, at least one, for a template (Efros & Leung 1999, section 2.1).

    A position competes when every known pixel of the template has a counterpart among the sample's pixels
    ("template-adaptive": nothing is asked of the unknown ones). If none competes - the sample is smaller than
    the window, or in pieces - the template is narrowed by one ring at a time, down to 3 x 3. If even then
    none does, all sample pixels compete on the 3 x 3 template, and a missing counterpart counts as a
    difference of 255 in each channel.

    Of the template at least one pixel among the eight around its centre is known; the sample has the same
    radius and is not empty.
    """
    for window in range(template.known.shape[0], 1, -2):
        narrowed = template.narrow(window)
        candidates = scan_exhaustively(narrowed, sample)
        if candidates.positions.size:
            return candidates
    distances, missing_weights = measure_distances(narrowed, sample)
    largest_difference = sample.levels.shape[2] * HIGHEST_LEVEL**2
    return _select(distances + missing_weights * largest_difference, narrowed, sample, sample.positions)


def scan_exhaustively(template: Template, sample: Sample) -> Candidates:
    """Return the competing positions with distance <= 1.1 * smallest; none if none competes."""
    distances, missing_weights = measure_distances(template, sample)
    competes = missing_weights == 0
    return _select(distances[competes], template, sample, sample.positions[competes])


def measure_distances(template: Template, sample: Sample) -> tuple[IntArray, IntArray]:
    """Measure how much the surroundings of each sample pixel differ from a template.

    Returns
    -------
    distances : array, shape (n,), int64
        For each of `sample.positions`: the sum, over the known pixels that have a counterpart in the sample,
        of Gaussian weight times squared difference over the channels.
    missing_weights : array, shape (n,), int64
        The sum of the weights of the known pixels that have none.
    """
    height, width = sample.usable.shape
    weights = gaussian_weights(template.known.shape[0])
    distances = np.zeros((height, width), dtype=np.int64)
    missing_weights = np.zeros((height, width), dtype=np.int64)
    for row, column in np.argwhere(template.known):
        top, left = row + sample.margin - sample.radius, column + sample.margin - sample.radius
        shifted = np.s_[top : top + height, left : left + width]
        squared = ((sample.padded_levels[shifted] - template.levels[row, column]) ** 2).sum(axis=2)
        has_counterpart = sample.padded_usable[shifted]
        distances += weights[row, column] * np.where(has_counterpart, squared, 0)
        missing_weights += weights[row, column] * ~has_counterpart
    return distances[sample.usable], missing_weights[sample.usable]


def _select(distances: IntArray, template: Template, sample: Sample, positions: IntArray) -> Candidates:
    """Keep what is at most 1.1 times as far as the nearest: 10 d <= 11 d_min, in whole numbers."""
    weights = gaussian_weights(template.known.shape[0])
    largest = int(weights[template.known].sum()) * sample.levels.shape[2] * HIGHEST_LEVEL**2
    is_near = 10 * distances <= 11 * distances.min(initial=largest)
    return Candidates(positions[is_near], distances[is_near], largest)
