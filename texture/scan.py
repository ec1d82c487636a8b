# SPDX-License-Identifier: MIT
"""The compiled scan: the matching rule's exhaustive search, dropping a position once it is too far.

Exact: a position is dropped only when its partial sum already exceeds 1.1 times a distance that some position
attains, so the candidates and their distances are those of `texture.matching.scan_exhaustively`.
"""

from collections.abc import Callable
from functools import cache

import numpy as np
from numpy.typing import NDArray

from texture.gaussian import gaussian_weights
from texture.levels import HIGHEST_LEVEL
from texture.sample import Sample
from texture.template import Candidates, Template

NOT_IN_SAMPLE = 1 << 22  # a level so far off that one difference exceeds every distance within the sample
TERMS_PER_STEP = 8  # terms added between two comparisons with the bound


@cache
def can_compile() -> bool:
    """Say whether numba is installed and its compiler enabled."""
    try:
        from numba import config
    except ImportError:
        return False
    return not config.DISABLE_JIT


def prepare_compiled_scan(sample: Sample) -> Callable[[Template], Candidates]:
    """Return the compiled equivalent of `scan_exhaustively` for one sample, which must not be empty."""
    find = _compile()
    width, n_channels = sample.padded_levels.shape[1:]
    levels = np.where(sample.padded_usable[..., None], sample.padded_levels, NOT_IN_SAMPLE).ravel()
    rows, columns = np.divmod(np.arange(sample.usable.size), sample.usable.shape[1])
    # Where each pixel of the sample stands in `levels`.
    place = ((rows + sample.margin) * width + columns + sample.margin) * n_channels
    starts = place[sample.positions]
    offsets = _list_offsets(sample.radius, width, n_channels)
    neighbour_offsets = _list_offsets(1, width, n_channels)[:, 0]
    weights = np.repeat(gaussian_weights(2 * sample.radius + 1).reshape(-1, 1), n_channels, axis=1)
    usable_levels = sample.levels[sample.usable]
    mean, variance = usable_levels.mean(axis=0), usable_levels.var(axis=0)

    def scan(template: Template) -> Candidates:
        known = np.flatnonzero(template.known)
        values = template.levels.reshape(-1, n_channels)[known]
        expected = weights[known] * ((values - mean) ** 2 + variance)
        telling = np.argsort(-expected, axis=None, kind="stable")  # what tells most is added first
        terms = np.zeros((3, -(-telling.size // TERMS_PER_STEP) * TERMS_PER_STEP), dtype=np.int64)
        for row, values_of_terms in enumerate((offsets[known], values, weights[known])):
            terms[row, : telling.size] = values_of_terms.ravel()[telling]
        has_source = template.neighbour_sources.ravel() >= 0
        guesses = place[template.neighbour_sources.ravel()[has_source]] - neighbour_offsets[has_source]
        largest = int(terms[2].sum()) * HIGHEST_LEVEL**2
        ordinals, distances = find(levels, starts, guesses, terms, largest)
        return Candidates(sample.positions[ordinals], distances, largest)

    return scan


def find_nearest(
    levels: NDArray[np.int64],
    starts: NDArray[np.int64],
    guesses: NDArray[np.int64],
    terms: NDArray[np.int64],
    largest: int,
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Find the starts whose distance is at most 1.1 times the smallest (compiled before use).

    Parameters
    ----------
    levels : array, shape (n_levels,), int64
        The padded sample, all channels of a pixel together; `NOT_IN_SAMPLE` where it may not be used.
    starts : array, shape (n,), int64
        Index in `levels` of each position that competes.
    guesses : array, shape (m,), int64
        Indices whose distance bounds the search from the beginning; those not in the sample are ignored.
    terms : array, shape (3, k), int64
        Offset, value and weight of each channel of each known pixel; k a multiple of `TERMS_PER_STEP`.
    largest : int
        A distance that no position within the sample exceeds, and every other does.

    Returns
    -------
    ordinals, distances : arrays, shape (n_found,), int64
        Which starts, rising, and how far.
    """
    n_terms = terms.shape[1]
    best = largest
    bound = largest
    ordinals = np.empty(starts.size, np.int64)
    distances = np.empty(starts.size, np.int64)
    n_found = 0
    for ordinal in range(-guesses.size, starts.size):
        start = guesses[-ordinal - 1] if ordinal < 0 else starts[ordinal]
        if levels[start] >= NOT_IN_SAMPLE:
            continue
        distance = 0
        step = 0
        while step < n_terms and distance <= bound:
            for term in range(step, step + TERMS_PER_STEP):
                difference = levels[start + terms[0, term]] - terms[1, term]
                distance += terms[2, term] * difference * difference
            step += TERMS_PER_STEP
        if distance > bound:
            continue
        if ordinal >= 0:
            ordinals[n_found] = ordinal
            distances[n_found] = distance
            n_found += 1
        if distance < best:
            best = distance
            bound = min(bound, best * 11 // 10)
    is_near = 10 * distances[:n_found] <= 11 * best
    return ordinals[:n_found][is_near], distances[:n_found][is_near]


def _list_offsets(radius: int, width: int, n_channels: int) -> NDArray[np.int64]:
    """Return, for each pixel of a window and each channel, its offset from the centre's first channel."""
    shifts = np.arange(-radius, radius + 1)
    return ((shifts[:, None] * width + shifts) * n_channels).reshape(-1, 1) + np.arange(n_channels)


@cache
def _compile() -> Callable[..., tuple[NDArray[np.int64], NDArray[np.int64]]]:
    """Return `find_nearest` compiled; numba is imported when it is first needed, for a quick start."""
    from numba import njit

    compiled: Callable[..., tuple[NDArray[np.int64], NDArray[np.int64]]] = njit(cache=True, nogil=True)(
        find_nearest
    )
    return compiled
