# SPDX-License-Identifier: MIT
import numpy as np
import pytest

from completion.observe.range_noise import RangeNoise, estimate_noise
from nbv.scanning.effects import Quantisation
from scenes.io.scan_files import read_scan
from scenes.pose import Pose
from scenes.scan.projection import PinholeProjection, SphericalProjection
from scenes.scan.range_image import RangeImage
from tests.helpers.data_paths import data_path, requires_data
from tests.helpers.yard_scans import yard_scan

RANGES = np.array([1.0, 2, 5, 10, 20, 30, 40])


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize(
    ("constant", "linear", "quantum"),
    [(0.005, 0, 0), (0.01, 0, 0), (0.005, 3e-4, 0), (0.01, 2e-4, 0), (0.005, 0, 0.005)],
)
def test_a_laser_scanner_is_known_to_a_fifth_at_every_range_among_trees_and_stones(
    constant, linear, quantum, seed
):
    noise = estimate_noise(yard_scan(constant, linear, quantum_m=quantum, seed=seed))
    truth = np.sqrt(constant**2 + quantum**2 / 12 + (linear * RANGES) ** 2)
    assert noise.quadratic_per_m == 0
    assert noise.sigma(RANGES) == pytest.approx(truth, rel=0.2)


def test_steps_wider_than_the_noise_are_told_and_those_below_it_are_not():
    coarse = estimate_noise(yard_scan(0.002, quantum_m=0.02))
    assert coarse.step_m == pytest.approx(0.02)
    assert coarse.sigma(RANGES) == pytest.approx(0.02 / np.sqrt(12), rel=0.35)
    assert estimate_noise(yard_scan(0.005, quantum_m=0.005)).step_m == 0


def camera_scan(noise_per_m: float, step_per_m: float) -> RangeImage:
    """A triangulating camera in a room with floor and walls 1 to 5 m away."""
    camera = PinholeProjection.from_fov(320, 240, 70)
    rays = camera.directions()
    walls = ((0.0, 0.0, 0.2), (0.25, 0.05, 0.15), (-0.55, 0.0, 0.1), (0.0, 0.8, 0.05), (0.0, -0.9, 0.02))
    ranges = 1.0 / np.max([rays @ np.array(wall) for wall in walls], axis=0)
    depth = ranges * rays[..., 2]
    depth = depth + np.random.default_rng(3).normal(0, noise_per_m, depth.shape) * depth**2
    if step_per_m:
        depth = Quantisation(inverse_depth_step_per_m=step_per_m).round_ranges(depth)
    return RangeImage(depth / rays[..., 2], camera, Pose.identity())


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0, 2.0])
def test_a_camera_with_steps_is_known_to_a_quarter(share):
    scan = camera_scan(0.0014, share * 0.0014)
    noise, depth = estimate_noise(scan), np.array([2.0, 3, 4])
    assert noise.sigma(depth) == pytest.approx(0.0014 * np.hypot(1, share / np.sqrt(12)) * depth**2, rel=0.25)
    assert noise.step_m == 0


def test_a_camera_whose_steps_hide_its_noise_says_so():
    noise, depth = estimate_noise(camera_scan(0.0002, 0.003)), np.array([2.0, 3, 4])
    assert noise.sigma(depth) == pytest.approx(0.003 / np.sqrt(12) * depth**2, rel=0.45)
    assert noise.step_m > 0.003


def test_a_scan_without_noise_has_none():
    grid = SphericalProjection.regular(120, 60, 90.0, (-30.0, 30.0))
    towards = grid.directions()[..., 2]
    assert not estimate_noise(RangeImage(3.0 / towards, grid, Pose.identity())).is_known


def test_too_few_returns_tell_no_noise():
    grid = SphericalProjection.regular(6, 6, 5.0, (-3.0, 3.0))
    assert not estimate_noise(RangeImage(np.full((6, 6), 2.0), grid, Pose.identity())).is_known


def test_tiles_too_few_for_a_bin_tell_the_noise_together():
    grid = SphericalProjection.regular(15, 15, 5.0, (-3.0, 3.0))
    ranges = 2.0 / grid.directions()[..., 2] + np.random.default_rng(0).normal(0, 0.004, grid.shape)
    noise = estimate_noise(RangeImage(ranges, grid, Pose.identity()))
    assert noise.sigma(np.array([2.0]))[0] == pytest.approx(0.004, rel=0.35)


def test_expected_errors_of_a_scanner_are_its_law():
    noise = RangeNoise(0.004, 0.0, 0.0005)
    assert noise.deviation(RANGES) == pytest.approx(noise.sigma(RANGES))
    assert noise.bias(RANGES) == pytest.approx(0.0)
    assert noise.window_pixels(30.0) == 1


@requires_data
def test_a_real_scanner_is_not_taken_for_a_camera():
    noise = estimate_noise(read_scan(data_path("range/e57/pumpA.e57")))
    assert noise.quadratic_per_m == 0
    assert noise.sigma(np.array([2.0, 3, 5])) == pytest.approx(0.0023, rel=0.2)


@requires_data
def test_real_cameras_steps_are_seen_where_they_hide_the_noise():
    """A PrimeSense's steps grow with the square of the depth: 7 mm at 1.6 m, 5 cm at 4 m."""
    assert estimate_noise(read_scan(data_path("range/pcl/office1.pcd"))).step_m > 0.03
    near = estimate_noise(read_scan(f"{data_path('range/align3d_sample1')}#1"))
    assert near.step_m == pytest.approx(0.007, abs=0.002)
    assert estimate_noise(read_scan(f"{data_path('range/align3d_sample2')}#1")).step_m == 0  # of .2 mm


@pytest.mark.long
@requires_data
def test_an_arcade_scanned_by_laser_is_known_to_centimetres_at_all_ranges():
    for number in (1, 2):
        noise = estimate_noise(read_scan(f"{data_path('range/tdtk')}#{number}"))
        assert noise.quadratic_per_m == 0
        assert (noise.sigma(np.array([1.0, 2, 5, 10, 20])) < 0.02).all()
        assert (noise.sigma(np.array([5.0, 10, 20])) > 0.0045).all()
        assert (noise.sigma(np.array([1.0, 2])) > 0.003).all()  # walls there are flat to 3.3 mm
