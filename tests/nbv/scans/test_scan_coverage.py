# SPDX-License-Identifier: MIT
"""Coverage of scans without a model: measured area against the truth, shadows against closed forms."""

from dataclasses import replace

import numpy as np
import pytest

from completion.options import CompletionOptions
from completion.pipeline import complete
from nbv.coverage.measurement import CoverageTally
from nbv.online.occupancy import VoxelMap
from nbv.online.voxels import VoxelGrid
from nbv.report.scans_report import scan_coverage_page
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import PinholeSensor
from nbv.scans.measured_area import measure_area
from nbv.scans.scan_coverage import cover_by_scans
from nbv.scans.scan_map import ScanMap, with_known_noise
from nbv.scans.state_mesh import FRONTIER, INFERRED, MEASURED, SEEN_WORSE, SHADOW, StateMesh
from nbv.scans.unseen_boundary import UnseenBoundary
from nbv.visibility.requirement import Requirement
from nbv.visibility.samples import sample_surface
from nbv.visibility.zones import Box, Zones
from scenes.checks import InputError
from scenes.pose import Pose
from scenes.world.builtin import builtin_scene
from tests.helpers.sheet_scenes import EAST, before_wall

ROOM = builtin_scene("two_occluders")
SENSOR = PinholeSensor(fov_deg=70, width=200, height=200, name="small")
GRID = VoxelGrid.around(ROOM.mesh.bounds(), 0.1)
AT_60 = Requirement(max_incidence_deg=60)
POSES = [
    Pose.looking_at(np.array(eye), np.array(target))
    for eye, target in (
        ((0.6, 0.6, 1.6), (5, 4, 0.8)),
        ((5.2, 0.8, 1.6), (1, 4, 0.8)),
        ((3.6, 4, 1.2), (1, 1, 0.8)),
    )
]


def room_scans(noise="none"):
    return [scan_scene(ROOM, pose, SENSOR, noise=noise, rng=k) for k, pose in enumerate(POSES)]


@pytest.fixture(scope="module")
def coverage():
    scan_map = ScanMap.of(room_scans()[:2], SENSOR)
    model = complete(scan_map.scans, CompletionOptions(texture=False), rng=0, n_threads=2)
    return cover_by_scans(scan_map, AT_60, completion=model)


@pytest.mark.parametrize("noise", ["none", "gaussian-5mm"])
@pytest.mark.parametrize("n", [1, 3])
def test_measured_area_is_that_of_the_true_surface(noise, n):
    scans = room_scans(noise)[:n]
    tally = CoverageTally.start(ROOM.ray_caster(1), sample_surface(ROOM.mesh, 0.05), AT_60)
    for scan in scans:
        tally.add_scan(scan)
    seen_m2 = float(tally.samples.areas[tally.best_cosine > 0].sum())
    found = measure_area(scans, AT_60, GRID)
    assert found.met_m2 == pytest.approx(tally.met_m2(), rel=0.03)
    assert found.total_m2 == pytest.approx(seen_m2, rel=0.06)


def test_surface_that_is_measured_twice_counts_once():
    scan = room_scans()[0]
    assert measure_area([scan, scan], AT_60, GRID) == measure_area([scan], AT_60, GRID)


def test_one_more_scan_never_lowers_what_is_measured_and_moving_the_world_changes_nothing():
    scans = room_scans()
    met = [measure_area(scans[:n], AT_60, GRID).met_m2 for n in (1, 2, 3)]
    assert met == sorted(met)
    shift = np.array([7.0, -3.0, 2.0])
    away = [scan.transform(Pose.from_parts(np.eye(3), shift)) for scan in scans]
    moved = measure_area(away, AT_60, replace(GRID, origin=GRID.origin + shift))
    assert moved.met_m2 == pytest.approx(met[-1], rel=1e-3)


def test_each_requirement_takes_area_away():
    scans, plain = room_scans(), measure_area(room_scans(), AT_60, GRID)
    for stricter in (
        Requirement(max_incidence_deg=45),
        Requirement(max_range_m=3.0),
        Requirement(min_density_per_m2=3000),
        Requirement(k=2),
    ):
        found = measure_area(scans, stricter, GRID)
        assert 0 < found.met_m2 < plain.met_m2
        assert found.total_m2 == pytest.approx(plain.total_m2, rel=0.03)
    with pytest.raises(InputError, match="whose errors are known"):
        measure_area([replace(scans[0], sigma_m=None)], Requirement(max_sd_m=0.01), GRID)


def test_measured_area_of_a_region_is_a_part():
    west, east = (Zones(Box((low, -1, -1), (high, 6, 4))) for low, high in ((-1, 3), (3, 7)))
    parts = [measure_area(room_scans(), AT_60, GRID, zones) for zones in (west, east)]
    whole = measure_area(room_scans(), AT_60, GRID)
    assert sum(part.total_m2 for part in parts) == pytest.approx(whole.total_m2, rel=0.03)


def test_the_edge_of_a_shadow_is_a_frustum():
    near, far, half = 2.0, 3.0, 0.3
    scan = scan_scene(before_wall(near, far, half), EAST, SENSOR, rng=0)
    volume = np.array([[0.0, -1.2, -1.2], [3.1, 1.2, 1.2]])
    voxels = VoxelMap.unknown(volume, voxel_m=0.04).integrate(scan, SENSOR)
    unseen = UnseenBoundary.of(voxels)
    beyond = unseen.faces.centres[:, 0] > near + 0.1
    beside = np.abs(unseen.faces.centres[:, 1:]).max(axis=1) < 0.7
    slant = np.hypot(far - near, half * (far / near - 1))
    frustum = 4 * slant * half * (1 + far / near)
    found = unseen.area_m2(unseen.occluded & beyond & beside)
    assert found == pytest.approx(frustum, rel=0.15)


@pytest.mark.long
def test_what_a_surface_explains_is_taken_from_the_shadow(coverage):
    bare = UnseenBoundary.of(
        coverage.scan_map.voxels, stood=np.array([s.origin for s in coverage.scan_map.scans]), clearance_m=0.3
    )
    explained = coverage.unseen
    assert explained.explained_m2 > 0
    assert explained.occluded_m2 + explained.explained_m2 == pytest.approx(bare.occluded_m2)
    assert bare.explained_m2 == 0
    assert explained.frontier_m2 <= bare.frontier_m2


def test_space_around_the_sensor_leaves_no_frontier():
    scan_map = ScanMap.of(room_scans()[:1], SENSOR)
    origin = scan_map.scans[0].origin
    with_ball = UnseenBoundary.of(scan_map.voxels)
    without = UnseenBoundary.of(scan_map.voxels, stood=origin[None], clearance_m=scan_map.clearance_m)
    assert without.frontier_m2 < with_ball.frontier_m2
    distance = np.linalg.norm(without.faces.centres - origin, axis=1)
    assert distance.min() > scan_map.clearance_m


def test_noise_that_nobody_knows_is_read_off_the_scan():
    scan = scan_scene(ROOM, POSES[0], SENSOR, noise="gaussian-5mm", rng=0)
    assert with_known_noise(scan) is scan
    assert with_known_noise(replace(scan, sigma_m=None)).sigma_m == pytest.approx(0.005, rel=0.1)


def test_coverage_json_keeps_surface_and_boundary_apart(coverage):
    content = coverage.to_json()
    surface, boundary = content["surface"], content["boundary"]
    assert surface["met_m2"] + surface["seen_worse_m2"] == pytest.approx(surface["measured_m2"])
    assert surface["recognised_m2"] == coverage.completion.observed_m2
    assert surface["inferred_m2"] == coverage.completion.hypothesised_m2 > 0
    assert set(boundary) == {"occluded_m2", "explained_m2", "frontier_m2"}
    assert content["scans"] == 2
    assert len(content["surfaces"]) == len(coverage.completion.patches)
    assert sum(one["hypothesised_m2"] for one in content["surfaces"]) == pytest.approx(
        surface["inferred_m2"], rel=0.05
    )
    met = sum(one["met"] * one["observed_m2"] for one in content["surfaces"])
    assert met == pytest.approx(surface["met_m2"], rel=0.1)


def test_without_completion_nothing_is_inferred():
    bare = cover_by_scans(ScanMap.of(room_scans()[:1], SENSOR), AT_60).to_json()
    assert bare["surface"]["inferred_m2"] is None
    assert bare["surfaces"] == []


def test_the_state_mesh_holds_each_state_and_its_areas(coverage):
    state = StateMesh.of(coverage)
    areas = np.bincount(state.mesh.face_surface, state.mesh.face_areas(), 5)
    assert (areas > 0).all()
    assert areas[INFERRED] == pytest.approx(coverage.completion.hypothesised_m2)
    unexplained = ~coverage.unseen.explained
    side = coverage.scan_map.voxels.grid.voxel_m
    n_faces = [
        (coverage.unseen.occluded & unexplained).sum(),
        (~coverage.unseen.occluded & unexplained).sum(),
    ]
    assert areas[[SHADOW, FRONTIER]] == pytest.approx(np.array(n_faces) * side**2)
    has_normal = state.cosine > 0  # pixels without one are as their neighbours are
    assert has_normal[state.state <= SEEN_WORSE].mean() > 0.9
    assert (state.cosine[has_normal & (state.state == MEASURED)] >= 0.5 - 1e-6).all()
    assert (state.cosine[has_normal & (state.state == SEEN_WORSE)] < 0.5).all()


def test_the_report_says_which_areas_are_boundary(coverage):
    page = scan_coverage_page(coverage, StateMesh.of(coverage), SENSOR, "two scans", 1)
    html = page.to_html()
    assert "Two" not in page.summary
    assert page.summary.startswith("2 scans measured")
    assert "They are not areas of surface" in html
    assert "edge of shadows (boundary, not surface)" in html
