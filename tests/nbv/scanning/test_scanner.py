# SPDX-License-Identifier: MIT
"""Scanner: ranges, truth, gate and noise of simulated scans against closed forms."""

import numpy as np
import pytest

from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import PinholeSensor, SphericalSensor, View
from scenes.checks import InputError
from scenes.mesh.labelled_mesh import Appearance, LabelledMesh
from scenes.pose import Pose
from scenes.world.scene import Scene

SENSOR = PinholeSensor(fov_deg=60, width=64, height=48)
AHEAD = Pose.looking_at((0, 0, 0), (1, 0, 0))


def square(distance: float = 2.0, half: float = 1.0, colour: float | None = None) -> Scene:
    """A square across the x axis."""
    vertices = [[distance, y, z] for y, z in ((-half, -half), (half, -half), (half, half), (-half, half))]
    look = None if colour is None else Appearance(np.full((2, 3, 3), colour, np.float32))
    mesh = LabelledMesh(np.array(vertices), np.array([[0, 2, 1], [0, 3, 2]]), np.array([1, 1]), look)
    return Scene(mesh, (None, None), ("nothing", "square"), "square", "object")


def test_ranges_of_a_square_are_those_of_its_plane():
    scan = scan_scene(square(), AHEAD, SENSOR)
    rays = SENSOR.projection.directions()
    expected = 2.0 / rays[..., 2]
    inside = np.abs(expected[..., None] * rays[..., :2]).max(axis=-1) <= 1.0
    assert (scan.valid == inside).all()
    assert np.abs(scan.ranges - expected)[inside].max() < 1e-12
    assert scan.sigma_m == 0.0
    assert scan.noise == "none"


def test_truth_channels_say_what_was_met():
    scan = scan_scene(square(colour=0.25), AHEAD, SENSOR)
    rays = SENSOR.projection.directions()
    assert set(np.unique(scan.truth.surface)) == {-1, 1}
    assert np.allclose(scan.truth.incidence[scan.valid], np.arccos(rays[..., 2])[scan.valid], atol=1e-7)
    assert np.isnan(scan.truth.incidence[~scan.valid]).all()
    assert np.allclose(scan.colour[scan.valid], 0.25)


def test_range_gate_and_circular_aperture_leave_pixels_empty_but_their_truth_stays():
    near = PinholeSensor(width=32, height=32, max_range_m=2.05)
    scan = scan_scene(square(half=5.0), AHEAD, near)
    assert (scan.valid == (scan.truth.ranges <= 2.05)).all()
    assert 0 < scan.valid.sum() < scan.valid.size
    cone = PinholeSensor(width=32, height=32, aperture="circular")
    scan = scan_scene(square(half=5.0), AHEAD, cone)
    assert (scan.valid == cone.sees(cone.projection.directions())).all()
    assert np.isfinite(scan.truth.ranges).all()


def test_noise_has_the_stated_sigma_and_its_own_stream():
    scene, view = square(half=5.0), View(AHEAD, SENSOR)
    scan = scan_scene(scene, view, noise="gaussian-2mm", rng=0)
    error = (scan.ranges - scan.truth.ranges)[scan.valid]
    assert scan.sigma_m == pytest.approx(0.002)
    assert abs(error.std() - 0.002) < 3 * 0.002 / np.sqrt(2 * error.size)
    again = scan_scene(scene, view, noise="gaussian-2mm", rng=0, n_threads=1)
    assert again.ranges.tobytes() == scan.ranges.tobytes()
    assert scan_scene(scene, view, noise="gaussian-2mm", rng=1).ranges.tobytes() != scan.ranges.tobytes()


def test_moving_the_world_moves_nothing_in_the_scan():
    motion = Pose.looking_at((30.0, -20.0, 5.0), (31.0, -22.0, 6.0))
    scan = scan_scene(square(), AHEAD, SENSOR)
    moved = scan_scene(square().transform(motion), motion @ AHEAD, SENSOR)
    assert (moved.valid == scan.valid).mean() > 0.999
    both = moved.valid & scan.valid
    assert np.abs(moved.ranges[both] - scan.ranges[both]).max() < 1e-10


def test_a_panorama_scans_all_round():
    scene = square()
    scan = scan_scene(scene, AHEAD, SphericalSensor(width=90, height=46))
    towards = scan.rays()[scan.valid]
    assert (towards[:, 0] > 0.7).all()
    assert scan.valid.sum() > 50


def test_a_pose_needs_a_sensor():
    with pytest.raises(InputError, match="a pose has no sensor"):
        scan_scene(square(), AHEAD)
