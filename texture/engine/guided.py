# SPDX-License-Identifier: MIT
"""Compiled filling under a guide: candidates are continuations alone, compared over the whole window.

Instead of every place of the sample, a pixel tries those that continue its neighbours (Ashikhmin 2001,
"Synthesizing natural textures", section 3) and those that the coarser fill names for it and its neighbours.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from texture.engine.compiled import compiled, inlined
from texture.engine.kernels import CanvasArrays, pick_one, write_pixel
from texture.engine.scan_kernels import MISSING, SampleArrays
from texture.sampling.sample import BoolArray, IntArray

MOST_GUESSES = 18  # nine of the neighbours, nine of the coarser fill
_NO_PIXEL = 255  # the difference where the sample has no pixel


class GuideArrays(NamedTuple):
    """What a coarser fill says of a canvas (h, w) and its sample; the last row and column are outside."""

    sources: (
        IntArray  # (h + 1, w + 1) where in the sample the coarser fill would take each pixel; -1: nowhere
    )
    levels: IntArray  # (h + 1, w + 1, c) of the coarser fill
    known: BoolArray  # (h + 1, w + 1) whether it has any
    sample_levels: NDArray[np.float32]  # as `SampleArrays.levels`, of the coarser image


@compiled
def fill_guided(
    sample: SampleArrays,
    canvas: CanvasArrays,
    guide: GuideArrays,
    positions: IntArray,
    visits: IntArray,
    words: NDArray[np.uint64],
) -> None:
    """Fill the visited pixels in turn, each by its nearest candidate; ties at random.

    The window's known pixels are compared as they are; for those not yet known the coarser fill stands, and
    the coarser image on the sample's side.

    Parameters
    ----------
    positions : array, shape (n,)
        Usable pixels of the sample: one of them where nothing continues.
    visits, words : arrays, shape (n,)
        Pixels, row * width + column, and their random words.
    """
    window, n_channels = canvas.row_reach.shape[1], canvas.levels.shape[2]
    offsets = np.empty(window * window, np.int64)
    weights = np.empty(window * window, np.int64)
    is_coarse = np.empty(window * window, np.bool_)
    colours = np.empty((window * window, n_channels), np.int64)
    guesses = np.empty(MOST_GUESSES, np.int64)
    distances = np.empty(MOST_GUESSES, np.int64)
    for turn in range(len(visits)):
        row, column = visits[turn] // canvas.unfilled.shape[1], visits[turn] % canvas.unfilled.shape[1]
        n_terms, weight = _read_window(
            sample, canvas, guide, row, column, offsets, weights, is_coarse, colours
        )
        n_guesses = _list_guesses(sample, canvas, guide, row, column, guesses)
        if n_guesses == 0:
            place = positions[pick_one(words[turn], len(positions))]
            guesses[0] = (place // sample.width + sample.margin) * sample.row
            guesses[0] += place % sample.width + sample.margin
            n_guesses = 1
        nearest = np.int64(2**62)
        for guess in range(n_guesses):
            total = np.int64(0)
            for term in range(n_terms):
                at = guesses[guess] + offsets[term]
                for channel in range(n_channels):
                    if is_coarse[term]:
                        level = guide.sample_levels[channel * sample.plane + at]
                    else:
                        level = sample.levels[channel * sample.plane + at]
                    difference = _NO_PIXEL if level == MISSING else int(level) - colours[term, channel]
                    total += weights[term] * difference * difference
                if total > nearest:
                    break
            distances[guess] = total
            nearest = min(nearest, total)
        n_near = 0
        for guess in range(n_guesses):
            if distances[guess] <= nearest:
                guesses[n_near], distances[n_near] = guesses[guess], distances[guess]
                n_near += 1
        chosen = pick_one(words[turn], n_near)
        error = distances[chosen] / max(weight * n_channels * 255 * 255, 1)
        write_pixel(sample, canvas, row, column, guesses[chosen], error)


@inlined
def _read_window(
    sample: SampleArrays,
    canvas: CanvasArrays,
    guide: GuideArrays,
    row: int,
    column: int,
    offsets: IntArray,
    weights: IntArray,
    is_coarse: BoolArray,
    colours: IntArray,
) -> tuple[int, int]:
    """Write what is known of the window, or coarsely known; return how many pixels, and their weight."""
    window = canvas.row_reach.shape[1]
    n_terms, total = 0, 0
    for i in range(window):
        there_row = canvas.row_reach[row, i]
        for j in range(window):
            there_column = canvas.column_reach[column, j]
            is_known = canvas.known[there_row, there_column]
            if not is_known and not guide.known[there_row, there_column]:
                continue
            offsets[n_terms] = (i - window // 2) * sample.row + j - window // 2
            weights[n_terms] = sample.weights[i, j]
            is_coarse[n_terms] = not is_known
            for channel in range(colours.shape[1]):
                if is_known:
                    colours[n_terms, channel] = canvas.levels[there_row, there_column, channel]
                else:
                    colours[n_terms, channel] = guide.levels[there_row, there_column, channel]
            total += weights[n_terms]
            n_terms += 1
    return n_terms, total


@inlined
def _list_guesses(
    sample: SampleArrays,
    canvas: CanvasArrays,
    guide: GuideArrays,
    row: int,
    column: int,
    guesses: IntArray,
) -> int:
    """Write the different centres that continue the neighbours' sources and those of the coarser fill."""
    radius = canvas.row_reach.shape[1] // 2
    n_guesses = 0
    for i in range(-1, 2):
        for j in range(-1, 2):
            there_row, there_column = (
                canvas.row_reach[row, radius + i],
                canvas.column_reach[column, radius + j],
            )
            for source in (canvas.sources[there_row, there_column], guide.sources[there_row, there_column]):
                if source < 0:
                    continue
                source_row, source_column = source // sample.width - i, source % sample.width - j
                centre = (source_row + sample.margin) * sample.row + source_column + sample.margin
                is_new = sample.costs[centre] == 0
                for guess in range(n_guesses):
                    is_new = is_new and guesses[guess] != centre
                if is_new:
                    guesses[n_guesses] = centre
                    n_guesses += 1
    return n_guesses
