# SPDX-License-Identifier: MIT
"""Dual: the multipliers of the linear relaxation, by HiGHS, or by subgradient ascent where it is large.

The instance is reduced first, exactly: the optimum stays. (1) Samples seen by the same candidates become one,
of their joint weight. (2) In full cover a sample is implied where some other one is seen by a part of its
candidates only: whoever covers that one covers both. (3) A candidate is dominated where another one sees all
that it sees; this needs samples that must be seen only once. The three are repeated until nothing changes
(Garfinkel, Nemhauser 1972).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import Bounds, LinearConstraint, linprog, milp
from scipy.sparse import block_array, csr_array, eye_array

from nbv.cover.instance import Certificate, CoverInstance, Indices
from scenes.checks import BoolArray, FloatArray
from scenes.run.memory import require
from texture.engine.compiled import compiled, inlined

Bits = NDArray[np.uint64]
_WORD = 64  # bits


@dataclass(frozen=True, slots=True, eq=False)
class Reduction:
    """A smaller instance with the same optimum; all of its samples are coverable.

    `candidates` (m',) are the numbers of its candidates in the original, `sample_of` (n,) of each original
    sample the one of the smaller instance that it is a part of, or -1.
    """

    instance: CoverInstance
    candidates: NDArray[np.int64]
    sample_of: NDArray[np.int64]


def reduce_instance(instance: CoverInstance) -> Reduction:
    """Return the smallest instance that merging and dropping lead to."""
    samples = np.flatnonzero(instance.coverable & (instance.weights > 0))
    candidates = np.arange(instance.n_candidates)
    matrix = _pattern(instance.matrix[:, samples])
    weights = instance.weights[samples]
    sample_of = np.full(instance.n_samples, -1)
    sample_of[samples] = np.arange(len(samples))
    while True:
        kept, group = _merge_samples(matrix)
        weights = np.bincount(group, weights, len(kept)).astype(np.float64)
        matrix = _pattern(matrix[:, kept])
        sample_of = _renumber(sample_of, group)
        if instance.is_full:
            needed = ~_find_implied(matrix)
            matrix, weights = _pattern(matrix[:, needed]), weights[needed]
            sample_of = _renumber(sample_of, np.where(needed, np.cumsum(needed) - 1, -1))
        useful = ~_find_dominated(matrix) if instance.fold == 1 else np.diff(matrix.indptr) > 0
        matrix, candidates = _pattern(matrix[useful]), candidates[useful]
        if useful.all():
            return Reduction(replace(instance, matrix=matrix, weights=weights), candidates, sample_of)


def _pattern(matrix: csr_array) -> csr_array:
    """Return which entries are stored, columns sorted."""
    ones = np.ones(len(matrix.indices), np.int8)
    pattern = csr_array((ones, matrix.indices, matrix.indptr), matrix.shape)
    pattern.sort_indices()
    return pattern


def _renumber(sample_of: NDArray[np.int64], numbers: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return `sample_of` with its entries replaced by their new `numbers`; -1 stays."""
    renumbered = sample_of.copy()
    renumbered[sample_of >= 0] = numbers[sample_of[sample_of >= 0]]
    return renumbered


def _merge_samples(matrix: csr_array) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the first of each group of samples with the same candidates, and the group of each sample."""
    bits = _bits(_pattern(csr_array(matrix.T)))
    as_bytes = np.ascontiguousarray(bits).view(np.dtype((np.void, bits.shape[1] * bits.itemsize))).ravel()
    _, first, group = np.unique(as_bytes, return_index=True, return_inverse=True)
    order = np.argsort(first).astype(np.int64)
    return first[order].astype(np.int64), np.argsort(order).astype(np.int64)[group]


def _find_implied(matrix: csr_array) -> BoolArray:
    """Tell which samples (n,) are seen by all candidates that see some other sample."""
    by_sample = _pattern(csr_array(matrix.T))
    implied: BoolArray = _supersets(
        by_sample.indptr, by_sample.indices, matrix.indptr, matrix.indices, _bits(by_sample)
    )
    return implied


def _find_dominated(matrix: csr_array) -> BoolArray:
    """Tell which candidates (m,) see nothing, or nothing that some other one does not see as well."""
    by_sample = _pattern(csr_array(matrix.T))
    dominated: BoolArray = _subsets(
        matrix.indptr, matrix.indices, by_sample.indptr, by_sample.indices, _bits(matrix)
    )
    return dominated


def _bits(matrix: csr_array) -> NDArray[np.uint64]:
    """Return the rows of a pattern as bit sets, (m, words)."""
    bits = np.zeros((matrix.shape[0], max(-(-matrix.shape[1] // _WORD), 1)), np.uint64)
    _set_bits(matrix.indptr, matrix.indices, bits)
    return bits


@compiled
def _set_bits(starts: Indices, members: Indices, bits: Bits) -> None:
    """Set the bits of the members of each set."""
    for number in range(len(starts) - 1):
        for k in range(starts[number], starts[number + 1]):
            bits[number, members[k] // _WORD] |= np.uint64(1) << np.uint64(members[k] % _WORD)


@compiled
def _subsets(
    starts: Indices, members: Indices, holder_starts: Indices, holders: Indices, bits: Bits
) -> BoolArray:
    """Tell which sets lie in another one that stays; of equal sets the first stays; empty ones go."""
    n_sets = len(starts) - 1
    gone = np.zeros(n_sets, np.bool_)
    for number in range(n_sets):
        rarest = -1
        size = starts[number + 1] - starts[number]
        for at in range(starts[number], starts[number + 1]):
            member = members[at]
            n_holders = holder_starts[member + 1] - holder_starts[member]
            if rarest < 0 or n_holders < holder_starts[rarest + 1] - holder_starts[rarest]:
                rarest = member
        gone[number] = size == 0
        if size == 0:
            continue
        for at in range(holder_starts[rarest], holder_starts[rarest + 1]):
            other = holders[at]
            other_size = starts[other + 1] - starts[other]
            if other == number or gone[other] or other_size < size or (other_size == size and other > number):
                continue
            if _lies_in(bits[number], bits[other]):
                gone[number] = True
                break
    return gone


@compiled
def _supersets(
    starts: Indices, members: Indices, holder_starts: Indices, holders: Indices, bits: Bits
) -> BoolArray:
    """Tell which sets hold another one that stays; of equal sets the first stays."""
    n_sets = len(starts) - 1
    gone = np.zeros(n_sets, np.bool_)
    for number in range(n_sets):
        if gone[number] or starts[number] == starts[number + 1]:
            continue
        smallest = members[starts[number]]
        for at in range(starts[number], starts[number + 1]):
            member = members[at]
            if (
                holder_starts[member + 1] - holder_starts[member]
                < holder_starts[smallest + 1] - holder_starts[smallest]
            ):
                smallest = member
        for at in range(holder_starts[smallest], holder_starts[smallest + 1]):
            other = holders[at]
            if other != number and not gone[other] and _lies_in(bits[number], bits[other]):
                gone[other] = True
    return gone


@inlined
def _lies_in(small: Bits, large: Bits) -> bool:
    """Tell whether one bit set lies in another."""
    n_outside = 0
    for word in range(len(small)):
        n_outside += (small[word] & ~large[word]) != 0
        if n_outside:
            break
    return n_outside == 0


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
    best = _price_multipliers(instance, multipliers)
    share, waited, direction = 1.0, 0, np.zeros(instance.n_samples)
    for _ in range(n_steps):
        now = _price_multipliers(instance, multipliers)
        waited = 0 if now.value > best.value + _GAIN * abs(best.value) else waited + 1
        best = max(best, now, key=lambda multipliers: multipliers.value)
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


def _price_multipliers(instance: CoverInstance, multipliers: FloatArray) -> Multipliers:
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
    for candidate in chosen:
        for at in range(starts[candidate], starts[candidate + 1]):
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
        multipliers_none = _solve_within(instance) if instance.matrix.nnz <= most_entries else None
        multipliers_none = multipliers_none or ascend(instance, n_chosen, _ASCENT_STEPS)
        part = np.flatnonzero(reduction.sample_of >= 0)
        whole = reduction.sample_of[part]
        multipliers[part] = (_feasible(instance, multipliers_none) / instance.weights)[whole] * weights[part]
        price = multipliers_none.price
    return Certificate.round_down(multipliers, price)


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
    solution = _price_multipliers(instance, multipliers)
    if instance.is_full:
        return solution
    return replace(solution, price=max(-float(solved.ineqlin.marginals[-1]), 0.0) / _scale(instance))


def _feasible(instance: CoverInstance, multipliers: Multipliers) -> FloatArray:
    """Scale multipliers (n,) of full cover so that no candidate sees more than 1, where that proves more."""
    if instance.fold > 1 or not instance.is_full:
        return multipliers.samples
    scaled = multipliers.samples / max(1.0, float(multipliers.sums.max()) * (1 + _HAIR))
    return max(
        multipliers, _price_multipliers(instance, scaled), key=lambda multipliers: multipliers.value
    ).samples


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
