# SPDX-License-Identifier: MIT
"""Occupancy, surfels and gain: a hand-built view whose labels and gains are known."""

from dataclasses import replace

import numpy as np
import pytest

from nbv.online.gain import best_view, cell_directions, cell_of
from nbv.online.occupancy import EMPTY, OCCLUDED, OCCPLANE, SEEN, UNSEEN, VoxelMap
from nbv.online.possible_solid import PossibleSurface
from nbv.online.targets import GainOptions, find_targets
from nbv.online.voxels import Surfels, VoxelGrid, image_normals
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import PinholeSensor
from nbv.visibility.viewpoints import Candidates
from scenes.checks import InputError
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.pose import Pose
from scenes.world.scene import Scene

SENSOR = PinholeSensor(fov_deg=90, width=200, height=200, max_range_m=20)
AHEAD = Pose.looking_at((0, 0, 0), (1, 0, 0))
VOLUME = np.array([[0.0, -1.5, -1.5], [3.0, 1.5, 1.5]])


def squares(*placed: tuple[float, float]) -> Scene:
    """Squares across the x axis at (distance, half side)."""
    vertices, faces = [], []
    for distance, half in placed:
        faces += [[len(vertices) + k for k in face] for face in ([0, 2, 1], [0, 3, 2])]
        vertices += [
            (distance, y, z) for y, z in ((-half, -half), (half, -half), (half, half), (-half, half))
        ]
    return Scene(LabelledMesh(np.array(vertices), np.array(faces)), (None,), ("squares",), "squares")


def seen_once(scene: Scene, **options: object) -> VoxelMap:
    voxels = VoxelMap.unknown(VOLUME, voxel_m=0.1, **options)  # type: ignore[arg-type]
    return voxels.integrate(scan_scene(scene, AHEAD, SENSOR), SENSOR)


def label_at(voxels: VoxelMap, x: float, y: float, z: float) -> int:
    return int(voxels.labels[voxels.grid.index_of(np.array([[x, y, z]]))[0]])


def test_labels_of_a_square_before_a_wall():
    voxels = seen_once(squares((1.0, 0.3), (2.5, 4.0)))
    assert label_at(voxels, 0.5, 0, 0) == EMPTY
    assert label_at(voxels, 1.0, 0, 0) == SEEN
    assert label_at(voxels, 1.6, 0, 0) == OCCLUDED
    assert label_at(voxels, 2.0, 0, 0) == OCCLUDED
    assert label_at(voxels, 2.0, 0.6, 0) == OCCPLANE
    assert label_at(voxels, 2.0, 0.9, 0) == EMPTY
    assert label_at(voxels, 2.5, 1.0, 0) == SEEN
    assert label_at(voxels, 2.8, 1.0, 0) == OCCLUDED
    assert label_at(voxels, 0.5, 1.2, 0) == UNSEEN


def test_occplane_is_exactly_what_is_occluded_beside_empty():
    voxels = seen_once(squares((1.0, 0.3), (2.5, 4.0)))
    labels = voxels.labels.reshape(voxels.grid.shape)
    for i, j, k in np.argwhere((labels == OCCPLANE) | (labels == OCCLUDED)):
        beside = [
            labels[i + a, j + b, k + c]
            for a, b, c in (*np.eye(3, dtype=int), *-np.eye(3, dtype=int))
            if all(0 <= p + d < n for p, d, n in zip((i, j, k), (a, b, c), labels.shape, strict=True))
        ]
        assert (labels[i, j, k] == OCCPLANE) == (EMPTY in beside)


def test_seen_beats_empty_and_empty_beats_occluded():
    both = squares((1.0, 0.3), (2.5, 4.0))
    voxels = seen_once(both)
    side = Pose.looking_at((2.0, 1.4, 0), (2.0, 0, 0))
    later = voxels.integrate(scan_scene(both, side, SENSOR), SENSOR)
    assert label_at(later, 2.0, 0, 0) == EMPTY
    assert (later.labels[voxels.labels == SEEN] == SEEN).all()
    gone = voxels.integrate(scan_scene(squares((2.5, 4.0)), AHEAD, SENSOR), SENSOR)
    assert label_at(gone, 1.0, 0, 0) == SEEN


LOOKS = [Pose.looking_at((0, y, z), (2.5, 0.3 * y, 0.3 * z)) for y, z in ((0, 0), (1, 0), (-1, 1), (0, -1))]


def after_noisy_looks(noise: str, voxel_m: float) -> VoxelMap:
    voxels = VoxelMap.unknown(VOLUME, voxel_m=voxel_m)
    for seed, pose in enumerate(LOOKS):
        scan = scan_scene(squares((2.5, 9.0)), pose, SENSOR, noise=noise, rng=seed)
        voxels = voxels.integrate(scan, SENSOR)
    return voxels


@pytest.mark.parametrize(("sigma_mm", "voxel_m"), [(2, 0.05), (10, 0.05), (10, 0.1), (25, 0.1)])
def test_noise_tears_no_holes_and_leaves_no_phantoms(sigma_mm, voxel_m):
    voxels = after_noisy_looks(f"gaussian-{sigma_mm}mm", voxel_m)
    seen = voxels.grid.centres(np.flatnonzero(voxels.labels == SEEN))
    farthest = 5.5 * sigma_mm / 1e3 + voxel_m / 2  # one of a million samples strays farther
    assert np.abs(seen[:, 0] - 2.5).max() <= farthest
    y, z = np.meshgrid(np.arange(-1.2, 1.2, voxel_m / 3), np.arange(-1.2, 1.2, voxel_m / 3))
    wall = np.stack([np.full(y.size, 2.5), y.ravel(), z.ravel()], axis=1)
    assert (voxels.labels[voxels.grid.index_of(wall)] == SEEN).all()
    behind = voxels.grid.index_of(wall + [3.5 * sigma_mm / 1e3 + 2 * voxel_m, 0, 0])
    assert not (voxels.labels[behind[behind >= 0]] == EMPTY).any()


@pytest.mark.parametrize(("sigma_mm", "voxel_m"), [(2, 0.05), (10, 0.05), (10, 0.1)])
def test_surfels_of_noisy_scans_know_normal_and_quality(sigma_mm, voxel_m):
    exact, noisy = (after_noisy_looks(noise, voxel_m).surfels for noise in ("none", f"gaussian-{sigma_mm}mm"))
    error = np.degrees(np.arccos(np.clip(-noisy.normals[:, 0], -1, 1)))
    assert np.average(error, weights=noisy.areas) < 3
    assert np.average(error > 20, weights=noisy.areas) < 0.01
    means = [np.average(surfels.quality, weights=surfels.areas) for surfels in (exact, noisy)]
    assert means[1] == pytest.approx(means[0], abs=0.02)


def test_a_stray_echo_vanishes_when_more_scans_go_through_it():
    scan = scan_scene(squares((2.5, 4.0)), AHEAD, SENSOR)
    ranges = scan.ranges.copy()
    ranges[100, 100] = 1.2
    stray = replace(scan, ranges=ranges)
    voxels = VoxelMap.unknown(VOLUME, voxel_m=0.1).integrate(stray, SENSOR)
    assert label_at(voxels, 1.2, 0, 0) == SEEN
    labels = []
    for y in (0.3, -0.3):
        beside = Pose.looking_at((0, y, 0), (2.5, 0, 0))
        voxels = voxels.integrate(scan_scene(squares((2.5, 4.0)), beside, SENSOR), SENSOR)
        labels.append(label_at(voxels, 1.2, 0, 0))
    assert labels == [SEEN, EMPTY]
    once_more = voxels.integrate(stray, SENSOR)
    assert label_at(once_more, 1.2, 0, 0) == SEEN  # the votes are even: a thin thing is not to be torn


def test_pixels_without_return_empty_the_ray_and_pixels_that_never_looked_do_not():
    cone = PinholeSensor(fov_deg=90, width=200, height=200, aperture="circular", max_range_m=20)
    scan = scan_scene(squares((1.0, 0.1)), AHEAD, cone)
    voxels = VoxelMap.unknown(VOLUME, voxel_m=0.1).integrate(scan, cone)
    assert label_at(voxels, 1.5, 1.2, 0) == EMPTY
    assert label_at(voxels, 1.5, 1.3, 1.3) == UNSEEN


def test_surfels_know_normal_quality_and_area():
    voxels = seen_once(squares((2.0, 4.0)))
    surfels = voxels.surfels
    cosine = 2.0 / np.linalg.norm(surfels.points, axis=1)
    assert np.allclose(surfels.points[:, 0], 2.0)
    assert np.allclose(surfels.normals, [-1, 0, 0], atol=1e-6)
    assert np.abs(surfels.quality - cosine).max() < 0.01
    inner = np.abs(surfels.points[:, 1:]).max(axis=1) < 1.2
    assert surfels.areas[inner].mean() == pytest.approx(0.01, rel=0.02)
    nearer = Pose.looking_at((1.0, 0.0, 0.0), (2.0, 0.0, 0.0))
    better = voxels.integrate(scan_scene(squares((2.0, 4.0)), nearer, SENSOR), SENSOR).surfels
    shared = np.isin(better.keys, surfels.keys)
    assert (better.quality[shared] >= surfels.quality - 1e-12).all()


def test_normals_do_not_reach_across_jump_edges():
    scene = squares((1.0, 0.3), (2.5, 4.0))
    scan = scan_scene(scene, AHEAD, SENSOR, noise="gaussian-1mm", rng=0)
    found = image_normals(scan, 0.06)
    known = np.isfinite(found.cosine)
    assert known.mean() > 0.97
    error = np.degrees(np.arccos(np.clip(-found.normals[known][:, 0], -1, 1)))
    assert np.median(error) < 3
    assert (error > 25).mean() < 0.005
    empty = scan_scene(squares((-1.0, 1.0)), AHEAD, SENSOR)
    assert np.isnan(image_normals(empty, 0.06).cosine).all()
    grid = VoxelGrid.around(VOLUME)
    assert len(Surfels.of_image(image_normals(empty, grid.voxel_m / 2), grid).keys) == 0


def test_free_positions_need_known_empty_space():
    voxels = seen_once(squares((2.5, 4.0)))
    asked = np.array([[1.5, 0, 0], [2.3, 0, 0], [0.3, 0, 0], [1.0, 0.85, 0], [9.0, 0, 0]])
    assert voxels.is_free(asked, 0.3).tolist() == [True, False, False, False, False]
    stood = voxels.clear_around(np.zeros(3), 0.5)
    assert voxels.is_free(np.array([[0.2, 0, 0]]), 0.15).tolist() == [False]
    assert stood.is_free(np.array([[0.2, 0, 0]]), 0.15).tolist() == [True]
    around = VoxelMap.unknown(VOLUME, voxel_m=0.1, outside_is_empty=True)
    assert around.is_free(np.array([[9.0, 0, 0], [1.0, 0, 0]]), 0.3).tolist() == [True, False]


def test_boundary_of_one_empty_voxel_is_a_cube():
    voxels = VoxelMap.unknown(VOLUME, voxel_m=0.5).clear_around(np.array([1.5, 0.0, 0.0]), 0.01)
    faces = voxels.boundary()
    assert len(faces.voxel) == 6
    centre = faces.centres.mean(axis=0)
    assert np.allclose(np.einsum("ij,ij->i", faces.outward, centre - faces.centres), 0.25)
    vertices, triangles = faces.triangles(0.5)
    a, b, c = vertices[triangles].transpose(1, 0, 2)
    assert np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2 == pytest.approx(6 * 0.25)


def targets_of(voxels: VoxelMap, attempts, options: GainOptions):
    surface = PossibleSurface.of(voxels)
    return find_targets(voxels, surface, required_cosine=0.5, attempts=attempts, options=options)


def gain_from(voxels: VoxelMap, position: tuple[float, float, float], options: GainOptions) -> float:
    boundary = PossibleSurface.of(voxels).ray_caster()
    attempts = np.zeros((2, voxels.grid.n_voxels), np.int32)
    targets = targets_of(voxels, attempts, options)
    wide = PinholeSensor(fov_deg=150, width=9, height=9, max_range_m=20)
    candidates = Candidates(np.array([position]), np.array([[1.0, 0, 0], [-1.0, 0, 0]]))
    best = best_view(boundary, targets, candidates, sensor=wide, required_cosine=0.5)
    return 0.0 if best is None else best.gain_m2


def test_quality_gain_counts_what_was_seen_too_flat():
    flat = LabelledMesh(
        np.array([[0, -9, -1.0], [9, -9, -1.0], [9, 9, -1.0], [0, 9, -1.0]]), np.array([[0, 1, 2], [0, 2, 3]])
    )
    voxels = seen_once(Scene(flat, (None,), ("floor",), "floor"))
    only_quality = GainOptions(occplane_weight=0.0)
    poor = targets_of(voxels, np.zeros((2, voxels.grid.n_voxels), np.int32), only_quality)
    beyond = np.linalg.norm(poor.points[:, :2], axis=1) > 1.6  # 60 deg are 1.73 m from below the sensor
    assert poor.worth_m2[beyond].sum() > 0.95 * poor.worth_m2.sum()  # the rest borders on what nobody saw
    total = poor.worth_m2.sum()
    gain = gain_from(voxels, (1.5, 0.0, 1.2), only_quality)
    assert 0.3 * total < gain <= total * 1.000001
    assert gain_from(voxels, (1.5, 0.0, 1.2), GainOptions(occplane_weight=0.0, quality_weight=2.0)) == (
        pytest.approx(2 * gain)
    )
    assert gain_from(voxels, (0.2, 0.0, -0.9), only_quality) == 0.0


def test_unknown_gain_counts_the_faces_of_the_shadow():
    voxels = seen_once(squares((1.0, 0.3), (2.5, 4.0)))
    only_unknown = GainOptions(quality_weight=0.0)
    again = gain_from(voxels, (0.0, 0.0, 0.0), only_unknown)
    beside = gain_from(voxels, (1.9, 1.3, 0.0), only_unknown)
    assert beside > 5 * again  # seen from where it was cast, the face of a shadow has no area
    assert gain_from(voxels, (1.9, 1.3, 0.0), GainOptions(occplane_weight=3.0, quality_weight=0.0)) == (
        pytest.approx(3 * beside)
    )


def test_targets_that_views_did_not_settle_are_given_up():
    voxels = seen_once(squares((1.0, 0.3), (2.5, 4.0)))
    attempts = np.full((2, voxels.grid.n_voxels), 2, np.int32)
    assert len(targets_of(voxels, attempts, GainOptions(max_attempts=2))) == 0
    assert len(targets_of(voxels, attempts, GainOptions(max_attempts=3))) > 0
    fresh = targets_of(voxels, attempts * 0, GainOptions())
    thin = fresh.thin(100)
    assert 50 < len(thin) <= 100
    assert thin.worth_m2.sum() == pytest.approx(fresh.worth_m2.sum(), rel=0.2)


def test_accumulator_cells_hold_their_middles():
    directions = cell_directions()
    assert (cell_of(directions * 3.0) == np.arange(len(directions))).all()
    assert (cell_of(np.array([[1.0, 1.0, 1.0], [-1.0, -1.0, -1.0]])) < len(directions)).all()


def test_grid_leaves_room_around_its_bounds():
    grid = VoxelGrid.around(VOLUME, 0.1)
    corners = np.stack(np.meshgrid(*VOLUME.T), axis=-1).reshape(-1, 3)
    assert (grid.index_of(corners) >= 0).all()
    assert (grid.index_of(grid.centres()) == np.arange(grid.n_voxels)).all()
    assert grid.index_of(np.full((1, 3), np.nan)).tolist() == [-1]
    assert 60_000 < VoxelGrid.around(VOLUME).n_voxels < 110_000


def test_centres_in_another_frame_are_the_centres_moved():
    grid = VoxelGrid(np.array([0.3, -2.0, 1.0]), (4, 5, 6), 0.7)
    pose = Pose.looking_at((1.0, 2.0, 3.0), (-2.0, 0.5, 0.1)).inverse()
    assert np.allclose(grid.centres_in(pose), pose.apply(grid.centres()), atol=1e-12)


def test_cells_around_a_cell_are_those_within_the_radius():
    grid = VoxelGrid(np.zeros(3), (9, 8, 7), 0.5)
    cells = grid.index_of(np.array([[2.2, 2.2, 1.6], [0.1, 3.9, 0.1]]))
    near = grid.around_cells(cells, 1.3)
    assert (near[0] >= 0).all()
    assert (near[1] < 0).any()
    for row, cell in zip(near, cells, strict=True):
        distance = np.linalg.norm(grid.centres() - grid.centres(cell[None]), axis=1)
        assert sorted(row[row >= 0].tolist()) == np.flatnonzero(distance < 1.3).tolist()


def test_unusable_options_are_refused():
    with pytest.raises(InputError, match="needs a positive side"):
        VoxelGrid(np.zeros(3), (1, 1, 1), 0.0)
    with pytest.raises(InputError, match="bounds must be finite and rise"):
        VoxelGrid.around(VOLUME[::-1])
    with pytest.raises(InputError, match="use a larger one"):
        VoxelGrid.around(VOLUME, 1e-4)
    with pytest.raises(InputError, match="must not be negative"):
        GainOptions(quality_weight=-1.0)
    with pytest.raises(InputError, match="both weights 0"):
        GainOptions(quality_weight=0.0, occplane_weight=0.0)
    with pytest.raises(InputError, match="at least 1"):
        GainOptions(max_targets=0)
