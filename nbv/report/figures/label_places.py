# SPDX-License-Identifier: MIT
"""Label places: where texts beside points of a drawing go so that they cover each other least."""

from __future__ import annotations

import numpy as np

from scenes.checks import FloatArray

_AROUND = np.array(
    [[1, 1], [-1, 1], [1, -1], [-1, -1], [1, 0], [-1, 0], [0, 1], [0, -1]], dtype=np.float64
)  # the best known first (Christensen, Marks & Shieber 1995)
_FARTHER = 0.02  # what a place farther down that list costs, where all of a text costs 1
_SWEEPS = 3


def beside(points: FloatArray, sizes: FloatArray, gap: float, taken: FloatArray) -> FloatArray:
    """Return the middles (n, 2) of texts of `sizes` (n, 2) beside `points` (n, 2).

    Each takes the one of eight places around its point, `gap` away from it, where it covers least of the
    rectangles `taken` (k, 2, 2), lower and upper corners, and of the other texts. All in one unit.
    """
    offsets = _AROUND[None] * (sizes[:, None] / 2 + gap * np.sqrt(0.5))
    return _placed(points[:, None] + offsets, sizes, taken)


def around(points: FloatArray, sizes: FloatArray, taken: FloatArray) -> FloatArray:
    """Return the middles (n, 2) of texts on `points` (n, 2), or up to a text's size away; see `beside`."""
    steps = np.vstack([np.zeros(2), 0.5 * _AROUND, _AROUND])
    return _placed(points[:, None] + steps[None] * sizes[:, None], sizes, taken)


def boxes(middles: FloatArray, sizes: FloatArray) -> FloatArray:
    """Return rectangles (n, 2, 2), lower and upper corners, by their middles and sizes (n, 2)."""
    return np.stack([middles - sizes / 2, middles + sizes / 2], axis=1)


def _placed(places: FloatArray, sizes: FloatArray, taken: FloatArray) -> FloatArray:
    """Of the places (n, m, 2) of each text the one that covers least; later sweeps see all other texts."""
    n, fixed = len(places), taken.reshape(-1, 2, 2)
    texts = np.full((n, 2, 2), np.nan)
    for _ in range(_SWEEPS):
        for number in range(n):
            texts[number] = np.nan
            known = np.concatenate([fixed, texts[~np.isnan(texts[:, 0, 0])]])
            mine = boxes(places[number], np.broadcast_to(sizes[number], places[number].shape))
            cost = _covered(mine, known) + _FARTHER * np.arange(len(mine))
            texts[number] = mine[int(np.argmin(cost))]
    return np.asarray(texts.mean(axis=1))


def _covered(mine: FloatArray, known: FloatArray) -> FloatArray:
    """Common area of each rectangle (m, 2, 2) with all known ones, in shares of the smaller of two."""
    low = np.maximum(mine[:, None, 0], known[None, :, 0])
    high = np.minimum(mine[:, None, 1], known[None, :, 1])
    common = np.maximum(high - low, 0.0).prod(axis=2)
    area, other = ((one[:, 1] - one[:, 0]).prod(axis=1) for one in (mine, known))
    return np.asarray((common / np.minimum(area[:, None], other[None])).sum(axis=1))
