# SPDX-License-Identifier: MIT
"""The seed: a random 3 x 3 piece of the sample, from which a texture grows where nothing is known."""

import numpy as np

from texture.canvas import Canvas
from texture.randomness import Purpose, pick, random_words
from texture.sample import Sample

UNSUPPORTED = 1.0  # the error of a seed: nothing around it vouches for it


def plant_seed(
    canvas: Canvas, sample: Sample, place: tuple[int, int], key: int, pass_number: int = 0
) -> None:
    """Copy a random 3 x 3 piece of the sample to a place of the canvas, as far as it is unfilled there.

    The piece is whole if the sample holds a whole one; otherwise at least its centre can be used.
    """
    height, width = sample.usable.shape
    rows, columns = np.divmod(sample.positions, width)
    shifts = np.indices((3, 3)).reshape(2, 9, 1) - 1
    beside_rows, beside_columns = (
        rows + shifts[0],
        columns + shifts[1],
    )  # (9, n): the piece around each position
    has_counterpart = sample.padded_usable[beside_rows + sample.margin, beside_columns + sample.margin]
    choices = np.flatnonzero(has_counterpart.all(axis=0))
    choices = choices if choices.size else np.arange(sample.positions.size)
    seed = choices[pick(random_words(key, Purpose.SEED_SOURCE, pass_number, 0)[0], choices.size)]
    sources = beside_rows[:, seed] % height * width + beside_columns[:, seed] % width
    reached_rows = canvas.row_reach[place[0], canvas.radius + shifts[0, :, 0]]
    reached_columns = canvas.column_reach[place[1], canvas.radius + shifts[1, :, 0]]
    is_outside = (reached_rows == canvas.unfilled.shape[0]) | (reached_columns == canvas.unfilled.shape[1])
    for piece in np.flatnonzero(has_counterpart[:, seed] & ~is_outside):
        row, column, source = int(reached_rows[piece]), int(reached_columns[piece]), int(sources[piece])
        if canvas.unfilled[row, column]:
            canvas.write(row, column, source, sample.levels[divmod(source, width)], UNSUPPORTED)


def draw_place(canvas: Canvas, key: int, pass_number: int) -> tuple[int, int]:
    """Draw an unfilled pixel."""
    unfilled = np.flatnonzero(canvas.unfilled)
    word = random_words(key, Purpose.SEED_PLACE, pass_number, 0)[0]
    row, column = divmod(int(unfilled[pick(word, unfilled.size)]), canvas.unfilled.shape[1])
    return row, column
