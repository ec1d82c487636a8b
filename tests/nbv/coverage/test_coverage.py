# SPDX-License-Identifier: MIT
"""Coverage: closed forms, monotony, motion of the world, reasons, real scans."""

import numpy as np
import pytest

from nbv.coverage.coverage import MET, REACHABLE
from nbv.coverage.measurement import measure_coverage, measure_scan_coverage
from nbv.coverage.unreachable import unreachable_patches
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import PinholeSensor, View
from nbv.visibility.requirement import Requirement
from nbv.visibility.samples import sample_surface
from nbv.visibility.viewpoints import Candidates
from scenes.checks import InputError
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.pose import Pose
from scenes.world.builtin import builtin_scene
from scenes.world.scene import Scene

WIDE = PinholeSensor(fov_deg=150, width=64, height=64, name="wide")
SENSOR = PinholeSensor(fov_deg=60, width=128, height=128, name="small")


def floor(half: float = 2.0, extra: tuple[np.ndarray, np.ndarray] | None = None) -> Scene:
    """A square on the ground, normal up, and what else there is."""
    vertices = np.array([[-half, -half, 0], [half, -half, 0], [half, half, 0], [-half, half, 0]])
    faces, surface = np.array([[0, 1, 2], [0, 2, 3]]), np.array([0, 0])
    if extra is not None:
        vertices, faces = np.vstack([vertices, extra[0]]), np.vstack([faces, extra[1] + 4])
        surface = np.concatenate([surface, np.ones(len(extra[1]), int)])
    return Scene(LabelledMesh(vertices, faces, surface), (None, None), ("floor", "lid"), "floor", "object")


def down_from(height: float, sensor: PinholeSensor = WIDE) -> View:
    return View(Pose.looking_at((0, 0, height), (0, 0, 0)), sensor)


def one_candidate(height: float) -> Candidates:
    return Candidates(np.array([[0.0, 0.0, height]]), np.array([[0.0, 0.0, -1.0]]))


@pytest.mark.parametrize("angle", [30.0, 45.0, 60.0])
def test_head_on_coverage_is_the_disc_of_the_incidence_angle(angle):
    height = 0.8
    scene = floor(half=2.0)
    coverage = measure_coverage(
        scene,
        [down_from(height)],
        max_incidence_deg=angle,
        samples=sample_surface(scene.mesh, 0.02),
        candidates=one_candidate(height),
    )
    disc = np.pi * (height * np.tan(np.radians(angle))) ** 2 / 16
    assert coverage.total_m2 == pytest.approx(16)
    assert coverage.met == pytest.approx(disc, abs=0.001)
    assert coverage.met == coverage.reachable
    assert coverage.reachable + coverage.unreachable == 1
    reasons = coverage.reasons()
    assert reasons["grazing"] == pytest.approx(coverage.unreachable)
    assert coverage.inferred == 0.0


def test_square_aperture_sees_its_footprint():
    scene = floor()
    view = down_from(1.0, SENSOR)
    coverage = measure_coverage(
        scene, [view], samples=sample_surface(scene.mesh, 0.02), candidates=one_candidate(1.0)
    )
    assert coverage.met == pytest.approx((2 * np.tan(np.radians(30))) ** 2 / 16, abs=0.003)
    assert coverage.reasons()["out_of_aperture"] > 0.4


def test_best_cosine_is_that_of_the_best_view():
    scene = floor()
    views = [down_from(1.0), down_from(2.0)]
    coverage = measure_coverage(scene, views, candidates=one_candidate(1.0))
    radius = np.linalg.norm(coverage.samples.points[:, :2], axis=1)
    seen = coverage.n_views == 2
    assert seen.any()
    assert np.allclose(coverage.best_cosine[seen], 2 / np.hypot(2, radius[seen]))


def test_hidden_and_out_of_range_are_told_apart():
    lid = np.array([[-1.0, -1, 0.5], [1, -1, 0.5], [1, 1, 0.5], [-1, 1, 0.5]])
    scene = floor(extra=(lid, np.array([[0, 1, 2], [0, 2, 3]])))
    requirement = Requirement(max_incidence_deg=90)
    samples = sample_surface(scene.mesh, 0.05)
    coverage = measure_coverage(
        scene, [down_from(1.0)], requirement, samples=samples, candidates=one_candidate(1.0)
    )
    beneath = (coverage.samples.surface == 0) & (np.abs(samples.points[:, :2]).max(axis=1) < 0.99)
    assert (coverage.reason[beneath] == 0).all()
    rows = {row.name: row for row in coverage.by_surface()}
    assert rows["lid"].met == 1.0
    assert rows["lid"].area_m2 == pytest.approx(4)
    near = Requirement(max_incidence_deg=90, max_range_m=0.6)
    coverage = measure_coverage(scene, [], near, sensor=WIDE, samples=samples, candidates=one_candidate(1.0))
    assert coverage.reasons()["out_of_range"] > 0
    assert coverage.reachable == pytest.approx(np.pi * (0.36 - 0.25) / 20, abs=0.002)


def test_unreachable_patches_are_parts_of_one_surface_with_one_reason():
    lids = np.array(
        [
            [x + dx, y, 0.5]
            for x in (-1.2, 1.2)
            for dx, y in ((-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5))
        ]
    )
    quads = np.array([[0, 1, 2], [0, 2, 3]])
    scene = floor(extra=(lids, np.vstack([quads, quads + 4])))
    samples = sample_surface(scene.mesh, 0.05)
    above = Candidates(np.array([[x, 0, 3.0] for x in (-1.2, 0, 1.2)]), np.array([[0.0, 0, -1]]))
    coverage = measure_coverage(
        scene, [], max_incidence_deg=75, sensor=WIDE, samples=samples, candidates=above
    )
    patches = unreachable_patches(coverage)
    assert [patch.reason for patch in patches] == ["hidden", "hidden"]
    assert {patch.name for patch in patches} == {"floor"}
    assert sorted(round(float(patch.centre[0]), 1) for patch in patches) == [-1.4, 1.4]
    assert sum(patch.area_m2 for patch in patches) == pytest.approx(coverage.unreachable * coverage.total_m2)
    assert (
        patches[0].to_json()["area_m2"] == patches[0].area_m2 == pytest.approx(0.864, abs=0.04)
    )  # 0.72 x 1.2 m in both shadows
    assert unreachable_patches(measure_coverage(floor(), [], sensor=WIDE, candidates=one_candidate(1.0)))


def test_one_more_view_never_lowers_coverage():
    scene = builtin_scene("two_occluders")
    rng = np.random.default_rng(1)
    samples = sample_surface(scene.mesh, 0.2)
    candidates = Candidates(rng.uniform([0.4, 0.4, 0.4], [5.6, 4.6, 2.3], (5, 3)), np.eye(3))
    views = []
    before = measure_coverage(scene, [], sensor=SENSOR, samples=samples, candidates=candidates)
    for _ in range(8):
        eye = rng.uniform([0.4, 0.4, 0.4], [5.6, 4.6, 2.3])
        views.append(View(Pose.looking_at(eye, rng.uniform([0, 0, 0], [6, 5, 2.7])), SENSOR))
        after = measure_coverage(scene, views, samples=samples, candidates=candidates)
        assert (after.best_cosine >= before.best_cosine).all()
        assert before.met <= after.met <= after.reachable
        assert before.reachable <= after.reachable
        before = after
    assert before.met > 0.1


@pytest.mark.parametrize("far", [0.0, 5000.0])
def test_moving_the_world_changes_nothing(far):
    scene = builtin_scene("two_occluders")
    motion = Pose.looking_at((far, 2.0, 3.0), (far + 1.0, 4.0, 3.5))
    candidates = Candidates(
        np.array([[0.5, 0.5, 1.0], [5.5, 4.5, 2.0]]), np.array([[1.0, 1, 0], [-1.0, -1, 0]])
    )
    moved_candidates = Candidates(motion.apply(candidates.positions), motion.rotate(candidates.directions))
    views = [View(candidates.pose(k), WIDE) for k in (0, 3)]
    moved_views = [View(motion @ view.world_from_sensor, WIDE) for view in views]
    samples, moved = sample_surface(scene.mesh, 0.15), sample_surface(scene.transform(motion).mesh, 0.15)
    here = measure_coverage(scene, views, samples=samples, candidates=candidates)
    there = measure_coverage(scene.transform(motion), moved_views, samples=moved, candidates=moved_candidates)
    assert len(moved) == len(samples)
    assert there.met == pytest.approx(here.met, abs=2e-4)
    assert there.reachable == pytest.approx(here.reachable, abs=2e-3)
    assert 0.1 < here.met < 0.9


def test_faces_count_from_both_sides():
    scene = floor()
    flipped = Scene(
        LabelledMesh(scene.mesh.vertices, scene.mesh.faces[:, ::-1], scene.mesh.face_surface),
        scene.surfaces,
        scene.surface_names,
        "flipped",
        "object",
    )
    met = [measure_coverage(s, [down_from(1.0)], candidates=one_candidate(1.0)).met for s in (scene, flipped)]
    assert met[0] == pytest.approx(met[1], abs=2e-3)
    assert met[0] > 0.1


def test_faces_and_json():
    scene = floor()
    coverage = measure_coverage(scene, [down_from(1.0)], candidates=one_candidate(1.0))
    faces = coverage.by_face()
    assert faces.state.tolist() == [MET, MET] or REACHABLE not in faces.state
    assert faces.best_cosine.shape == (2,)
    assert (faces.n_views > 0.5).all()
    content = coverage.to_json()
    assert list(content)[:5] == ["total_m2", "met", "reachable", "unreachable", "inferred"]
    assert content["requirement"]["max_incidence_deg"] == 60
    assert sum(content["unreachable_because"].values()) == pytest.approx(content["unreachable"])
    assert [row["name"] for row in content["surfaces"]] == ["floor"]


@pytest.mark.parametrize("noise", ["none", "gaussian-2mm"])
def test_coverage_by_scans_agrees_with_coverage_by_views(noise):
    scene = builtin_scene("two_occluders")
    views = [
        View(Pose.looking_at((1, 1, 1.6), (4, 3, 1)), SENSOR),
        View(Pose.looking_at((5, 1, 1), (2, 2, 0.5)), SENSOR),
    ]
    samples = sample_surface(scene.mesh, 0.15)
    scans = [scan_scene(scene, view, noise=noise, rng=k) for k, view in enumerate(views)]
    candidates = Candidates(np.array([[3.0, 1, 1]]), np.array([[1.0, 0, 0]]))
    by_views = measure_coverage(scene, views, samples=samples, candidates=candidates)
    by_scans = measure_scan_coverage(scene, scans, samples=samples, candidates=candidates)
    assert by_scans.met == pytest.approx(by_views.met, abs=0.01)
    assert ((by_scans.n_views > 0) == (by_views.n_views > 0)).mean() > 0.98


def test_unusable_input_is_refused():
    scene = floor()
    with pytest.raises(InputError, match="not both"):
        measure_coverage(scene, [down_from(1.0)], Requirement(), max_incidence_deg=60)
    with pytest.raises(InputError, match="needs a sensor"):
        measure_coverage(scene, [])
    with pytest.raises(InputError, match=r"0\.\.90 deg, got 120"):
        Requirement(max_incidence_deg=120)
    with pytest.raises(InputError, match="max_range_m must be positive, got -1"):
        Requirement(max_range_m=-1)
