# SPDX-License-Identifier: MIT
"""Effect: what came of a person's say on a surface, and where the measurements stood against it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from completion.extension.patch import Patch, Provenance


@dataclass(frozen=True, slots=True)
class Effect:
    """What came of it; square metres, cells counted whole.

    Attributes
    ----------
    filled_m2 : float
        Inferred because a person says so.
    vetoed_m2 : float
        Accepted, but beams went through: it stays empty.
    measured_m2 : float
        Measured in a declared opening, or beyond an end that was set: it stays.
    """

    filled_m2: float
    vetoed_m2: float
    measured_m2: float


def effect_of(patch: Patch) -> Effect:
    """Measure what came of the edits of a completed surface.

    Where a surface is accepted as a whole, what beams went through counts in its measured rectangle and on
    to its known ends.
    """
    grid, verdict = patch.grid, patch.verdict
    known = grid.within(*patch.limits.known_window())
    accepted = verdict.accepted(grid, known)
    against = verdict.open_cells(grid)
    for end in verdict.ends:
        against |= (end.distance(grid.centres()) < -float(np.hypot(*grid.cell)) / 2).reshape(grid.shape)
    return Effect(
        float((patch.hypothesised & (patch.provenance == Provenance.USER)).sum()) * grid.cell_area,
        float((accepted & patch.evidence.open & ~patch.observed).sum()) * grid.cell_area,
        float((against & patch.observed).sum()) * grid.cell_area,
    )
