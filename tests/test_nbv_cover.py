# SPDX-License-Identifier: MIT
"""Cover and bound: plain greedy as oracle, planted optima, the room of the benchmark."""

import os
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from scipy.sparse import csr_array

from nbv.bound import marginal_bound
from nbv.cover import coverable_weight, covered_weight, drop_redundant, greedy_cover
from nbv.planning import plan_views
from nbv.viewpoints import load_candidates
from scenes.builtin import builtin_scene
from scenes.checks import InputError

BENCH = Path(os.environ.get("UNSEEN_BENCH", Path(__file__).parents[2] / "shared" / "bench"))


def random_rows(seed: int, shape: tuple[int, int] = (40, 60), density: float = 0.1) -> csr_array:
    return csr_array(np.random.default_rng(seed).uniform(size=shape) < density).astype(float)


def plain_greedy(matrix: csr_array, weights: np.ndarray, wanted: float) -> list[int]:
    dense, left, chosen = matrix.toarray() > 0, weights.copy(), []
    while covered_weight(matrix, weights, chosen) < wanted - 1e-9:
        gains = dense @ left
        chosen.append(int(np.argmax(gains)))
        left[dense[chosen[-1]]] = 0
    return chosen


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("target", [0.6, 0.9, 1.0])
def test_lazy_greedy_is_plain_greedy(seed, target):
    matrix = random_rows(seed)
    weights = np.random.default_rng(seed).integers(1, 9, 60).astype(float)
    wanted = target * coverable_weight(matrix, weights)
    plain = plain_greedy(matrix, weights, wanted)
    cover = greedy_cover(matrix, weights, target)
    assert list(cover.chosen) == drop_redundant(matrix, weights, plain, wanted)
    assert cover.is_complete
    assert cover.covered >= wanted - 1e-9


def test_planted_partition_is_found():
    rng = np.random.default_rng(3)
    planted = np.zeros((7, 70))
    planted[np.arange(70) // 10, np.arange(70)] = 1
    noise = np.zeros((50, 70))
    noise[np.repeat(np.arange(50), 4), rng.integers(0, 70, 200)] = 1
    rows = np.vstack([noise[:25], planted, noise[25:]])
    cover = greedy_cover(csr_array(rows), np.ones(70))
    assert sorted(cover.chosen) == list(range(25, 32))
    assert marginal_bound(csr_array(rows), np.ones(70), 1.0, cover.chosen).views == 7


def test_reverse_deletion_drops_what_greedy_took_too_much():
    rows = csr_array(np.array([[0, 1, 1, 1, 1, 0], [1, 1, 1, 0, 0, 0], [0, 0, 0, 1, 1, 1]]))
    assert greedy_cover(rows, np.ones(6)).chosen == (1, 2)


@pytest.mark.parametrize("seed", range(5))
def test_bound_never_exceeds_the_optimum(seed):
    matrix, weights = random_rows(seed, (9, 20), 0.25), np.random.default_rng(seed).uniform(size=20)
    wanted = 0.9 * coverable_weight(matrix, weights)
    optimum = next(
        k
        for k in range(10)
        if any(covered_weight(matrix, weights, some) >= wanted - 1e-12 for some in combinations(range(9), k))
    )
    cover = greedy_cover(matrix, weights, 0.9)
    assert 1 <= marginal_bound(matrix, weights, 0.9, cover.chosen).views <= optimum <= len(cover.chosen)


def test_a_limit_of_views_and_nothing_to_see():
    matrix = random_rows(0)
    cover = greedy_cover(matrix, np.ones(60), n_most=2)
    assert len(cover.chosen) == 2
    assert not cover.is_complete
    nothing = greedy_cover(csr_array((3, 5)), np.ones(5))
    assert nothing.chosen == ()
    assert nothing.is_complete
    assert marginal_bound(csr_array((3, 5)), np.ones(5), 1.0).views == 0


def test_unusable_input_is_refused():
    matrix = random_rows(0)
    with pytest.raises(InputError, match="3 weights for 60 columns"):
        greedy_cover(matrix, np.ones(3))
    with pytest.raises(InputError, match="not negative"):
        greedy_cover(matrix, -np.ones(60))
    with pytest.raises(InputError, match=r"0 to 1, got 1\.5"):
        marginal_bound(matrix, np.ones(60), 1.5)
    with pytest.raises(InputError, match="at least one view, got 0"):
        greedy_cover(matrix, np.ones(60), n_most=0)


@pytest.mark.skipif(not BENCH.is_dir(), reason="the benchmark instances are not here (UNSEEN_BENCH)")
def test_the_benchmark_room_takes_as_many_views_as_greedy_takes():
    candidates = load_candidates(BENCH / "room_candidates.npz")
    room = builtin_scene("two_occluders")
    plan = plan_views(room, method="cover", candidates=candidates, max_incidence_deg=60, target=0.99)
    assert len(plan.views) == 22
    assert plan.n_candidates == 14_868
    assert plan.coverage.reachable == 1.0
    assert plan.coverage.met >= 0.99
    assert plan.lower_bound is not None
    assert plan.lower_bound.views <= 21
    assert len(plan_views(room, method="cover", candidates=candidates, target=1.0).views) <= 31
