# SPDX-License-Identifier: MIT
"""The exact engine: the sample laid out for compiled loops, and threads that share the turns of a pass."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from texture.sampling.canvas import Canvas
from texture.sampling.matching import gaussian_weights
from texture.sampling.sample import IntArray, Sample

if TYPE_CHECKING:
    from texture.engine.kernels import CanvasArrays
    from texture.engine.scan_kernels import SampleArrays

FillPixels: TypeAlias = Callable[[IntArray, float, NDArray[np.uint64]], None]


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

TURNS_PER_THREAD = 8  # a pass of fewer turns is not worth a thread


@cache
def can_compile() -> bool:
    """Say whether numba is installed and its compiler enabled."""
    try:
        from numba import config
    except ImportError:
        return False
    return not config.DISABLE_JIT


def prepare_engine(canvas: Canvas, sample: Sample, pool: ThreadPoolExecutor, n_threads: int) -> FillPixels:
    """Return what fills the visited pixels of a canvas below a threshold: the compiled `fill_pixels`.

    The sample is not empty. The pool has at least n_threads - 1 threads, since the calling one works too; the
    result is the same for any number.
    """
    from texture.engine.kernels import fill_visits

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


def count_threads(n_threads: int | None) -> int:
    """Return how many threads to use; None is one for each processor."""
    return n_threads or os.cpu_count() or 1


def lay_out(sample: Sample) -> SampleArrays:
    """Return a sample's levels as planes, and the blocks of centres that may be copied."""
    from texture.engine.compiled import LANES
    from texture.engine.scan_kernels import MISSING, SampleArrays

    height, width = sample.padded_usable.shape
    inner = np.s_[sample.margin : height - sample.margin, sample.margin : width - sample.margin]
    is_centre = np.zeros(sample.padded_usable.shape, dtype=np.bool_)
    is_centre[inner] = sample.usable
    places, n_channels = is_centre.size, sample.levels.shape[2]
    levels = np.full(
        n_channels * places + LANES, MISSING, dtype=np.float32
    )  # beyond the planes there is none
    planes = levels[: n_channels * places].reshape(n_channels, height, width)
    np.copyto(
        planes, np.moveaxis(sample.padded_levels, 2, 0), casting="same_kind", where=sample.padded_usable
    )
    costs = np.full(places + LANES, MISSING**2, dtype=np.float32)
    costs[:places][is_centre.ravel()], costs[places:] = 0, MISSING
    chosen = [sample.levels[..., channel][sample.usable] for channel in range(n_channels)]
    return SampleArrays(
        levels=levels,
        costs=costs,
        blocks=_list_blocks(np.flatnonzero(is_centre), LANES),
        weights=gaussian_weights(2 * sample.radius + 1),
        means=np.array([values.mean() for values in chosen]),
        variances=np.array([values.var() for values in chosen]),
        plane=height * width,
        row=width,
        margin=sample.margin,
        width=sample.usable.shape[1],
    )


def _list_blocks(centres: IntArray, size: int) -> IntArray:
    """Return where to begin the fewest runs of `size` places, none overlapping, that hold all centres."""
    starts, ordinal = [], 0
    while ordinal < centres.size:
        starts.append(centres[ordinal])
        ordinal = int(np.searchsorted(centres, centres[ordinal] + size))
    return np.array(starts, dtype=np.int64)


def view(canvas: Canvas) -> CanvasArrays:
    """Return a canvas's arrays, to be written by compiled loops."""
    from texture.engine.kernels import CanvasArrays

    return CanvasArrays(*(getattr(canvas, name) for name in CanvasArrays._fields))
