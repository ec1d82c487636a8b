# SPDX-License-Identifier: MIT
"""The passes over the front of a canvas, until nothing is unfilled; large holes coarse to fine.

The exact search costs pixels times samples, and in a hole much larger than its window what grows in from two
sides meets out of step. At half the size a hole has a quarter of the pixels and the window reaches twice as
far (pyramids as in Wei & Levoy 2000, "Fast texture synthesis using tree-structured vector quantization",
section 3); the coarsest level is searched exactly, and each level guides the next finer one.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache, partial
from math import inf
from time import monotonic
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from texture.sampling.arguments import EngineName
from texture.sampling.canvas import NOWHERE, Canvas, Front, OrderName, draw_place, plant_seed
from texture.sampling.limits import (
    EXACT_PIXELS,
    FEWEST_SAMPLES,
    MAX_ERROR_THRESHOLD,
    RELAXATION,
    SMALLEST_WINDOW,
)
from texture.sampling.randomness import Purpose, pick, random_words
from texture.sampling.sample import BoolArray, IntArray, Sample, find_candidates

if TYPE_CHECKING:
    from texture.engine.compiled_front import CompiledFront
    from texture.engine.kernels import FillPixels

Progress: TypeAlias = Callable[[int, int], None]

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


if TYPE_CHECKING:
    from texture.engine.kernels import FillPixels


@dataclass(frozen=True, slots=True, eq=False)
class CoarseGuide:
    """A coarser fill, seen from the next finer level (h, w).

    Attributes
    ----------
    sources : array, shape (h, w), int64
        Where in the sample the coarser fill would take each pixel of the hole, row * w + column; else -1.
    levels : array, shape (h, w, c), int64
        The coarser image, filled.
    known : array, shape (h, w), bool
        Where it has a value.
    usable : array, shape (h, w), bool
        Where it is of the sample alone.
    """

    sources: IntArray
    levels: IntArray
    known: BoolArray
    usable: BoolArray


def fill_coarse_to_fine(canvas: Canvas, sample: Sample, how: Way, progress: Progress | None = None) -> Tally:
    """Fill a canvas: by the exact search where the hole is small, else under the guide of a coarser fill."""
    height, width = canvas.unfilled.shape
    known, levels = canvas.known[:height, :width], canvas.levels[:height, :width]
    guide = guide_by_coarse(levels, known, canvas.unfilled, sample, how)
    if guide is None:
        return synthesise(canvas, sample, how, progress)
    visit = _fill_under(canvas, sample, guide)
    return synthesise(canvas, sample, how._replace(order="paper"), progress, visit)


def guide_by_coarse(
    levels: IntArray, known: BoolArray, hole: BoolArray, sample: Sample, how: Way
) -> CoarseGuide | None:
    """Fill a hole at half the size, and there at half the size again, until it is small.

    Parameters
    ----------
    levels : array, shape (h, w, c), int64
        8-bit levels.
    known, hole : arrays, shape (h, w), bool
        Which pixels hold a value, and which are to be filled.
    sample : Sample
        Of the same image.
    how : Way
        As the finer level is to be filled.

    Returns
    -------
    Guide or None
        None where the hole is small, or half the size would leave too few samples: it is searched exactly.
    """
    if np.count_nonzero(hole) <= EXACT_PIXELS:
        return None
    usable = _all_of_four(sample.usable)
    if np.count_nonzero(usable) < FEWEST_SAMPLES:
        return None
    coarse_known, coarse_hole = _all_of_four(known), np.asarray(_four(hole).any(axis=2))
    coarse = np.rint(_four(levels).mean(axis=2)).astype(np.int64)
    closes = (sample.wrap[0] and hole.shape[0] % 2 == 0, sample.wrap[1] and hole.shape[1] % 2 == 0)
    radius = max(SMALLEST_WINDOW // 2, (sample.radius + 1) // 2)
    smaller = Sample(coarse, usable, closes, radius)
    canvas = Canvas.around_hole(coarse, coarse_known, coarse_hole, closes, 2 * radius + 1)
    fill_coarse_to_fine(canvas, smaller, how)
    here = np.ix_(*(np.arange(size) // 2 for size in hole.shape))
    sources = canvas.sources[here]
    rows, columns = np.divmod(sources, coarse.shape[1])
    finer_rows = 2 * rows + np.arange(hole.shape[0])[:, None] % 2
    finer = finer_rows * hole.shape[1] + 2 * columns + np.arange(hole.shape[1]) % 2
    return CoarseGuide(
        sources=np.where(hole & (sources != NOWHERE), finer, NOWHERE),
        levels=canvas.levels[here],
        known=canvas.known[here],
        usable=sample.usable & coarse_known[here] & ~coarse_hole[here],
    )


def _fill_under(canvas: Canvas, sample: Sample, guide: CoarseGuide) -> FillPixels:
    """Return what fills the visited pixels of a canvas under a guide; the threshold does not matter."""
    from texture.engine.kernels import GuideArrays, fill_guided, view
    from texture.engine.scan_kernels import lay_out

    coarser = Sample(guide.levels, guide.usable, sample.wrap, sample.radius)
    arrays = GuideArrays(
        sources=_with_outside(guide.sources, NOWHERE),
        levels=_with_outside(guide.levels, 0),
        known=_with_outside(guide.known, False),
        sample_levels=lay_out(coarser).levels,
    )
    source, target = lay_out(sample), view(canvas)

    def fill(visits: IntArray, _threshold: float, words: NDArray[np.uint64]) -> None:
        fill_guided(source, target, arrays, sample.positions, visits, words)

    return fill


def _four(values: NDArray[Any]) -> NDArray[Any]:
    """Return the values (h, w, ...) of two by two pixels, (h / 2, w / 2, 4, ...); an odd edge is repeated."""
    odd = [(0, size % 2) for size in values.shape[:2]]
    even = np.pad(values, odd + [(0, 0)] * (values.ndim - 2), mode="edge")
    return np.stack([even[row::2, column::2] for row in range(2) for column in range(2)], axis=2)


def _all_of_four(mask: BoolArray) -> BoolArray:
    """Tell which two by two pixels are all in a mask (h, w); those over an odd edge are not."""
    held = np.asarray(_four(mask).all(axis=2))
    held[mask.shape[0] // 2 :], held[:, mask.shape[1] // 2 :] = False, False
    return held


def _with_outside(values: NDArray[Any], outside: int) -> NDArray[Any]:
    """Return values (h, w, ...) with a row and a column more, which stand for everything outside."""
    more = np.full((values.shape[0] + 1, values.shape[1] + 1, *values.shape[2:]), outside, dtype=values.dtype)
    more[:-1, :-1] = values
    return more
