# SPDX-License-Identifier: MIT
"""The null: how evident patterns become on plates without any, of which patches were lost.

Measured by `python -m benchmarks.features holes --null`: the greatest evidence of each kind on simulated
blank plates, 30 % of them lost in discs, ellipses, strips, stars, clouds and rectangles, 10 % outliers.
"""

from __future__ import annotations

import numpy as np

from completion.templates.holes.patterns import CIRCLE, GRID, ROW

_N_PLATES = 150
_TAIL = {ROW: (0.0, 0.06, 2.0), GRID: (-10.0, 0.04, 2.5), CIRCLE: (0.0, 0.06, 2.0)}
"""Of each kind: nats, the share of plates beyond them, and the nats in which that falls by e."""


def false_fit_probability(kind: str, evidence: float) -> float:
    """Return how probably a blank plate with losses shows a pattern of a kind as evident, or more.

    The measured tail is exponential; no less is quoted than one in as many plates as were simulated.
    """
    start, share, scale = _TAIL[kind]
    if evidence < start:
        return 1.0
    return float(max(share * np.exp(-(evidence - start) / scale), 1 / _N_PLATES))
