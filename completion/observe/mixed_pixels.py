# SPDX-License-Identifier: MIT
"""Mixed pixels: ranges between two surfaces, where a wide beam met both and tells of neither.

No surface is where they were measured, and the nearer of the two fills a part of the beam. All of the beam
got as far as that, though: nothing stands before both.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import minimum_filter

from completion.observe.limits import (
    BEFORE_BOTH_M,
    CLEAR_SD,
    FEWEST_JUMPS,
    JUMP_SD,
    MIDDLE,
    STEEP,
    WIDE_SHARE,
)
from completion.observe.rays import Noise, deviation_at
from completion.observe.tolerance import FLATNESS_M
from scenes.card import shown
from scenes.checks import BoolArray, FloatArray
from texture.engine.compiled import compiled, inlined

_WIDEST = 8  # pixels between two surfaces that are looked at
_BACK = 2  # pixels of a surface that tell how it goes on
_LONGER = np.sqrt(2.0)  # than across an edge, the way along a row over one that is aslant
_STEPS = ((0, 1), (1, 0), (1, 1), (1, -1))


@shown
class MixedBeams(NamedTuple):
    """Beams of a scan that were left out, since each met two surfaces."""

    pixels: NDArray[np.int64]  # (n,) flat
    passed: FloatArray  # (n,) metres from the sensor up to which nothing stopped them

    @classmethod
    def of(cls, ranges: FloatArray, mixed: BoolArray) -> MixedBeams:
        """Return the beams of the pixels `mixed` (rows, columns) of an image of ranges, metres.

        They passed what lies before the nearest range of as many pixels around as two surfaces are apart.
        """
        pixels = np.flatnonzero(mixed)
        if not len(pixels):
            return NO_MIXED
        nearest = minimum_filter(ranges, 2 * _WIDEST + 1, mode="nearest")
        return cls(pixels, np.maximum(nearest.ravel()[pixels] - BEFORE_BOTH_M, 0.0))


NO_MIXED = MixedBeams(np.zeros(0, np.int64), np.zeros(0))


def find_mixed(ranges: FloatArray, noise: Noise) -> BoolArray:
    """Find the pixels (rows, columns) whose range lies between two surfaces that one beam met.

    Along rows and columns of `ranges` (rows, columns), metres, wherever one surface ends and another goes on,
    the pixels between are counted whose ranges lie between both. Their median tells how wide the beam is.
    Scans are left alone where less than a third of the jumps have one in the middle half between: sides of
    things that are seen aslant lie between others, too, and limbs of round things do near their own side.
    Else those are mixed that lie between two surfaces no farther apart than a beam is wide.
    """
    counts = _count_between(ranges, noise)
    counts, n_middle = counts[:-1], int(counts[-1])
    if counts.sum() < FEWEST_JUMPS or n_middle < WIDE_SHARE * counts.sum():
        return np.zeros(ranges.shape, dtype=np.bool_)
    width = int(np.searchsorted(np.cumsum(counts), counts.sum() / 2))
    return _find_between(ranges, noise, int(np.ceil(_LONGER * width + 1)) if width else 0)


@compiled
def _count_between(ranges: FloatArray, noise: Noise) -> NDArray[np.int64]:
    """How many jumps have 0, 1, 2 ... pixels between both surfaces, and how many one in the middle half."""
    counts = np.zeros(_WIDEST + 2, np.int64)
    for step in _STEPS[:2]:
        for row in range(ranges.shape[0] - step[0]):
            for column in range(ranges.shape[1] - step[1]):
                for n in range(_first_apart(ranges, noise, (row, column), step), _WIDEST + 1):
                    if _is_jump(ranges, noise, (row, column), step, n):
                        counts[n] += 1
                        here = ranges[row, column]
                        jump = ranges[row + (n + 1) * step[0], column + (n + 1) * step[1]] - here
                        for k in range(1, n + 1):
                            between = ranges[row + k * step[0], column + k * step[1]]
                            if abs((between - here) / jump - 0.5) <= MIDDLE:
                                counts[_WIDEST + 1] += 1
                                break
                        break
    return counts


@inlined
def _first_apart(ranges: FloatArray, noise: Noise, pixel: tuple[int, int], step: tuple[int, int]) -> int:
    """The least n for which the range n + 1 steps on is a jump away, beyond the widest where none is.

    Most pixels have none: they are told by as many differences. Noise does not fall with the range.
    """
    (row, column), here = pixel, ranges[pixel]
    if not here < np.inf:
        return _WIDEST + 1
    least = JUMP_SD * max(deviation_at(noise, here), FLATNESS_M)
    for n in range(_WIDEST + 1):
        i, j = row + (n + 1) * step[0], column + (n + 1) * step[1]
        if i >= ranges.shape[0] or j >= ranges.shape[1]:
            break
        if abs(ranges[i, j] - here) > least:
            return n
    return _WIDEST + 1


@compiled
def _find_between(ranges: FloatArray, noise: Noise, most: int) -> BoolArray:
    """The pixels (rows, columns) of all jumps with at most so many between both surfaces, along any step."""
    mixed = np.zeros(ranges.shape, np.bool_)
    for down, right in _STEPS:
        farthest = most / _LONGER if down * right != 0 else float(most)
        for n in range(1, int(farthest) + 1):
            for row in range(ranges.shape[0]):
                for column in range(ranges.shape[1]):
                    if _is_jump(ranges, noise, (row, column), (down, right), n):
                        for k in range(1, n + 1):
                            mixed[row + k * down, column + k * right] = True
    return mixed


@inlined
def _is_jump(ranges: FloatArray, noise: Noise, pixel: tuple[int, int], step: tuple[int, int], n: int) -> bool:
    """Tell whether a surface ends at a pixel, another goes on n + 1 steps on, and ranges between lie between.

    Both are taken to be plane; two surfaces are apart where ranges change more steeply than beside the jump.
    """
    (rows, columns), (row, column), (down, right) = ranges.shape, pixel, step
    first, last = -_BACK, n + 1 + _BACK
    if row + first * down < 0 or row + last * down >= rows:
        return False
    if not (0 <= column + first * right < columns and 0 <= column + last * right < columns):
        return False
    here, there = ranges[row, column], ranges[row + (n + 1) * down, column + (n + 1) * right]
    if not JUMP_SD * FLATNESS_M < abs(there - here) < np.inf:  # noise is no less than flatness
        return False
    before = ranges[row + first * down, column + first * right]
    after = ranges[row + last * down, column + last * right]
    if not (np.isfinite(before) and np.isfinite(after)):
        return False
    jump, beside = abs(there - here), max(abs(here - before), abs(after - there)) / _BACK
    sigma = max(deviation_at(noise, max(here, there)), FLATNESS_M)
    if not (jump > JUMP_SD * sigma and jump > STEEP * (n + 1) * beside):
        return False
    sign = 1.0 if there > here else -1.0
    for k in range(1, n + 1):
        between, back = ranges[row + k * down, column + k * right], n + 1 - k
        if not sign * (between - _going_on(here, before, k)) > CLEAR_SD * sigma * (1.0 + k / _BACK):
            return False
        if not sign * (_going_on(there, after, back) - between) > CLEAR_SD * sigma * (1.0 + back / _BACK):
            return False
    return True


@inlined
def _going_on(end: float, before: float, k: int) -> float:
    """Range k steps beyond the end of a plane, from that and the one `_BACK` steps before."""
    inverse = 1.0 / end + k * (1.0 / end - 1.0 / before) / _BACK
    return 1.0 / inverse if inverse > 0.0 else np.inf
