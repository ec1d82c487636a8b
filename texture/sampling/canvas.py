# SPDX-License-Identifier: MIT
"""The canvas: the image while it is filled, and the seeds from which it grows."""

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from texture.sampling.randomness import Purpose, pick, random_words
from texture.sampling.sample import BoolArray, IntArray, PixelTemplate, Sample

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
        indices = np.arange(known.size).reshape(known.shape)
        canvas.sources[:height, :width] = np.where(known, indices, NOWHERE)
        canvas.unfilled[...] = hole
        return canvas

    @property
    def radius(self) -> int:
        """How far a window reaches from its centre, pixels."""
        return int(self.row_reach.shape[1]) // 2

    def read_template(self, row: int, column: int) -> PixelTemplate:
        """Return what is known around a pixel at this moment."""
        rows, columns = self.row_reach[row][:, None], self.column_reach[column]
        return PixelTemplate(self.levels[rows, columns], self.known[rows, columns])

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


OrderName: TypeAlias = Literal["paper", "window"]

SHARE_PER_PASS = 8  # the window order visits the best eighth of the front


class Front:
    """Which pixels can be filled next, and in which order.

    The paper (Efros & Leung 1999, section 2.2 and the pseudocode) visits those with most filled neighbours
    first and leaves open which neighbours count. "paper" counts the eight around the pixel and visits the
    whole front; "window" counts the whole window and visits the best eighth of the front. A pass costs what
    it fills, not what the canvas holds.

    Attributes
    ----------
    n_unfilled : int
        Pixels that are to be filled and are not yet.
    places : array, shape (n,), int64
        The front, in no order: row * (w + 1) + column.
    n_known : array, shape ((h + 1) * (w + 1),), int32
        Known pixels within `reach` of each pixel that is to be filled.
    belongs : array, shape ((h + 1) * (w + 1),), bool
        Whether a pixel is, or was, of the front.
    reach : int
        How far away a known pixel counts, pixels.
    share : int
        A pass visits the best one of so many of the front.
    """

    def __init__(self, canvas: Canvas, order: OrderName) -> None:
        """Find the front of a canvas as it is; from here on `advance` must hear of each pixel filled."""
        self._canvas = canvas
        self.n_known = np.zeros(canvas.known.size, np.int32)
        self.share = SHARE_PER_PASS if order == "window" else 1
        self.reach = canvas.radius if order == "window" else 1
        self.belongs = np.zeros(canvas.known.size, np.bool_)
        self.places = np.zeros(0, np.int64)
        self.n_unfilled = int(np.count_nonzero(canvas.unfilled))
        rows, columns = _find_box(canvas)
        place = np.ravel_multi_index(np.ix_(rows, columns), canvas.known.shape)
        self.n_known[place] = _count_known(canvas, rows, columns, self.reach)
        is_near = _count_known(canvas, rows, columns, 1) > 0
        self._admit(place[canvas.unfilled[rows[:, None], columns] & is_near])

    def list_visits(self, key: int, pass_number: int) -> IntArray:
        """List the pixels that a pass visits, those with most filled neighbours first, ties at random.

        Parameters
        ----------
        key, pass_number : int
            Random ties are a pure function of them and the pixel.

        Returns
        -------
        array, shape (n,), int64
            row * width + column; empty when no unfilled pixel has a filled neighbour.
        """
        rows, columns = np.divmod(self.places, self._canvas.known.shape[1])
        pixels = rows * self._canvas.unfilled.shape[1] + columns
        ties = random_words(key, Purpose.ORDER, pass_number, pixels)
        n_visits = -(-pixels.size // self.share)
        visits: IntArray = pixels[np.lexsort((pixels, ties, -self.n_known[self.places]))][:n_visits]
        return visits

    def advance(self, visits: IntArray) -> int:
        """Take out the visited pixels (n,), row * width + column, that were filled; return how many."""
        unfilled = self._canvas.unfilled
        filled = visits[~unfilled.ravel()[visits]]
        np.add.at(self.n_known, self._around(filled, self.reach), np.int32(1))  # of one type: 30 times faster
        rows, columns = np.divmod(self.places, self._canvas.known.shape[1])
        self.places = self.places[unfilled[rows, columns]]
        near = np.unique(self._around(filled, 1))
        rows, columns = np.divmod(near, self._canvas.known.shape[1])
        inside = (rows < unfilled.shape[0]) & (columns < unfilled.shape[1])
        near, rows, columns = near[inside], rows[inside], columns[inside]
        self._admit(near[unfilled[rows, columns] & ~self.belongs[near]])
        self.n_unfilled -= filled.size
        return int(filled.size)

    def _admit(self, places: IntArray) -> None:
        self.belongs[places] = True
        self.places = np.concatenate([self.places, places])

    def _around(self, pixels: IntArray, reach: int) -> IntArray:
        """Return the places within `reach` of each pixel, in (h + 1, w + 1), with repetitions, flat."""
        canvas = self._canvas
        rows, columns = np.divmod(pixels, canvas.unfilled.shape[1])
        near = slice(canvas.radius - reach, canvas.radius + reach + 1)
        places = canvas.row_reach[rows, near, None] * canvas.known.shape[1]
        return np.ravel(places + canvas.column_reach[columns, None, near])


def _find_box(canvas: Canvas) -> tuple[IntArray, IntArray]:
    """Return the rows and columns between which all unfilled pixels lie; empty when there are none."""
    rows, columns = np.nonzero(canvas.unfilled.any(axis=1))[0], np.nonzero(canvas.unfilled.any(axis=0))[0]
    if not rows.size:
        return rows, columns
    return np.arange(rows[0], rows[-1] + 1), np.arange(columns[0], columns[-1] + 1)


def _count_known(canvas: Canvas, rows: IntArray, columns: IntArray, reach: int) -> IntArray:
    """Count the known pixels within `reach` (rows and columns) of each pixel of a box, in its shape.

    A table of sums over rectangles (Crow 1984, "Summed-area tables for texture mapping", section 2).
    """

    def lines(around: IntArray) -> IntArray:
        """Return the rows, or columns, of the box and those within `reach` of it."""
        if not len(around):
            return np.zeros(2 * reach, dtype=np.int64)
        near = around[:, canvas.radius - reach : canvas.radius + reach + 1]
        return np.concatenate([near[0, :reach], near[:, reach], near[-1, reach + 1 :]])

    known = canvas.known[lines(canvas.row_reach[rows])[:, None], lines(canvas.column_reach[columns])]
    sums = np.zeros((known.shape[0] + 1, known.shape[1] + 1), dtype=np.int64)
    np.cumsum(np.cumsum(known, axis=0, dtype=np.int64), axis=1, out=sums[1:, 1:])
    far = 2 * reach + 1
    return np.asarray(sums[far:, far:] - sums[:-far, far:] - sums[far:, :-far] + sums[:-far, :-far])
