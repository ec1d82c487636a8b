# SPDX-License-Identifier: MIT
"""Plans: the online loop, its reasons to stop, same seed same bytes, plan.json there and back."""

import json
from dataclasses import replace

import numpy as np
import pytest

import nbv
from nbv.online.planner import PlannerOptions, explore
from nbv.online.targets import GainOptions
from nbv.plan.plan import read_plan
from nbv.plan.planning import plan_views
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import PinholeSensor
from nbv.visibility.samples import sample_surface
from nbv.visibility.site_options import SiteOptions
from nbv.visibility.viewpoints import Candidates, viewing_sphere
from nbv.visibility.zones import Box, Zones
from scenes.checks import InputError
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.pose import Pose
from scenes.world.builtin import builtin_scene
from scenes.world.scene import Scene

ROOM = builtin_scene("two_occluders")
SAMPLES = sample_surface(ROOM.mesh, 0.15)
SENSOR = PinholeSensor(fov_deg=60, width=120, height=120, name="small")
COARSE = PlannerOptions(voxel_m=0.15)


def box() -> Scene:
    """A box of 0.2 x 0.2 x 0.2 m."""
    corners = np.array([[x, y, z] for x in (0, 0.2) for y in (0, 0.2) for z in (0, 0.2)])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = np.array([[q[0], *pair] for q in quads for pair in (q[1:3], q[2:4])])
    return Scene(LabelledMesh(corners, faces), (None,), ("box",), "box", "object")


@pytest.fixture(scope="module")
def room_plan():
    return plan_views(ROOM, SENSOR, target=0.95, samples=SAMPLES, options=COARSE, rng=0, n_threads=1)


def test_the_online_planner_covers_the_room(room_plan):
    coverage = room_plan.coverage
    assert len(room_plan.views) <= 30  # 23 where a station may stand on the box of 1.8 m
    assert coverage.met >= 0.95 * coverage.reachable
    assert coverage.reachable >= 0.995  # of what bounds the room
    under_boxes = 2 * (1.4 * 1.0 + 0.7 * 0.7)  # their bottoms, and the floor below
    assert sum(coverage.apart_m2.values()) == pytest.approx(under_boxes, rel=0.05)
    assert room_plan.stopped_because == "target met on the true scene: 0.95 of the reachable area"
    met = [view.met_fraction for view in room_plan.views]
    assert met == sorted(met)
    assert met[-1] == pytest.approx(coverage.met)
    gains = sum(view.gain_m2 for view in room_plan.views)
    assert gains == pytest.approx(coverage.met * coverage.total_m2)


@pytest.mark.parametrize(
    ("name", "value"), [("max_incidence_deg", 70), ("max_incidence_deg", 60), ("max_range_m", 3)]
)
def test_a_requirement_beside_single_values_is_refused(name, value):
    required = nbv.Requirement(max_incidence_deg=50, max_range_m=4.0)
    with pytest.raises(
        InputError, match=f"give requirement or {name}, not both: .* beside it stands {value}"
    ):
        plan_views(ROOM, requirement=required, **{name: value})


def test_a_plan_is_saved_and_read_back(room_plan, tmp_path):
    room_plan.save(tmp_path / "one.json")
    room_plan.save(tmp_path / "all")
    names = {file.name for file in (tmp_path / "all").iterdir() if not file.name.startswith(".")}
    assert names == {"plan.json", "plan.csv", "trajectory.txt", "coverage.json", "stations.json"}
    for file in (tmp_path / "one.json", tmp_path / "all" / "plan.json"):
        assert nbv.read_plan(file).to_json() == room_plan.to_json()
    with pytest.raises(InputError, match="nowhere"):
        room_plan.save(tmp_path / "nowhere" / "plan.json")


def test_public_objects_tell_themselves_in_a_line(room_plan):
    told = [room_plan, room_plan.coverage, room_plan.coverage.samples, room_plan.views[0]]
    told += [room_plan.candidates, room_plan.site, room_plan.stations.tour, room_plan.sensor]
    assert max(len(repr(one)) for one in told) < 250
    assert repr(room_plan).startswith("Plan('nbv', ")
    assert f"{len(room_plan.views)} views" in repr(room_plan)
    assert f"{room_plan.coverage.met:.4f}" in repr(room_plan.coverage)
    assert repr(room_plan.coverage.samples).startswith(f"SurfaceSamples({len(room_plan.coverage.samples)} ")


def test_online_plans_tell_the_way_from_scan_to_scan(room_plan):
    tour = room_plan.stations.tour
    assert tour.order == tuple(range(len(room_plan.views)))
    assert tour.is_given
    places = np.array([view.world_from_sensor.translation for view in room_plan.views])
    straight = np.linalg.norm(np.diff(places[:, :2], axis=0), axis=1).sum()
    assert tour.length_m >= straight - 1e-9 or tour.n_without_way
    assert room_plan.stations.overlaps is None


def test_candidates_can_be_made_and_given(room_plan):
    rooms = nbv.room_candidates(ROOM, SENSOR, nbv.SiteOptions(heights_m=(1.5,)), subdivisions=0)
    assert set(np.round(rooms.positions[:, 2], 6).tolist()) == {1.5}
    plan = plan_views(ROOM, SENSOR, method="random", candidates=rooms, samples=SAMPLES, views=1, rng=0)
    assert plan.n_candidates == rooms.n_poses
    box = nbv.sphere_candidates(builtin_scene("two_cylinders"), SENSOR, 50)
    assert 0 < box.n_positions < 50
    assert nbv.sphere_candidates(builtin_scene("two_cylinders"), SENSOR, 50, all_round=True).n_positions == 50
    with pytest.raises(InputError, match="n_positions must be at least 1, got 0"):
        nbv.sphere_candidates(ROOM, SENSOR, 0)


def test_a_single_value_has_its_effect():
    plan = plan_views(ROOM, SENSOR, samples=SAMPLES, views=1, method="random", max_incidence_deg=40, rng=0)
    assert plan.requirement == nbv.Requirement(max_incidence_deg=40)


def test_zones_of_the_options_count_and_are_not_given_twice():
    zones = Zones(Box(np.zeros(3), np.array([2.0, 2.0, 2.0])))
    options = replace(COARSE, zones=zones)
    plan = plan_views(ROOM, SENSOR, samples=SAMPLES, views=1, options=options, rng=0, n_threads=1)
    assert plan.zones is zones
    assert plan.coverage.total_m2 < SAMPLES.total_m2
    with pytest.raises(InputError, match=r"as zones and in options\.zones"):
        plan_views(ROOM, SENSOR, views=1, options=options, zones=Zones(keep_out=(zones.region,)))


@pytest.mark.long
def test_same_seed_same_bytes_for_any_number_of_threads(room_plan):
    again = plan_views(ROOM, SENSOR, target=0.95, samples=SAMPLES, options=COARSE, rng=0, n_threads=2)
    assert json.dumps(again.to_json()) == json.dumps(room_plan.to_json())
    other = plan_views(ROOM, SENSOR, views=2, samples=SAMPLES, options=COARSE, rng=5)
    assert other.to_json()["views"][0] != room_plan.to_json()["views"][0]


def test_views_stand_in_free_space(room_plan):
    for view in room_plan.views:
        x, y, z = view.world_from_sensor.translation
        assert 0.3 <= x <= 5.7
        assert 0.3 <= y <= 4.7
        assert 0.3 <= z <= 2.4
        assert not (1.2 < x < 3.2 and 1.2 < y < 2.8 and z < 1.2)


def test_plan_json_has_the_documented_form_and_is_read_back(room_plan, tmp_path):
    content = room_plan.to_json()
    assert list(content) == [
        *("method", "sensor", "requirement", "seed", "n_candidates"),
        *("views", "coverage", "lower_bound", "stopped_because"),
        *("inference", "resumed_from", "region", "keep_out", "rooms", "platforms"),
        *("time", "lost_if_blocked", "most_in_time"),
    ]
    assert list(content["views"][0]) == ["world_from_sensor", "gain_m2", "met_fraction"]
    assert list(content["coverage"]) == [
        *("total_m2", "met", "reachable", "unreachable", "inferred", "modelled", "unknown"),
        "standard_error",
    ]
    errors = content["coverage"]["standard_error"]
    assert list(errors) == ["met", "reachable", "unreachable", "inferred", "modelled", "unknown"]
    assert all(0 < error < 0.01 for error in errors.values())
    assert content["lower_bound"] is None
    assert content["seed"] == 0
    file = tmp_path / "plan.json"
    file.write_text(json.dumps(content))
    plan = read_plan(file)
    assert plan.to_json() == content
    assert plan.sensor == SENSOR
    scan = scan_scene(ROOM, plan.views[0], rng=0)
    assert scan.valid.any()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda c: c.pop("views"), "has no 'views'"),
        (lambda c: c["sensor"].update(kind="sonar"), "kind must be one of"),
        (lambda c: c["views"][0].update(world_from_sensor=[[1]]), r"pose with shape \(4, 4\)"),
        (lambda c: c["requirement"].update(extra=1), "is not a plan"),
    ],
)
def test_unusable_plans_are_refused(room_plan, tmp_path, change, message):
    content = json.loads(json.dumps(room_plan.to_json()))
    change(content)
    file = tmp_path / "plan.json"
    file.write_text(json.dumps(content))
    with pytest.raises(InputError, match=message):
        read_plan(file)


def test_files_that_are_no_plans_are_refused(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        read_plan(tmp_path / "absent.json")
    (tmp_path / "list.json").write_text("[1, 2]")
    with pytest.raises(InputError, match="is JSON, but not an object"):
        read_plan(tmp_path / "list.json")


def test_the_planner_stops_by_itself_on_what_its_voxels_say():
    found = explore_box(PlannerOptions())
    assert "marginal gain" in found.stopped_because or "nothing is unknown" in found.stopped_because
    assert 4 <= len(found.steps) <= 20
    surfels = found.voxels.surfels
    assert surfels.areas[surfels.quality >= 0.5].sum() == pytest.approx(6 * 0.04, rel=0.3)


def test_the_limit_of_views_and_the_callers_reason_stop_it_too():
    assert explore_box(PlannerOptions(max_views=2)).stopped_because == "the limit of 2 views is reached"
    assert explore_box(PlannerOptions(), finished=lambda: "tired").stopped_because == "tired"
    found = explore_box(PlannerOptions(epsilon_m2=10.0))
    assert found.stopped_because.startswith("marginal gain")
    assert len(found.steps) == 1


def explore_box(options: PlannerOptions, finished=None):
    scene = box()
    sensor = PinholeSensor(fov_deg=40, width=80, height=80, max_range_m=5)
    candidates = viewing_sphere(scene.mesh.bounds(), sensor, 60)
    options = replace(options, voxel_m=0.02)

    def scan(pose: Pose):
        return scan_scene(scene, pose, sensor)

    bounds = scene.mesh.bounds()
    return explore(
        scan,
        bounds,
        candidates.pose(0),
        candidates,
        sensor,
        None,
        options,
        from_outside=True,
        finished=finished,
    )


@pytest.mark.long
def test_both_methods_and_modes_reach_the_target_on_a_box():
    sensor = PinholeSensor(fov_deg=40, width=80, height=80)
    hanging = SiteOptions(all_round=True)
    plans = {
        m: plan_views(box(), sensor, method=m, site=hanging, target=0.99, rng=1) for m in ("nbv", "cover")
    }
    for plan in plans.values():
        assert plan.coverage.reachable == 1.0
        assert plan.coverage.met >= 0.99
        assert plan.coverage.met_of_reachable >= 0.99
    assert plans["cover"].lower_bound is not None
    assert plans["cover"].lower_bound.views <= len(plans["cover"].views) <= len(plans["nbv"].views)


def test_quality_weight_changes_what_the_planner_does():
    blind = replace(COARSE, gain=GainOptions(quality_weight=0.0))
    candidates = Candidates(
        np.array([[3.0, 1.0, 1.6], [1.0, 4.0, 1.0], [5.0, 1.0, 1.0]]), np.vstack([np.eye(3), -np.eye(3)])
    )
    plans = [
        plan_views(ROOM, SENSOR, views=6, candidates=candidates, samples=SAMPLES, options=o, rng=0)
        for o in (COARSE, blind)
    ]
    poses = [json.dumps([view.to_json()["world_from_sensor"] for view in plan.views]) for plan in plans]
    assert poses[0] != poses[1]


def test_a_scanner_that_measures_nothing_near_itself_explores_too():
    """What is unknown nearer than its shortest range lies on the way of beams that go on."""
    far = replace(SENSOR, min_range_m=COARSE.clearance_m + 2 * COARSE.voxel_m)
    plan = plan_views(ROOM, far, options=COARSE, samples=SAMPLES, target=0.5, rng=0)
    assert plan.stopped_because.startswith("target met")


def test_progress_is_reported_by_stage():
    stages = []
    candidates = Candidates(np.array([[3.0, 1.0, 1.6]]), np.eye(3))
    for method in ("nbv", "cover"):
        plan_views(
            ROOM,
            SENSOR,
            method=method,
            views=1,
            candidates=candidates,
            samples=SAMPLES,
            rng=0,
            progress=lambda stage, done, total: stages.append((stage, done <= total)),
        )
    expected = {"reachability", "views", "visibility", "bound", "cover"}
    assert {stage for stage, _ in stages} == expected
    assert all(sane for _, sane in stages)


def test_patches_of_another_scene_are_refused():
    patches = {"patch_points": np.array([[3.0, 3.0, 1.3]]), "patch_normals": np.array([[0.0, 0, 1]])}
    candidates = Candidates(np.array([[3.0, 1.0, 1.6]]), np.eye(3), **patches)
    with pytest.raises(InputError, match="1 of 1 patches do not lie on two_occluders"):
        plan_views(ROOM, SENSOR, candidates=candidates)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"method": "magic"}, "method must be one of nbv, cover"),
        ({"target": 1.5}, "0 < target <= 1"),
        ({"views": 0}, "views must be at least 1"),
        ({"mode": "garden"}, "mode must be room or object"),
        ({"max_incidence_deg": 0.0}, "max_incidence_deg"),
        ({"noise": "loud"}, "no noise model"),
    ],
)
def test_unusable_options_are_refused(options, message):
    candidates = Candidates(np.array([[3.0, 1.0, 1.6]]), np.eye(3))
    with pytest.raises(InputError, match=message):
        plan_views(ROOM, SENSOR, candidates=candidates, samples=SAMPLES, **options)


def test_planner_options_are_checked():
    with pytest.raises(InputError, match="must not be negative"):
        PlannerOptions(clearance_m=-1.0)
    with pytest.raises(InputError, match="at least 1, got 0"):
        PlannerOptions(max_views=0)


def test_the_face_names_what_exists():
    assert sorted(nbv.__all__) == nbv.__all__
    assert all(hasattr(nbv, name) for name in nbv.__all__)
