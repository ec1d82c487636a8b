# SPDX-License-Identifier: MIT
"""Canvas: a field of heights continued beyond its border and through its gaps, so that it is periodic."""

from __future__ import annotations

import numpy as np
from scipy import fft, ndimage

from scenes.checks import BoolArray, FloatArray

MARGIN = 48  # cells at least, between one side and the other
_OUTLIER = 4.5  # sd of the differences of neighbours
_ENOUGH = 0.05  # of the cells around one that must be known to fill it
_SPIKE = 6.0  # times their middle size


def extend(field: FloatArray, *, fades: bool) -> FloatArray:
    """A field (rows, columns) with margins that lead from its last row to its first, and so for columns.

    Behind the end lies its mirror image, before the start too; where they meet one fades into the other, or
    there is a jump.
    """
    return _extend_axis(_extend_axis(field, 0, fades), 1, fades)


def _extend_axis(field: FloatArray, axis: int, fades: bool) -> FloatArray:
    """The field with a margin behind its end along an axis."""
    ahead = np.moveaxis(field, axis, 0)
    n = len(ahead)
    away = np.arange(fft.next_fast_len(n + MARGIN, real=True) - n)
    share = ((away + 1) / (len(away) + 1))[:, None]
    share = share**2 * (3 - 2 * share) if fades else np.where(share > 0.5, 1.0, 0.0)
    behind = (1 - share) * ahead[_mirrored(n + away, n)] + share * ahead[_mirrored(away - len(away), n)]
    return np.moveaxis(np.concatenate([ahead, behind]), 0, axis)


def _mirrored(index: FloatArray, n: int) -> FloatArray:
    """Indices beyond 0 .. n - 1 by mirroring."""
    turned = index % (2 * n)
    return np.where(turned < n, turned, 2 * n - 1 - turned)


def fill_gaps(heights: FloatArray, known: BoolArray) -> FloatArray:
    """Heights (rows, columns) with gaps filled smoothly, from the finest scale that reaches them."""
    values, weights = np.where(known, heights, 0.0), known.astype(np.float64)
    enough = min(_ENOUGH, 0.5 * float(weights.mean()))  # at the coarsest scale it is the mean everywhere
    filled, left = values.copy(), ~known
    scale = 1.0
    while left.any():
        total = ndimage.gaussian_filter(values, scale, mode="reflect", truncate=3)
        weight = ndimage.gaussian_filter(weights, scale, mode="reflect", truncate=3)
        reached = left & (weight > enough)
        filled[reached] = total[reached] / weight[reached]
        left &= ~reached
        scale *= 2
    return filled


def without_jumps(heights: FloatArray) -> FloatArray:
    """Heights (rows, columns) without their jumps.

    They are rebuilt from the differences of neighbours, the outliers among these left out. What is rebuilt
    has the differences nearest to these in least squares, by the cosine transform.
    """
    rows, columns = heights.shape
    down, right = np.diff(heights, axis=0), np.diff(heights, axis=1)
    sources = np.zeros(heights.shape)
    for difference, axis in ((down, 0), (right, 1)):
        usual = _OUTLIER * 1.4826 * np.median(np.abs(difference - np.median(difference)))
        kept = np.where(np.abs(difference) <= usual, difference, 0.0)
        wide = np.pad(kept, [(1, 1) if k == axis else (0, 0) for k in range(2)])
        sources += np.diff(wide, axis=axis)
    waves = 2 * (
        np.cos(np.pi * np.arange(rows) / rows)[:, None] + np.cos(np.pi * np.arange(columns) / columns) - 2
    )
    waves[0, 0] = 1.0
    found = fft.dctn(sources, norm="ortho") / waves
    found[0, 0] = heights.mean() * np.sqrt(heights.size)
    out: FloatArray = fft.idctn(found, norm="ortho")
    return out


def find_spikes(heights: FloatArray, known: BoolArray) -> BoolArray:
    """Known cells (rows, columns) far from all their neighbours but one: mixed pixels, no surface."""
    wide = np.pad(np.where(known, heights, np.nan), 1, constant_values=np.nan)
    rows, columns = heights.shape
    away = np.stack(
        [
            np.abs(wide[1 + a : 1 + a + rows, 1 + b : 1 + b + columns] - heights)
            for a in (-1, 0, 1)
            for b in (-1, 0, 1)
            if a or b
        ]
    )
    differ = away[:, known]
    differ = differ[differ > 0]  # exactly flat cells say nothing of the noise
    if not len(differ):
        return np.zeros_like(known)
    near = np.sum(away <= _SPIKE * np.median(differ), axis=0)
    found: BoolArray = known & (near <= 1) & (np.sum(np.isfinite(away), axis=0) >= 3)
    return found
