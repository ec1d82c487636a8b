# SPDX-License-Identifier: MIT
"""Plans that are resumed from scans: what was measured stays measured, and the next view is the same."""

import json
from dataclasses import replace

import numpy as np
import pytest

from nbv.cover.pipeline import CoverOptions
from nbv.online.occupancy import EMPTY, VoxelMap
from nbv.online.planner import PlannerOptions, explore
from nbv.plan.baselines import compare_with_baselines
from nbv.plan.plan import read_plan
from nbv.plan.planning import plan_views
from nbv.report.coverage_report import plan_page
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import PinholeSensor
from nbv.visibility.clearance import Clearance
from nbv.visibility.requirement import Requirement
from nbv.visibility.samples import sample_surface
from nbv.visibility.viewpoints import Candidates, room_lattice, sphere_directions
from scenes.checks import InputError
from scenes.pose import Pose
from scenes.world.builtin import builtin_scene
from tests.helpers.long_cases import first_in_gate

ROOM = builtin_scene("two_occluders")
SAMPLES = sample_surface(ROOM.mesh, 0.2)
SENSOR = PinholeSensor(fov_deg=70, width=160, height=160, name="small")
COARSE = PlannerOptions(voxel_m=0.2)
CORNER = Pose.looking_at(np.array([0.6, 0.6, 1.6]), np.array([5.0, 4.0, 0.8]))
QUICK = CoverOptions(polish_steps=0)
LATTICE = room_lattice(ROOM.mesh.bounds(), spacing_m=1.0)
CANDIDATES = Candidates(LATTICE[Clearance.of(ROOM.mesh, 0.3).holds(LATTICE)], sphere_directions(0))


def plan_room(method, scans=(), **more):
    fixed = {"candidates": CANDIDATES, "samples": SAMPLES, "options": COARSE, "budgets": QUICK}
    return plan_views(ROOM, SENSOR, method=method, scans=scans, rng=0, n_threads=2, **fixed, **more)


def scans_of(views):
    return [scan_scene(ROOM, view, rng=0) for view in views]


@pytest.fixture(scope="module")
def plans():
    return {method: plan_room(method, target=0.8) for method in ("nbv", "cover")}


@pytest.mark.parametrize("method", first_in_gate(1, ["cover", "nbv"]))
def test_what_scans_have_met_counts_and_only_the_rest_is_planned(plans, method):
    whole = plans[method]
    given = scans_of(whole.views[:5])
    resumed = plan_room(method, given, target=0.8)
    before = whole.views[4].met_fraction
    assert resumed.resumed_from.met_fraction == pytest.approx(before, abs=0.02)
    assert len(resumed.views) <= len(whole.views) - 2
    assert resumed.views[0].met_fraction > resumed.resumed_from.met_fraction
    assert resumed.coverage.met >= 0.8 * resumed.coverage.reachable
    gained = sum(view.gain_m2 for view in resumed.views) / SAMPLES.total_m2
    assert gained + resumed.resumed_from.met_fraction == pytest.approx(resumed.coverage.met)


@pytest.mark.parametrize("method", ["nbv", "cover"])
def test_scans_that_meet_the_target_leave_nothing_to_plan(plans, method):
    done = plan_room(method, scans_of(plans[method].views), target=0.7)
    assert done.views == ()
    assert "target met" in done.stopped_because
    assert done.coverage.met == pytest.approx(done.resumed_from.met_fraction)


def test_the_bound_counts_views_beyond_the_scans(plans):
    whole = plans["cover"]
    resumed = plan_room("cover", scans_of(whole.views[:5]), target=0.8)
    assert resumed.lower_bound.views <= len(resumed.views)
    assert resumed.lower_bound.views >= whole.lower_bound.views - 6


@pytest.mark.long
def test_the_full_target_stays_full(plans):
    views = plans["cover"].views[:5]
    resumed = plan_room("cover", scans_of(views), target=1.0)
    assert resumed.coverage.met == pytest.approx(resumed.coverage.reachable)


def explore_room(start, given=(), most=4):
    candidates = Candidates(LATTICE, sphere_directions(1))
    return explore(
        lambda pose: scan_scene(ROOM, pose, SENSOR, rng=0),
        ROOM.mesh.bounds(),
        start,
        candidates,
        SENSOR,
        options=replace(COARSE, max_views=most),
        given=given,
        n_threads=1,
    )


def test_the_next_view_is_the_one_that_an_unbroken_run_takes():
    whole = explore_room(CORNER)
    poses = [step.world_from_sensor for step in whole.steps]
    resumed = explore_room(None, [scan_scene(ROOM, pose, SENSOR, rng=0) for pose in poses[:2]], 1)
    assert resumed.steps[0].world_from_sensor.matrix.tobytes() == poses[2].matrix.tobytes()
    assert resumed.steps[0].expected_gain_m2 == whole.steps[2].expected_gain_m2


def test_exploring_needs_a_start_or_scans():
    with pytest.raises(InputError, match="pose to start from"):
        explore_room(None)


def test_pixels_without_return_say_nothing_when_another_instrument_took_them():
    scan = scan_scene(ROOM, CORNER, replace(SENSOR, max_range_m=2.0), rng=0)
    assert not scan.valid.all()
    blank = VoxelMap.unknown(ROOM.mesh.bounds(), voxel_m=0.2)
    ours, foreign = blank.integrate(scan, SENSOR), blank.integrate(scan, None)
    free = np.flatnonzero(foreign.labels == EMPTY)
    assert 0 < len(free) < (ours.labels == EMPTY).sum()
    distance = np.linalg.norm(foreign.grid.centres(free) - scan.origin, axis=1)
    assert distance.max() < 2.0
    assert (ours.labels[free] == EMPTY).all()


@pytest.mark.parametrize("method", ["nbv", "cover"])
def test_scans_of_another_place_are_refused(method):
    scan = scan_scene(ROOM, CORNER, SENSOR, rng=0)
    away = scan.transform(Pose.from_parts(np.eye(3), np.array([100.0, 0, 0])))
    with pytest.raises(InputError, match=r"measures none of \d+ places of two_occluders: its poses"):
        plan_room(method, [away])


def test_cover_does_not_count_scans_towards_several_views():
    scan = scan_scene(ROOM, CORNER, SENSOR, rng=0)
    with pytest.raises(InputError, match=r"towards k = 2 views .* method nbv"):
        plan_room("cover", [scan], requirement=Requirement(k=2))


def test_plan_json_says_from_what_it_was_resumed_and_is_read_back(plans, tmp_path):
    scans = scans_of(plans["cover"].views[:2])
    content = plan_room("cover", scans, views=2).to_json()
    assert content["resumed_from"]["scans"] == 2
    assert 0 < content["resumed_from"]["met"] < content["coverage"]["met"]
    assert content["resumed_from"]["world_from_sensor"][1] == scans[1].world_from_sensor.matrix.tolist()
    file = tmp_path / "plan.json"
    file.write_text(json.dumps(content))
    assert read_plan(file).to_json() == content


@pytest.mark.long
def test_baselines_begin_with_what_the_scans_have_met(plans):
    scans = scans_of(plans["cover"].views[:5])
    plan = plan_room("cover", scans, views=3)
    found = compare_with_baselines(ROOM.ray_caster(1), plan, scans=scans, rng=0, n_threads=1)
    for baseline in found:
        assert (baseline.met[:, 0] >= plan.resumed_from.met_fraction - 0.01).all()
    assert found[0].met[0, -1] == pytest.approx(plan.coverage.met, abs=0.01)
    entry = found[1].to_json()
    assert entry["runs"] == 30
    assert entry["met"] == entry["curve"][-1]
    html = plan_page(ROOM, plan, plan.coverage, 1, found).to_html()
    assert "after 5 scans that measured" in html
    assert "Squares with letters" in html
