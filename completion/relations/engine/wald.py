# SPDX-License-Identifier: MIT
"""Tests of relations: of a new one given those that are imposed, and of each of these given all the others.

A relation that holds misses by c, of which W = c' S^-1 c has the chi-square distribution, or W over its rank
the F distribution where the covariances' scale was estimated (Wald's test).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_solve, qr
from scipy.special import chdtrc, fdtrc

from completion.relations.engine.equations import Constraint
from completion.relations.engine.estimate import Estimate
from completion.relations.engine.relation import Relation
from scenes.checks import FloatArray

_SAME = 1e-6  # of its own variance, to which what is accepted already determines an equation
_EXACT = 1e-2  # standard deviations by which an equation that is determined may miss
_PART = 1e-6  # of the greatest share, from which a relation has a part in what determines an equation


@dataclass(frozen=True, slots=True, eq=False)
class WaldTest:
    """What a relation is worth, given what is imposed.

    Attributes
    ----------
    rows : list of int
        Its equations that are not determined yet, the best known first.
    chi2, p : float
        Squared misfit of these in standard deviations, and the probability of one so large if it holds.
    log_density : float
        Of these equations' misfit.
    is_met : bool
        Whether the others, which are determined, hold.
    constraint : Constraint
        The equations where the estimate is.
    """

    rows: list[int]
    chi2: float
    p: float
    log_density: float
    is_met: bool
    constraint: Constraint


def wald_test(relation: Relation, estimate: Estimate) -> WaldTest:
    """Tell what a relation is worth, given those that are imposed.

    An equation counts as determined where what is imposed leaves less than a millionth of the variance that
    the fits alone give it.
    """
    constraint = estimate.constraint(relation)
    prior, now = estimate.variance(constraint, prior=True), estimate.variance(constraint)
    scale = np.sqrt(np.maximum(np.diag(prior), np.finfo(np.float64).tiny))
    rows = _independent(now / np.outer(scale, scale))
    rest = [k for k in range(len(scale)) if k not in rows]
    value = constraint.value
    if not rows:
        is_met = _is_met(value, scale)
        return WaldTest(rows, chi2=0.0, p=1.0, log_density=0.0, is_met=is_met, constraint=constraint)
    spread = now + np.diag(estimate.built_within(constraint))
    inner = spread[np.ix_(rows, rows)]
    whitened = np.linalg.solve(inner, value[rows])
    square = float(value[rows] @ whitened)
    left = value[rest] - spread[np.ix_(rest, rows)] @ whitened
    _, log_volume = np.linalg.slogdet(2 * np.pi * inner)
    p = probability(square, len(rows), estimate.freedom_of(relation.surfaces))
    return WaldTest(
        rows,
        chi2=square,
        p=p,
        log_density=float(-(log_volume + square) / 2),
        is_met=_is_met(left, scale[rest]),
        constraint=constraint,
    )


def multiplier_tests(estimate: Estimate) -> list[float]:
    """Return the probability of each imposed relation's misfit, given all the others.

    By the Lagrange multipliers lambda = S^-1 c0: W = lambda_k' [(S^-1)_kk]^-1 lambda_k.
    """
    jacobian, value, within = estimate.equations()
    _, factor = estimate.factor(jacobian, within)
    multiplier = cho_solve(factor, jacobian @ estimate.x - value)
    inverse = cho_solve(factor, np.eye(len(value)))
    found, first = [], 0
    for one in estimate.imposed:
        own = slice(first, first + len(one.rows))
        square = float(multiplier[own] @ np.linalg.solve(inverse[own, own], multiplier[own]))
        freedom = estimate.freedom_of(one.relation.surfaces)
        found.append(probability(square, len(one.rows), freedom))
        first += len(one.rows)
    return found


def probability(square: float, rank: int, freedom: float) -> float:
    """Return the probability of a squared misfit that is at least so large, where a relation holds."""
    if np.isfinite(freedom):
        return float(fdtrc(rank, freedom, square / rank))
    return float(chdtrc(rank, square))


def what_determines(constraint: Constraint, estimate: Estimate) -> list[int]:
    """Return the places among the imposed of those relations that determine the equations.

    They are the ones whose derivatives have a part in the sum that gives the equations' derivatives.
    """
    jacobian, _, _ = estimate.equations()
    own = np.zeros((len(constraint.value), estimate.n_unknowns))
    for number, block in constraint.blocks.items():
        own[:, estimate.columns(number)] = block
    scaled = jacobian.toarray() * estimate.prior_sd
    size = np.linalg.norm(scaled, axis=1, keepdims=True)
    share, *_ = np.linalg.lstsq((scaled / size).T, (own * estimate.prior_sd).T, rcond=1e-9)
    weight = np.abs(share).max(axis=1) / max(float(np.abs(share).max()), np.finfo(np.float64).tiny)
    which = np.repeat(np.arange(len(estimate.imposed)), [len(one.rows) for one in estimate.imposed])
    return sorted(set(which[weight > _PART].tolist()))


def with_only(relations: Sequence[Relation], estimate: Estimate) -> Estimate:
    """Return an estimate from the same fits with these relations imposed, where they say something.

    Derivatives are those where the surfaces are now, until all is solved.
    """
    other = estimate.anew()
    for relation in relations:
        rows = wald_test(relation, other).rows
        if rows:
            other.impose(relation, rows)
    other.solve()
    return other


def _is_met(value: FloatArray, scale: FloatArray) -> bool:
    """Whether equations that are determined hold, within a small part of what the fits say of them."""
    return bool((np.abs(value) <= _EXACT * scale).all())


def _independent(unit: FloatArray) -> list[int]:
    """Equations (m, m) in their own deviations that are not determined by others, the best first."""
    if not (np.diag(unit) > _SAME).any():
        return []
    values, vectors = np.linalg.eigh((unit + unit.T) / 2)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    _, triangle, order = qr(root.T, mode="economic", pivoting=True)
    known = np.square(np.diag(triangle)) > _SAME
    return sorted(int(k) for k in order[: int(np.count_nonzero(known))])
