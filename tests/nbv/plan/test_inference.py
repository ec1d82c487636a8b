# SPDX-License-Identifier: MIT
"""Planning with completion: what counts as known, what a look into the unknown promises, what it saves."""

import json
from dataclasses import replace

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
from nbv.online.expected_gain import ExpectedGain, SurfacePrior, UnknownSpace, _cross
from nbv.online.limits import REMEMBERED
from nbv.online.occupancy import EMPTY, SEEN, UNSEEN, VoxelMap
from nbv.online.planner import PlannerOptions
from nbv.online.targets import voxels_of_interest
from nbv.online.voxels import UPWARD, Surfels, VoxelGrid
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


BOUNDS = [[-2, -3.5, 0], [2, 0.2, 2]]


def expected_gain_of(scan, completed, prior=None):
    """What is expected of views after one scan, and the map."""
    voxels = VoxelMap.unknown(np.array(BOUNDS), voxel_m=0.1, outside_is_empty=True)
    voxels = voxels.integrate(scan, SENSOR)
    every = np.ones(voxels.grid.n_voxels, np.bool_)
    space = UnknownSpace.of(voxels, completed)
    return ExpectedGain(space, prior or SurfacePrior.none(), every), voxels


def chance_into_shadow(expected, position):
    """Mean chance of the rays from a position to the middle of what the board hides of the wall.

    They are asked where they enter the shadow, whose sides run from the eye over the board's edges.
    """
    x, z = (values.ravel() for values in np.meshgrid(np.linspace(-0.25, 0.25, 9), np.linspace(0.8, 1.2, 9)))
    rays = np.stack([x, np.zeros_like(x), z], axis=1) - position
    along = np.linspace(0, 1, 400)[None, :, None]
    places = position + along * rays[:, None]
    depth = (places[..., 1] + 3.0) / 2.0  # of the board's section, at y = -1
    shadow = (np.abs(places[..., 0]) < 0.3 * depth) & (np.abs(places[..., 2] - 1) < 0.3 * depth)
    first = (shadow & (places[..., 1] > -1.0)).argmax(axis=1)
    offsets = places[np.arange(len(x)), first] - position
    return expected.chance_behind(position, offsets, 30.0).mean()


def test_a_shadow_before_surely_inferred_wall_promises_little(wall):
    """The empty shadow has a rate of surface; behind it the wall is inferred, and so is nothing new."""
    _, scan, completed = wall
    beside, nothing = np.array([1.2, -2.0, 1.0]), np.zeros(6)
    prior = replace(SurfacePrior.none(), surfaces=nothing)
    sure, _ = expected_gain_of(scan, completed, prior)
    unsure, _ = expected_gain_of(scan, replace(completed, min_confidence=1.01), prior)
    assert chance_into_shadow(sure, beside) < 0.3 * chance_into_shadow(unsure, beside)
    assert sure.space.confidence.max() >= completed.min_confidence
    assert (sure.space.possible[sure.space.confidence > 0] == 0).all()
    assert not unsure.space.confidence.any()


def test_the_rear_of_a_board_is_new_for_certain(wall):
    """Whoever looks from behind through the shadow at the measured board sees its rear."""
    _, scan, completed = wall
    zero = replace(SurfacePrior.none(), **dict.fromkeys(("surfaces", "stopped", "met"), np.zeros(6)))
    expected, _ = expected_gain_of(scan, completed, zero)
    behind = np.array([0.9, -0.4, 1.0])  # between the board and the wall
    x, z = (values.ravel() for values in np.meshgrid(np.linspace(-0.2, 0.2, 5), np.linspace(0.8, 1.2, 5)))
    offsets = 0.4 * (np.stack([x, np.full_like(x, -1.0), z], axis=1) - behind)
    assert expected.chance_behind(behind, offsets, 30.0) == pytest.approx(np.ones(25))


def test_nothing_is_expected_where_nothing_was_ever_met(wall):
    """From the eye no ray meets the rear of anything; what lies beyond the wall is left by open sides."""
    _, scan, completed = wall
    zero = replace(SurfacePrior.none(), **dict.fromkeys(("surfaces", "stopped", "met"), np.zeros(6)))
    at, aside = np.array([0.0, -2.5, 1.0]), np.array([[0.5, 1.9, 1.3], [-0.4, 1.9, 0.6], [0.0, 1.9, 1.0]])
    assert expected_gain_of(scan, completed, zero)[0].chance_behind(at, aside, 30.0) == pytest.approx(0.0)
    beside = np.array([1.2, -2.0, 1.0])
    none, even = (chance_into_shadow(expected_gain_of(scan, completed, p)[0], beside) for p in (zero, None))
    assert even > none + 0.1


def test_the_prior_counts_what_rays_met_in_unknown_space():
    """A wall across an unknown volume: a surface for each ray, after as many metres as it is away."""
    build = SceneBuilder("wall", "object")
    build.add_rectangle("wall", (-9, 0, -9), (18, 0, 0), (0, 0, 18), GREY)
    camera = PinholeSensor(fov_deg=20, width=60, height=60)
    scan = scan_scene(build.finish(), Pose.looking_at(np.array(EYE), np.array([0.0, 0.0, 1.0])), camera)
    deep = VoxelMap.unknown(np.array([[-2.0, -3.5, 0], [2, 2, 2]]), voxel_m=0.1)
    none = SurfacePrior.none()
    after = none.after(scan, UnknownSpace.of(deep))
    rays = after.surfaces[1] - REMEMBERED * none.surfaces[1]
    assert rays > 30
    assert after.metres[1] - REMEMBERED * none.metres[1] == pytest.approx(3.0 * rays, rel=0.03)
    assert after.rate_per_m()[1] < none.rate_per_m()[1]
    assert (after.trust() == 0.5).all()  # no ray came as far as a side
    assert (after.rate_per_m()[[0, 2, 3, 4, 5]] == 0.5).all()
    shallow = VoxelMap.unknown(np.array([[-2.0, -3.5, 0], [2, 0.0, 2]]), voxel_m=0.1)
    ended = none.after(scan, UnknownSpace.of(shallow))  # the wall is on the side +y of this volume
    assert ended.trust()[1] > 0.6
    assert ended.surfaces[1] == pytest.approx(REMEMBERED * none.surfaces[1])
    near = VoxelMap.unknown(np.array([[-2.0, -3.5, 0], [2, -1.0, 2]]), voxel_m=0.1)
    assert none.after(scan, UnknownSpace.of(near)).trust()[1] < 0.4  # and beyond that side of this one


def test_rays_cross_the_voxels_that_points_along_them_lie_in():
    """Against closely spaced points, from within the grid and from outside."""
    grid, rng = VoxelGrid(np.array([-1.0, 0.0, 2.0]), (7, 5, 6), 0.3), np.random.default_rng(4)
    voxels, ends = np.zeros(30, np.int64), np.zeros(30)
    for eye in ([0.12, 0.71, 2.93], [-3.0, 0.41, 2.52], [0.22, 4.0, 3.04]):
        for towards in rng.uniform([-1, 0, 2], [1.1, 1.5, 3.8], (20, 3)):
            position = np.array(eye)
            ray = (towards - position) / np.linalg.norm(towards - position)
            n, begin, side = _cross(position, ray, grid.origin, grid.shape, grid.voxel_m, voxels, ends)
            along = np.arange(0.0, 9.0, 1e-3)
            at = grid.index_of(position + along[:, None] * ray)
            wanted, first = np.unique(at[at >= 0], return_index=True)
            expected = wanted[np.argsort(first)]
            assert np.isin(expected, voxels[:n]).all()  # points may miss a voxel that is cut at a corner
            assert begin == pytest.approx(along[at >= 0][0], abs=2e-3)
            assert ends[n - 1] == pytest.approx(along[at >= 0][-1], abs=2e-3)
            beyond = position + (ends[n - 1] + 1e-6) * ray  # beyond the one side by which it leaves
            high = grid.origin + np.array(grid.shape) * grid.voxel_m
            assert np.flatnonzero(np.concatenate([beyond > high, beyond < grid.origin])).tolist() == [side]


def test_what_is_seen_through_the_open_bounds_no_room():
    """Columns that are empty to the bottom, or to the top over no floor; none where objects are scanned."""
    voxels = VoxelMap.unknown(np.array([[0.0, 0, 0], [1, 1, 1]]), voxel_m=0.5)
    labels = np.full(voxels.grid.shape, UNSEEN, np.int8)
    labels[0, 0, 0], labels[0, 1, 2], labels[1, 1, 2], labels[1, 1, 0] = EMPTY, EMPTY, EMPTY, SEEN
    floor = int(np.ravel_multi_index((1, 1, 0), voxels.grid.shape))
    up = np.array([[0.0, 0.0, 1.0]])
    surfels = Surfels(np.array([6 * floor + UPWARD]), np.full((1, 3), 0.6), up, np.ones(1), np.ones(1))
    known = replace(voxels, labels=labels.ravel(), surfels=surfels)
    outdoors = UnknownSpace.of(known).outdoors.reshape(voxels.grid.shape[:2])
    assert np.argwhere(outdoors).tolist() == [[0, 0], [0, 1]]
    assert not UnknownSpace.of(replace(known, outside_is_empty=True)).outdoors.any()


def test_inferred_surface_counts_from_its_stated_confidence_on(wall):
    """And what is claimed at less is neither counted as inferred nor as right."""
    scene, scan, _ = wall
    completed = KnownSurfaces.of([scan], relates=False)
    samples = sample_surface(scene.mesh, 0.05)
    unseen = np.zeros(len(samples), np.bool_)
    areas = []
    for level in (0.5, completed.min_confidence, 1.0):
        known = replace(completed, min_confidence=level)
        classes = classify(samples, unseen, unseen, known)
        shares = shares_of(classes, samples, ~unseen, known, scene.mesh, 1)
        areas.append(shares.inferred_m2)
        assert shares.inferred == pytest.approx(shares.inferred_m2 / samples.total_m2, abs=0.01)
        assert 0.0 <= shares.right_m2 <= shares.inferred_m2
    assert areas[0] >= areas[1] > areas[2]


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
