# SPDX-License-Identifier: MIT
"""The seed: a random 3 x 3 piece of the sample, from which a texture grows where nothing is known."""

import numpy as np
from numpy.typing import NDArray

from texture.sampling.canvas import Canvas
from texture.sampling.randomness import Purpose, pick, random_words
from texture.sampling.sample import Sample

UNSUPPORTED = 1.0  # the error of a seed: nothing around it vouches for it


def plant_seed(
    canvas: Canvas, sample: Sample, place: tuple[int, int], key: int, pass_number: int = 0
) -> None:
    """Copy a random 3 x 3 piece of the sample to a place of the canvas, as far as it is unfilled there.

    The piece is whole if the sample holds a whole one; otherwise at least its centre can be used.
    """
    height, width = sample.usable.shape
    shifts = np.indices((3, 3)).reshape(2, 9, 1) - 1
    choices = np.flatnonzero(_is_whole(sample).ravel()[sample.positions])
    choices = choices if choices.size else np.arange(sample.positions.size)
    seed = choices[pick(random_words(key, Purpose.SEED_SOURCE, pass_number, 0)[0], choices.size)]
    row, column = divmod(int(sample.positions[seed]), width)
    beside_rows, beside_columns = row + shifts[0, :, 0], column + shifts[1, :, 0]  # (9,): the piece around it
    has_counterpart = sample.padded_usable[beside_rows + sample.margin, beside_columns + sample.margin]
    sources = beside_rows % height * width + beside_columns % width
    reached_rows = canvas.row_reach[place[0], canvas.radius + shifts[0, :, 0]]
    reached_columns = canvas.column_reach[place[1], canvas.radius + shifts[1, :, 0]]
    is_outside = (reached_rows == canvas.unfilled.shape[0]) | (reached_columns == canvas.unfilled.shape[1])
    for piece in np.flatnonzero(has_counterpart & ~is_outside):
        row, column, source = int(reached_rows[piece]), int(reached_columns[piece]), int(sources[piece])
        if canvas.unfilled[row, column]:
            canvas.write(row, column, source, sample.levels[divmod(source, width)], UNSUPPORTED)


def _is_whole(sample: Sample) -> NDArray[np.bool_]:
    """Tell around which pixels (h, w) of the sample a whole 3 x 3 piece may be copied."""
    height, width = sample.usable.shape
    whole = np.ones((height, width), dtype=np.bool_)
    for row, column in np.ndindex(3, 3):
        top, left = sample.margin + row - 1, sample.margin + column - 1
        whole &= sample.padded_usable[top : top + height, left : left + width]
    return whole


def draw_place(canvas: Canvas, key: int, pass_number: int) -> tuple[int, int]:
    """Draw an unfilled pixel."""
    unfilled = np.flatnonzero(canvas.unfilled)
    word = random_words(key, Purpose.SEED_PLACE, pass_number, 0)[0]
    row, column = divmod(int(unfilled[pick(word, unfilled.size)]), canvas.unfilled.shape[1])
    return row, column
