# SPDX-License-Identifier: MIT
"""The front of a canvas kept by compiled loops; on one thread they fill it, too.

The visits are those of `texture.sampling.canvas.Front`, to the bit.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from texture.engine.compiled import compiled, inlined, sort_order
from texture.engine.kernels import CanvasArrays, make_findings, make_terms, view, visit_pixel
from texture.engine.scan_kernels import SampleArrays
from texture.sampling.canvas import Canvas, Front, OrderName
from texture.sampling.randomness import GOLDEN, Purpose
from texture.sampling.sample import BoolArray, IntArray

_ORDER, _PICK, _N_PURPOSES = int(Purpose.ORDER), int(Purpose.PICK), len(Purpose)


class FrontArrays(NamedTuple):
    """The front of a canvas (h, w): its unfilled pixels beside known ones."""

    n_known: NDArray[np.int32]  # (h + 1, w + 1) known pixels within `reach` of each pixel
    belongs: BoolArray  # (h + 1, w + 1) whether it is, or was, of the front
    pixels: IntArray  # (n,) the front, row * w + column; room for all that is unfilled
    sizes: IntArray  # (2,) pixels of the front, and pixels unfilled
    visits: IntArray  # (n,) room for those that a pass visits, ...
    words: NDArray[np.uint64]  # (n,) ... and for their random words
    reach: int
    share: int  # a pass visits the best one of so many


@compiled
def run_passes(
    sample: SampleArrays,
    canvas: CanvasArrays,
    front: FrontArrays,
    key: np.uint64,
    relaxation: float,
    pass_number: int,
    threshold: float,
    most: int,
) -> tuple[int, float, int]:
    """Run up to `most` passes of the exact search, as `texture.engine.passes.synthesise` on one thread.

    Returns
    -------
    n_passes : int
        Fewer than `most` when all is filled, or when nothing that is unfilled has a known neighbour.
    threshold : float
        Multiplied by the relaxation after each pass that filled nothing.
    n_relaxed : int
        How often that was.
    """
    terms, passes, guesses = make_terms(canvas), make_findings(sample), np.empty(9, np.int64)
    n_passes, n_relaxed = 0, 0
    while n_passes < most and front.sizes[0] > 0:
        n_visits = list_visits(canvas, front, key, pass_number + n_passes)
        for turn in range(n_visits):
            pixel, word = front.visits[turn], front.words[turn]
            visit_pixel(sample, canvas, pixel, word, threshold, terms, passes, guesses)
        if advance(canvas, front, front.visits[:n_visits]) == 0:
            threshold *= relaxation
            n_relaxed += 1
        n_passes += 1
    return n_passes, threshold, n_relaxed


@compiled
def list_visits(canvas: CanvasArrays, front: FrontArrays, key: np.uint64, pass_number: int) -> int:
    """Write the pixels that a pass visits, in turn, and their random words to pick by; return how many."""
    n, width = front.sizes[0], canvas.unfilled.shape[1]
    most = 0
    for place in range(n):
        pixel = front.pixels[place]
        most = max(most, front.n_known[pixel // width, pixel % width])
    starts = np.zeros(most + 2, np.int64)  # of those with most, most - 1, ... known pixels around
    for place in range(n):
        pixel = front.pixels[place]
        starts[most - front.n_known[pixel // width, pixel % width] + 1] += 1
    ranked, at = np.empty(n, np.int64), np.empty(most + 2, np.int64)
    for rank in range(most + 1):
        starts[rank + 1] += starts[rank]
        at[rank] = starts[rank]
    for place in range(n):
        pixel = front.pixels[place]
        rank = most - front.n_known[pixel // width, pixel % width]
        ranked[at[rank]] = pixel
        at[rank] += 1
    n_visits = int(-(-n // front.share))
    room = np.empty(n, np.int64)
    orders, picks = _first_word(key, _ORDER, pass_number), _first_word(key, _PICK, pass_number)
    for rank in range(most + 1):
        first, end = starts[rank], starts[rank + 1]
        if first >= n_visits:
            break
        ties, turns = np.empty(end - first, np.uint64), np.empty(end - first, np.int64)
        for place in range(end - first):
            ties[place] = _word(orders, ranked[first + place])
        sort_order(ties, turns, room)
        for place in range(min(end, n_visits) - first):
            pixel = ranked[first + turns[place]]
            front.visits[first + place], front.words[first + place] = pixel, _word(picks, pixel)
    return n_visits


@compiled
def advance(canvas: CanvasArrays, front: FrontArrays, visits: IntArray) -> int:
    """Take out the visited pixels (n,) that were filled, bring in what they border on; return how many."""
    height, width = canvas.unfilled.shape
    radius, n_filled = canvas.row_reach.shape[1] // 2, 0
    for pixel in visits:
        row, column = pixel // width, pixel % width
        if canvas.unfilled[row, column]:
            continue
        n_filled += 1
        near = slice(radius - front.reach, radius + front.reach + 1)
        for there_row in canvas.row_reach[row, near]:
            for there_column in canvas.column_reach[column, near]:
                front.n_known[there_row, there_column] += 1
    n = 0
    for place in range(front.sizes[0]):
        pixel = front.pixels[place]
        if canvas.unfilled[pixel // width, pixel % width]:
            front.pixels[n] = pixel
            n += 1
    for pixel in visits:
        row, column = pixel // width, pixel % width
        if canvas.unfilled[row, column]:
            continue
        for there_row in canvas.row_reach[row, radius - 1 : radius + 2]:
            for there_column in canvas.column_reach[column, radius - 1 : radius + 2]:
                if there_row == height or there_column == width or front.belongs[there_row, there_column]:
                    continue
                if canvas.unfilled[there_row, there_column]:
                    front.belongs[there_row, there_column] = True
                    front.pixels[n] = there_row * width + there_column
                    n += 1
    front.sizes[0] = n
    front.sizes[1] -= n_filled
    return n_filled


@inlined
def _first_word(key: np.uint64, purpose: int, round_number: int) -> np.uint64:
    """Return what the words of one purpose and round begin with (`texture.sampling.randomness`)."""
    return _mix(key + np.uint64(GOLDEN) * np.uint64(1 + _N_PURPOSES * round_number + purpose))


@inlined
def _word(first: np.uint64, pixel: int) -> np.uint64:
    return _mix(first + np.uint64(GOLDEN) * np.uint64(pixel + 1))


@inlined
def _mix(word: np.uint64) -> np.uint64:
    word = (word ^ (word >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    word = (word ^ (word >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return word ^ (word >> np.uint64(31))


class CompiledFront:
    """As `texture.sampling.canvas.Front`, to the bit; imported only when something is filled."""

    def __init__(self, canvas: Canvas, order: OrderName) -> None:
        """Find the front of a canvas as it is; from here on `advance` must hear of each pixel filled."""
        front, shape = Front(canvas, order), canvas.known.shape
        rows, columns = np.divmod(front.places, shape[1])
        room = np.empty(front.n_unfilled, np.int64)
        room[: front.places.size] = rows * canvas.unfilled.shape[1] + columns
        self._canvas = view(canvas)
        self._front = FrontArrays(
            n_known=front.n_known.reshape(shape),
            belongs=front.belongs.reshape(shape),
            pixels=room,
            sizes=np.array([front.places.size, front.n_unfilled]),
            visits=np.empty(room.size, np.int64),
            words=np.empty(room.size, np.uint64),
            reach=front.reach,
            share=front.share,
        )

    @property
    def n_unfilled(self) -> int:
        """Pixels that are to be filled and are not yet."""
        return int(self._front.sizes[1])

    def list_visits(self, key: int, pass_number: int) -> IntArray:
        """List the pixels (n,) that a pass visits, row * width + column, as `Front.list_visits`."""
        n_visits = list_visits(self._canvas, self._front, np.uint64(key), pass_number)
        return self._front.visits[:n_visits].copy()

    def advance(self, visits: IntArray) -> int:
        """Take out the visited pixels (n,), row * width + column, that were filled; return how many."""
        return int(advance(self._canvas, self._front, visits))

    def run_passes(
        self, sample: SampleArrays, key: int, relaxation: float, pass_number: int, threshold: float, most: int
    ) -> tuple[int, float, int]:
        """Run up to `most` passes of the exact search on this thread: `run_passes`."""
        word = np.uint64(key)
        arrays = (sample, self._canvas, self._front)
        return run_passes(*arrays, word, relaxation, pass_number, threshold, most)
