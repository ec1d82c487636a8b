# SPDX-License-Identifier: MIT
"""The compiled loops of the swap search: candidates put in and taken out, scores kept up to date."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

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
    own = 0.0
    for at in range(state.starts[candidate], state.starts[candidate + 1]):
        sample = state.samples[at]
        if state.times[sample] == state.fold - 1:
            _close_gap(state, sample)
        elif state.times[sample] == state.fold:
            _share(state, sample, -state.penalty[sample])
        state.times[sample] += 1
        state.last_one[sample] ^= candidate
        if state.times[sample] <= state.fold:
            own += state.penalty[sample]
    state.alone[candidate] = own


@inlined
def take_out(state: SwapState, candidate: int) -> None:
    """Give a chosen candidate up."""
    state.sizes[CHOSEN] -= 1
    last = state.chosen[state.sizes[CHOSEN]]
    state.chosen[state.place[candidate]] = last
    state.place[last] = state.place[candidate]
    state.place[candidate] = -1
    state.moved[candidate] = state.sizes[STEPS]
    own = 0.0
    for at in range(state.starts[candidate], state.starts[candidate + 1]):
        sample = state.samples[at]
        state.times[sample] -= 1
        state.last_one[sample] ^= candidate
        if state.times[sample] == state.fold - 1:
            _open_gap(state, sample)
        elif state.times[sample] == state.fold:
            _share(state, sample, state.penalty[sample])
        if state.times[sample] < state.fold:
            own += state.penalty[sample]
    state.score[candidate] = own


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
        while _missing(state) <= state.spare:
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
def _missing(state: SwapState) -> float:
    missing = 0.0
    for at in range(state.sizes[GAPS]):
        missing += state.weights[state.gaps[at]]
    return missing


@inlined
def _least_useful(state: SwapState, never: int) -> int:
    """Return the chosen candidate of the lowest score, the longest unmoved of equals; `never` one of them."""
    best = int(state.chosen[0])
    for at in range(state.sizes[CHOSEN]):
        one = int(state.chosen[at])
        better = state.alone[one] < state.alone[best]
        older = state.alone[one] == state.alone[best] and state.moved[one] < state.moved[best]
        if one != never and (best == never or better or older):
            best = one
    return best


@inlined
def _most_useful(state: SwapState, gap: int, never: int) -> int:
    """Return the best candidate that sees a gap, the longest unmoved of equals; `never` where it is alone."""
    best = never
    for at in range(state.first[gap], state.first[gap + 1]):
        one = int(state.candidates[at])
        if state.place[one] >= 0 or one == never:
            continue
        older = state.score[one] == state.score[best] and state.moved[one] < state.moved[best]
        if best == never or state.score[one] > state.score[best] or older:
            best = one
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
