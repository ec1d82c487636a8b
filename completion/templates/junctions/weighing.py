# SPDX-License-Identifier: MIT
"""Weighing: a fit against what is plainer, and against other solutions of its own kind."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from completion.templates.junctions.alternatives import Alternative
from completion.templates.junctions.certainty import Certainty, certainty, misfit
from completion.templates.junctions.descent import Descended
from completion.templates.junctions.starts import Unit

LEAST_EVIDENCE = float(np.log(100.0))
"""Nats from which on a fit counts as better than what is plainer."""


class Weighed(NamedTuple):
    """A fit at unit RMS and what it was weighed against."""

    found: Descended
    known: Certainty
    evidence: float
    plain: str  # the best that is plainer
    misfit: str  # why residuals are no noise, "" where they may be
    rival: str  # another solution that is nearly as likely, "" for none
    evaluations: int


def weigh(
    found: Descended,
    others: Sequence[Alternative],
    unit: Unit,
    *,
    rival: Callable[[float], str],
    evaluations: int,
) -> Weighed:
    """Return a fit with its evidence against the best of the `others`, each less what its parameters cost.

    `rival` tells of another solution, by how much residuals of neighbours have in common.
    """
    n = len(unit.points)
    known = certainty(found, unit.points, unit.measured.spacing)
    plain = max(others, key=lambda one: one.value(n))
    cost = 0.5 * found.model.basis.shape[1] * float(np.log(n))
    evidence = (found.log_likelihood - cost - plain.value(n)) / known.excess
    return Weighed(
        found,
        known,
        evidence,
        plain.name,
        misfit=misfit(found, unit),
        rival=rival(known.excess),
        evaluations=evaluations,
    )
