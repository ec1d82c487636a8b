# SPDX-License-Identifier: MIT
"""Plain reflectance: a surface of one colour, whose pixels differ by noise alone; there is nothing to match.

Matching noise chooses what resembles it by chance, which grows garbage. A plain surface is filled by its
robust mean and its noise: each pixel is a random one of the sample's usual pixels.
"""

import numpy as np

from texture.sampling.canvas import Canvas
from texture.sampling.randomness import Purpose, random_words
from texture.sampling.sample import BoolArray, FloatArray, IntArray, Sample

LAGS = ((0, 1), (1, 0), (1, 1), (1, -1), (0, 2), (2, 0))
UNUSUAL = 3.0  # standard deviations from the median
IRRELEVANT = 0.05  # a correlation that explains 0.3 % of the variance


def is_plain(levels: IntArray, usable: BoolArray) -> bool:
    """Say whether a sample's pixels differ by noise alone: no correlation between close ones.

    Levels (h, w, c) are of 8 bits; usable (h, w) are the sample's pixels. Those further than 3 robust
    standard deviations from the median count as that far, so that a few specks hide nothing. Correlated means
    by more than 4 standard errors, 4 / sqrt(pairs), and by more than 0.05.

    Examples
    --------
    >>> noise = np.random.default_rng(0).normal(90, 5, (60, 60, 1)).astype(np.int64)
    >>> everywhere = np.ones((60, 60), bool)
    >>> is_plain(noise, everywhere), is_plain(noise.cumsum(axis=1) % 256, everywhere)
    (True, False)
    """
    limits = _list_limits(levels[usable])
    clipped = np.clip(levels, *limits)
    return all(
        _is_uncorrelated(clipped[..., channel].astype(np.float64), usable)
        for channel in range(levels.shape[2])
    )


def fill_plainly(canvas: Canvas, sample: Sample, key: int) -> None:
    """Fill all that is unfilled with random ones of the sample's usual pixels; nothing is compared."""
    width = sample.usable.shape[1]
    chosen = sample.levels[sample.usable]
    low, high = _list_limits(chosen)
    usual = sample.positions[((chosen >= low) & (chosen <= high)).all(axis=1)]
    usual = usual if usual.size else sample.positions
    unfilled = np.flatnonzero(canvas.unfilled)
    words = random_words(key, Purpose.PICK, 0, unfilled)
    picks = (words >> np.uint64(32)) * np.uint64(usual.size) >> np.uint64(32)
    for pixel, source in zip(unfilled.tolist(), usual[picks.astype(np.int64)].tolist(), strict=True):
        row, column = divmod(pixel, canvas.unfilled.shape[1])
        canvas.write(row, column, source, sample.levels[divmod(source, width)], 0.0)


def _list_limits(chosen: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return the lowest and highest usual level of each channel; at least one level apart."""
    middle = np.median(chosen, axis=0)
    spread = np.maximum(1.4826 * np.median(np.abs(chosen - middle), axis=0), 1.0)
    return middle - UNUSUAL * spread, middle + UNUSUAL * spread


def _is_uncorrelated(values: FloatArray, usable: BoolArray) -> bool:
    height, width = values.shape
    centred = values - values[usable].mean()
    variance = (centred[usable] ** 2).mean()
    for down, right in LAGS:
        first = np.s_[: height - down, max(0, -right) : width - max(0, right)]
        second = np.s_[down:, max(0, right) : width + min(0, right)]
        both = usable[first] & usable[second]
        n_pairs = np.count_nonzero(both)
        if n_pairs and variance > 0:
            correlation = (centred[first] * centred[second])[both].mean() / variance
            if abs(correlation) > max(IRRELEVANT, 4 / np.sqrt(n_pairs)):
                return False
    return True
