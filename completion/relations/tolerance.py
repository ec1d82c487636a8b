# SPDX-License-Identifier: MIT
"""Tolerance: how exactly things are built, told by the directions that are known well."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from completion.relations.engine.estimate import Estimate
from completion.relations.engine.relation import Relation
from completion.relations.options import RelationOptions
from scenes.checks import FloatArray

_USUAL = np.radians(0.1)  # of buildings: walls stand within .1 to .2 deg of square
_SPREAD = 1.5  # natural logarithms by which that differs from one to the next, standard deviation
_MEANT = 0.7  # of the pairs that come into question are meant to be square or parallel
_ASIDE = np.radians(10.0)  # to either side, within which the others lie
_TRIED = np.radians(np.geomspace(1e-4, 1.0, 81))
_LEVER_M = 1.0  # over which an angle is an error of a length


def with_tolerance(
    options: RelationOptions, relations: Sequence[Relation], estimate: Estimate
) -> RelationOptions:
    """Return the options with a tolerance, where none is given.

    The most probable one by the misfits of `relations` between directions: normal, with the variance of the
    fits and the tolerance, or anything within 10 deg where nobody meant it; before these a tenth of a degree,
    within a factor of 4.5 or so. Lengths have the same tolerance over a metre.
    """
    if options.tolerance_deg is not None:
        return options
    log_posterior = -0.5 * np.square(np.log(_TRIED / _USUAL) / _SPREAD)
    for relation in relations:
        constraint = estimate.constraint(relation)
        log_posterior = log_posterior + _log_likelihood(
            constraint.value, np.diag(estimate.variance(constraint))
        )
    angle = float(_TRIED[int(np.argmax(log_posterior))])
    length = options.tolerance_m if options.tolerance_m is not None else angle * _LEVER_M
    return replace(options, tolerance_deg=float(np.degrees(angle)), tolerance_m=length)


def _log_likelihood(misfit: FloatArray, variance: FloatArray) -> FloatArray:
    """Of a relation's misfits (m,) with these variances (m,), for each tolerance that is tried (k,)."""
    total = variance[:, None] + np.square(_TRIED)
    log_meant = -0.5 * (np.log(2 * np.pi * total) + np.square(misfit)[:, None] / total).sum(axis=0)
    log_chance = -len(misfit) * np.log(2 * _ASIDE)
    return np.asarray(np.logaddexp(np.log(_MEANT) + log_meant, np.log(1 - _MEANT) + log_chance))
