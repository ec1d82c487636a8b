# SPDX-License-Identifier: MIT
"""Greedy cover: always the candidate that adds most (Minoux 1978, lazily), then reverse deletion.

At most 1 + ln n times the optimum for full cover; the gain is submodular, also when samples must be seen
several times.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from nbv.cover.instance import CoverInstance

Progress = Callable[[str, int, int], None]


def choose_greedily(
    instance: CoverInstance, *, n_most: int | None = None, progress: Progress | None = None
) -> list[int]:
    """Choose candidates by their gain until the instance is met, or there are `n_most`.

    A candidate's gain is the weight of what it sees and too few of the chosen see. It only shrinks: one whose
    old gain is not the largest need not be looked at again. `progress` is called with ("cover", percent,
    100).
    """
    worth = np.where(instance.coverable, instance.weights, 0.0)
    need = np.full(instance.n_samples, instance.fold)
    times = np.zeros(instance.n_samples, np.int64)
    heap = [
        (-gain, c, 0)
        for c in range(instance.n_candidates)
        if (gain := float(worth[instance.seen_by(c)].sum())) > 0
    ]
    heapq.heapify(heap)
    chosen: list[int] = []
    while heap and not instance.is_met_by(times) and len(chosen) < (n_most or instance.n_candidates):
        candidate = _pop_best(instance, heap, worth, len(chosen))
        if candidate is None:
            break
        chosen.append(candidate)
        seen = instance.seen_by(candidate)
        times[seen] += 1
        worth[seen[times[seen] >= need[seen]]] = 0.0
        if progress is not None:
            progress("cover", int(100 * (worth == 0).mean()), 100)
    return chosen


def _pop_best(
    instance: CoverInstance, heap: list[tuple[float, int, int]], worth: NDArray[np.float64], n_chosen: int
) -> int | None:
    """Return the candidate with the largest gain and take it from the heap; None when none gains."""
    while heap:
        _, candidate, counted_at = heapq.heappop(heap)
        if counted_at == n_chosen:
            return candidate
        if (gain := float(worth[instance.seen_by(candidate)].sum())) > 0:
            heapq.heappush(heap, (-gain, candidate, n_chosen))
    return None


def drop_redundant(instance: CoverInstance, chosen: list[int]) -> list[int]:
    """Drop candidates as long as the instance stays met, the one first whose own share is smallest."""
    kept = list(chosen)
    times = instance.times_seen(kept)
    while kept and instance.is_met_by(times):
        alone = [
            float(instance.weights[s[times[s] == instance.fold]].sum()) for s in map(instance.seen_by, kept)
        ]
        least = instance.seen_by(kept[int(np.argmin(alone))])
        times[least] -= 1
        if not instance.is_met_by(times):
            break
        kept.pop(int(np.argmin(alone)))
    return kept


def by_gain(instance: CoverInstance, chosen: list[int]) -> list[int]:
    """Return the chosen in the order in which each adds most to those before it."""
    worth = instance.weights.copy()
    times = np.zeros(instance.n_samples, np.int64)
    left, ordered = sorted(chosen), list[int]()
    while left:
        gains = [float(worth[instance.seen_by(c)].sum()) for c in left]
        ordered.append(left.pop(int(np.argmax(gains))))
        seen = instance.seen_by(ordered[-1])
        times[seen] += 1
        worth[seen[times[seen] >= instance.fold]] = 0.0
    return ordered
