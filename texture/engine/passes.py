# SPDX-License-Identifier: MIT
"""The passes over the front of a canvas, until nothing is unfilled."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from math import inf
from time import monotonic
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from texture.engine.engine import FillPixels, can_compile, prepare_engine
from texture.sampling.arguments import EngineName
from texture.sampling.canvas import Canvas, draw_place, plant_seed
from texture.sampling.front import Front, OrderName
from texture.sampling.matching import find_candidates
from texture.sampling.randomness import Purpose, pick, random_words
from texture.sampling.sample import IntArray, Sample

Progress: TypeAlias = Callable[[int, int], None]

MAX_ERROR_THRESHOLD = 0.3  # Efros's own page: MaxErrThreshold, pixels in 0..1
RELAXATION = 1.1  # a pass without progress multiplies the threshold by this


class Tally(NamedTuple):
    """What a synthesis counted: relaxations of the threshold, and seeds; and whether it had time enough."""

    n_relaxed: int = 0
    n_seeds: int = 0
    is_complete: bool = True


class Way(NamedTuple):
    """How to synthesise: the same engine, order and key give the same result."""

    engine: EngineName
    order: OrderName
    key: int
    n_threads: int
    time_budget_s: float | None


def synthesise(
    canvas: Canvas,
    sample: Sample,
    how: Way,
    progress: Progress | None = None,
    fill_visits: FillPixels | None = None,
) -> Tally:
    """Fill all that is unfilled on the canvas, pass by pass (Efros & Leung 1999; pseudocode of Efros's page).

    A pass visits the pixels of the front; each in turn reads its template, and takes a random one of its
    candidates if that one's error is below the threshold. A pass that fills nothing raises the threshold.
    Where no unfilled pixel has a known neighbour, a seed is planted. When the time budget is spent, the pass
    that runs is the last. `fill_visits` may stand in for the exact search.
    """
    front = Front(canvas, how.order)
    n_to_fill = front.n_unfilled
    if not n_to_fill:
        return Tally()
    deadline = inf if how.time_budget_s is None else monotonic() + how.time_budget_s
    threshold, n_relaxed, n_seeds, pass_number = MAX_ERROR_THRESHOLD, 0, 0, 0
    with ThreadPoolExecutor(how.n_threads) as pool:
        is_compiled = how.engine == "numba" and can_compile()
        if fill_visits is None and is_compiled:
            fill_visits = prepare_engine(canvas, sample, pool, how.n_threads)
        visit = fill_visits or partial(fill_pixels, canvas, sample)
        while front.n_unfilled:
            visits = front.list_visits(how.key, pass_number)
            if visits.size:
                visit(visits, threshold, random_words(how.key, Purpose.PICK, pass_number, visits))
            else:
                place = draw_place(canvas, how.key, pass_number)
                visits = plant_seed(canvas, sample, place, how.key, pass_number)
                n_seeds += 1
            if not front.advance(visits):
                threshold *= RELAXATION
                n_relaxed += 1
            pass_number += 1
            if progress is not None:
                progress(n_to_fill - front.n_unfilled, n_to_fill)
            if monotonic() >= deadline:
                break
    return Tally(n_relaxed, n_seeds, is_complete=not front.n_unfilled)


def fill_pixels(
    canvas: Canvas, sample: Sample, visits: IntArray, threshold: float, words: NDArray[np.uint64]
) -> None:
    """Fill the visited pixels (n,) in turn, each by a random candidate, if its error is below the threshold.

    A random word (n,) chooses each candidate. The readable reference: the oracle of the compiled engine, and
    what serves where nothing can be compiled.
    """
    width = sample.usable.shape[1]
    for pixel, word in zip(visits.tolist(), words.tolist(), strict=True):
        row, column = divmod(pixel, canvas.unfilled.shape[1])
        candidates = find_candidates(canvas.read_template(row, column), sample)
        chosen = pick(word, candidates.positions.size)
        error = int(candidates.distances[chosen]) / candidates.largest_distance
        if error < threshold:
            source = int(candidates.positions[chosen])
            canvas.write(row, column, source, sample.levels[divmod(source, width)], error)
