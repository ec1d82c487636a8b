# SPDX-License-Identifier: MIT
"""Baselines: order of strength, laws of their curves, and farthest points by brute force."""

from dataclasses import replace

import numpy as np
import pytest

from nbv.cover.pipeline import CoverOptions
from nbv.plan.baselines import PLAN, Baseline, compare_with_baselines, farthest_poses
from nbv.plan.planning import plan_views
from nbv.report.coverage_report import plan_page
from nbv.scanning.sensor import PinholeSensor
from nbv.scanning.sensor_profile import load_sensor
from nbv.visibility.requirement import Requirement
from nbv.visibility.samples import sample_surface
from nbv.visibility.viewpoints import Candidates, sphere_directions
from scenes.checks import InputError
from scenes.world.builtin import builtin_scene
from tests.helpers.long_cases import first_in_gate

ROOM = builtin_scene("two_occluders")
SAMPLES = sample_surface(ROOM.mesh, 0.3)
SENSOR = PinholeSensor(fov_deg=60, width=80, height=80)
PANORAMA = load_sensor("panorama")


@pytest.fixture(scope="module")
def plan():
    budgets = CoverOptions(polish_steps=300)
    return plan_views(ROOM, SENSOR, method="cover", views=10, target=1.0, samples=SAMPLES, budgets=budgets)


@pytest.fixture(scope="module")
def baselines(plan):
    return compare(plan, n_threads=1)


def compare(plan, **options):
    return compare_with_baselines(ROOM.ray_caster(1), plan, rng=0, **options)


@pytest.mark.long
def test_they_are_all_there_and_their_coverage_only_grows(plan, baselines):
    names = [baseline.name for baseline in baselines]
    assert names == [PLAN, "random", "farthest-point", "visibility-only greedy", "greedy"]
    assert [len(baseline.met) for baseline in baselines] == [1, 30, 30, 1, 1]
    for baseline in baselines:
        assert baseline.met.shape[1] == len(plan.views)
        assert (np.diff(baseline.met, axis=1) >= 0).all()
    assert baselines[0].met[0, -1] == pytest.approx(plan.coverage.met, abs=0.01)


def test_knowing_more_reaches_more(baselines):
    _, random, _, visibility, greedy = (np.median(baseline.met[:, -1]) for baseline in baselines)
    assert greedy > visibility
    assert greedy > random + 0.2


def test_greedy_choice_is_close_to_the_cover_planner_but_no_better(plan, baselines):
    assert 0.9 * plan.coverage.met <= baselines[-1].met[0, -1] <= plan.coverage.met


def test_results_depend_on_the_seed_alone(plan, baselines):
    again = compare(plan, n_threads=2)
    for one, other in zip(baselines, again, strict=True):
        assert one.met.tobytes() == other.met.tobytes()


def test_views_to_a_share_are_counted_from_one():
    curve = Baseline("x", False, np.array([[0.2, 0.5, 0.9], [0.1, 0.2, 0.3]]))
    assert curve.views_to(0.5).tolist() == [2.0, np.inf]
    assert curve.views_to(0.1).tolist() == [1.0, 1.0]


def test_farthest_poses_are_farthest_by_brute_force():
    candidates = Candidates(np.random.default_rng(0).normal(size=(7, 3)), sphere_directions(0))
    extent = np.linalg.norm(np.ptp(candidates.positions, axis=0))
    poses = np.array([[*(p / extent), *(d / 2)] for p in candidates.positions for d in candidates.directions])
    chosen = farthest_poses(candidates, 5, 6)
    assert chosen[0] == 5
    for k in range(1, 6):
        nearest = np.linalg.norm(poses[:, None] - poses[chosen[:k]], axis=2).min(axis=1)
        assert nearest[chosen[k]] == pytest.approx(nearest.max())


@pytest.mark.parametrize("spacing", [0.3, pytest.param(0.1, marks=pytest.mark.long)])
@pytest.mark.parametrize(
    ("sensor", "target", "k"), first_in_gate(1, [(PANORAMA, 0.99, 1), (SENSOR, 0.95, 1), (PANORAMA, 0.95, 2)])
)
def test_no_baseline_stands_below_the_certified_bound(sensor, target, k, spacing):
    plan = plan_views(
        ROOM, sensor, method="cover", target=target, samples=sample_surface(ROOM.mesh, spacing), rng=0,
        requirement=Requirement(k=k), budgets=CoverOptions(polish_steps=0),
    )  # fmt: skip
    found = {baseline.name: baseline for baseline in compare(plan)}
    share = target * plan.coverage.reachable
    assert found[PLAN].views_to(share).min() == len(plan.views)
    assert np.isfinite(found["greedy"].views_to(share - 0.01)).all()  # it gets there, or nearly
    for baseline in found.values():
        assert baseline.views_to(share).min() >= plan.lower_bound.views


def test_the_plan_s_own_curve_is_that_of_its_coverage(plan, baselines):
    assert baselines[0].met[0, -1] == pytest.approx(plan.coverage.met, abs=1e-12)
    assert baselines[0].met[0].tolist() == pytest.approx([view.met_fraction for view in plan.views])


def test_a_blind_sensor_leaves_every_planner_with_nothing(plan):
    blind = PinholeSensor(fov_deg=60, width=80, height=80, min_range_m=50.0, max_range_m=60.0)
    for baseline in compare(replace(plan, sensor=blind))[1:]:
        assert not baseline.met.any()


def test_a_plan_without_views_is_refused(plan):
    with pytest.raises(InputError, match="without views"):
        compare(replace(plan, views=()))


def test_a_plan_of_a_file_is_refused(plan):
    with pytest.raises(InputError, match="read from a file"):
        compare(replace(plan, coverage=plan.coverage.summary(), candidates=None))


def test_the_report_of_a_plan_shows_them(plan, baselines, tmp_path):
    file = tmp_path / "report.html"
    plan_page(ROOM, plan, plan.coverage, 1, baselines).write(file)
    text = file.read_text("utf-8")
    assert "Beside other planners" in text
    assert "greedy may be ahead at fewer views" in text
    assert "The last column counts the views to 95 % of what this plan measures" in text
    assert all(name in text for name in ("random", "farthest-point", "visibility-only greedy"))
