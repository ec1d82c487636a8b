# SPDX-License-Identifier: MIT
"""Criteria of the literature: voxels on a ray by an oracle, scores by hand, maps with one right choice."""

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray
from scipy.sparse import csr_array

from nbv import Exploration, PinholeSensor, PlannerOptions, explore, scan_scene, sphere_candidates
from nbv.online import planner
from nbv.online.literature import (
    CRITERIA,
    OCCUPANCY,
    RAY_CRITERIA,
    ViewRays,
    choose_views,
    cover_at_once,
    edges_of_surface,
    nearness_to_surface,
)
from nbv.online.occupancy import EMPTY, OCCLUDED, SEEN, UNSEEN, VoxelMap
from nbv.online.voxel_walk import AROUND, MEASURED, PASSED, UNKNOWN, KnownSpace, Rays
from nbv.online.voxels import Surfels, VoxelGrid, sides_of
from nbv.run.plan_options import ONLINE_METHODS
from nbv.visibility.viewpoints import Candidates
from scenes import Scene
from scenes.checks import InputError
from scenes.pose import Pose
from scenes.run.journal import NO_JOURNAL, FileJournal, Journal

SENSOR = PinholeSensor(fov_deg=60, width=90, height=90, max_range_m=100)
SIDE = 9
MIDDLE = np.full(3, SIDE / 2)
UNKNOWN_ENTROPY = np.log(2)
EMPTY_ENTROPY, SEEN_ENTROPY = (-p * np.log(p) - (1 - p) * np.log(1 - p) for p in (0.12, 0.97))


def empty_map() -> NDArray[np.int8]:
    return np.full((SIDE,) * 3, EMPTY, np.int8)


def map_of(labels: NDArray[np.int8], surfels: Surfels | None = None, stood: object = ()) -> VoxelMap:
    """A map of 1 m voxels, seen from outside."""
    grid = VoxelGrid(np.zeros(3), (SIDE,) * 3, 1.0)
    return VoxelMap(
        grid, labels.ravel(), surfels or Surfels.none(), np.zeros(labels.size, np.int16),
        outside_is_empty=True, stood=np.array(stood, dtype=np.float64).reshape(-1, 3),
    )  # fmt: skip


def views_from(*sides: tuple[float, float, float]) -> Candidates:
    """Candidates 20 m from the middle, each looking at it."""
    outward = np.array(sides) / np.linalg.norm(sides, axis=1, keepdims=True)
    return Candidates(MIDDLE + 20 * outward, -outward[:, None])


def chosen(
    criterion: str, voxels: VoxelMap, candidates: Candidates, n_threads: int = 1, least_m2: float = 1.0
) -> list[Pose]:
    counts = np.ones((2, voxels.grid.n_voxels), np.bool_)
    here = Pose.looking_at(MIDDLE + (0, 0, 30), MIDDLE)
    views = choose_views(
        criterion, voxels, candidates, here, sensor=SENSOR, counts=counts, least_m2=least_m2,
        n_threads=n_threads,
    )  # fmt: skip
    return [view.pose for view in views]


def ray_along_x(labels: NDArray[np.int8], sign: int, solid_angle: float = 0.5) -> object:
    """What one ray through the middle passes, along x or against it."""
    voxels = map_of(labels)
    counts = np.ones(labels.size, np.bool_)
    space = KnownSpace.of(voxels, counts, nearness_to_surface(voxels))
    rays = Rays(np.array([[float(sign), 0.0, 0.0]]), np.array([solid_angle]))
    return space.walk(MIDDLE - np.array([20.0 * sign, 0, 0]), rays, 100.0)


@pytest.mark.parametrize("seed", range(20))
def test_a_ray_passes_the_voxels_between_its_crossings_of_planes(seed: int) -> None:
    rng = np.random.default_rng(seed)
    kinds = rng.choice([PASSED, UNKNOWN, MEASURED], size=(5, 7, 4), p=[0.6, 0.37, 0.03]).astype(np.int8)
    grid = VoxelGrid(np.array([-1.0, 2.0, 0.5]), kinds.shape, 0.25)
    space = KnownSpace(grid, kinds, rng.random(kinds.shape).astype(np.float32))
    position = grid.origin + rng.uniform(-2, 3, 3)
    toward = grid.origin + rng.random(3) * kinds.shape * 0.25 - position
    ray = toward / np.linalg.norm(toward)
    walked = space.walk(position, Rays(ray[None], np.ones(1)), 10.0)

    crossings = [
        (grid.origin[a] + k * 0.25 - position[a]) / ray[a]
        for a in range(3)
        for k in range(kinds.shape[a] + 1)
    ]
    ends = np.unique([0.0, *(t for t in crossings if 0 < t < 10.0)])
    middles = position + ((ends[1:] + ends[:-1]) / 2)[:, None] * ray
    numbers = grid.index_of(middles)
    begins, numbers = ends[:-1][numbers >= 0], numbers[numbers >= 0]
    of = kinds.ravel()[numbers]
    last = int(np.argmax(of == MEASURED)) if (of == MEASURED).any() else len(of) - 1
    assert walked.n_passed[0].tolist() == [np.count_nonzero(of[: last + 1] == kind) for kind in range(3)]
    assert walked.end[0] == (numbers[last] if of[last] == MEASURED else -1)
    assert walked.is_rear[0] == (of[last] == MEASURED and last > 0 and of[last - 1] == UNKNOWN)
    passed = numbers[: last + 1][of[: last + 1] == UNKNOWN]
    assert walked.nearness[0] == pytest.approx(space.nearness.ravel()[passed].sum())
    if (of[: last + 1] != PASSED).any():
        first = int(np.argmax(of != PASSED))
        assert walked.first[0] == numbers[first]
        assert walked.away[0] * 0.25 == pytest.approx(begins[first])
    else:
        assert walked.first[0] == -1


def test_rays_cover_the_volume_from_outside_and_everything_from_within() -> None:
    grid = VoxelGrid(np.zeros(3), (SIDE,) * 3, 1.0)
    assert Rays.into(grid, MIDDLE + 1) is AROUND
    assert AROUND.solid_angle.sum() == pytest.approx(4 * np.pi, rel=1e-3)
    place = MIDDLE + np.array([14.0, 9.0, -11.0])
    rays = Rays.into(grid, place)
    voxels = grid.centres() - place
    voxels /= np.linalg.norm(voxels, axis=1, keepdims=True)
    assert (voxels @ rays.directions.T).max(axis=1).min() > np.cos(0.5 / 15)  # half a voxel


def test_scores_of_a_ray_are_those_by_hand() -> None:
    """Empty, empty, empty, unknown, unseen surface's shadow, shadow, seen, ... along one row."""
    labels = empty_map()
    labels[3, 4, 4], labels[4:6, 4, 4], labels[6, 4, 4] = UNSEEN, OCCLUDED, SEEN
    there, back = ray_along_x(labels, 1), ray_along_x(labels, -1)
    assert there.end[0] == back.end[0] == np.ravel_multi_index((6, 4, 4), labels.shape)

    score = {
        name: [criterion(walked) for walked in (there, back)] for name, criterion in RAY_CRITERIA.items()
    }
    assert [worth.tolist() for worth, _ in score["frontier"]] == [[1.0], [0.0]]
    assert [worth.tolist() for worth, _ in score["rear-side"]] == [[0.5], [0.0]]
    assert [worth.tolist() for worth, _ in score["proximity"]] == [[0.5 * (28 + 29)], [0.0]]
    means = [float((worth / of)[0]) for worth, of in score["entropy"]]
    assert means[0] == pytest.approx((3 * EMPTY_ENTROPY + 3 * UNKNOWN_ENTROPY + SEEN_ENTROPY) / 7)
    assert means[1] == pytest.approx((2 * EMPTY_ENTROPY + SEEN_ENTROPY) / 3)
    labels[6, 4, 4] = EMPTY
    worth, of = RAY_CRITERIA["entropy"](ray_along_x(labels, 1))
    assert (worth[0], of[0]) == (0.0, 0.0)  # it ends in no surface
    assert OCCUPANCY[1] == 0.5


def test_unknown_voxels_that_do_not_count_end_rays() -> None:
    labels = empty_map()
    labels[3:5, 4, 4], labels[6, 4, 4] = UNSEEN, SEEN
    counts = np.ones(labels.size, np.bool_)
    counts[np.ravel_multi_index((4, 4, 4), labels.shape)] = False
    space = KnownSpace.of(map_of(labels), counts)
    rays = Rays(np.array([[1.0, 0, 0], [-1.0, 0, 0]]), np.ones(2))
    ahead = space.walk(MIDDLE - np.array([20.0, 0, 0]), rays, 100.0)
    assert ahead.n_passed.tolist() == [[3, 1, 0], [0, 0, 0]]
    assert ahead.is_unknown.tolist() == [True, False]
    near = space.walk(MIDDLE - np.array([20.0, 0, 0]), rays, 18.0)
    assert near.n_passed[0].tolist() == [3, 0, 0]  # the range ends before


def test_frontier_takes_the_view_of_most_voxels_once_each() -> None:
    """A plate of 5 x 5 unknown voxels shows 25 from the front and 5 from a side."""
    labels = empty_map()
    labels[4, 2:7, 2:7] = UNSEEN
    voxels, candidates = map_of(labels), views_from((0, 1, 0), (1, 0, 0), (0, 0, -1))
    views = ViewRays.of(KnownSpace.of(voxels, np.ones(labels.size, np.bool_)), candidates, SENSOR)
    assert [views.score(RAY_CRITERIA["frontier"], i)[0].tolist() for i in range(3)] == [[5.0], [25.0], [5.0]]
    best = views.evaluate(1)
    assert best.gain_m2 == 25.0
    assert sorted(best.sees.voxel.tolist()) == np.flatnonzero(labels == UNSEEN).tolist()
    assert best.sees.offsets[:, 0] == pytest.approx(np.full(25, -19.5))  # front face at x = 5
    assert chosen("frontier", voxels, candidates)[0].translation == pytest.approx(candidates.positions[1])


def backed_plate() -> NDArray[np.int8]:
    """A seen plate, its shadow three voxels deep behind it towards +x, and a large unknown wall at +y."""
    labels = empty_map()
    labels[4, 2:7, 2:7] = SEEN
    labels[5:8, 2:7, 2:7] = OCCLUDED
    labels[:, 8, :] = UNSEEN
    return labels


def test_rear_side_and_entropy_look_at_seen_surface_from_behind() -> None:
    voxels, candidates = map_of(backed_plate()), views_from((0, 1, 0), (-1, 0, 0), (1, 0, 0))
    taken = {name: chosen(name, voxels, candidates)[0].translation for name in RAY_CRITERIA}
    assert taken["frontier"] == pytest.approx(candidates.positions[0])
    assert taken["rear-side"] == pytest.approx(candidates.positions[2])
    assert taken["entropy"] == pytest.approx(candidates.positions[2])


def test_proximity_counts_shadow_beside_surface_alone() -> None:
    """More unseen voxels lie on one side, but those in the shadow of the plate on the other."""
    labels = empty_map()
    labels[4, 2:7, 2:7], labels[5, 2:7, 2:7], labels[0] = SEEN, OCCLUDED, UNSEEN
    voxels, candidates = map_of(labels), views_from((-1, 0, 0), (1, 0, 0))
    assert nearness_to_surface(voxels)[5, 3, 3] == 29.0
    assert nearness_to_surface(voxels)[0].max() == 0.0
    assert chosen("frontier", voxels, candidates)[0].translation == pytest.approx(candidates.positions[0])
    assert chosen("proximity", voxels, candidates)[0].translation == pytest.approx(candidates.positions[1])


def plates(
    *placed: tuple[tuple[slice | int, ...], tuple[float, float, float]],
) -> tuple[NDArray[np.int8], Surfels]:
    """Seen voxels with a surfel each, by where they are and their normal."""
    labels, keys, points, normals = empty_map(), [], [], []
    for where, normal in placed:
        labels[where] = SEEN
        numbers = np.arange(labels.size).reshape(labels.shape)[where].ravel()
        side = int(sides_of(np.array([normal]))[0])
        keys += (numbers * 6 + side).tolist()
        points += (np.stack(np.unravel_index(numbers, labels.shape), axis=1) + 0.5).tolist()
        normals += [normal] * len(numbers)
    order = np.argsort(keys)
    ones = np.ones(len(keys))
    return labels, Surfels(
        np.array(keys)[order], np.array(points)[order], np.array(normals)[order], ones, ones
    )


def test_the_edge_of_surface_is_where_the_unknown_begins() -> None:
    labels, surfels = plates(((4, slice(2, 7), slice(2, 7)), (1, 0, 0)))
    counts = np.ones(labels.size, np.bool_)
    assert not len(edges_of_surface(map_of(labels, surfels), counts))  # known space lies all around
    labels[4, 7, 1:8] = UNSEEN
    edges = surfels.voxels[edges_of_surface(map_of(labels, surfels), counts)]
    assert edges.tolist() == [np.ravel_multi_index((4, 6, z), labels.shape) for z in range(2, 7)]
    counts[edges[0]] = False
    assert len(edges_of_surface(map_of(labels, surfels), counts)) == 4
    labels[4, 7], labels[3, 7, 1:8] = EMPTY, UNSEEN  # surface that bends away from where it was seen
    assert surfels.voxels[edges_of_surface(map_of(labels, surfels), counts)].tolist() == edges[1:].tolist()


def test_a_crease_is_no_edge() -> None:
    """Of a floor and a wall, with the unknown below and behind, only the far sides are edges."""
    labels, surfels = plates(
        ((slice(1, 9), slice(0, 9), 0), (0, 0, 1)), ((0, slice(0, 9), slice(1, 9)), (1, 0, 0))
    )
    labels[0, :, 0] = UNSEEN
    assert not len(edges_of_surface(map_of(labels, surfels), np.ones(labels.size, np.bool_)))


@pytest.mark.parametrize(("nearest", "hidden", "taken"), [(0, False, 0), (1, False, 1), (0, True, 2)])
def test_surface_edge_takes_the_nearest_view_along_a_normal(nearest: int, hidden: bool, taken: int) -> None:
    """Two plates with one unknown row each; where one is hidden from the front, a slanted view sees it."""
    labels, surfels = plates(
        ((1, slice(2, 5), slice(2, 7)), (1, 0, 0)), ((slice(4, 7), 1, slice(2, 7)), (0, 1, 0))
    )
    labels[1, 5, 2:7] = labels[7, 1, 2:7] = UNSEEN
    if hidden:
        labels[8, 3:7, :] = SEEN
    candidates = views_from((1, 0, 0), (0, 1, 0), (1, 0, 1.2))
    voxels = map_of(labels, surfels)
    here = Pose.looking_at(candidates.positions[nearest] + 1.0, MIDDLE)
    counts = np.ones((2, labels.size), np.bool_)
    (view,) = choose_views(
        "surface-edge", voxels, candidates, here, sensor=SENSOR, counts=counts, least_m2=0.0
    )
    assert view.pose.translation == pytest.approx(candidates.positions[taken])
    assert not view.sees.is_unknown.any()
    counts[0] = False
    given = {"sensor": SENSOR, "counts": counts, "least_m2": 0.0}
    assert choose_views("surface-edge", voxels, candidates, here, **given) == ()


def test_a_cover_is_smaller_than_greedy_choice_makes_it() -> None:
    shown = csr_array(np.array([[0, 1, 1, 1, 1, 0], [1, 1, 1, 0, 0, 0], [0, 0, 0, 1, 1, 1]]))
    assert sorted(cover_at_once(shown, 1.0)) == [1, 2]
    assert cover_at_once(shown, 4.0) == ()


def test_set_cover_takes_both_sides_of_a_wall_and_nothing_else() -> None:
    labels = empty_map()
    labels[3:6] = UNSEEN
    labels[4] = SEEN
    candidates = views_from((1, 0, 0), (1, 0.5, 0), (-1, 0, 0), (1, 0, -0.5), (-1, 0.5, 0))
    taken = chosen("set-cover", map_of(labels), candidates)
    assert len(taken) == 2
    assert sorted(np.sign(pose.translation[0] - MIDDLE[0]) for pose in taken) == [-1.0, 1.0]


@pytest.mark.parametrize("criterion", CRITERIA)
def test_no_view_is_taken_twice_nor_where_nothing_is_unknown(criterion: str) -> None:
    labels, surfels = plates(((4, slice(2, 7), slice(2, 7)), (1, 0, 0)))
    candidates = views_from((1, 0, 0), (1, 0.3, 0))
    assert chosen(criterion, map_of(labels, surfels), candidates, least_m2=0.0) == []
    labels[4, 7, 2:7] = OCCLUDED
    stood = candidates.positions[:1]
    assert chosen(criterion, map_of(labels, surfels, stood), candidates)[0].translation == pytest.approx(
        candidates.positions[1]
    )
    assert chosen(criterion, map_of(labels, surfels, candidates.positions), candidates) == []


@pytest.mark.parametrize("criterion", [*RAY_CRITERIA, "surface-edge"])
def test_a_view_with_other_directions_is_not_repeated_at_once(criterion: str) -> None:
    labels, surfels = plates(((4, slice(2, 7), slice(2, 7)), (1, 0, 0)))
    labels[4, 7, 1:8] = labels[3, 2:7, 2:7] = OCCLUDED
    place, ahead = MIDDLE + (20, 0, 0), np.array([[-1.0, 0.0, 0.0], [-1.0, 0.3, 0.0], [0.0, 0.0, 1.0]])
    candidates = Candidates(place[None], ahead)
    counts = np.ones((2, labels.size), np.bool_)
    taken = [
        choose_views(
            criterion, map_of(labels, surfels), candidates, Pose.looking_at(place, place + way),
            sensor=SENSOR, counts=counts, least_m2=0.0,
        )[0].pose.rotation[:, 2]
        for way in (ahead[2], ahead[0])
    ]  # fmt: skip
    assert taken[0] == pytest.approx(ahead[0])
    assert taken[1] == pytest.approx(ahead[1] / np.linalg.norm(ahead[1]))


WORLD = Scene.from_mesh(trimesh.creation.capsule(height=0.5, radius=0.2), mode="object")
CAMERA = PinholeSensor(fov_deg=50, width=64, height=64, max_range_m=6)
PLACES = sphere_candidates(WORLD, CAMERA, 40)


def explored(
    criterion: str, n_threads: int | None = 1, max_views: int = 4, journal: Journal = NO_JOURNAL
) -> Exploration:
    return explore(
        lambda pose: scan_scene(WORLD, pose, CAMERA, rng=0), WORLD.mesh.bounds(), PLACES.pose(0), PLACES,
        CAMERA, options=PlannerOptions(max_views=max_views, criterion=criterion), from_outside=True,
        journal=journal, n_threads=n_threads,
    )  # fmt: skip


@pytest.mark.parametrize("criterion", CRITERIA)
def test_every_criterion_explores_the_same_on_any_number_of_threads(criterion: str) -> None:
    one, three = explored(criterion), explored(criterion, 3)
    assert len(one.steps) == 4
    assert [step.world_from_sensor.matrix.tobytes() for step in one.steps] == [
        step.world_from_sensor.matrix.tobytes() for step in three.steps
    ]
    assert one.steps[-1].unknown_m2 < one.steps[0].unknown_m2
    assert len({step.world_from_sensor.translation.tobytes() for step in one.steps}) == 4


def test_set_cover_decides_once(monkeypatch: pytest.MonkeyPatch) -> None:
    decided = []

    def decide(*given, **named):
        decided.append(choose_views(*given, **named))
        return decided[-1]

    monkeypatch.setattr(planner, "choose_views", decide)
    found = explored("set-cover", max_views=40)
    assert len(decided) == 1
    assert found.stopped_because == "all views that were planned at once are taken"
    assert [step.world_from_sensor.matrix.tobytes() for step in found.steps[1:]] == [
        view.pose.matrix.tobytes() for view in decided[0]
    ]


def test_a_cover_that_was_begun_is_gone_on_with(tmp_path, monkeypatch) -> None:
    whole = explored("set-cover", max_views=5, journal=FileJournal(tmp_path, "key"))
    monkeypatch.setattr(planner, "choose_views", None)
    again = explored("set-cover", max_views=5, journal=FileJournal(tmp_path, "key"))
    assert [step.world_from_sensor.matrix.tobytes() for step in again.steps] == [
        step.world_from_sensor.matrix.tobytes() for step in whole.steps
    ]


def test_methods_are_named_for_the_criteria() -> None:
    assert ("nbv", *(f"online:{name}" for name in CRITERIA)) == ONLINE_METHODS
    with pytest.raises(InputError, match=r"criterion must be one of gain, frontier, .*, got 'best'"):
        PlannerOptions(criterion="best")
