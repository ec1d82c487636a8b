# SPDX-License-Identifier: MIT
"""Polish: a swap search that makes a cover smaller.

Weighting local search for set cover (Gao, Weise and Li 2015), extended to weighted partial cover and to
samples that must be seen several times: give one candidate up, swap until all is covered again, and let
samples that stay uncovered count for more from step to step.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from nbv.cover.greedy import Progress
from nbv.cover.instance import CoverInstance
from nbv.cover.swap_kernels import BEST, STEPS, SwapState, put_in, search

_AT_A_TIME = 500  # steps between looks at the clock
_PATIENCE = 1_500  # steps for each view without a smaller choice after which none is expected


@dataclass(frozen=True, slots=True)
class Polished:
    """A choice that meets the instance, steps searched, and whether the clock ended the search."""

    chosen: tuple[int, ...]
    steps: int
    was_cut_short: bool


def polish(
    instance: CoverInstance,
    chosen: Sequence[int],
    n_steps: int,
    *,
    enough: int = 0,
    time_budget_s: float | None = None,
    rng: np.random.Generator | int | None = None,
    progress: Progress | None = None,
) -> Polished:
    """Return the smallest choice that `n_steps` swaps lead to from `chosen`, which must meet the instance.

    All samples are coverable (`nbv.cover.reduction`). The search stops at a choice of the size `enough`: a
    lower bound says that there is none smaller; when 1,500 swaps for each view of the smallest choice have
    brought no smaller one; and after `time_budget_s` seconds: what is found then depends on the machine.
    """
    if len(chosen) <= enough:
        return Polished(tuple(chosen), 0, False)
    rng = np.random.default_rng(rng)
    state = _begin(instance, chosen)
    draws = rng.random(n_steps)
    started = time.monotonic()
    was_cut_short, smallest, found_at = False, len(chosen), 0
    for start in range(0, n_steps, _AT_A_TIME):
        search(state, draws[start : start + _AT_A_TIME], enough)
        if state.sizes[BEST] <= enough:
            break
        if state.sizes[BEST] < smallest:
            smallest, found_at = int(state.sizes[BEST]), int(state.sizes[STEPS])
        if state.sizes[STEPS] - found_at >= _PATIENCE * smallest:
            break
        if progress is not None:
            progress("polish", min(start + _AT_A_TIME, n_steps), n_steps)
        if time_budget_s is not None and time.monotonic() - started > time_budget_s:
            was_cut_short = start + _AT_A_TIME < n_steps
            break
    best = state.best[: state.sizes[BEST]]
    return Polished(tuple(int(c) for c in best), int(state.sizes[STEPS]), was_cut_short)


def _begin(instance: CoverInstance, chosen: Sequence[int]) -> SwapState:
    """Return the search before its first step."""
    by_sample = csr_array(instance.matrix.T)
    by_sample.sort_indices()
    m, n = instance.matrix.shape
    weights = np.ones(n) if instance.is_full else instance.weights / instance.weights.mean()
    state = SwapState(
        starts=instance.matrix.indptr.astype(np.int64),
        samples=instance.matrix.indices.astype(np.int32, copy=False),
        first=by_sample.indptr.astype(np.int64),
        candidates=by_sample.indices.astype(np.int32, copy=False),
        weights=weights,
        fold=instance.fold,
        spare=0.0 if instance.is_full else instance.spare / float(instance.weights.mean()),
        times=np.zeros(n, np.int64),
        last_one=np.zeros(n, np.int64),
        penalty=weights.copy(),
        score=instance.sums_seen(weights),
        alone=np.zeros(m),
        moved=np.zeros(m, np.int64),
        place=np.full(m, -1),
        chosen=np.zeros(m, np.int64),
        gap=np.arange(n),
        gaps=np.arange(n),
        best=np.zeros(m, np.int64),
        sizes=np.array([0, n, 0, 0, 0]),
    )
    for candidate in chosen:
        put_in(state, int(candidate))
    state.best[: len(chosen)] = chosen
    state.sizes[BEST] = len(chosen)
    return state
