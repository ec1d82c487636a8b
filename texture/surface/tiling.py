# SPDX-License-Identifier: MIT
"""Tiling: a hole too large for memory is filled tile by tile, each from what its neighbours hold by then.

A tile sees the known pixels and the finished tiles around it, as the rim of a hole does, so that nothing
shows where tiles meet. All are sampled from one block, the one of its size that holds most of the sample.
"""

from collections.abc import Callable, Iterator
from time import monotonic
from typing import NamedTuple, TypeAlias

import numpy as np

from texture.engine.passes import Progress
from texture.result import Synthesis
from texture.sampling.sample import BoolArray, IntArray, Pixels

SIDE = 192  # pixels: of a tile
SAMPLE_SIDE = 256  # of the block that is sampled
MOST_PIXELS = 512 * 512  # of an image that is filled in one piece
MARGIN = 49  # the largest window's reach

Block: TypeAlias = tuple[IntArray, IntArray]


class Tile(NamedTuple):
    """A tile with its surroundings.

    Attributes
    ----------
    block : Block
        The image's rows and columns, a margin around the tile included; some twice where an axis closes.
    inner : array, shape (rows, columns), bool
        Which of the block's pixels are the tile's.
    """

    block: Block
    inner: BoolArray


class Piece(NamedTuple):
    """What one tile is filled from: the tile with its surroundings, a gap, and the sampled block beside it.

    Attributes
    ----------
    image : array, shape (h, w, c)
        Pixels, meaningless where not known.
    hole, known, usable : arrays, shape (h, w), bool
        What to fill, what holds a value, and what may be copied: pixels of the sampled block alone.
    number : int
        Of the tile, in the order in which they are filled.
    """

    image: Pixels
    hole: BoolArray
    known: BoolArray
    usable: BoolArray
    number: int


FillPiece: TypeAlias = Callable[[Piece, int | None, float | None, Progress | None], Synthesis]


def fill_tiles(
    whole: Piece,
    fill_piece: FillPiece,
    *,
    wrap: tuple[bool, bool],
    window: int | None,
    progress: Progress | None = None,
    time_budget_s: float | None = None,
) -> Synthesis:
    """Fill a large hole; memory beyond the arrays given and returned does not grow with it.

    Parameters
    ----------
    whole : Piece
        The image, shape (h, w, c), and what of it to fill, is known, and may be copied.
    fill_piece : callable
        Fills a `Piece` with a window and a time budget, in seconds, and tells its progress.
    wrap : (bool, bool)
        Whether rows and columns close on themselves.
    window : int, optional
        Of the comparison; None: the one that the first tile chooses.
    progress, time_budget_s
        As in `texture.fill`.
    """
    hole, known, usable = whole.hole, whole.known, whole.usable
    image, done = whole.image.copy(), known.copy()
    own = np.indices(hole.shape, dtype=np.int32)
    rows, columns = (np.where(known, index, -1).astype(np.int32) for index in own)
    error, confidence = np.zeros(hole.shape, np.float32), known.astype(np.float32)
    sampled = densest_block(usable, SAMPLE_SIDE)
    n_to_fill, deadline = int(np.count_nonzero(hole)), _deadline(time_budget_s)
    totals, n_before = np.zeros(2, np.int64), 0
    window_distances: dict[int, float] = {}
    for number, tile in enumerate(_in_order(hole, done, wrap)):
        left = deadline - monotonic()
        if number and left <= 0:
            break
        piece = _piece(image, hole, done=done, usable=usable, tile=tile, sampled=sampled, number=number)
        tell = None if progress is None else _onward(progress, n_before, n_to_fill)
        made = fill_piece(piece, window, None if np.isinf(left) else max(left, 1e-3), tell)
        window, window_distances = made.window, window_distances or made.window_distances
        totals += [made.n_relaxed, made.n_seeds]

        filled = piece.hole & (made.source_rows >= 0)
        at_row, at_column = np.nonzero(filled)
        at = tile.block[0][at_row], tile.block[1][at_column]
        rows[at] = sampled[0][made.source_rows[filled]]
        columns[at] = sampled[1][made.source_cols[filled] - (filled.shape[1] - len(sampled[1]))]
        image[at], done[at] = made.image[filled], True
        error[at], confidence[at] = made.error[filled], made.confidence[filled]
        n_before += at_row.size
    return Synthesis(
        image=image,
        source_rows=rows,
        source_cols=columns,
        error=error,
        confidence=confidence,
        n_relaxed=int(totals[0]),
        n_seeds=int(totals[1]),
        window=window or 0,
        window_distances=window_distances,
        is_complete=n_before == n_to_fill,
    )


def densest_block(usable: BoolArray, side: int) -> Block:
    """Return rows and columns of the block with most usable pixels; its side is this or the image's.

    Examples
    --------
    >>> mask = np.zeros((5, 9), bool)
    >>> mask[2:, 6:] = True
    >>> densest_block(mask, 3)
    (array([2, 3, 4]), array([6, 7, 8]))
    """
    height, width = (min(side, size) for size in usable.shape)
    total = np.pad(np.cumsum(np.cumsum(usable, axis=0, dtype=np.int32), axis=1), ((1, 0), (1, 0)))
    inside = (
        total[height:, width:] - total[:-height, width:] - total[height:, :-width] + total[:-height, :-width]
    )
    top, left = np.unravel_index(int(inside.argmax()), inside.shape)
    return np.arange(top, top + height), np.arange(left, left + width)


def _in_order(hole: BoolArray, done: BoolArray, wrap: tuple[bool, bool]) -> Iterator[Tile]:
    """Yield the tiles that hold part of the hole, the one around which most is done by then first."""
    waiting: dict[int, Tile] = {}
    for top in range(0, hole.shape[0], SIDE):
        for left in range(0, hole.shape[1], SIDE):
            if hole[top : top + SIDE, left : left + SIDE].any():
                rows, first_row = _reach(top, hole.shape[0], wrap[0])
                columns, first_column = _reach(left, hole.shape[1], wrap[1])
                inner = np.zeros((len(rows), len(columns)), dtype=np.bool_)
                inner[first_row : first_row + SIDE, first_column : first_column + SIDE] = True
                inner[first_row + hole.shape[0] - top :] = False
                inner[:, first_column + hole.shape[1] - left :] = False
                waiting[len(waiting)] = Tile((rows, columns), inner)
    while waiting:
        shares = {key: done[np.ix_(*tile.block)].mean() for key, tile in waiting.items()}
        yield waiting.pop(max(shares, key=lambda key: shares[key]))


def _reach(start: int, size: int, wraps: bool) -> tuple[IntArray, int]:
    """Return the indices of a tile with its margin along an axis, and at which of them the tile starts."""
    reach = np.arange(start - MARGIN, min(start + SIDE, size) + MARGIN)
    if wraps:
        return reach % size, MARGIN
    return reach[(reach >= 0) & (reach < size)], min(start, MARGIN)


def _piece(
    image: Pixels,
    hole: BoolArray,
    done: BoolArray,
    usable: BoolArray,
    tile: Tile,
    sampled: Block,
    number: int,
) -> Piece:
    """Return what a tile is filled from."""
    here, there = np.ix_(*tile.block), np.ix_(*sampled)
    (height, width), (sample_height, sample_width) = tile.inner.shape, (len(sampled[0]), len(sampled[1]))
    shape = (max(height, sample_height), width + MARGIN + sample_width)
    left, right = np.s_[:height, :width], np.s_[:sample_height, -sample_width:]
    pixels = np.zeros((*shape, *image.shape[2:]), image.dtype)
    to_fill, known, may_copy = (np.zeros(shape, dtype=np.bool_) for _ in range(3))
    pixels[left], pixels[right] = image[here], image[there]
    to_fill[left] = hole[here] & ~done[here] & tile.inner
    known[left], known[right] = done[here], usable[there]
    may_copy[right] = usable[there]
    return Piece(pixels, to_fill, known, may_copy, number)


def _onward(progress: Progress, n_before: int, n_to_fill: int) -> Progress:
    """Return a progress of a tile that tells the whole hole's."""
    return lambda done, _total: progress(n_before + done, n_to_fill)


def _deadline(time_budget_s: float | None) -> float:
    return np.inf if time_budget_s is None else monotonic() + time_budget_s
