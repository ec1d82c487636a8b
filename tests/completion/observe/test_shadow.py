# SPDX-License-Identifier: MIT
"""Where the projector stands, from the strips without return; nothing is said where nothing is known."""

import numpy as np
import pytest

from benchmarks.cases.desks import desk_case, kinect
from completion.observe.shadow import NO_SHADOW, Devices, Shadow, find_shadow, is_shadowed, shadow_of
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import SphericalSensor
from nbv.scanning.triangulation import TriangulationSensor
from scenes.checks import FloatArray
from scenes.pose import Pose
from scenes.scan.projection import PinholeProjection
from scenes.scan.range_image import RangeImage

CAMERA = PinholeProjection.from_fov(200, 150, 60)
NEAR_M, FAR_M = 1.0, 2.0


def image(depth: FloatArray) -> RangeImage:
    return RangeImage(depth / CAMERA.directions()[..., 2], CAMERA, Pose.identity())


def box_before_wall(left: int, right: int) -> RangeImage:
    """A box with strips of so many pixels without return on either side."""
    depth = np.full(CAMERA.shape, FAR_M)
    depth[40:110, 80 - left : 120 + right] = np.nan
    depth[40:110, 80:120] = NEAR_M
    return image(depth)


def width(baseline_m: float) -> float:
    return CAMERA.fx * baseline_m * (1 / NEAR_M - 1 / FAR_M)


@pytest.mark.parametrize("baseline_m", [-0.1, -0.05, 0.05, 0.075])
def test_the_projector_of_a_simulated_camera_is_found(baseline_m):
    case = desk_case(7)
    sensor = TriangulationSensor(57.0, 320, 240, baseline_m=baseline_m, partner_fov_deg=80.0)
    scan = scan_scene(case.scene, case.views[0].world_from_sensor, sensor, noise="gaussian-2mm", rng=0)
    found = find_shadow(scan)
    near, other = (found.right_m, found.left_m) if baseline_m > 0 else (found.left_m, found.right_m)
    assert near == pytest.approx(abs(baseline_m), rel=0.15)
    assert other == found.below_m == found.above_m == 0


def test_a_camera_on_its_side_has_the_projector_below_or_above():
    case = desk_case(7)
    (scan,) = case.scans(kinect().effects, 0)
    camera = scan.projection
    turned = PinholeProjection(scan.shape[0], scan.shape[1], camera.fy, camera.fx, camera.cy, camera.cx)
    found = find_shadow(RangeImage(np.ascontiguousarray(scan.ranges.T), turned, Pose.identity()))
    assert found.below_m == pytest.approx(0.075, rel=0.1)
    assert found.right_m == found.left_m == found.above_m == 0


def test_a_file_in_another_camera_s_view_has_a_strip_on_either_side():
    left, right = round(width(0.1)), round(width(0.06))
    found = find_shadow(box_before_wall(left, right))
    half_a_pixel = 0.5 * 0.1 / width(0.1)
    assert found.right_m == pytest.approx(0.1, abs=half_a_pixel)
    assert found.left_m == pytest.approx(0.06, abs=half_a_pixel)


def test_a_scan_without_strips_has_none():
    assert find_shadow(box_before_wall(0, 0)) == NO_SHADOW


def test_few_strips_do_not_tell():
    scan = box_before_wall(round(width(0.06)), 0)
    few = np.where(np.arange(150)[:, None] % 20 == 0, scan.ranges, np.inf)
    assert find_shadow(RangeImage(few, CAMERA, Pose.identity())) == NO_SHADOW


def test_holes_of_any_width_are_no_shadow():
    """Dark things beside jumps: their widths have nothing to do with the depths."""
    rng = np.random.default_rng(0)
    depth = np.full(CAMERA.shape, FAR_M)
    for row in range(150):
        gap = int(rng.integers(0, 40))
        depth[row, 80 - gap : 80] = np.nan
        depth[row, 80:120] = NEAR_M
    assert find_shadow(image(depth)) == NO_SHADOW


def test_a_place_lies_in_the_shadow_on_the_far_side_and_as_far_as_the_parallax():
    scan = box_before_wall(70, 70)
    ranges, lens = scan.ranges.ravel(), (CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy)

    def shadowed(column: int, depth: float, shadow: Shadow) -> bool:
        return is_shadowed(Devices(shadow, lens, CAMERA.shape), ranges, 75 * 200 + column, depth, 0.01)

    strip = width(0.1)
    assert shadowed(79, FAR_M, shadow_of(0.1))
    assert shadowed(int(80 - strip), FAR_M, shadow_of(0.1))
    assert not shadowed(int(80 - 1.25 * strip) - 3, FAR_M, shadow_of(0.1))
    assert not shadowed(79, NEAR_M, shadow_of(0.1))
    assert not shadowed(120, FAR_M, shadow_of(0.1))
    assert shadowed(120, FAR_M, shadow_of(-0.1))
    assert not shadowed(79, FAR_M, NO_SHADOW)


def test_beyond_what_was_lit_there_is_no_shadow():
    scan = box_before_wall(20, 0)
    depth = scan.points_in_sensor()[..., 2].copy()
    depth[75, 70] = FAR_M
    lit = image(depth)
    lens = (CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy)
    devices = Devices(shadow_of(0.2), lens, CAMERA.shape)
    for column, expected in ((72, True), (68, False)):
        pixel = 75 * 200 + column
        assert is_shadowed(devices, lit.ranges.ravel(), pixel, FAR_M, 0.01) is expected


def test_a_laser_scanner_has_no_projector():
    case = desk_case(7)
    sensor = SphericalSensor(width=120, height=60, elevation_max_deg=60.0)
    scan = scan_scene(case.scene, case.views[0].world_from_sensor, sensor)
    assert find_shadow(scan) == NO_SHADOW
