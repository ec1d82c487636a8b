# SPDX-License-Identifier: MIT
"""Compiled visits of pixels, shared by any number of threads; each reads a template, scans, and picks.

Imported only when something is filled, because numba takes a while to load. The picks are those of
`texture.engine.passes.fill_pixels`, to the bit.
"""

from typing import NamedTuple

import numpy as np
from numba import int64, uint64
from numpy.typing import NDArray

from texture.engine.compiled import LANES, TERMS_PER_STEP, compiled, inlined, read_number, take_number
from texture.engine.scan_kernels import N_BUCKETS, Findings, SampleArrays, Terms, find_candidates
from texture.sampling.sample import BoolArray, IntArray


class CanvasArrays(NamedTuple):
    """The arrays of a `texture.sampling.canvas.Canvas`, in its shapes."""

    levels: IntArray
    known: BoolArray
    sources: IntArray
    unfilled: BoolArray
    errors: NDArray[np.float32]
    row_reach: IntArray
    column_reach: IntArray


@compiled
def fill_visits(
    sample: SampleArrays,
    canvas: CanvasArrays,
    visits: IntArray,
    words: NDArray[np.uint64],
    threshold: float,
    turns: IntArray,
    done: IntArray,
    counter: IntArray,
) -> None:
    """Fill the visited pixels in turn, as `passes.fill_pixels`; any number of threads may call it.

    A thread takes the next turn, or puts it off while earlier turns within its window are not over: so each
    template is what it would be if the turns came one by one. The earliest turn that is not over is never
    put off.

    Parameters
    ----------
    visits, words : arrays, shape (n,)
        Pixels, row * width + column, and their random words.
    threshold : float
        Errors from here on are not accepted.
    turns : array, shape (h + 1, w + 1)
        Which turn visits each pixel; n where none does.
    done : array, shape (n,)
        Zeros; 1 when a turn is over.
    counter : array, shape (1,)
        Turns taken so far.
    """
    terms, found = make_terms(canvas), make_findings(sample)
    guesses = np.empty(9, np.int64)
    waiting = np.empty(len(visits), np.int64)
    n_waiting, has_more = 0, True
    while has_more or n_waiting > 0:
        if has_more:
            turn = take_number(counter.ctypes.data)
            has_more = turn < len(visits)
            if has_more:
                waiting[n_waiting] = turn
                n_waiting += 1
        n_left = 0
        for place in range(n_waiting):
            turn = waiting[place]
            if _is_ready(canvas, visits[turn], turn, turns, done):
                visit_pixel(sample, canvas, visits[turn], words[turn], threshold, terms, found, guesses)
                take_number(done[turn:].ctypes.data)
            else:
                waiting[n_left] = turn
                n_left += 1
        n_waiting = n_left


@inlined
def visit_pixel(
    sample: SampleArrays,
    canvas: CanvasArrays,
    pixel: int,
    word: np.uint64,
    threshold: float,
    terms: Terms,
    found: Findings,
    guesses: IntArray,
) -> None:
    """Fill a pixel by a random candidate, if its error is below the threshold."""
    row, column = pixel // canvas.unfilled.shape[1], pixel % canvas.unfilled.shape[1]
    n_known = _read_template(canvas, row, column, terms)
    n_guesses = list_continuations(sample, canvas, row, column, guesses)
    n_found, largest = find_candidates(sample, terms, n_known, guesses[:n_guesses], found)
    chosen = pick_one(word, n_found)
    error = found.distances[chosen] / largest
    if error < threshold:
        write_pixel(sample, canvas, row, column, found.centres[chosen], error)


@inlined
def _is_ready(canvas: CanvasArrays, pixel: int, turn: int, turns: IntArray, done: IntArray) -> bool:
    """Say whether all earlier turns within a pixel's window are over."""
    for row in canvas.row_reach[pixel // canvas.unfilled.shape[1]]:
        for column in canvas.column_reach[pixel % canvas.unfilled.shape[1]]:
            earlier = turns[row, column]
            if earlier < turn and read_number(done[earlier:].ctypes.data) == 0:
                return False
    return True


@inlined
def make_terms(canvas: CanvasArrays) -> Terms:
    """Return room for the terms of a template, and a step more."""
    n_pixels, n_channels = canvas.row_reach.shape[1] ** 2, canvas.levels.shape[2]
    n = n_pixels * n_channels + TERMS_PER_STEP
    return Terms(
        np.empty(n, np.int64),
        np.empty(n, np.float32),
        np.empty(n, np.float32),
        np.empty(n, np.int64),
        np.empty(N_BUCKETS + 1, np.int64),
        np.empty(n_pixels, np.int64),
        np.empty((n_pixels, n_channels), np.float32),
    )


@inlined
def make_findings(sample: SampleArrays) -> Findings:
    """Return room for all centres of a sample."""
    n = len(sample.blocks) * LANES
    room = np.empty(2 * LANES, np.float32)
    skip = (-int64(room.ctypes.data) // 4) % LANES  # sums within whole cache lines are read back at once
    sums = room[skip : skip + LANES]
    return Findings(np.empty(n, np.int64), np.empty(n, np.int64), np.empty(n, np.float32), sums)


@inlined
def _read_template(canvas: CanvasArrays, row: int, column: int, terms: Terms) -> int:
    """Write the known pixels of the window and their colours; return how many."""
    window = canvas.row_reach.shape[1]
    n_known = 0
    for i in range(window):
        there_row = canvas.row_reach[row, i]
        for j in range(window):
            there_column = canvas.column_reach[column, j]
            if canvas.known[there_row, there_column]:
                terms.pixels[n_known] = i * window + j
                for channel in range(terms.colours.shape[1]):
                    terms.colours[n_known, channel] = canvas.levels[there_row, there_column, channel]
                n_known += 1
    return n_known


@inlined
def list_continuations(
    sample: SampleArrays, canvas: CanvasArrays, row: int, column: int, guesses: IntArray
) -> int:
    """Write the centres that continue the sources of the eight neighbours; return how many."""
    radius = canvas.row_reach.shape[1] // 2
    n_guesses = 0
    for i in range(-1, 2):
        for j in range(-1, 2):
            source = canvas.sources[
                canvas.row_reach[row, radius + i], canvas.column_reach[column, radius + j]
            ]
            if source >= 0:
                source_row, source_column = source // sample.width - i, source % sample.width - j
                guesses[n_guesses] = (source_row + sample.margin) * sample.row + source_column + sample.margin
                n_guesses += 1
    return n_guesses


@inlined
def pick_one(word: np.uint64, n_choices: int) -> int:
    """Return word * n_choices / 2**64, as `texture.sampling.randomness.pick`."""
    n, half = uint64(n_choices), uint64(32)
    low = uint64(word & uint64(0xFFFFFFFF)) * n >> half
    return int((uint64(word >> half) * n + low) >> half)


@inlined
def write_pixel(
    sample: SampleArrays, canvas: CanvasArrays, row: int, column: int, centre: int, error: float
) -> None:
    """Fill a pixel, as `texture.sampling.canvas.Canvas.write`."""
    source_row, source_column = centre // sample.row - sample.margin, centre % sample.row - sample.margin
    for channel in range(canvas.levels.shape[2]):
        canvas.levels[row, column, channel] = int(sample.levels[channel * sample.plane + centre])
    canvas.sources[row, column] = source_row * sample.width + source_column
    canvas.errors[row, column] = error
    canvas.unfilled[row, column] = False
    canvas.known[row, column] = True
