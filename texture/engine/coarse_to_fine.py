# SPDX-License-Identifier: MIT
"""Coarse to fine: a large hole is filled at half the size first, and that fill guides the finer one.

The exact search costs pixels times samples, and in a hole much larger than its window what grows in from two
sides meets out of step. At half the size a hole has a quarter of the pixels and the window reaches twice as
far (pyramids as in Wei & Levoy 2000, "Fast texture synthesis using tree-structured vector quantization",
section 3); the coarsest level is searched exactly.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from texture.engine.passes import Progress, Tally, Way, synthesise
from texture.sampling.canvas import NOWHERE, Canvas
from texture.sampling.sample import BoolArray, IntArray, Sample

if TYPE_CHECKING:
    from texture.engine.kernels import FillPixels

EXACT_PIXELS = 4_000  # a hole of so many is searched exactly
FEWEST_SAMPLES = 1_000  # a coarser level must leave so many
SMALLEST_WINDOW = 9  # of a coarser level


@dataclass(frozen=True, slots=True, eq=False)
class Guide:
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
    visit = _prepare(canvas, sample, guide)
    return synthesise(canvas, sample, how._replace(order="paper"), progress, visit)


def guide_by_coarse(
    levels: IntArray, known: BoolArray, hole: BoolArray, sample: Sample, how: Way
) -> Guide | None:
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
    return Guide(
        sources=np.where(hole & (sources != NOWHERE), finer, NOWHERE),
        levels=canvas.levels[here],
        known=canvas.known[here],
        usable=sample.usable & coarse_known[here] & ~coarse_hole[here],
    )


def _prepare(canvas: Canvas, sample: Sample, guide: Guide) -> FillPixels:
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
