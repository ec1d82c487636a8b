# SPDX-License-Identifier: MIT
"""Exploration: where a template may lie, by evolution on truncated distances, until it settles."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from completion.templates.engine.equations import Equations, Gate
from completion.templates.engine.evolution import search
from completion.templates.engine.measured import Measured
from completion.templates.engine.template import Template
from scenes.checks import FloatArray

_N_POINTS = 400  # that the search looks at
REACH = 0.1  # of the diagonal, beyond which a point has no say
_PATIENCE, _SETTLED = 6, 1e-3  # generations a sought parameter in which the best gets hardly better


class Found(NamedTuple):
    """Where the search ended."""

    place: FloatArray  # (m,) in the unit box
    violation: float
    evaluations: int
    is_settled: bool


def explore(
    template: Template,
    measured: Measured,
    sought: Equations,
    *,
    rng: np.random.Generator,
    budget: int,
    begun: Sequence[FloatArray],
    gates: Sequence[Gate],
) -> Found:
    """Return the best place of an evolution, until it stands still or the budget is spent.

    Deb's rule for gates: what obeys them beats what does not. It has settled when the best value has fallen
    by less than a thousandth in six generations for each parameter sought. An interrupt ends it, unsettled.
    It begins at the places (m,) that are given, among others.
    """
    n = sought.n_sought
    if n == 0:
        return Found(np.zeros(0), breach(gates, sought.base), 0, True)
    chosen = rng.permutation(len(measured.points))[:_N_POINTS]
    some, reach = measured.points[chosen], REACH * measured.diagonal
    scale = min(max(measured.noise, 0.25 * measured.spacing, 1e-3 * measured.diagonal), 0.5 * reach)
    most = float(np.log1p((reach / scale) ** 2))

    def value(places: FloatArray) -> FloatArray:
        each = [template.distance(some, sought.full(z))[0] for z in places]
        return np.array([np.minimum(np.log1p((one / scale) ** 2), most).mean() for one in each])

    def broken(places: FloatArray) -> FloatArray:
        return np.array([breach(gates, sought.full(z)) for z in places])

    stages = search(
        value,
        np.zeros(n),
        np.ones(n),
        rng=rng,
        budget=max(1, budget),
        starts=np.array(begun) if len(begun) else None,
        violation=broken if gates else None,
    )
    best: list[tuple[float, float]] = []
    settled = False
    try:
        for stage in stages:
            found = Found(stage.place, stage.violation, stage.evaluations, False)
            best.append((stage.violation, stage.value))
            before = best[max(0, len(best) - 1 - _PATIENCE * n)]
            still = before[0] == stage.violation and before[1] - stage.value < _SETTLED * before[1]
            settled = len(best) > _PATIENCE * n and still
            if settled:
                break
    except KeyboardInterrupt:
        if not best:
            raise
    return found._replace(is_settled=settled)


def breach(gates: Sequence[Gate], x: FloatArray) -> float:
    """Return by how many tolerances parameters (k,) break all gates."""
    return sum(gate.breach(x) for gate in gates)
