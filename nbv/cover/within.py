# SPDX-License-Identifier: MIT
"""Most within a budget: the choice of stations that sees most in the time on site, and how much any could.

A station costs its scan; a place costs its set-up once, and the way to it. Greedy choice by gain for each
second, the way by cheapest insertion into the tour, is compared with greedy choice by gain alone (Khuller,
Moss and Naor 1999, The budgeted maximum coverage problem), both begun at each of a few. Then stations are
given up, one at a time and a random few at a time, and what that frees is spent anew, as long as more is seen
(ruin and recreate, Schrimpf et al. 2000).

For multipliers y and a price p (`nbv.cover.instance`) the certificate's bound is linear in the weight that is
wanted. Solved for it: no K candidates see more than the weight at which the bound is K.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from nbv.cover.dual import find_certificate, reduce_instance
from nbv.cover.instance import Certificate, CoverInstance
from scenes.checks import FloatArray, InputError, frozen_copy

_ROUNDS = 60  # random ruins of a choice, after all single ones
_SEEDS = 24  # candidates of most gain, each of which begins a choice
_RUINED = 0.5  # of the stations at most that one of them takes out
_GAIN = 1e-9  # of the coverable weight, from which more is more


@dataclass(frozen=True, slots=True, eq=False)
class SiteCosts:
    """What m candidates at p places cost, seconds.

    Parameters
    ----------
    scan_s : (m,) float
        A scan from each candidate.
    place : (m,) int
        The place of each candidate.
    travel_s : (p, p) float
        The way from place to place; inf where there is none.
    set_up_s : float
        At each place once.
    least_scan_s : float, optional
        What a scan takes at least, where it may turn out to be shorter; else the shortest of `scan_s`.
    """

    scan_s: FloatArray
    place: NDArray[np.int64]
    travel_s: FloatArray
    set_up_s: float = 0.0
    least_scan_s: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "scan_s", frozen_copy(self.scan_s, np.float64))
        object.__setattr__(self, "place", frozen_copy(self.place, np.int64))
        if len(self.scan_s) != len(self.place):
            raise InputError(f"{len(self.place)} places for the scans of {len(self.scan_s)} candidates")

    @classmethod
    def counted(cls, n_candidates: int) -> SiteCosts:
        """Costs that only count candidates, one each."""
        return cls(np.ones(n_candidates), np.zeros(n_candidates, np.int64), np.zeros((1, 1)))

    @property
    def least_s(self) -> float:
        """What the cheapest station takes."""
        scan_s = self.scan_s.min(initial=np.inf) if self.least_scan_s is None else self.least_scan_s
        return float(scan_s) + (self.set_up_s if self._has_one_each else 0.0)

    @property
    def _has_one_each(self) -> bool:
        """Whether no two candidates share a place."""
        return len(np.unique(self.place)) == len(self.place)

    def most_stations(self, budget_s: float) -> int:
        """How many stations a budget can hold at most, all the cheapest, by the shortest ways there are."""
        leg_s = 0.0
        if self._has_one_each and len(self.place) > 1:
            apart = ~np.eye(len(self.travel_s), dtype=np.bool_)
            leg_s = float(self.travel_s[apart].min(initial=np.inf))
            leg_s = leg_s if np.isfinite(leg_s) else budget_s
        return int((budget_s + leg_s) / max(self.least_s + leg_s, 1e-9) + 1e-9)


@dataclass(slots=True, eq=False)
class _Choice:
    """Candidates that are chosen, in order, the places of their tour, and how often each sample (n,) is seen.

    The tour begins at its first place where that `is_fixed`.
    """

    instance: CoverInstance
    costs: SiteCosts
    times: NDArray[np.int64]
    chosen: list[int] = field(default_factory=list)
    tour: list[int] = field(default_factory=list)
    n_fixed: int = 0

    @classmethod
    def begin(cls, instance: CoverInstance, costs: SiteCosts, given: list[int]) -> _Choice:
        choice = cls(instance, costs, np.zeros(instance.n_samples, np.int64))
        for candidate in given:
            choice.add(candidate)
        choice.n_fixed = len(given)
        return choice

    def copy(self) -> _Choice:
        return replace(self, times=self.times.copy(), chosen=list(self.chosen), tour=list(self.tour))

    @property
    def weight(self) -> float:
        """What it covers."""
        return float(self.instance.weights[self.times >= self.instance.fold].sum())

    @property
    def spent_s(self) -> float:
        """What it costs."""
        tour = np.array(self.tour, np.int64)
        walked = float(self.costs.travel_s[tour[:-1], tour[1:]].sum())
        return float(self.costs.scan_s[self.chosen].sum()) + self.costs.set_up_s * len(tour) + walked

    def gains(self) -> FloatArray:
        """Weight (m,) that each candidate would bring nearer to being covered."""
        lacks = self.instance.coverable & (self.times < self.instance.fold)
        lacking = np.where(lacks, self.instance.weights, 0.0)
        gains = self.instance.sums_seen(lacking)
        gains[self.chosen] = 0.0
        return gains

    def added_s(self) -> FloatArray:
        """What each candidate (m,) would cost more."""
        more = np.full(len(self.costs.travel_s), self.costs.set_up_s, np.float64)
        if self.tour:
            there = self.costs.travel_s[self.tour]
            more += np.minimum(self._between(there), there[-1])
            if not self.n_fixed:
                more = np.minimum(more, self.costs.set_up_s + there[0])
            more[self.tour] = 0.0
        return np.asarray(self.costs.scan_s + more[self.costs.place])

    def _between(self, there: FloatArray) -> FloatArray:
        """Least detour (p,) by each place between two of the tour; inf where there are not two."""
        if len(there) < 2:
            return np.full(there.shape[1], np.inf)
        now = self.costs.travel_s[self.tour[:-1], self.tour[1:]]
        with np.errstate(invalid="ignore"):
            detour = there[:-1] + there[1:] - np.where(np.isfinite(now), now, 0.0)[:, None]
        return np.asarray(detour.min(axis=0))

    def add(self, candidate: int) -> None:
        """Choose a candidate; its place goes where it lengthens the tour least."""
        place = int(self.costs.place[candidate])
        self.chosen.append(candidate)
        self.times[self.instance.seen_by(candidate)] += 1
        if place in self.tour:
            return
        begin, end = min(self.n_fixed, 1), len(self.tour) + 1
        ways = [[*self.tour[:k], place, *self.tour[k:]] for k in range(begin, end)]
        lengths = [float(self.costs.travel_s[way[:-1], way[1:]].sum()) for way in ways]
        self.tour = ways[int(np.argmin(lengths))]

    def drop(self, candidate: int) -> None:
        """Give a chosen candidate up."""
        self.chosen.remove(candidate)
        self.times[self.instance.seen_by(candidate)] -= 1
        place = int(self.costs.place[candidate])
        if all(int(self.costs.place[other]) != place for other in self.chosen):
            self.tour.remove(place)

    def filled(self, budget_s: float) -> tuple[_Choice, _Choice]:
        """The choice with all added, while it fits, that gains most, and that gains most for each second."""
        ways = self.copy(), self.copy()
        for way, by_the_second in zip(ways, (False, True), strict=True):
            while True:
                gains, added = way.gains(), way.added_s()
                fits = (gains > 0) & (added <= budget_s - way.spent_s + 1e-9)
                if not fits.any():
                    break
                worth = gains / np.maximum(added, 1e-9) if by_the_second else gains
                way.add(int(np.argmax(np.where(fits, worth, -1.0))))
        return ways


@dataclass(frozen=True, slots=True)
class Within:
    """Candidates chosen within a budget, in the order of their choice.

    `weight` is what they cover, and they take `spent_s`.
    """

    chosen: tuple[int, ...]
    weight: float
    spent_s: float


def choose_within(
    instance: CoverInstance,
    costs: SiteCosts,
    budget_s: float,
    *,
    first: tuple[int, ...] = (),
    rng: np.random.Generator | int | None = None,
) -> Within:
    """Choose the candidates that cover most within a budget.

    Parameters
    ----------
    instance : CoverInstance
        Which candidate sees which sample; its target does not matter.
    costs : SiteCosts
        Of its candidates.
    budget_s : float
        For all stations and the way between them, seconds.
    first : tuple of int
        Candidates that are chosen in any case; the tour begins at the first.
    rng : Generator, int or None
        Drives the search.

    Raises
    ------
    InputError
        A budget within which not even the stations given, or one station, can be done.
    """
    rng = np.random.default_rng(rng)
    begun = _Choice.begin(instance, costs, list(first))
    least = begun.spent_s if first else costs.least_s
    if not budget_s >= least:
        raise InputError(f"the budget of {budget_s:g} s is less than one station takes, {least:g} s")
    ways = [begun]
    for seed in np.argsort(-begun.gains(), kind="stable")[:_SEEDS].tolist():
        if begun.spent_s + begun.added_s()[seed] <= budget_s:
            ways.append(begun.copy())
            ways[-1].add(seed)
    ways = [filled for way in ways for filled in way.filled(budget_s)]
    best = _improved(max(ways, key=lambda way: way.weight), budget_s, rng)
    return Within(tuple(best.chosen), best.weight, best.spent_s)


def _improved(best: _Choice, budget_s: float, rng: np.random.Generator) -> _Choice:
    """The choice after ruins of single stations, until none helps, and of random few."""
    enough = _GAIN * max(best.instance.coverable_weight, 1e-300)

    def without(ruined: list[int]) -> _Choice | None:
        tried = best.copy()
        for candidate in ruined:
            tried.drop(candidate)
        better = max(tried.filled(budget_s), key=lambda way: way.weight)
        return better if better.weight > best.weight + enough else None

    helped = True
    while helped:
        helped = False
        for candidate in best.chosen[best.n_fixed :]:
            better = without([candidate])
            if better is not None:
                best, helped = better, True
                break
    for _ in range(_ROUNDS):
        free = best.chosen[best.n_fixed :]
        if len(free) < 2:
            return best
        n = int(rng.integers(2, max(int(_RUINED * len(free)), 2) + 1))
        best = without([free[k] for k in sorted(rng.choice(len(free), n, replace=False).tolist())]) or best
    return best


def most_covered(
    instance: CoverInstance, n_most: int, rng: np.random.Generator | int | None = None
) -> list[int]:
    """Choose the `n_most` candidates that cover most; `rng` drives the search."""
    useful = reduce_instance(replace(instance, target=min(instance.target, 1 - 1e-9))).candidates
    fewer = replace(instance, matrix=instance.matrix[useful])
    found = choose_within(fewer, SiteCosts.counted(len(useful)), float(n_most), rng=rng)
    return [int(useful[k]) for k in found.chosen]


def most_of(instance: CoverInstance, n_most: int, n_chosen: int, weight: float) -> float:
    """Weight that no `n_most` candidates exceed, by the multipliers for what `n_chosen` cover."""
    whole = instance.coverable_weight
    if not whole or weight >= whole * (1 - 1e-12):
        return whole
    asked = CoverInstance(instance.matrix, instance.weights, min(weight / whole, 1 - 1e-6), instance.fold)
    certificate = find_certificate(reduce_instance(asked), asked.weights, n_chosen)
    return min(whole, most_by(certificate, asked, n_most))


def most_by(certificate: Certificate, instance: CoverInstance, n_most: int) -> float:
    """Weight that a certificate proves no `n_most` candidates exceed; inf where it prices no weight."""
    if not certificate.price:
        return np.inf
    more = (Fraction(n_most) - certificate.value(instance)) / Fraction(certificate.price)
    return float(Fraction(instance.wanted) + more) + 1e-9 * instance.coverable_weight
