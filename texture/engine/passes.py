# SPDX-License-Identifier: MIT
"""The passes over the front of a canvas, until nothing is unfilled."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache, partial
from math import inf
from time import monotonic
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from texture.sampling.arguments import EngineName
from texture.sampling.canvas import Canvas, Front, OrderName, draw_place, plant_seed
from texture.sampling.randomness import Purpose, pick, random_words
from texture.sampling.sample import IntArray, Sample, find_candidates

if TYPE_CHECKING:
    from texture.engine.compiled_front import CompiledFront
    from texture.engine.kernels import FillPixels

Progress: TypeAlias = Callable[[int, int], None]

MAX_ERROR_THRESHOLD = 0.3  # Efros's own page: MaxErrThreshold, pixels in 0..1
RELAXATION = 1.1  # a pass without progress multiplies the threshold by this
PASSES_AT_ONCE = 16  # on one thread, where nobody is told of progress and no time runs out


class Passes(NamedTuple):
    """What passes over a front did.

    Attributes
    ----------
    n_passes : int
        How many they were; none when nothing that is unfilled has a known neighbour.
    threshold : float
        The error from which on the next pass accepts nothing.
    n_relaxed : int
        How often it was raised, because a pass filled nothing.
    """

    n_passes: int
    threshold: float
    n_relaxed: int


RunPasses: TypeAlias = Callable[[int, float, int], Passes]  # of a number, a threshold, up to so many


@cache
def can_compile() -> bool:
    """Say whether numba is installed and its compiler enabled."""
    try:
        from numba import config
    except ImportError:
        return False
    return not config.DISABLE_JIT


def count_threads(n_threads: int | None) -> int:
    """Return how many threads to use; None is one for each processor."""
    return n_threads or os.cpu_count() or 1


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
    front: Front | CompiledFront
    if how.engine == "numba" and can_compile():
        from texture.engine.compiled_front import CompiledFront  # numba takes a while to load

        front = CompiledFront(canvas, how.order)
    else:
        front = Front(canvas, how.order)
    n_to_fill = front.n_unfilled
    if not n_to_fill:
        return Tally()
    deadline = inf if how.time_budget_s is None else monotonic() + how.time_budget_s
    most = PASSES_AT_ONCE if progress is None and how.time_budget_s is None else 1
    threshold, n_relaxed, n_seeds, pass_number = MAX_ERROR_THRESHOLD, 0, 0, 0
    with ThreadPoolExecutor(how.n_threads) as pool:
        run = _prepare(canvas, sample, front, how, pool=pool, fill_visits=fill_visits)
        while front.n_unfilled:
            done = run(pass_number, threshold, most)
            threshold, n_relaxed = done.threshold, n_relaxed + done.n_relaxed
            if not done.n_passes:
                place = draw_place(canvas, how.key, pass_number)
                front.advance(plant_seed(canvas, sample, place, how.key, pass_number))
                n_seeds += 1
            pass_number += max(done.n_passes, 1)
            if progress is not None:
                progress(n_to_fill - front.n_unfilled, n_to_fill)
            if monotonic() >= deadline:
                break
    return Tally(n_relaxed, n_seeds, is_complete=not front.n_unfilled)


def _prepare(
    canvas: Canvas,
    sample: Sample,
    front: Front | CompiledFront,
    how: Way,
    pool: ThreadPoolExecutor,
    fill_visits: FillPixels | None,
) -> RunPasses:
    """Return what runs passes: by the front itself where one thread searches exactly, else one by one."""
    if fill_visits is None and not isinstance(front, Front):
        from texture.engine.kernels import prepare_engine
        from texture.engine.scan_kernels import lay_out

        if how.n_threads == 1:
            source = lay_out(sample)
            return lambda *pass_: Passes(*front.run_passes(source, how.key, RELAXATION, *pass_))
        fill_visits = prepare_engine(canvas, sample, pool, how.n_threads)
    visit = fill_visits or partial(fill_pixels, canvas, sample)

    def run(pass_number: int, threshold: float, _most: int) -> Passes:
        visits = front.list_visits(how.key, pass_number)
        if not visits.size:
            return Passes(0, threshold, 0)
        visit(visits, threshold, random_words(how.key, Purpose.PICK, pass_number, visits))
        if front.advance(visits):
            return Passes(1, threshold, 0)
        return Passes(1, threshold * RELAXATION, 1)

    return run


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
