# SPDX-License-Identifier: MIT
"""Cover: plain greedy and exhaustive search as oracles, planted optima, exact reduction, the bench room."""

import json

import numpy as np
import pytest
from scipy.sparse import csr_array

from nbv.cover.dual import reduce_instance, solve_exactly
from nbv.cover.instance import CoverInstance
from nbv.cover.overlap import OverlapOptions
from nbv.cover.pipeline import CoverOptions, find_cover
from nbv.cover.swap_search import by_gain, choose_greedily, drop_redundant, polish
from nbv.plan.planning import plan_views
from nbv.scanning.sensor import PinholeSensor
from nbv.visibility.requirement import Requirement
from nbv.visibility.samples import sample_surface
from nbv.visibility.viewpoints import Candidates, load_candidates
from scenes.checks import InputError
from scenes.world.builtin import builtin_scene
from tests.helpers.cover_examples import meets, optimum, plain_greedy, planted_instance, random_instance
from tests.helpers.data_paths import bench_path
from tests.helpers.long_cases import first_in_gate

BENCH = bench_path("")
QUICK = CoverOptions(polish_steps=500)


def test_the_swap_search_ends_where_it_stagnates():
    rows = np.kron(np.eye(4), np.ones((2, 3)))  # each of four parts is seen by two candidates alike
    searched = polish(CoverInstance(csr_array(rows), np.ones(12)), [0, 2, 4, 6], 10**6, enough=0, rng=0)
    assert sorted(candidate // 2 for candidate in searched.chosen) == [0, 1, 2, 3]
    assert 1_500 * 4 <= searched.steps < 1_500 * 4 + 1_000
    assert not searched.was_cut_short


@pytest.mark.parametrize("fold", [1, 2])
def test_sums_over_what_is_seen_are_products_with_the_pattern(fold):
    instance = random_instance(3, target=0.9, fold=fold, whole=False)
    values = np.random.default_rng(0).random(instance.n_samples)
    assert instance.sums_seen(values) == pytest.approx((instance.matrix != 0).astype(float) @ values)


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("target", [0.6, 0.9, 1.0])
@pytest.mark.parametrize("fold", [1, 2])
def test_lazy_greedy_is_plain_greedy(seed, target, fold):
    instance = random_instance(seed, target=target, fold=fold, whole=True)
    chosen = choose_greedily(instance)
    assert chosen == plain_greedy(instance)
    assert meets(instance, chosen)


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize(("target", "fold"), [(1.0, 1), (0.8, 1), (1.0, 2), (0.8, 2)])
def test_reduction_keeps_the_optimum(seed, target, fold):
    instance = random_instance(seed, (9, 20), 0.3, target=target, fold=fold)
    reduction = reduce_instance(instance)
    assert reduction.instance.coverable.all()
    assert optimum(reduction.instance) == optimum(instance)
    chosen = [int(reduction.candidates[c]) for c in choose_greedily(reduction.instance)]
    assert meets(instance, chosen)


def test_reduction_merges_and_drops():
    rows = np.array([[1, 1, 0, 0, 0], [1, 1, 1, 0, 0], [0, 0, 1, 1, 0], [0, 0, 0, 1, 0]])
    full = reduce_instance(CoverInstance(csr_array(rows), np.ones(5)))
    assert full.candidates.tolist() == [1, 2]
    assert full.sample_of.tolist() == [0, 0, -1, 1, -1]  # 1 is 0 again, 2 is implied, 4 not coverable
    partial = reduce_instance(CoverInstance(csr_array(rows), np.ones(5), 0.5))
    assert partial.instance.weights.tolist() == [2.0, 1.0, 1.0]
    assert partial.candidates.tolist() == [1, 2]
    twice = reduce_instance(CoverInstance(csr_array(rows), np.ones(5), fold=2))
    assert twice.candidates.tolist() == [0, 1, 2, 3]


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize(("target", "fold"), [(1.0, 1), (0.8, 1), (1.0, 2), (0.7, 2)])
def test_small_covers_are_optimal_by_search_and_by_branch_and_bound(seed, target, fold):
    instance = random_instance(seed, (10, 20), 0.3, target=target, fold=fold)
    best = optimum(instance)
    reduced = reduce_instance(instance).instance
    exact = solve_exactly(reduced, 1000)
    assert exact is not None
    assert len(exact) == best
    searched = polish(reduced, drop_redundant(reduced, choose_greedily(reduced)), 2000, rng=seed)
    assert meets(reduced, searched.chosen)
    assert len(searched.chosen) == best
    cover = find_cover(instance, QUICK, rng=seed)
    assert meets(instance, cover.chosen)
    assert cover.is_smallest
    assert cover.bound.views == len(cover.chosen) == best


@pytest.mark.parametrize("seed", range(5))
def test_planted_partition_is_found(seed):
    instance = planted_instance(seed)
    cover = find_cover(instance, CoverOptions(exact_entries=0), rng=0)
    assert sorted(cover.chosen) == list(range(25, 32))
    assert cover.bound.views == 7
    assert cover.bound.kind == "dual of the linear relaxation, checked exactly"


@pytest.mark.parametrize("seed", range(3))
def test_a_planted_cover_is_found_by_swaps_where_greedy_misses_it(seed):
    rng = np.random.default_rng(seed)
    rows = np.zeros((112, 120))
    rows[np.arange(120) // 10, rng.permutation(120)] = 1
    for decoy in rows[12:]:  # larger than the planted twelve, and across them
        decoy[rng.choice(120, 11, replace=False)] = 1
    instance = CoverInstance(csr_array(rows), np.ones(120))
    assert len(drop_redundant(instance, choose_greedily(instance))) > 16
    cover = find_cover(instance, CoverOptions(polish_steps=5000, exact_entries=0), rng=0)
    assert sorted(cover.chosen) == list(range(12))


def test_reverse_deletion_drops_what_greedy_took_too_much():
    rows = csr_array(np.array([[0, 1, 1, 1, 1, 0], [1, 1, 1, 0, 0, 0], [0, 0, 0, 1, 1, 1]]))
    instance = CoverInstance(rows, np.ones(6))
    assert choose_greedily(instance) == [0, 1, 2]
    assert drop_redundant(instance, [0, 1, 2]) == [1, 2]


def test_order_by_gain_falls_and_covers_the_same():
    instance = random_instance(3)
    chosen = drop_redundant(instance, choose_greedily(instance))
    ordered = by_gain(instance, chosen[::-1])
    covered = [instance.covered_weight(ordered[:k]) for k in range(len(ordered) + 1)]
    gains = np.diff(covered)
    assert sorted(ordered) == sorted(chosen)
    assert (np.diff(gains) <= 1e-12).all()  # coverage grows with each, by less and less
    assert (gains > 0).all()


def test_budgets_change_what_is_found_and_seeds_repeat_it():
    instance = random_instance(5, (300, 200), 0.05)
    found = [
        len(find_cover(instance, CoverOptions(polish_steps=n, exact_entries=0), rng=0).chosen)
        for n in (0, 3000)
    ]
    assert found[1] < found[0]
    options, stages = CoverOptions(polish_steps=300, exact_entries=0), []
    once = find_cover(instance, options, rng=7, progress=lambda *stage: stages.append(stage))
    again = find_cover(instance, options, rng=7)
    assert {stage for stage, _, _ in stages} == {"cover", "bound", "polish"}
    assert stages[-1] == ("polish", 300, 300)
    assert once.chosen == again.chosen
    assert not once.was_cut_short
    cut = find_cover(instance, CoverOptions(polish_steps=50_000, exact_entries=0, time_budget_s=0.0), rng=7)
    assert cut.was_cut_short
    assert cut.steps == 500
    small = random_instance(2, (10, 20), 0.3)
    assert find_cover(small, CoverOptions(polish_steps=0, exact_nodes=1000), rng=0).is_smallest


def test_a_limit_of_views_and_nothing_to_see():
    instance = random_instance(0)
    cover = find_cover(instance, QUICK, n_most=2)
    assert len(cover.chosen) == 2
    assert not cover.is_complete
    assert instance.covered_weight(cover.chosen) >= instance.covered_weight(
        choose_greedily(instance, n_most=2)
    )
    nothing = find_cover(CoverInstance(csr_array((3, 5)), np.ones(5)))
    assert nothing.chosen == ()
    assert nothing.is_smallest
    assert nothing.bound.views == 0


def test_unusable_input_is_refused():
    matrix = random_instance(0).matrix
    with pytest.raises(InputError, match="3 weights for 60 samples"):
        CoverInstance(matrix, np.ones(3))
    with pytest.raises(InputError, match="not negative"):
        CoverInstance(matrix, -np.ones(60))
    with pytest.raises(InputError, match=r"0 to 1, got 1\.5"):
        CoverInstance(matrix, np.ones(60), 1.5)
    with pytest.raises(InputError, match="at least once, got fold = 0"):
        CoverInstance(matrix, np.ones(60), fold=0)
    with pytest.raises(InputError, match="at least one view, got 0"):
        find_cover(random_instance(0), n_most=0)
    with pytest.raises(InputError, match="budgets of a cover must not be negative"):
        CoverOptions(polish_steps=-1)


@pytest.mark.long
@pytest.mark.skipif(not BENCH.is_dir(), reason="the benchmark instances are not here (UNSEEN_BENCH)")
def test_the_benchmark_room_takes_24_views_or_fewer_and_21_at_least():
    plan = plan_views(
        builtin_scene("two_occluders"),
        method="cover",
        candidates=load_candidates(BENCH / "room_candidates.npz"),
        max_incidence_deg=60,
        target=1.0,
        budgets=CoverOptions(polish_steps=8_000),
        rng=1,
    )
    assert len(plan.views) <= 24
    assert plan.n_candidates == 14_868
    assert plan.coverage.reachable == 1.0
    assert plan.coverage.met == pytest.approx(1.0, abs=1e-12)
    assert plan.lower_bound is not None
    assert plan.lower_bound.views == 21


def test_equal_seeds_give_equal_plans_for_any_number_of_threads():
    room = builtin_scene("two_occluders")
    rng = np.random.default_rng(0)
    candidates = Candidates(
        rng.uniform([0.4, 0.4, 1.2], [5.6, 4.6, 2.2], (50, 3)), np.vstack([np.eye(3), -np.eye(3)])
    )
    once, again = (
        plan_views(
            room,
            PinholeSensor(fov_deg=90, width=90, height=90),
            method="cover",
            candidates=candidates,
            samples=sample_surface(room.mesh, 0.25),
            overlap=OverlapOptions(),
            budgets=CoverOptions(polish_steps=2000),
            rng=5,
            n_threads=n,
        )
        for n in (1, 2)
    )
    assert json.dumps(once.to_json()) == json.dumps(again.to_json())
    assert json.dumps(once.stations.to_json()) == json.dumps(again.stations.to_json())
    assert once.seed == 5


@pytest.mark.parametrize("target", first_in_gate(1, [1.0, 0.9]))
def test_a_requirement_that_nothing_meets_needs_no_views_and_says_so(target):
    nothing = find_cover(CoverInstance(csr_array(np.zeros((3, 4))), np.ones(4), target))
    assert nothing.chosen == ()
    assert nothing.bound.views == 0
    scene = builtin_scene("chair_before_wall")
    sensor = PinholeSensor(fov_deg=60, width=60, height=60)
    plan = plan_views(scene, sensor, method="cover", requirement=Requirement(k=5000), target=target, rng=0)
    assert plan.views == ()
    assert plan.coverage.reachable == 0
    assert plan.stopped_because == "no candidate can measure anything as required"


def test_a_bound_of_more_candidates_is_kept_and_not_sought_anew():
    rng = np.random.default_rng(5)
    rows = csr_array((rng.random((40, 60)) < 0.12).astype(float))
    whole = CoverInstance(rows, np.ones(60))
    first = find_cover(whole, rng=0)
    fewer = whole.only(np.arange(40) % 2 == 0)
    again = find_cover(fewer, relaxed=first, rng=0)
    alone = find_cover(fewer, rng=0)
    assert (again.bound, again.certificate) == (first.bound, first.certificate)
    assert set(again.chosen) <= set(range(0, 40, 2))
    assert fewer.is_met_by(fewer.times_seen(again.chosen))
    assert len(alone.chosen) <= len(again.chosen) <= len(alone.chosen) + 2
