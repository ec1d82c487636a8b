# SPDX-License-Identifier: MIT
from dataclasses import replace

import numpy as np
import pytest

from completion.boundary.meshing import mesh_cells
from completion.boundary.range_mesh import mesh_range_image
from completion.evidence.chart_grid import ChartGrid
from completion.evidence.evidence import Label, Scans
from completion.evidence.form import form_of
from completion.evidence.free_space import free_cells
from completion.evidence.reach import reach_of
from completion.evidence.sight import look, sight_of
from completion.evidence.weighing import weigh
from completion.observe.observation import observe
from completion.observe.tolerance import EvidenceOptions
from completion.result.audit import audit, bundle
from scenes.pose import Pose
from scenes.scan.projection import PinholeProjection
from scenes.scan.range_image import RangeImage
from scenes.surfaces.catalogue import Cylinder, Plane

CAMERA = PinholeProjection.from_fov(120, 120, 60)
WALL = Plane((0, 0, 3), (0, 0, -1), (1, 0, 0))
GRID = ChartGrid.over(WALL, (-2.5, -2.5), (2.5, 2.5), 0.05, full_turn=False)
DEPTH = np.full((120, 120), 3.0)
DEPTH[40:80, 20:50] = 1.5  # a box before the wall
DEPTH[40:80, 70:100] = 5.0  # a window in it
DEPTH[10:20, 50:70] = np.inf  # glass
SCAN = RangeImage(DEPTH / CAMERA.directions()[..., 2], CAMERA, Pose.identity(), sigma_m=0.0)
USUAL = EvidenceOptions().tolerance()
EXACT = np.zeros(GRID.shape[0] * GRID.shape[1])


def evidence(*scans: RangeImage, options: EvidenceOptions = EvidenceOptions()):  # noqa: B008
    observations = [observe(scan, Pose.identity()) for scan in scans]
    owners = [
        np.where(np.abs(seen.scan.points()[..., 2] - 3) < 0.01, 1, 2).astype(np.int32)
        for seen in observations
    ]
    return weigh(GRID, EXACT, Scans(tuple(observations), tuple(owners), options.tolerance()), 1)


def free_of(grid, sd, scan):
    seen = observe(scan, Pose.identity())
    return free_cells(grid, sd, [sight_of(seen, USUAL)], [reach_of(seen)])


def test_scans_together_veto_what_each_of_them_does():
    """Tiles whose cells are decided are left out: here the same frame comes again and again, then others."""
    scans = [SCAN] * 3 + [
        replace(SCAN, ranges=np.roll(SCAN.ranges, shift, (0, 1))) for shift in ((9, 0), (0, 23), (31, -17))
    ]
    seen = [observe(scan, Pose.identity()) for scan in scans]
    found = free_cells(GRID, EXACT, [sight_of(one, USUAL) for one in seen], list(map(reach_of, seen)))
    each = [free_of(GRID, EXACT, scan) for scan in scans[2:]]
    assert len({one.sum() for one in each}) > 1
    np.testing.assert_array_equal(found, np.logical_or.reduce(each))


def test_other_frames_vote_and_colour_only_what_no_key_frame_measured():
    nearer = replace(
        SCAN, ranges=SCAN.ranges * 0.8, world_from_sensor=Pose.from_parts(np.eye(3), np.array([0, 0, 0.6]))
    )
    seen = tuple(observe(scan, Pose.identity()) for scan in (SCAN, nearer))
    owners = tuple((np.abs(one.scan.points()[..., 2] - 3) < 0.01).astype(np.int32) for one in seen)
    both, first = (weigh(GRID, EXACT, Scans(seen, owners, USUAL, keys), 1) for keys in (None, (0,)))
    alone = weigh(GRID, EXACT, Scans(seen[:1], owners[:1], USUAL), 1)
    for name in ("labels", "observed", "is_own", "through", "limb"):
        np.testing.assert_array_equal(getattr(first, name), getattr(both, name))
    assert (both.labels != alone.labels).any()
    np.testing.assert_array_equal(first.scan[alone.is_own], 0)
    np.testing.assert_array_equal(first.pixel[alone.is_own], alone.pixel[alone.is_own])
    assert (both.scan[alone.is_own] == 1).any()
    assert (first.scan[first.is_own & ~alone.is_own] == 1).all()


def label_at(found, x: float, y: float) -> int:
    _, cell = GRID.cells_of(np.array([[x, y, 3.0]]))
    return int(found.labels.ravel()[cell[0]])


def through(row: int, column: int) -> tuple[float, float]:
    """Where the ray of a pixel meets the wall."""
    direction = CAMERA.directions()[row, column]
    return tuple(direction[:2] / direction[2] * 3)


def test_every_kind_of_cell_gets_its_label():
    found = evidence(SCAN)
    assert label_at(found, *through(100, 60)) == Label.VISIBLE
    assert label_at(found, *through(60, 35)) == Label.OCCLUDED
    assert label_at(found, *through(60, 85)) == Label.FREE
    assert label_at(found, *through(15, 60)) == Label.NO_RETURN
    assert label_at(found, 2.2, 2.2) == Label.OUT
    assert not (found.observed & (found.labels != Label.VISIBLE)).any()


SAID = {  # what one scan measures along the ray through a place, and whose pixel that is: 1 is the surface
    "own": (3.0, 1),
    "nobody's": (3.0, 0),
    "another's": (3.0, 2),
    "before": (1.5, 2),
    "beyond": (5.0, 2),
    "no echo": (np.inf, 0),
}
WEIGHED = [  # two scans, one after the other: label of the place, whether it counts as measured
    ("own", "own", Label.VISIBLE, True),
    ("own", "before", Label.VISIBLE, True),
    ("own", "no echo", Label.VISIBLE, True),
    ("own", "beyond", Label.VISIBLE, True),  # what was measured stays
    ("own", "nobody's", Label.VISIBLE, True),
    ("nobody's", "nobody's", Label.VISIBLE, False),  # but far from own pixels it is something else
    ("another's", "another's", Label.VISIBLE, False),
    ("another's", "before", Label.VISIBLE, False),
    ("before", "before", Label.OCCLUDED, False),
    ("before", "no echo", Label.OCCLUDED, False),
    ("before", "beyond", Label.FREE, False),  # one beam is a veto
    ("no echo", "beyond", Label.FREE, False),
    ("another's", "beyond", Label.FREE, False),
    ("no echo", "no echo", Label.NO_RETURN, False),
]


@pytest.mark.parametrize(("one", "other", "label", "is_measured"), WEIGHED)
@pytest.mark.parametrize("turned", [False, True])
def test_two_scans_are_weighed_whatever_their_order(one, other, label, is_measured, turned):
    observations, owners = [], []
    for said in (other, one) if turned else (one, other):
        depth, owner = SAID[said]
        scan = replace(SCAN, ranges=np.full((120, 120), depth) / CAMERA.directions()[..., 2])
        observations.append(observe(scan, Pose.identity()))
        owners.append(np.full((120, 120), owner, np.int32))
    found = weigh(GRID, EXACT, Scans(tuple(observations), tuple(owners), USUAL), 1)
    assert label_at(found, 0.02, 0.02) == label
    _, cell = GRID.cells_of(np.array([[0.02, 0.02, 3.0]]))
    assert found.observed.ravel()[cell[0]] == found.is_own.ravel()[cell[0]] == is_measured
    assert (found.pixel.ravel()[cell[0]] >= 0) == is_measured or one == other == "nobody's"
    assert (found.occluder.ravel()[cell[0]] == 2) == (label == Label.OCCLUDED)


def test_free_in_any_scan_beats_occluded_and_visible_cells_stay():
    depth = np.full((120, 120), 3.0)
    depth[30:90, 10:60] = 5.0  # the second scan looks through where the first saw the box
    second = replace(SCAN, ranges=depth / CAMERA.directions()[..., 2])
    both = evidence(SCAN, second)
    assert label_at(both, *through(60, 35)) == Label.FREE
    assert label_at(both, *through(100, 60)) == Label.VISIBLE


def test_one_beam_is_a_veto_without_noise_and_not_with_it():
    depth = np.full((120, 120), 3.0)
    depth[60, 60] = 5.0
    clean = replace(SCAN, ranges=depth / CAMERA.directions()[..., 2])
    noisy = replace(clean, sigma_m=1e-4)
    for scan, vetoed in ((clean, 1), (noisy, 0)):
        free = free_of(GRID, EXACT, scan)
        assert free.sum() == vetoed


def test_beams_from_behind_are_a_veto_too():
    behind = replace(
        SCAN,
        ranges=np.full((120, 120), 9.0),
        world_from_sensor=Pose.looking_at((0, 0, 6), (0, 0, 0), up=(0, -1, 0)),
    )
    free = free_of(GRID, EXACT, behind)
    assert free.mean() > 0.3


def test_far_wall_of_a_cylinder_is_vetoed_by_beams_that_crossed_it():
    post = Cylinder((0, 0, 2), (0, 1, 0), 0.3)
    grid = ChartGrid.over(post, (0, -0.5), (0, 0.5), 0.05, full_turn=True)
    scan = replace(SCAN, ranges=np.full((120, 120), 9.0))
    free = free_of(grid, np.zeros(grid.shape[0] * grid.shape[1]), scan)
    assert free.all()


def test_tolerance_grows_with_noise_obliqueness_and_registration():
    one = np.ones(1)
    base = USUAL.along_ray(0.001 * one, 0 * one, one)
    for worse in (
        USUAL.along_ray(0.002 * one, 0 * one, one),
        USUAL.along_ray(0.001 * one, 0.003 * one, one),
        USUAL.along_ray(0.001 * one, 0 * one, 0.2 * one),
        EvidenceOptions(registration_m=0.005).tolerance().along_ray(0.001 * one, 0 * one, one),
        EvidenceOptions(n_sigma=6.0).tolerance().along_ray(0.001 * one, 0 * one, one),
        EvidenceOptions(flatness_m=0.01).tolerance().along_ray(0.001 * one, 0 * one, one),
    ):
        assert worse[0] > base[0]


def test_where_the_tolerance_is_large_only_own_pixels_count():
    tight = EvidenceOptions(max_tolerance_m=1e-6)
    sight = sight_of(observe(SCAN, Pose.identity()), tight.tolerance())
    place = *through(100, 60), 3.0
    assert look(sight.eye, form_of(WALL), place, 0.0, (3.0, 0.0)).allowed > tight.max_tolerance_m
    assert label_at(evidence(SCAN, options=tight), *through(60, 85)) != Label.FREE


def test_charts_of_cells_and_points_agree():
    post = Cylinder((0, 0, 2), (0, 1, 0), 0.3)
    for grid in (GRID, ChartGrid.over(post, (0, -0.5), (0, 0.5), 0.05, full_turn=True)):
        index, cell = grid.cells_of(grid.centres())
        assert index.tolist() == cell.tolist() == list(range(grid.shape[0] * grid.shape[1]))
    assert grid.shape[1] * grid.cell[0] == pytest.approx(post.period)


def area(mesh) -> float:
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


@pytest.mark.parametrize("merged", [True, False])
def test_cells_are_meshed_with_their_area_and_cut_exactly(merged):
    cells = np.ones(GRID.shape, dtype=bool)
    assert area(mesh_cells(GRID, cells, (), merged=merged)) == pytest.approx(25.0)
    slanted = Plane((0, 0.011, 3), (0.3, 1.0, 0.0))
    mesh = mesh_cells(GRID, cells, [slanted], merged=merged)
    assert area(mesh) == pytest.approx(25.0 / 2 - 0.011 * 5, abs=1e-9)
    assert slanted.distance(mesh.vertices).min() > -1e-6
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    assert (np.cross(b - a, c - a) @ WALL.normal_direction > 0).all()


def test_random_cells_keep_their_area_when_joined():
    cells = np.random.default_rng(0).random(GRID.shape) < 0.6
    joined, single = (mesh_cells(GRID, cells, (), merged=m) for m in (True, False))
    assert area(joined) == pytest.approx(cells.sum() * GRID.cell_area) == pytest.approx(area(single))
    assert len(joined.faces) < len(single.faces)


def test_no_cells_give_an_empty_mesh():
    assert len(mesh_cells(GRID, np.zeros(GRID.shape, dtype=bool), (), merged=True).faces) == 0


def test_range_image_mesh_has_no_triangle_across_a_jump():
    seen = observe(SCAN, Pose.identity())
    faces = mesh_range_image(seen.scan.points(), seen.valid, np.where(seen.valid, 0.1, 0.0), seen.scan.origin)
    depths = seen.scan.points().reshape(-1, 3)[faces][..., 2]
    assert np.ptp(depths, axis=1).max() < 1e-9
    assert len(faces) > 2 * 0.8 * seen.valid.sum()


@pytest.mark.parametrize("merged", [False, True])
@pytest.mark.parametrize("concave", [None, False, True])
def test_chart_meshes_are_wound_counter_clockwise_seen_from_the_normal_s_side(concave, merged):
    upright = np.array([0.0, 0.0, 1.0])
    surface = (
        Plane(np.zeros(3), upright)
        if concave is None
        else Cylinder(np.zeros(3), upright, 0.5, concave=concave)
    )
    grid = ChartGrid.over(surface, np.full(2, -0.2), np.full(2, 0.2), 0.05, full_turn=False)
    mesh = mesh_cells(grid, np.ones(grid.shape, dtype=bool), (), merged=merged)
    a, b, c = (mesh.vertices[mesh.faces[:, corner]] for corner in range(3))
    normals = surface.normal((a + b + c) / 3)
    assert (np.einsum("ij,ij->i", np.cross(b - a, c - a), normals) > 0).all()


@pytest.mark.parametrize("fy", [80.0, -80.0])  # rows may run up or down
def test_range_image_mesh_faces_its_sensor(fy):
    camera = PinholeProjection(60, 50, 80.0, fy, 29.5, 24.5)
    ranges = np.random.default_rng(0).uniform(2.9, 3.1, camera.shape)
    pose = Pose.looking_at((1.0, 2.0, 3.0), (4.0, 2.0, 1.0))
    seen = observe(RangeImage(ranges, camera, pose), Pose.identity())
    faces = mesh_range_image(seen.scan.points(), seen.valid, np.full(camera.shape, 9.0), seen.scan.origin)
    a, b, c = (seen.scan.points().reshape(-1, 3)[faces[:, corner]] for corner in range(3))
    towards = np.einsum("ij,ij->i", np.cross(b - a, c - a), seen.scan.origin - a)
    assert len(faces) == 2 * 59 * 49
    assert (towards > 0).mean() > 0.8  # steep steps between noisy pixels may face aside


def planted(depth: float, sigma: float = 0.0):
    """Audit a 1 m square at `depth` in the view of a scan of a wall at 3 m."""
    square = np.array([[-0.5, -0.5, depth], [0.5, -0.5, depth], [0.5, 0.5, depth], [-0.5, 0.5, depth]])
    scan = replace(SCAN, ranges=3.0 / CAMERA.directions()[..., 2])
    faces = np.array([[0, 2, 1], [0, 3, 2]], np.int32)
    seen = observe(scan, Pose.identity(), sigma)
    return audit(square, faces, np.zeros(4), [seen], [bundle(seen)], tolerance=USUAL)


def test_audit_measures_a_planted_violation_and_only_that():
    assert planted(2.0).violation_m2 == pytest.approx(1.0)
    assert planted(2.9, sigma=0.01).violation_m2 == pytest.approx(1.0)
    for harmless in (planted(3.5), planted(3.0), planted(2.997), planted(2.9, sigma=0.05)):
        assert harmless.violation_m2 == 0
        assert len(harmless.faces) == 0


def test_audit_of_nothing_is_zero():
    vertices, faces = np.zeros((0, 3)), np.zeros((0, 3), np.int32)
    nothing = audit(vertices, faces, np.zeros(0), [], [], tolerance=USUAL)
    assert nothing.violation_m2 == 0
