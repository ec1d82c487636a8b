# SPDX-License-Identifier: MIT
"""The front: the unfilled pixels beside filled ones, kept up to date as pixels are filled."""

from typing import Literal, TypeAlias

import numpy as np

from texture.sampling.canvas import Canvas
from texture.sampling.randomness import Purpose, random_words
from texture.sampling.sample import IntArray

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
