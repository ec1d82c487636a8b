# SPDX-License-Identifier: MIT
"""Error of a share: how far the share of a surface that samples tell may be from that of the surface.

Samples are drawn one in each of many pieces of surface, and neighbouring pieces come in pairs (or threes;
`nbv.visibility.samples`). A share p is a ratio of two sums over samples; of its linear part u = z - p within
the surface in question, and 0 elsewhere, the variance is estimated from the differences within pairs
(Cochran, Sampling Techniques, 1977, sections 5A.12 and 6.3):

    sd(p)^2 = sum over pairs of m / (m - 1) * a^2 * sum of (u - mean u)^2 / A^2

with m samples in a pair, a^2 their mean squared area, and A the area in question. The two pieces of a pair
are taken as if one were drawn from both, so that the estimate is too large rather than too small: where the
share changes along a smooth line, the sd comes out a third too large; where it changes from sample to sample,
right. What samples never met they cannot tell: no sd is less than the share that one sample stands for.
"""

from __future__ import annotations

import numpy as np

from nbv.visibility.samples import SurfaceSamples
from scenes.checks import BoolArray


def share_error(samples: SurfaceSamples, where: BoolArray, among: BoolArray | None = None) -> float:
    """Return the standard deviation of the share of area that lies in the samples `where` (n,).

    The share is of the samples `among` (n,), of all when not given; 0 where these have no area.

    Examples
    --------
    >>> one, row = np.ones(4), np.zeros((4, 3))
    >>> samples = SurfaceSamples(row, row, one, np.zeros(4), np.zeros(4))
    >>> share_error(samples, np.array([True, True, False, False]))
    0.25
    >>> round(share_error(samples, np.array([True, False, True, False])), 3)
    0.354
    """
    areas = samples.areas if among is None else np.where(among, samples.areas, 0.0)
    total, counts = float(areas.sum()), areas > 0
    if total == 0:
        return 0.0
    share = float(areas[where].sum()) / total
    off = np.where(counts, where - share, 0.0)
    pair = np.unique(samples.pair, return_inverse=True)[1]
    n = np.maximum(np.bincount(pair), 2)
    squares = np.bincount(pair, areas**2) / np.maximum(np.bincount(pair, counts), 1)
    spread = np.bincount(pair, off**2) - np.bincount(pair, off) ** 2 / n
    variance = float((n / (n - 1) * squares * np.maximum(spread, 0.0)).sum()) / total**2
    one_sample = float((areas**2).sum()) / counts.sum() / total**2
    return float(np.sqrt(max(variance, one_sample)))
