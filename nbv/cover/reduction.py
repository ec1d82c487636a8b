# SPDX-License-Identifier: MIT
"""Reduction of a cover instance: samples merged, implied samples and dominated candidates dropped.

All exactly: the optimum stays. (1) Samples seen by the same candidates become one, of their joint weight.
(2) In full cover a sample is implied where some other one is seen by a part of its candidates only: whoever
covers that one covers both. (3) A candidate is dominated where another one sees all that it sees; this needs
samples that must be seen only once. The three are repeated until nothing changes (Garfinkel, Nemhauser 1972).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from nbv.cover.instance import CoverInstance, Indices
from scenes.checks import BoolArray
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
        sample_of = _renumbered(sample_of, group)
        if instance.is_full:
            needed = ~_implied(matrix)
            matrix, weights = _pattern(matrix[:, needed]), weights[needed]
            sample_of = _renumbered(sample_of, np.where(needed, np.cumsum(needed) - 1, -1))
        useful = ~_dominated(matrix) if instance.fold == 1 else np.diff(matrix.indptr) > 0
        matrix, candidates = _pattern(matrix[useful]), candidates[useful]
        if useful.all():
            return Reduction(replace(instance, matrix=matrix, weights=weights), candidates, sample_of)


def _pattern(matrix: csr_array) -> csr_array:
    """Return which entries are stored, columns sorted."""
    ones = np.ones(len(matrix.indices), np.int8)
    pattern = csr_array((ones, matrix.indices, matrix.indptr), matrix.shape)
    pattern.sort_indices()
    return pattern


def _renumbered(sample_of: NDArray[np.int64], numbers: NDArray[np.int64]) -> NDArray[np.int64]:
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


def _implied(matrix: csr_array) -> BoolArray:
    """Tell which samples (n,) are seen by all candidates that see some other sample."""
    by_sample = _pattern(csr_array(matrix.T))
    implied: BoolArray = _supersets(
        by_sample.indptr, by_sample.indices, matrix.indptr, matrix.indices, _bits(by_sample)
    )
    return implied


def _dominated(matrix: csr_array) -> BoolArray:
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
    for one in range(len(starts) - 1):
        for k in range(starts[one], starts[one + 1]):
            bits[one, members[k] // _WORD] |= np.uint64(1) << np.uint64(members[k] % _WORD)


@compiled
def _subsets(
    starts: Indices, members: Indices, holder_starts: Indices, holders: Indices, bits: Bits
) -> BoolArray:
    """Tell which sets lie in another one that stays; of equal sets the first stays; empty ones go."""
    n_sets = len(starts) - 1
    gone = np.zeros(n_sets, np.bool_)
    for one in range(n_sets):
        rarest = -1
        size = starts[one + 1] - starts[one]
        for at in range(starts[one], starts[one + 1]):
            member = members[at]
            n_holders = holder_starts[member + 1] - holder_starts[member]
            if rarest < 0 or n_holders < holder_starts[rarest + 1] - holder_starts[rarest]:
                rarest = member
        gone[one] = size == 0
        if size == 0:
            continue
        for at in range(holder_starts[rarest], holder_starts[rarest + 1]):
            other = holders[at]
            other_size = starts[other + 1] - starts[other]
            if other == one or gone[other] or other_size < size or (other_size == size and other > one):
                continue
            if _lies_in(bits[one], bits[other]):
                gone[one] = True
                break
    return gone


@compiled
def _supersets(
    starts: Indices, members: Indices, holder_starts: Indices, holders: Indices, bits: Bits
) -> BoolArray:
    """Tell which sets hold another one that stays; of equal sets the first stays."""
    n_sets = len(starts) - 1
    gone = np.zeros(n_sets, np.bool_)
    for one in range(n_sets):
        if gone[one] or starts[one] == starts[one + 1]:
            continue
        smallest = members[starts[one]]
        for at in range(starts[one], starts[one + 1]):
            member = members[at]
            if (
                holder_starts[member + 1] - holder_starts[member]
                < holder_starts[smallest + 1] - holder_starts[smallest]
            ):
                smallest = member
        for at in range(holder_starts[smallest], holder_starts[smallest + 1]):
            other = holders[at]
            if other != one and not gone[other] and _lies_in(bits[one], bits[other]):
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
