# SPDX-License-Identifier: MIT
"""Choices within a budget: beside the exact optimum of small instances, the certified bound, errors."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse import csr_array

from nbv.cover.instance import CoverInstance
from nbv.cover.pipeline import CoverOptions, find_cover
from nbv.cover.within import SiteCosts, choose_within, most_covered, most_of
from scenes.checks import InputError

SET_UP_S = 60.0


def discs(seed: int, n_candidates: int = 9) -> tuple[CoverInstance, SiteCosts]:
    """Candidates in a square of 10 m that see discs of points, scans of two lengths, 8 s a metre to walk."""
    rng = np.random.default_rng(seed)
    at, points = rng.uniform(0, 10, (n_candidates, 2)), rng.uniform(0, 10, (80, 2))
    reach = rng.uniform(1.5, 3.5, n_candidates)
    seen = np.linalg.norm(at[:, None] - points, axis=2) < reach[:, None]
    travel = 8 * np.linalg.norm(at[:, None] - at, axis=2)
    scans = rng.choice([40.0, 90.0], n_candidates)
    instance = CoverInstance(csr_array(seen.astype(np.int8)), rng.uniform(0.2, 1, 80))
    return instance, SiteCosts(scans, np.arange(n_candidates), travel, SET_UP_S)


def exact_most(instance: CoverInstance, costs: SiteCosts, budget_s: float) -> float:
    """The most that any choice within the budget covers: shortest open tours of all subsets (Held, Karp)."""
    m = instance.n_candidates
    shortest = np.full((1 << m, m), np.inf)
    shortest[1 << np.arange(m), np.arange(m)] = 0.0
    best = 0.0
    for subset in range(1, 1 << m):
        inside = [k for k in range(m) if subset >> k & 1]
        for new in set(range(m)) - set(inside):
            ways = shortest[subset, inside] + costs.travel_s[inside, new]
            into = subset | 1 << new
            shortest[into, new] = min(shortest[into, new], ways.min())
        spent = shortest[subset, inside].min() + costs.scan_s[inside].sum() + SET_UP_S * len(inside)
        if spent <= budget_s + 1e-9:
            best = max(best, instance.covered_weight(inside))
    return best


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_choices_are_within_five_percent_of_an_exact_solver(seed) -> None:
    instance, costs = discs(seed)
    for budget_s in (400.0, 650.0):
        found = choose_within(instance, costs, budget_s, rng=0)
        optimum = exact_most(instance, costs, budget_s)
        assert 0.95 * optimum <= found.weight <= optimum + 1e-9
        n_most = costs.most_stations(budget_s)
        assert most_of(instance, n_most, len(found.chosen), found.weight) >= optimum - 1e-9
        assert found.spent_s <= budget_s
        assert found.weight == pytest.approx(instance.covered_weight(list(found.chosen)))


def test_what_is_given_is_kept_and_begins_the_tour() -> None:
    instance, costs = discs(3)
    found = choose_within(instance, costs, 500.0, first=(4,), rng=0)
    assert found.chosen[0] == 4
    with pytest.raises(InputError, match="less than one station takes"):
        choose_within(instance, costs, 50.0)


def test_the_most_for_a_number_of_views_is_proved() -> None:
    """Of three views no choice sees more than the bound, which lies close to the best of all."""
    instance, _ = discs(5)
    numbers = range(instance.n_candidates)
    best = max(instance.covered_weight([a, b, c]) for a in numbers for b in range(a) for c in range(b))
    found = most_covered(instance, 3, rng=0)
    assert len(found) == 3
    assert instance.covered_weight(found) == pytest.approx(best)
    assert best - 1e-9 <= most_of(instance, 3, 3, best) <= 1.25 * best
    cover = find_cover(instance, CoverOptions(polish_steps=100), n_most=3, rng=0)
    assert instance.covered_weight(list(cover.chosen)) == pytest.approx(best)
