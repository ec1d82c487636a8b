# SPDX-License-Identifier: MIT
"""The matching rule: which places of the sample are candidates for a pixel; oracle of every faster engine.

All distances are whole numbers, so "the same candidates" means equal, not close.
"""

import numpy as np
from numpy.typing import NDArray

from texture.sampling.levels import HIGHEST_LEVEL
from texture.sampling.sample import Sample
from texture.sampling.template import Candidates, Template, gaussian_weights


def find_candidates(template: Template, sample: Sample) -> Candidates:
    """Find the candidates for a template (Efros & Leung 1999, section 2.1).

    A position competes when every known pixel of the template has a counterpart among the sample's pixels
    ("template-adaptive": nothing is asked of the unknown ones). If none competes - the sample is smaller than
    the window, or in pieces - the template is narrowed by one ring at a time, down to 3 x 3. If even then
    none does, all sample pixels compete on the 3 x 3 template, and a missing counterpart counts as a
    difference of 255 in each channel.

    Parameters
    ----------
    template : Template
        With at least one known pixel among the eight around its centre.
    sample : Sample
        Of the same radius, not empty.

    Returns
    -------
    Candidates
        At least one.
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


def measure_distances(template: Template, sample: Sample) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
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


def _select(
    distances: NDArray[np.int64], template: Template, sample: Sample, positions: NDArray[np.int64]
) -> Candidates:
    """Keep what is at most 1.1 times as far as the nearest: 10 d <= 11 d_min, in whole numbers."""
    weights = gaussian_weights(template.known.shape[0])
    largest = int(weights[template.known].sum()) * sample.levels.shape[2] * HIGHEST_LEVEL**2
    is_near = 10 * distances <= 11 * distances.min(initial=largest)
    return Candidates(positions[is_near], distances[is_near], largest)
