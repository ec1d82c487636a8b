# SPDX-License-Identifier: MIT
"""The null: how evident patterns become on plates without any, of which patches were lost.

Measured on simulated blank plates, 30 % of them lost in discs, ellipses, strips, stars, clouds and
rectangles, 10 % outliers (`python -m benchmarks.features holes --null`, seeds 500 to 549, 600 to 699 and, for
rows, 50000 to 50299): of each kind the greatest evidence of those patterns that nothing else refuses.
"""

from __future__ import annotations

import numpy as np

from completion.templates.holes.patterns import CIRCLE, GRID, LEAST_SEEN, ROW

_N_PLATES = 450
_TAIL = {
    ROW: ((0.0, 0.049, 3.0), (0.0, 0.049, 3.0)),
    GRID: ((-1.0, 0.027, 1.5), (-2.0, 0.02, 1.5)),
    CIRCLE: ((0.0, 0.045, 2.4), (0.0, 0.045, 1.4)),
}
"""Of each kind, with as few holes seen as it needs, and with more: nats, the share of plates that show such a
pattern beyond them, and the nats in which that falls by e."""


def false_fit_probability(kind: str, evidence: float, *, n_seen: int) -> float:
    """Return how probably a blank plate with losses shows a pattern of a kind as evident, or more.

    False patterns have mostly as few holes as are needed: three of a circle lie on one anyhow. So both are
    told apart, and each may be false as often: twice the tail of its own. The tails are exponential; no less
    is quoted than one in as many plates as were simulated.
    """
    start, share, scale = _TAIL[kind][n_seen > LEAST_SEEN[kind]]
    if evidence < start:
        return 1.0
    return float(max(2 * share * np.exp(-(evidence - start) / scale), 1 / _N_PLATES))
