# SPDX-License-Identifier: MIT
"""Planning with completion: what counts as known, what a look into the unknown promises, what it saves."""

import json

import numpy as np
import pytest

from nbv.cover.overlap import OverlapOptions
from nbv.coverage.measurement import CoverageTally
from nbv.coverage.surface_classes import (
    CLASSES,
    INFERRED,
    MET,
    MODELLED,
    UNKNOWN,
    KnownSurfaces,
    classify,
    shares_of,
)
from nbv.online.expected_gain import ExpectedGain, SurfacePrior
from nbv.online.gain import ViewEvaluation
from nbv.online.occupancy import VoxelMap
from nbv.online.planner import PlannerOptions
from nbv.online.targets import voxels_of_interest
from nbv.online.voxels import VoxelGrid
from nbv.plan.plan import read_plan
from nbv.plan.planning import plan_views
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import PinholeSensor, View
from nbv.visibility.requirement import Requirement
from nbv.visibility.samples import sample_surface
from nbv.visibility.zones import Box, Zones
from scenes.checks import InputError
from scenes.mesh.triangle_distance import distances
from scenes.pose import Pose
from scenes.rays.raycast import RayCaster
from scenes.world.builtin import Finish, SceneBuilder, builtin_scene

ROOM = builtin_scene("two_occluders")
SENSOR = PinholeSensor(fov_deg=60, width=120, height=120)
GREY = Finish((0.5, 0.5, 0.5))
EYE = (0.0, -3.0, 1.0)


def wall_behind_a_board():
    """A wall of 4 x 2 m at y = 0, and a board of 0.6 x 0.6 m that stands 1 m before it."""
    build = SceneBuilder("wall behind a board", "object")
    build.add_rectangle("wall", (-2, 0, 0), (4, 0, 0), (0, 0, 2), GREY)
    build.add_rectangle("board", (-0.3, -1, 0.7), (0.6, 0, 0), (0, 0, 0.6), GREY)
    return build.finish()


@pytest.fixture(scope="module")
def wall():
    """The scene, its one scan from the front, and what completion makes of it."""
    scene = wall_behind_a_board()
    scan = scan_scene(scene, Pose.looking_at(np.array(EYE), np.array([0.0, 0.0, 1.0])), SENSOR)
    return scene, scan, KnownSurfaces.of([scan])


def test_knowledge_tells_measured_from_inferred_and_from_what_is_neither(wall):
    _, _, completed = wall
    asked = np.array([[1.2, 0.0, 1.0], [0.0, 0.0, 1.0], [0.0, -1.0, 1.0], [0.0, 0.5, 1.0], [0.0, 0.0, 3.0]])
    normals = np.tile([0.0, -1.0, 0.0], (5, 1))
    assert completed.on_modelled(asked, normals, 0.02).tolist() == [True, False, True, False, False]
    assert completed.on_inferred(asked, normals, 0.02).tolist() == [False, True, False, False, False]
    across = np.tile([1.0, 0.0, 0.0], (5, 1))  # another surface that crosses the wall is not known by it
    assert not completed.on_modelled(asked, across, 0.02).any()
    strict = KnownSurfaces(completed.completion, 0.0)
    assert not strict.on_modelled(asked, normals, 0.02).any()


def test_classes_part_the_area_and_met_comes_first(wall):
    scene, _, completed = wall
    samples = sample_surface(scene.mesh, 0.05)
    seen = np.ones(len(samples), np.bool_)
    met = samples.points[:, 0] > 1.0
    classes = classify(samples, met, seen, completed)
    assert (classes[met] == MET).all()
    hidden = (np.abs(samples.points[:, 0]) < 0.35) & (np.abs(samples.points[:, 2] - 1) < 0.35)
    hidden &= np.abs(samples.points[:, 1]) < 0.01
    assert (classes[hidden] == INFERRED).mean() > 0.95
    reachable = samples.points[:, 0] > -1.0
    shares = shares_of(classes, samples, reachable, completed, scene.mesh, 1)
    assert shares.known + shares.unknown == pytest.approx(1.0)
    for kind, name in enumerate(CLASSES):
        assert getattr(shares, name) == pytest.approx(samples.areas[classes == kind].sum() / samples.total_m2)
    known = samples.areas[reachable & (classes != UNKNOWN)].sum()
    assert shares.reached == pytest.approx(known / samples.areas[reachable].sum())
    assert shares.right_m2 == pytest.approx(shares.inferred_m2, rel=0.01)
    never = classify(samples, np.zeros_like(met), np.zeros_like(seen), completed)
    assert set(np.unique(never)) <= {INFERRED, UNKNOWN}  # what was never seen is not modelled
    assert MODELLED in classes


def expected_gain_of(scan, completed, bounds, trust=None):
    """What lies beyond the unknown of a map with one scan, and the map."""
    voxels = VoxelMap.unknown(np.array(bounds), voxel_m=0.1).integrate(scan, SENSOR)
    sought = np.ones(voxels.grid.n_voxels, np.bool_)
    faces, trust = voxels.boundary(), SurfacePrior.none().trust if trust is None else trust
    boundary = RayCaster(*faces.triangles(0.1), n_threads=1)
    more = {"worth_entering": sought, "completed": completed, "trust": trust}
    return ExpectedGain.of(voxels, boundary, np.repeat(faces.voxel, 2), **more), voxels


def test_a_shadow_before_inferred_wall_promises_little_and_the_rear_of_a_board_much(wall):
    _, scan, completed = wall
    expected, _ = expected_gain_of(scan, completed, [[-2, -3.5, 0], [2, 0.2, 2]])
    beside = np.array([1.2, -2.0, 1.0])  # sees the shadow behind the board from the right
    evaluation = expected.look(beside, 30.0)
    rays = evaluation.offsets / np.linalg.norm(evaluation.offsets, axis=1, keepdims=True)
    onto_wall = beside + rays * (-beside[1] / rays[:, 1])[:, None]
    into_shadow = (
        (evaluation.side < 0) & (np.abs(onto_wall[:, 0]) < 0.3) & (np.abs(onto_wall[:, 2] - 1) < 0.2)
    )
    into_shadow &= rays[:, 1] > 0
    before_wall = evaluation.worth_m2[into_shadow].sum()
    assert before_wall < 0.1 * 0.6 * 0.4  # inferred with a confidence of well above 0.9
    back = expected.look(np.array([1.5, -0.3, 1.0]), 30.0)  # nearer to the wall than the board is
    onto_board = back.offsets[:, 1] < 0
    assert back.worth_m2[onto_board & (back.side < 0)].sum() == pytest.approx(0.36, rel=0.35)


def test_what_leaves_the_volume_is_worth_its_side_times_trust(wall):
    _, scan, completed = wall
    bounds = [[-2, -3.5, 0], [2, 0.2, 2]]
    full, voxels = expected_gain_of(scan, completed, bounds)
    none, _ = expected_gain_of(scan, completed, bounds, np.zeros(6))
    at = np.array([0.0, -2.5, 1.0])
    hoped, gone = full.look(at, 30.0), none.look(at, 30.0)
    assert (gone.side < 0).all()
    low, high = voxels.grid.origin, voxels.grid.origin + np.array(voxels.grid.shape) * voxels.grid.voxel_m
    floor_m2 = np.prod((high - low)[:2])
    assert 0.3 * floor_m2 < hoped.worth_m2[hoped.side == 5].sum() < 1.1 * floor_m2


def test_the_prior_is_the_share_of_rays_that_met_surface():
    grid = VoxelGrid.around(np.array([[-2.0, -4, 0], [2, 2, 2]]), 0.1)
    scene = wall_behind_a_board()
    scan = scan_scene(scene, Pose.looking_at(np.array(EYE), np.array([0.0, 0.0, 1.0])), SENSOR)
    towards = np.array([[0.0, 3.0, 0.0], [0.9, 3.0, 0.3], [0.3, 3.0, 1.6], [0.0, -3.0, 0.0], [0.2, 3.0, 0.0]])
    hoped = ViewEvaluation(
        offsets=towards,
        worth_m2=np.ones(5),
        voxel=np.zeros(5, np.int64),
        is_unknown=np.ones(5, bool),
        side=np.array([1, 1, 2, 3, -1]),
        share=np.ones(5),
    )
    trust = SurfacePrior.none().after(scan, hoped, grid).trust
    assert trust[1] == 1.0  # both met the wall
    assert trust[2] == pytest.approx(50 / 51)  # above the wall there is nothing
    assert trust[3] == 1.0  # not looked at


def test_rays_leave_a_grid_by_the_side_they_run_into():
    grid = VoxelGrid(np.zeros(3), (4, 6, 8), 0.5)
    points = np.tile([1.0, 1.0, 1.0], (4, 1))
    rays = np.array([[1.0, 0, 0], [0, -1, 0], [0.6, 0.0, 0.8], [0.0, 0.8, -0.6]])
    length, side = grid.way_out(points, rays)
    assert length == pytest.approx([1.0, 1.0, 1.0 / 0.6, 1.0 / 0.6])
    assert side.tolist() == [0, 4, 0, 5]


def test_the_region_is_of_interest_once_it_is_reached():
    voxels = VoxelMap.unknown(np.array([[0.0, 0, 0], [2, 2, 2]]), voxel_m=0.5)
    region = Zones(Box(np.array([0.0, 0, 0]), np.array([0.9, 2, 2])))
    assert voxels_of_interest(voxels, region).all()
    reached = voxels.clear_around(np.array([0.3, 0.3, 0.3]), 0.6)
    held = voxels_of_interest(reached, region)
    assert 0 < held.sum() < len(held)
    assert voxels_of_interest(reached, Zones()).all()


def test_distances_to_large_triangles_among_small_ones_are_exact_nearby():
    rng = np.random.default_rng(0)
    large = np.array([[[0.0, 0, 0], [4, 0, 0], [0, 4, 0]]])
    small = rng.uniform(-0.02, 0.02, (300, 3, 3)) + np.array([1.0, 1.0, 0.6])
    points = np.column_stack([rng.uniform(0.2, 1.5, (50, 2)), rng.uniform(0.0, 0.05, 50)])
    assert distances(points, np.concatenate([large, small])) == pytest.approx(points[:, 2])
    assert np.isinf(distances(points, np.zeros((0, 3, 3)))).all()
    assert distances(np.zeros((0, 3)), large).shape == (0,)


def test_distances_to_slivers_and_to_triangles_without_area_are_found_in_little_memory():
    x = np.linspace(0.0, 1.0, 3000)
    start = np.column_stack([x, np.zeros_like(x), np.zeros_like(x)])
    slivers = np.stack([start, start + [0.0, 100.0, 0.0], start + [1e-9, 100.0, 0.0]], axis=1)
    points = np.column_stack([x[:50], np.linspace(1, 99, 50), np.full(50, 0.3)])
    assert distances(points, slivers) == pytest.approx(0.3, abs=1e-3)
    assert distances(points, np.repeat(start[:1, None], 3, axis=1))[0] == pytest.approx(np.hypot(1, 0.3))


COARSE = {
    "samples": sample_surface(ROOM.mesh, 0.2),
    "options": PlannerOptions(voxel_m=0.2),
    "target": 0.9,
    "rng": 0,
    "views": 20,
}


@pytest.mark.long
def test_with_completion_a_room_takes_far_fewer_views(tmp_path):
    plain = plan_views(ROOM, SENSOR, **COARSE)
    aware = plan_views(ROOM, SENSOR, infer=True, **COARSE)
    assert len(aware.views) <= 0.5 * len(plain.views)
    last = aware.shares[-1]
    assert last.right_m2 >= 0.9 * last.inferred_m2
    assert last.reached >= 0.9
    file = tmp_path / "plan.json"
    file.write_text(json.dumps(aware.to_json()))
    again = read_plan(file)
    assert again.shares == aware.shares
    assert again.coverage.inferred == pytest.approx(last.inferred)
    assert again.coverage.modelled == pytest.approx(last.modelled)


@pytest.mark.long
def test_views_of_a_known_room_are_chosen_for_what_completion_will_not_know():
    plan = plan_views(ROOM, SENSOR, method="cover", infer=True, **COARSE)
    assert len(plan.views) <= 6  # at 60 deg alone it takes 12 at least
    assert (
        plan.stopped_because
        == "target met, modelled or inferred on the true scene: 0.9 of the reachable area"
    )
    assert plan.lower_bound is None
    last = plan.shares[-1]
    assert last.views == len(plan.views)
    tally = CoverageTally.start(ROOM.ray_caster(), COARSE["samples"], Requirement())
    for view in plan.views:
        tally.add(View(view.world_from_sensor, SENSOR))
    counted = plan.coverage.samples.areas  # completion adds nothing to what is met
    assert last.met == pytest.approx(counted[tally.met].sum() / counted.sum())


@pytest.mark.long
def test_plans_with_completion_are_the_same_on_one_and_two_threads():
    asked = {**COARSE, "views": 2, "rng": 3, "infer": True}
    one, two = (plan_views(ROOM, SENSOR, n_threads=n, **asked).to_json() for n in (1, 2))
    assert one == two


def test_completion_and_overlap_do_not_go_together():
    with pytest.raises(InputError, match="cannot also ask for overlap"):
        plan_views(ROOM, SENSOR, method="cover", infer=True, overlap=OverlapOptions())
