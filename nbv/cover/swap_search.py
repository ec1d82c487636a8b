# SPDX-License-Identifier: MIT
"""Greedy cover, and the swap search that makes a cover smaller.

Greedy: always the candidate that adds most (Minoux 1978, lazily), then reverse deletion. At most 1 + ln n
times the optimum for full cover; the gain is submodular, also when samples must be seen several times.

Swap search: weighting local search for set cover (Gao, Weise and Li 2015), extended to weighted partial cover
and to samples that must be seen several times: give one candidate up, swap until all is covered again, and
let samples that stay uncovered count for more from step to step.
"""

from __future__ import annotations

import heapq
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from nbv.cover.instance import CoverInstance
from scenes.checks import FloatArray
from texture.engine.compiled import compiled, inlined

Indices = NDArray[np.int64]


class SwapState(NamedTuple):
    """State of a search for the compiled loops, which change the arrays from `times` on.

    Attributes
    ----------
    starts, samples : int
        What each candidate sees: `samples[starts[c] : starts[c + 1]]`.
    first, candidates : int
        Who sees each sample, likewise.
    weights : (n,) float
        Weight of each sample.
    fold : int
        How many must see a sample.
    spare : float
        Weight that may stay uncovered.
    times : (n,) int
        How many of the chosen see each sample.
    last_one : (n,) int
        Exclusive or of the numbers of the chosen that see it: where it is one, that one.
    penalty : (n,) float
        What a sample counts in the search.
    score : (m,) float
        Penalty that a candidate would cover; of no meaning for those that are chosen.
    alone : (m,) float
        Penalty that a chosen candidate alone covers.
    moved : (m,) int
        The step in which a candidate was last put in or taken out.
    place : (m,) int
        Where a candidate stands in `chosen`, -1 when it is not chosen.
    chosen : (m,) int
        The chosen in front.
    gap : (n,) int
        Where a sample stands in `gaps`, -1 when it is covered.
    gaps : (n,) int
        The samples too few see, in front.
    best : (m,) int
        The smallest choice so far that met the instance.
    sizes : (5,) int
        How many are chosen, how many gaps there are, steps done, size of the best choice, last one put in.
    """

    starts: Indices
    samples: NDArray[np.int32]
    first: Indices
    candidates: NDArray[np.int32]
    weights: FloatArray
    fold: int
    spare: float
    times: Indices
    last_one: Indices
    penalty: FloatArray
    score: FloatArray
    alone: FloatArray
    moved: Indices
    place: Indices
    chosen: Indices
    gap: Indices
    gaps: Indices
    best: Indices
    sizes: Indices


CHOSEN, GAPS, STEPS, BEST, NEWEST = range(5)


@compiled
def put_in(state: SwapState, candidate: int) -> None:
    """Choose a candidate."""
    state.place[candidate] = state.sizes[CHOSEN]
    state.chosen[state.sizes[CHOSEN]] = candidate
    state.sizes[CHOSEN] += 1
    state.sizes[NEWEST] = candidate
    state.moved[candidate] = state.sizes[STEPS]
    value = 0.0
    for at in range(state.starts[candidate], state.starts[candidate + 1]):
        sample = state.samples[at]
        if state.times[sample] == state.fold - 1:
            _close_gap(state, sample)
        elif state.times[sample] == state.fold:
            _share(state, sample, -state.penalty[sample])
        state.times[sample] += 1
        state.last_one[sample] ^= candidate
        if state.times[sample] <= state.fold:
            value += state.penalty[sample]
    state.alone[candidate] = value


@inlined
def take_out(state: SwapState, candidate: int) -> None:
    """Give a chosen candidate up."""
    state.sizes[CHOSEN] -= 1
    last = state.chosen[state.sizes[CHOSEN]]
    state.chosen[state.place[candidate]] = last
    state.place[last] = state.place[candidate]
    state.place[candidate] = -1
    state.moved[candidate] = state.sizes[STEPS]
    value = 0.0
    for at in range(state.starts[candidate], state.starts[candidate + 1]):
        sample = state.samples[at]
        state.times[sample] -= 1
        state.last_one[sample] ^= candidate
        if state.times[sample] == state.fold - 1:
            _open_gap(state, sample)
        elif state.times[sample] == state.fold:
            _share(state, sample, state.penalty[sample])
        if state.times[sample] < state.fold:
            value += state.penalty[sample]
    state.score[candidate] = value


@inlined
def _close_gap(state: SwapState, sample: int) -> None:
    """Take a sample from the gaps; nobody gains by it any more."""
    state.sizes[GAPS] -= 1
    last = state.gaps[state.sizes[GAPS]]
    state.gaps[state.gap[sample]] = last
    state.gap[last] = state.gap[sample]
    state.gap[sample] = -1
    penalty = state.penalty[sample]
    for at in range(state.first[sample], state.first[sample + 1]):
        state.score[state.candidates[at]] -= penalty


@inlined
def _open_gap(state: SwapState, sample: int) -> None:
    """Add a sample to the gaps; those who see it would gain it."""
    state.gap[sample] = state.sizes[GAPS]
    state.gaps[state.sizes[GAPS]] = sample
    state.sizes[GAPS] += 1
    penalty = state.penalty[sample]
    for at in range(state.first[sample], state.first[sample + 1]):
        state.score[state.candidates[at]] += penalty


@inlined
def _share(state: SwapState, sample: int, change: float) -> None:
    """Change the scores of those chosen that see a sample which just enough of them see."""
    if state.fold == 1:
        state.alone[state.last_one[sample]] += change
        return
    for at in range(state.first[sample], state.first[sample + 1]):
        if state.place[state.candidates[at]] >= 0:
            state.alone[state.candidates[at]] += change


@compiled
def search(state: SwapState, draws: FloatArray, enough: int) -> None:
    """Search for smaller choices: one swap for each of the `draws` (0..1); stop at `enough` chosen.

    Whenever the instance is met the choice is kept and its least useful candidate given up. A step gives up
    one more and puts in the best of those that see a gap, drawn at random; then all gaps' penalties rise.
    """
    for draw in draws:
        while _count_missing(state) <= state.spare:
            state.sizes[BEST] = state.sizes[CHOSEN]
            state.best[: state.sizes[BEST]] = state.chosen[: state.sizes[BEST]]
            if state.sizes[BEST] <= enough or state.sizes[CHOSEN] == 0:
                return
            take_out(state, _least_useful(state, -1))
        if state.sizes[CHOSEN] == 0:
            return
        state.sizes[STEPS] += 1
        given_up = _least_useful(state, state.sizes[NEWEST])
        take_out(state, given_up)
        gap = state.gaps[int(draw * state.sizes[GAPS])]
        put_in(state, _most_useful(state, gap, given_up))
        _raise_penalties(state)


@inlined
def _count_missing(state: SwapState) -> float:
    missing = 0.0
    for at in range(state.sizes[GAPS]):
        missing += state.weights[state.gaps[at]]
    return missing


@inlined
def _least_useful(state: SwapState, never: int) -> int:
    """Return the chosen candidate of lowest score but `never`; of equal ones the one unmoved the longest."""
    best = int(state.chosen[0])
    for at in range(state.sizes[CHOSEN]):
        number = int(state.chosen[at])
        better = state.alone[number] < state.alone[best]
        older = state.alone[number] == state.alone[best] and state.moved[number] < state.moved[best]
        if number != never and (best == never or better or older):
            best = number
    return best


@inlined
def _most_useful(state: SwapState, gap: int, never: int) -> int:
    """Return the best candidate that sees a gap, of equal ones the longest unmoved; `never` if none."""
    best = never
    for at in range(state.first[gap], state.first[gap + 1]):
        number = int(state.candidates[at])
        if state.place[number] >= 0 or number == never:
            continue
        older = state.score[number] == state.score[best] and state.moved[number] < state.moved[best]
        if best == never or state.score[number] > state.score[best] or older:
            best = number
    return best


@inlined
def _raise_penalties(state: SwapState) -> None:
    """Let all gaps count for more; those who see them score higher."""
    for at in range(state.sizes[GAPS]):
        sample = state.gaps[at]
        state.penalty[sample] += state.weights[sample]
        weight = state.weights[sample]
        for who in range(state.first[sample], state.first[sample + 1]):
            state.score[state.candidates[who]] += weight


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

    All samples are coverable (`nbv.cover.dual`). The search stops at a choice of the size `enough`: a
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
