# SPDX-License-Identifier: MIT
"""The canvas: the image while it is filled, and the seeds from which it grows."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from texture.sampling.matching import Template
from texture.sampling.randomness import Purpose, pick, random_words
from texture.sampling.sample import BoolArray, IntArray, Sample

NOWHERE = -1  # the source of a pixel that has none
UNSUPPORTED = 1.0  # the error of a seed: nothing around it vouches for it


@dataclass(slots=True, eq=False)
class Canvas:
    """What is known so far, where it came from, and what is still to be filled.

    Arrays of (h + 1, w + 1) have a last row and column that stand for everything outside: never known.

    Parameters
    ----------
    levels : array, shape (h + 1, w + 1, c), int64
        8-bit levels; meaningless where unknown.
    known : array, shape (h + 1, w + 1), bool
        Which pixels hold a value.
    sources : array, shape (h + 1, w + 1), int64
        Where in the sample each pixel came from, row * width + column; -1 for nowhere.
    unfilled : array, shape (h, w), bool
        Which pixels are to be filled and are not yet.
    errors : array, shape (h, w), float32
        Normalised error of the chosen candidate, 0..1; 0 where nothing was filled.
    row_reach : array, shape (h, window), int64
        The rows that a window centred on each row covers; h for outside.
    column_reach : array, shape (w, window), int64
        The same of columns.
    """

    levels: IntArray
    known: BoolArray
    sources: IntArray
    unfilled: BoolArray
    errors: NDArray[np.float32]
    row_reach: IntArray
    column_reach: IntArray

    @classmethod
    def empty(cls, shape: tuple[int, int], n_channels: int, wrap: tuple[bool, bool], window: int) -> "Canvas":
        """Return a canvas of `shape` on which everything is to be filled."""
        height, width = shape
        return cls(
            levels=np.zeros((height + 1, width + 1, n_channels), dtype=np.int64),
            known=np.zeros((height + 1, width + 1), dtype=np.bool_),
            sources=np.full((height + 1, width + 1), NOWHERE, dtype=np.int64),
            unfilled=np.ones(shape, dtype=np.bool_),
            errors=np.zeros(shape, dtype=np.float32),
            row_reach=_list_reach(height, window, wrap[0]),
            column_reach=_list_reach(width, window, wrap[1]),
        )

    @classmethod
    def around_hole(
        cls, levels: IntArray, known: BoolArray, hole: BoolArray, wrap: tuple[bool, bool], window: int
    ) -> "Canvas":
        """Return a canvas that holds the known pixels, each its own source, and a hole to be filled.

        Levels (h, w, c) are of 8 bits; known and hole are masks (h, w). `wrap` says whether rows and columns
        close on themselves, `window` is the side of the comparison window in pixels.
        """
        height, width, n_channels = levels.shape
        canvas = cls.empty((height, width), n_channels, wrap, window)
        canvas.levels[:height, :width] = levels
        canvas.known[:height, :width] = known
        own = np.arange(known.size).reshape(known.shape)
        canvas.sources[:height, :width] = np.where(known, own, NOWHERE)
        canvas.unfilled[...] = hole
        return canvas

    @property
    def radius(self) -> int:
        """How far a window reaches from its centre, pixels."""
        return int(self.row_reach.shape[1]) // 2

    def read_template(self, row: int, column: int) -> Template:
        """Return what is known around a pixel at this moment."""
        rows, columns = self.row_reach[row][:, None], self.column_reach[column]
        return Template(self.levels[rows, columns], self.known[rows, columns])

    def write(self, row: int, column: int, source: int, levels: IntArray, error: float) -> None:
        """Fill a pixel with levels (c,) from a source, and keep its error, 0..1."""
        self.levels[row, column] = levels
        self.known[row, column] = True
        self.sources[row, column] = source
        self.unfilled[row, column] = False
        self.errors[row, column] = error


def _list_reach(size: int, window: int, wraps: bool) -> IntArray:
    reach = np.arange(size)[:, None] + np.arange(window) - window // 2
    return reach % size if wraps else np.where((reach >= 0) & (reach < size), reach, size)


def plant_seed(
    canvas: Canvas, sample: Sample, place: tuple[int, int], key: int, pass_number: int = 0
) -> IntArray:
    """Copy a random 3 x 3 piece of the sample to a place of the canvas, as far as it is unfilled there.

    The piece is whole if the sample holds a whole one; otherwise at least its centre can be used. Returns the
    pixels written (n,), row * width + column.
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
    written = []
    for piece in np.flatnonzero(has_counterpart & ~is_outside):
        row, column, source = int(reached_rows[piece]), int(reached_columns[piece]), int(sources[piece])
        if canvas.unfilled[row, column]:
            canvas.write(row, column, source, sample.levels[divmod(source, width)], UNSUPPORTED)
            written.append(row * canvas.unfilled.shape[1] + column)
    return np.array(written, np.int64)


def _is_whole(sample: Sample) -> BoolArray:
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
