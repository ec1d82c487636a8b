# SPDX-License-Identifier: MIT
"""Compiled visits of pixels, by the exact scan or under the guide of a coarser fill.

Imported only when something is filled, because numba takes a while to load. Any number of threads may share
the exact visits; their picks are those of `texture.engine.passes.fill_pixels`, to the bit. Under a guide a
pixel tries not every place of the sample but those that continue its neighbours (Ashikhmin 2001,
"Synthesizing natural textures", section 3) and those that the coarser fill names for it and its neighbours;
they are compared over the whole window.
"""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple, TypeAlias

import numpy as np
from numba import int64, uint64
from numpy.typing import NDArray

from texture.engine.compiled import LANES, TERMS_PER_STEP, compiled, inlined, read_number, take_number
from texture.engine.scan_kernels import (
    MISSING,
    N_BUCKETS,
    Findings,
    SampleArrays,
    Terms,
    find_candidates,
    lay_out,
)
from texture.sampling.canvas import Canvas
from texture.sampling.sample import BoolArray, IntArray, Sample

FillPixels: TypeAlias = Callable[[IntArray, float, NDArray[np.uint64]], None]
TURNS_PER_THREAD = 8  # a pass of fewer turns is not worth a thread


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
    terms, findings = make_terms(canvas), make_findings(sample)
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
                visit_pixel(sample, canvas, visits[turn], words[turn], threshold, terms, findings, guesses)
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
    findings: Findings,
    guesses: IntArray,
) -> None:
    """Fill a pixel by a random candidate, if its error is below the threshold."""
    row, column = pixel // canvas.unfilled.shape[1], pixel % canvas.unfilled.shape[1]
    n_known = _read_template(canvas, row, column, terms)
    n_guesses = list_continuations(sample, canvas, row, column, guesses)
    n_found, largest = find_candidates(sample, terms, n_known, guesses[:n_guesses], findings)
    chosen = pick_one(word, n_found)
    error = findings.distances[chosen] / largest
    if error < threshold:
        write_pixel(sample, canvas, row, column, findings.centres[chosen], error)


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


def view(canvas: Canvas) -> CanvasArrays:
    """Return a canvas's arrays, to be written by compiled loops."""
    return CanvasArrays(*(getattr(canvas, name) for name in CanvasArrays._fields))


def prepare_engine(canvas: Canvas, sample: Sample, pool: ThreadPoolExecutor, n_threads: int) -> FillPixels:
    """Return what fills the visited pixels of a canvas below a threshold: the compiled `fill_pixels`.

    The sample is not empty. The pool has at least n_threads - 1 threads, since the calling one works too; the
    result is the same for any number.
    """
    source, target = lay_out(sample), view(canvas)
    nobody = np.iinfo(np.int64).max
    turns = np.full(canvas.known.shape, nobody)

    def fill(visits: IntArray, threshold: float, words: NDArray[np.uint64]) -> None:
        rows, columns = np.divmod(visits, canvas.unfilled.shape[1])
        turns[rows, columns] = np.arange(visits.size)
        done, counter = np.zeros(visits.size, dtype=np.int64), np.zeros(1, dtype=np.int64)

        def work() -> None:
            fill_visits(source, target, visits, words, threshold, turns, done, counter)

        n_helpers = min(n_threads, visits.size // TURNS_PER_THREAD) - 1
        helping = [pool.submit(work) for _ in range(n_helpers)]
        work()
        for helper in helping:
            if not helper.cancel():  # one that has not begun has nothing to do any more
                helper.result()
        turns[rows, columns] = nobody

    return fill


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
