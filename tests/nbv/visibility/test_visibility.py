# SPDX-License-Identifier: MIT
"""Visibility: against brute force, thread counts, apertures; reachability and free space."""

import numpy as np
import pytest

from nbv.scanning.sensor import PinholeSensor, View
from nbv.scanning.sensor_profile import load_sensor
from nbv.visibility.candidates import find_standing, scene_candidates
from nbv.visibility.clearance import Clearance
from nbv.visibility.requirement import Requirement, SightLimits
from nbv.visibility.samples import sample_surface
from nbv.visibility.viewpoints import Candidates
from nbv.visibility.visibility import find_reachable, orient, visible_from_positions, visible_from_view
from scenes.checks import InputError
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.world.builtin import builtin_scene
from scenes.world.scene import Scene

ROOM = builtin_scene("two_occluders")
SAMPLES = sample_surface(ROOM.mesh, 0.25)
POSITIONS = np.array([[1.0, 1.0, 1.0], [5.0, 4.0, 2.0], [3.0, 3.0, 0.5]])


def sees_by_brute_force(position: np.ndarray) -> np.ndarray:
    """Plain segment against every triangle (Moeller and Trumbore), the sample's own face left out."""
    a, b, c = np.moveaxis(ROOM.mesh.corners, 1, 0)
    seen = np.ones(len(SAMPLES), bool)
    for k, point in enumerate(SAMPLES.points):
        along = point - position
        across = np.cross(along, c - a)
        det = np.einsum("ij,ij->i", b - a, across)
        with np.errstate(divide="ignore", invalid="ignore"):
            u = np.einsum("ij,ij->i", position - a, across) / det
            q = np.cross(position - a, b - a)
            v, t = (q @ along) / det, np.einsum("ij,ij->i", c - a, q) / det
        hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 1e-9) & (t < 1 - 1e-9)
        hit[SAMPLES.face[k]] = False
        seen[k] = not hit.any()
    return seen


def test_visibility_agrees_with_brute_force():
    matrix = visible_from_positions(ROOM.ray_caster(), POSITIONS, SAMPLES, SightLimits(min_cosine=0.02))
    for row, position in enumerate(POSITIONS):
        offset = position - SAMPLES.points
        cosine = np.abs(np.einsum("ij,ij->i", offset, SAMPLES.normals)) / np.linalg.norm(offset, axis=1)
        expected = np.where(sees_by_brute_force(position) & (cosine >= 0.02), cosine, 0)
        found = matrix[[row]].toarray()[0]
        assert ((found > 0) == (expected > 0)).mean() == 1.0
        assert np.allclose(found, expected)


def test_threads_change_nothing():
    caster, limits = ROOM.ray_caster(1), SightLimits(0.5, 0.5, 4.0)
    one, two = (visible_from_positions(caster, POSITIONS, SAMPLES, limits, n_threads=n) for n in (1, 2))
    assert (one.indptr == two.indptr).all()
    assert one.indices.tobytes() == two.indices.tobytes()
    assert one.data.tobytes() == two.data.tobytes()
    distance = np.linalg.norm(POSITIONS[0] - SAMPLES.points[one.indices[: one.indptr[1]]], axis=1)
    assert distance.min() >= 0.5
    assert distance.max() <= 4.0
    assert one.data.min() >= 0.5


def test_rows_of_poses_are_those_of_views():
    sensor = PinholeSensor(fov_deg=70, width=40, height=30)
    candidates = Candidates(POSITIONS, np.array([[1.0, 0, 0], [0, 1.0, 0.2], [0, 0, -1.0], [-1.0, -1, 0]]))
    caster, limits = ROOM.ray_caster(), Requirement().limits(sensor)
    seen = visible_from_positions(caster, POSITIONS, SAMPLES, limits)
    rows = orient(seen, POSITIONS, candidates.rotations(), SAMPLES.points, sensor)
    assert rows.shape == (candidates.n_poses, len(SAMPLES))
    for number in range(candidates.n_poses):
        index, _ = visible_from_view(caster, View(candidates.pose(number), sensor), SAMPLES, limits)
        assert (np.sort(rows.indices[rows.indptr[number] : rows.indptr[number + 1]]) == index).all()


def test_the_rooms_candidates_are_those_of_the_benchmark_that_stand_on_the_floor():
    standing = find_standing(ROOM, load_sensor("generic60"))
    lattice, candidates = standing.proposals.positions, standing.candidates
    x, y, z = lattice.T
    in_boxes = (abs(x - 2.2) < 0.7) & (abs(y - 2.0) < 0.5) & (z < 0.9)
    in_boxes |= (abs(x - 4.35) < 0.35) & (abs(y - 3.15) < 0.35) & (z < 1.8)
    benchmark = lattice[Clearance.of(ROOM.mesh, 0.3).holds(lattice) & ~in_boxes]
    assert len(benchmark) == 354
    assert candidates.n_poses == 42 * candidates.n_positions
    boxes = (([2.2, 2.0], [0.7, 0.5]), ([4.35, 3.15], [0.35, 0.35]))
    away = np.min(
        [np.linalg.norm(np.maximum(abs(benchmark[:, :2] - at) - half, 0), axis=1) for at, half in boxes],
        axis=0,
    )
    stands = (np.linalg.norm(benchmark[:, None] - candidates.positions, axis=2) < 1e-6).any(axis=1)
    assert stands.sum() == candidates.n_positions
    assert stands[away >= 0.35].all()  # a tripod's feet have a radius of 0.25 m, cells a side of 0.1 m
    assert not stands[away < 0.15].any()


def test_reachability_does_not_depend_on_threads_and_names_the_hidden():
    sensor, caster = load_sensor("generic60"), ROOM.ray_caster(1)
    candidates = scene_candidates(ROOM, sensor)
    found = [find_reachable(caster, SAMPLES, candidates, sensor, Requirement(), n_threads=n) for n in (1, 2)]
    assert (found[0].reason == found[1].reason).all()
    under = np.array([name.endswith("bottom") for name in ROOM.surface_names])[SAMPLES.surface]
    assert under.any()
    assert (found[0].reason[under] == 0).all()
    assert SAMPLES.areas[found[0].reachable].sum() / SAMPLES.total_m2 == pytest.approx(0.971, abs=0.005)


def test_nowhere_to_stand_is_refused():
    mesh = LabelledMesh(ROOM.mesh.vertices / 20, ROOM.mesh.faces, ROOM.mesh.face_surface)
    tiny = Scene(mesh, ROOM.surfaces, ROOM.surface_names, "tiny")
    with pytest.raises(InputError, match=r"nowhere to stand in tiny: 0\.0 m2 of floor in 0 rooms"):
        scene_candidates(tiny, load_sensor("generic60"))
    with pytest.raises(InputError, match="mode must be room or object, got 'garden'"):
        scene_candidates(ROOM, load_sensor("generic60"), mode="garden")
