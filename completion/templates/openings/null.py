# SPDX-License-Identifier: MIT
"""The null: how often a room whose wall has no opening shows one as good.

Measured by `python -m benchmarks.features nulls --first 4000 --seeds 12 --tail` on simulated walls that are
plain, end, bear pictures or mirrors, lost a patch, or have cupboards, wardrobes, a table or shelves before
them, each scanned once, with boxes, 5 mm of noise and 1 % of strays.
"""

from __future__ import annotations

import numpy as np

from completion.templates.engine.template import Status

LEVELS = (-np.inf, 0.0, 8.0, 16.0, 32.0, 64.0, 128.0, 256.0)
"""Nats of evidence."""

N_WALLS = 108
WALLS_AS_GOOD: dict[Status, tuple[int, ...]] = {
    Status.FOUND: (2, 2, 2, 2, 2, 1, 1, 0),
    Status.AMBIGUOUS: (25, 25, 25, 25, 25, 25, 11, 2),
    Status.NONE: (66, 47, 42, 41, 39, 35, 25, 25),
}
"""Of each status: on how many walls one came as far with that evidence, or farther."""

_ORDER = (Status.NONE, Status.AMBIGUOUS, Status.FOUND)


def rank(status: Status, evidence: float) -> tuple[int, float]:
    """Return by what fits are ordered: how far the rules let them come, then their evidence, nats."""
    return _ORDER.index(status), evidence


def false_fit_probability(status: Status, evidence: float) -> float:
    """Return how probably a wall without an opening shows one that comes as far, and is as evident, or more.

    A share of the walls that were simulated, at the tabled evidence below; never less than one of them.
    """
    level = max(int(np.searchsorted(LEVELS, evidence, side="right")) - 1, 0)
    return max(WALLS_AS_GOOD[status][level], 1) / N_WALLS
