# SPDX-License-Identifier: MIT
"""The canvas: the image while it is being filled. The one thing in this package that changes."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from texture.sampling.template import Template

NOWHERE = -1  # the source of a pixel that has none


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

    levels: NDArray[np.int64]
    known: NDArray[np.bool_]
    sources: NDArray[np.int64]
    unfilled: NDArray[np.bool_]
    errors: NDArray[np.float32]
    row_reach: NDArray[np.int64]
    column_reach: NDArray[np.int64]

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
        cls,
        levels: NDArray[np.int64],
        known: NDArray[np.bool_],
        hole: NDArray[np.bool_],
        wrap: tuple[bool, bool],
        window: int,
    ) -> "Canvas":
        """Return a canvas that holds the known pixels, each its own source, and a hole to be filled.

        Parameters
        ----------
        levels : array, shape (h, w, c), int64
            8-bit levels.
        known, hole : arrays, shape (h, w), bool
            Which pixels hold a value, and which are to be filled.
        wrap : (bool, bool)
            Whether rows and columns close on themselves.
        window : int
            Side of the comparison window, pixels.
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
        near = slice(self.radius - 1, self.radius + 2)
        sources = self.sources[rows[near], columns[near]]
        return Template(self.levels[rows, columns], self.known[rows, columns], sources)

    def write(self, row: int, column: int, source: int, levels: NDArray[np.int64], error: float) -> None:
        """Fill a pixel with levels (c,) from a source, and keep its error, 0..1."""
        self.levels[row, column] = levels
        self.known[row, column] = True
        self.sources[row, column] = source
        self.unfilled[row, column] = False
        self.errors[row, column] = error

    def find_unfilled_box(self) -> tuple[slice, slice]:
        """Return the rows and columns between which all unfilled pixels lie; empty when there are none."""
        rows = np.flatnonzero(self.unfilled.any(axis=1))
        if not rows.size:
            return slice(0, 0), slice(0, 0)
        columns = np.flatnonzero(self.unfilled[rows[0] : rows[-1] + 1].any(axis=0))
        return slice(int(rows[0]), int(rows[-1]) + 1), slice(int(columns[0]), int(columns[-1]) + 1)

    def count_known(self, box: tuple[slice, slice], radius: int) -> NDArray[np.int64]:
        """Count the known pixels within `radius` (rows and columns) of each pixel of a box, in its shape.

        A table of sums over rectangles (Crow 1984, "Summed-area tables for texture mapping", section 2).
        """
        rows = self._list_lines(self.row_reach[box[0]], radius)
        columns = self._list_lines(self.column_reach[box[1]], radius)
        known = self.known[rows[:, None], columns]
        sums = np.zeros((known.shape[0] + 1, known.shape[1] + 1), dtype=np.int64)
        np.cumsum(np.cumsum(known, axis=0, dtype=np.int64), axis=1, out=sums[1:, 1:])
        far = 2 * radius + 1
        return np.asarray(sums[far:, far:] - sums[:-far, far:] - sums[far:, :-far] + sums[:-far, :-far])

    def _list_lines(self, reach: NDArray[np.int64], radius: int) -> NDArray[np.int64]:
        """Return the rows, or columns, of a box and those within `radius` of it."""
        if not len(reach):
            return np.zeros(2 * radius, dtype=np.int64)
        near = reach[:, self.radius - radius : self.radius + radius + 1]
        return np.concatenate([near[0, :radius], near[:, radius], near[-1, radius + 1 :]])


def _list_reach(size: int, window: int, wraps: bool) -> NDArray[np.int64]:
    reach = np.arange(size)[:, None] + np.arange(window) - window // 2
    return reach % size if wraps else np.where((reach >= 0) & (reach < size), reach, size)
