# SPDX-License-Identifier: MIT
"""The null: what walls with the same ripple and no relief show, and how probable a region is on them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import fft, ndimage

from completion.flattening.canvas import MARGIN
from completion.flattening.separation import Separation, separate
from scenes.checks import BoolArray, FloatArray

_WALLS = (4, 8)  # without relief, least and most
_SIDE, _CELLS = 160, 50_000  # the longest side of one; cells of all
_TAIL = 5  # regions of each that make the tail
_LEAST_SCALE = 1.0  # nats: half a chi-square of one freedom falls no faster
_CLEAR = 10.0  # nats: what is as evident as this is left out of the error from which walls are drawn
_RIM = 3  # cells around it too
_EXACT = 1e-3  # of the sd: a smaller middle error is none
_FARTHEST = 5.0  # sd: what is farther is no noise


@dataclass(frozen=True, slots=True)
class Null:
    """Regions on walls without relief.

    Beyond `start` nats of evidence there are `rate` of them a cell, fewer by e for each further `scale` nats,
    as the `n` that were found there tell; inf where that is known.
    """

    start: float
    rate: float
    scale: float
    n: float

    def p(self, evidence: float, n_cells: int) -> float:
        """How probably a wall of that many cells without relief shows a region of that evidence, or more.

        The scale of an exponential tail that n of its members tell is known to 1 / sqrt(n) of itself: what
        is to be expected beyond is the mean over all that it may be, (1 + x / n)^-n in place of exp(-x).
        """
        beyond = (evidence - self.start) / self.scale
        with np.errstate(over="ignore"):
            share = np.exp(-beyond if beyond < 0 or np.isinf(self.n) else -self.n * np.log1p(beyond / self.n))
        return float(-np.expm1(-n_cells * self.rate * share))


NOTHING = Null(np.inf, np.inf, 1.0, np.inf)
"""Of walls on which nothing could stay: no evidence says anything."""


def learn_null(parts: Separation, rng: np.random.Generator) -> Null:
    """Make walls without relief with the ripple of a wall, and find regions on them.

    Their white noise is drawn from the whitened error itself, with its tails, and takes the ripple's
    spectrum. All that was learned from the wall is learned from each of them anew. Evidence
    far beyond theirs is judged by the exponential tail of the largest.
    """
    white = _white_noise(parts)
    shape = tuple(min(_SIDE, n) for n in _extent(parts.known))
    wide = tuple(fft.next_fast_len(n + MARGIN, real=True) for n in shape)
    n_walls = int(np.clip(_CELLS // (shape[0] * shape[1]), *_WALLS))
    gain = np.sqrt(parts.ripple.spectrum.on(wide, fall=0))
    evidence = list[float]()
    for _ in range(n_walls):
        noise = rng.choice(white, wide) * rng.choice([-1.0, 1.0], wide)
        heights = fft.irfft2(fft.rfft2(noise) * gain, s=wide)[: shape[0], : shape[1]]
        found = separate(heights - heights.mean(), np.ones(shape, np.bool_)).candidates
        evidence += [one.evidence for one in found]
    n_cells = n_walls * shape[0] * shape[1]
    largest = np.sort(evidence)[::-1][: _TAIL * n_walls + 1]
    if len(largest) < 3:
        return Null(0.0, 1 / n_cells, _LEAST_SCALE, np.inf)
    start = float(largest[-1])
    n = len(largest) - 1
    return Null(start, n / n_cells, max(float(np.mean(largest[:-1] - start)), _LEAST_SCALE), n)


def _white_noise(parts: Separation) -> FloatArray:
    """Whitened errors (n,) of unit sd, where there is no evident relief."""
    evident = tuple(one for one in parts.candidates if one.stands_out and one.evidence > _CLEAR)
    used = parts.known.copy()
    for one in evident:
        used &= ~parts.cells(one)
    used = ndimage.binary_erosion(used, np.ones((3, 3)), iterations=_RIM, border_value=1) if evident else used
    if used.sum() < 0.1 * parts.known.sum():
        used = parts.known
    error = parts.ripple.continued(parts.heights - parts.levels(evident), parts.known)
    white = parts.ripple.whitened(error)[used]
    white = white - np.median(white)
    sd = 1.4826 * float(np.median(np.abs(white)))
    if sd <= _EXACT * float(white.std()):  # most cells are exactly flat
        sd = max(float(white.std()), 1e-30)
    unit: FloatArray = np.clip(white / sd, -_FARTHEST, _FARTHEST)
    return unit


def _extent(known: BoolArray) -> tuple[int, int]:
    """Rows and columns between the first known ones and the last."""
    rows, columns = np.nonzero(known.any(axis=1))[0], np.nonzero(known.any(axis=0))[0]
    return int(np.ptp(rows)) + 1, int(np.ptp(columns)) + 1
