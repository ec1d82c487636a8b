# SPDX-License-Identifier: MIT
"""Dual: the multipliers of the linear relaxation, by HiGHS, or by subgradient ascent where it is large."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.optimize import Bounds, LinearConstraint, linprog, milp
from scipy.sparse import block_array, csr_array, eye_array

from nbv.cover.cover import Certificate
from nbv.cover.instance import CoverInstance, Indices
from nbv.cover.reduction import Reduction
from scenes.checks import FloatArray
from scenes.run.memory import require
from texture.engine.compiled import compiled

_PATIENCE = 30  # steps without gain after which the step is halved
_GAIN = 1e-4  # share of the value that counts as gain
_MEMORY = 0.7  # of the direction before
_SMALLEST = 1e-4  # share of Polyak's step at which it is over


@dataclass(frozen=True, slots=True, eq=False)
class Multipliers:
    """Multipliers (n,) of the samples, the price of a unit of weight, and about what they prove.

    `sums` (m,) are those over what each candidate sees.
    """

    samples: FloatArray
    price: float
    value: float
    sums: FloatArray


def ascend(instance: CoverInstance, n_chosen: int, n_steps: int) -> Multipliers:
    """Return multipliers that prove a bound near the best, of a reduced instance.

    The steps, which go once through the matrix each, aim at the size of a choice that is known. They begin
    where no candidate sees more than 1 together.
    """
    multipliers = _even_shares(instance)
    best = _valued(instance, multipliers)
    share, waited, direction = 1.0, 0, np.zeros(instance.n_samples)
    for _ in range(n_steps):
        now = _valued(instance, multipliers)
        waited = 0 if now.value > best.value + _GAIN * abs(best.value) else waited + 1
        best = max(best, now, key=lambda some: some.value)
        if waited > _PATIENCE:
            share, waited = share / 2, 0
            multipliers, direction = best.samples, np.zeros(instance.n_samples)
            continue
        direction = _slope(instance, now) + _MEMORY * direction
        length = float(direction @ direction)
        if share < _SMALLEST or length == 0:
            break
        step = share * (n_chosen - now.value) / length
        multipliers = np.clip(multipliers + step * direction, 0.0, 1.0)
    return best


def _even_shares(instance: CoverInstance) -> FloatArray:
    """Return multipliers (n,) of which no candidate sees more than 1 together."""
    sizes = np.maximum(np.diff(instance.matrix.indptr), 1)
    largest = np.ones(instance.n_samples)
    np.maximum.at(largest, instance.matrix.indices, np.repeat(sizes, np.diff(instance.matrix.indptr)))
    return 1.0 / largest


def _valued(instance: CoverInstance, multipliers: FloatArray) -> Multipliers:
    """Return the multipliers with their best price, and about what they prove."""
    sums = instance.sums_seen(multipliers)
    excess = float(np.maximum(sums - 1.0, 0.0).sum())
    if instance.is_full:
        return Multipliers(multipliers, 0.0, instance.fold * float(multipliers.sum()) - excess, sums)
    price = _best_price(instance, multipliers)
    lost = np.maximum(price * instance.weights - instance.fold * multipliers, 0.0)
    return Multipliers(multipliers, price, price * instance.wanted - float(lost.sum()) - excess, sums)


def _best_price(instance: CoverInstance, multipliers: FloatArray) -> float:
    """Return the price that fits multipliers best: the samples that are cheaper hold the wanted weight."""
    prices = instance.fold * multipliers / instance.weights
    order = np.argsort(prices, kind="stable")
    reached = np.cumsum(instance.weights[order])
    last = min(int(np.searchsorted(reached, instance.wanted)), len(order) - 1)
    return float(prices[order[last]])


def _slope(instance: CoverInstance, at: Multipliers) -> FloatArray:
    """Return how the value changes with each multiplier, 0 where one is to fall below 0."""
    matrix = instance.matrix
    chosen = np.flatnonzero(at.sums > 1.0)
    wanted = at.price * instance.weights > instance.fold * at.samples
    slope: FloatArray = instance.fold * (wanted | instance.is_full).astype(np.float64)
    _take_off(matrix.indptr, matrix.indices, chosen, slope)
    slope[(at.samples <= 0) & (slope < 0)] = 0.0
    return slope


@compiled
def _take_off(starts: Indices, members: Indices, chosen: Indices, values: FloatArray) -> None:
    """Take one off the value of each member of the chosen sets, as often as it is one."""
    for one in chosen:
        for at in range(starts[one], starts[one + 1]):
            values[members[at]] -= 1.0


_ASCENT_STEPS = 1000
_BYTES_AN_ENTRY = 300  # of the relaxation, for HiGHS and what it is given: 80 to 330 were measured
_SIMPLEX_ENTRIES = 500_000  # beyond it interior points are faster: with 2,100,000 entries 51 s for 116 s
_HAIR = 1e-12  # by which multipliers are scaled below feasibility, against rounding


def find_certificate(
    reduction: Reduction, weights: FloatArray, n_chosen: int, *, most_entries: int = 4_000_000
) -> Certificate:
    """Return the best certificate that the linear relaxation gives, for the original's samples.

    Samples that were merged share a multiplier by their `weights` (n,); those that were dropped get none.
    `n_chosen` is the size of a choice that is known. Instances with more than `most_entries`, and those that
    HiGHS does not solve, are left to subgradient ascent.

    Raises
    ------
    InputError
        HiGHS would need more memory than is left.
    """
    instance = reduction.instance
    multipliers, price = np.zeros(len(weights)), 0.0
    if instance.n_samples:
        found = _solve_within(instance) if instance.matrix.nnz <= most_entries else None
        found = found or ascend(instance, n_chosen, _ASCENT_STEPS)
        part = np.flatnonzero(reduction.sample_of >= 0)
        whole = reduction.sample_of[part]
        multipliers[part] = (_feasible(instance, found) / instance.weights)[whole] * weights[part]
        price = found.price
    return Certificate.rounded(multipliers, price)


def _solve_within(instance: CoverInstance) -> Multipliers | None:
    """Solve the linear relaxation where it fits into memory; without it the bound would be another one.

    Raises
    ------
    InputError
        It does not.
    """
    n = instance.matrix.nnz
    what = f"the bound on the number of views, a linear programme of {n:,} entries,"
    require(_BYTES_AN_ENTRY * n, what, "plan with fewer candidates, or give more memory")
    return _solve(instance)


def _solve(instance: CoverInstance) -> Multipliers | None:
    """Return the multipliers of the linear relaxation, None where HiGHS fails."""
    is_large = instance.matrix.nnz > _SIMPLEX_ENTRIES
    solved = linprog(**relaxation(instance), method="highs-ipm" if is_large else "highs-ds")
    if solved.x is None:
        return None
    multipliers = np.clip(-solved.ineqlin.marginals[: instance.n_samples], 0.0, 1.0)
    found = _valued(instance, multipliers)
    if instance.is_full:
        return found
    return replace(found, price=max(-float(solved.ineqlin.marginals[-1]), 0.0) / _scale(instance))


def _feasible(instance: CoverInstance, found: Multipliers) -> FloatArray:
    """Scale multipliers (n,) of full cover so that no candidate sees more than 1, where that proves more."""
    if instance.fold > 1 or not instance.is_full:
        return found.samples
    scaled = found.samples / max(1.0, float(found.sums.max()) * (1 + _HAIR))
    return max(found, _valued(instance, scaled), key=lambda some: some.value).samples


def relaxation(instance: CoverInstance) -> dict[str, Any]:
    """Return the relaxed cover as arguments of `linprog`.

    Of candidate c the share x_c is chosen, and of sample i the share z_i covered (all of it in full cover):
    smallest sum of x, where the x that see i sum to fold * z_i or more, and the z hold the wanted weight.
    """
    m, n = instance.matrix.shape
    seen_by = csr_array(instance.matrix.T).astype(np.float64)
    if instance.is_full:
        limits = np.full(n, -float(instance.fold))
        return {"c": np.ones(m), "A_ub": -seen_by, "b_ub": limits, "bounds": (0, 1)}
    weights = instance.weights / _scale(instance)
    rows = [[-seen_by, instance.fold * eye_array(n)], [None, csr_array(-weights[None])]]
    limits = np.append(np.zeros(n), -instance.target * weights.sum())
    cost = np.append(np.ones(m), np.zeros(n))
    return {"c": cost, "A_ub": block_array(rows, format="csr"), "b_ub": limits, "bounds": (0, 1)}


def _scale(instance: CoverInstance) -> float:
    """Return the weight that counts as one."""
    return float(instance.weights.mean())


def solve_exactly(instance: CoverInstance, n_nodes: int) -> tuple[int, ...] | None:
    """Return a smallest choice that meets the instance; None when `n_nodes` nodes do not settle it.

    Parameters
    ----------
    instance : CoverInstance
        Reduced: all of its samples coverable.
    n_nodes : int
        Nodes of the search tree to look at.
    """
    if not instance.n_samples:
        return ()
    model = relaxation(instance)
    solved = milp(
        model["c"],
        constraints=LinearConstraint(model["A_ub"], ub=model["b_ub"]),
        bounds=Bounds(0, 1),
        integrality=np.ones(len(model["c"])),
        options={"node_limit": n_nodes},
    )
    if solved.status != 0:
        return None
    chosen = tuple(int(c) for c in np.flatnonzero(solved.x[: instance.n_candidates] > 0.5))
    return chosen if instance.is_met_by(instance.times_seen(chosen)) else None
