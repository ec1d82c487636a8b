# SPDX-License-Identifier: MIT
"""Triangulation: shadows of closed form, on the right side; profiles of one row."""

import numpy as np
import pytest

from nbv.scanning.beam import Footprint
from nbv.scanning.effects import Effects
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import Partner
from nbv.scanning.sensor_profile import load_sensor
from nbv.scanning.triangulation import LineSensor, TriangulationSensor
from scenes.checks import InputError
from tests.helpers.sheet_scenes import EAST, before_wall, sheets

NEAR, FAR, HALF, BASE = 2.0, 3.0, 0.3, 0.2


def sensor(baseline_m=BASE, **options):
    options = {"fov_deg": 40, "width": 200, "height": 150, "partner_fov_deg": 90.0, **options}
    return TriangulationSensor(baseline_m=baseline_m, **options)


def wall_points(scan):
    """Sensor x and y of where each pixel's ray meets the wall."""
    rays = scan.projection.directions()
    return rays[..., 0] / rays[..., 2] * FAR, rays[..., 1] / rays[..., 2] * FAR


@pytest.mark.parametrize("baseline_m", [BASE, -BASE])
def test_the_shadow_has_its_width_and_lies_opposite_to_the_second_device(baseline_m):
    scan = scan_scene(before_wall(NEAR, FAR, HALF), EAST, sensor(baseline_m))
    x, y = wall_points(scan)
    hidden = (FAR / NEAR) * HALF  # half width of what the square hides from the camera, on the wall
    edges = baseline_m + (FAR / NEAR) * (
        np.array([-HALF, HALF]) - baseline_m
    )  # of what it hides from the other
    shadow = (
        (x > edges[0])
        & (x < edges[1])
        & (np.abs(y) < hidden)
        & ~((np.abs(x) < hidden) & (np.abs(y) < hidden))
    )
    assert (scan.valid == ~shadow).mean() > 0.9995  # but for rays along its outline
    lost = x[~scan.valid]
    assert len(lost) > 100
    assert (np.sign(lost) == -np.sign(baseline_m)).all()
    width = abs(baseline_m) * (FAR / NEAR - 1)
    assert np.ptp(lost) == pytest.approx(width, abs=1.5 * FAR / scan.projection.fx)


def test_two_path_occlusion_is_what_both_single_paths_allow():
    scene, camera = before_wall(NEAR, FAR, HALF), sensor()
    scan = scan_scene(scene, EAST, camera)
    caster = scene.ray_caster()
    points = scan.true_points()[np.isfinite(scan.truth.ranges)]
    second = EAST.apply(np.array([BASE, 0, 0]))
    way = points - second
    reach = np.linalg.norm(way, axis=1)
    other = np.abs(caster.first_hit(second[None], way).ranges - reach) < 1e-6
    assert (scan.valid[np.isfinite(scan.truth.ranges)] == other).mean() > 0.9995


def test_the_second_device_must_have_the_point_in_its_view():
    scene = sheets((FAR, -20, 20, -20, 20))
    camera = TriangulationSensor(fov_deg=40, width=200, height=150, baseline_m=BASE)
    scan = scan_scene(scene, EAST, camera)
    x, _ = wall_points(scan)
    edge = BASE - FAR * np.tan(np.radians(20))  # the other camera's left border on the wall
    assert (scan.valid == (x >= edge)).all()
    assert not scan.valid.all()


def test_a_face_that_turns_its_back_on_the_second_device_is_not_measured():
    # seen by the camera from the left, by the other device from the right, edge-on between them
    scene = sheets((2.0, -0.5, 0.5, -0.5, 0.5))
    moved = EAST.looking_at((1.9999999, 1.0, 0), (2.0, 0, 0))
    assert scan_scene(scene, moved, sensor(fov_deg=60)).valid.sum() == 0


def test_a_footprint_is_lit_only_where_both_see_it():
    effects = Effects(footprint=Footprint(divergence_rad=0.004, returns="last", range_resolution_m=0.01))
    scene = before_wall(NEAR, FAR, HALF)
    sharp, wide = scan_scene(scene, EAST, sensor()), scan_scene(scene, EAST, sensor(), effects=effects, rng=0)
    assert (wide.valid & ~sharp.valid).sum() > 0  # beams that are partly out of the shadow
    x, _ = wall_points(sharp)
    deep = ~sharp.valid & (np.abs(x + 0.5) < 0.03)
    assert deep.any()
    assert not wide.valid[deep].any()


def test_the_kinects_shadow_lies_to_the_left_of_things():
    scan = scan_scene(before_wall(1.0, 2.0, 0.2), EAST, load_sensor("kinect_v1"))
    rays = scan.projection.directions()
    lost = ~scan.valid & np.isfinite(scan.truth.ranges) & (scan.truth.ranges < 4)
    assert lost.sum() > 100
    assert (rays[..., 0][lost] < -0.15).all()


def test_a_line_sensor_measures_one_row_of_closed_form():
    scan = scan_scene(sheets((2.0, -5, 5, -5, 5)), EAST, LineSensor(fan_deg=90, width=101))
    assert scan.shape == (1, 101)
    azimuth = scan.projection.azimuths
    assert np.abs(scan.ranges[0] - 2 / np.cos(azimuth)).max() < 1e-9
    line = LineSensor(fan_deg=90, width=101)
    assert line.sees(np.array([[1.0, 0, 1.01], [1.0, 0, 0.99], [0, 0.1, 1]])).tolist() == [True, False, False]


def test_a_line_lies_in_the_shadow_of_its_camera():
    scene = sheets(
        (1.0, -0.2, 0.2, -0.5, -0.05), (2.0, -5, 5, -5, 5)
    )  # hangs down to just above the laser plane
    above, below = (
        scan_scene(scene, EAST, LineSensor(fan_deg=40, width=201, baseline_m=b)) for b in (-0.3, 0.3)
    )
    assert below.valid.all()
    x = np.tan(above.projection.azimuths) * 2
    assert (above.valid[0] == (np.abs(x) > 0.4)).mean() > 0.98


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: TriangulationSensor(baseline_m=0.0), "baseline_m must be finite and not zero"),
        (lambda: TriangulationSensor(partner_fov_deg=180.0), "partner_fov_deg must lie between"),
        (lambda: TriangulationSensor(fov_deg=200.0), "between 0 and 180"),
        (lambda: TriangulationSensor(min_range_m=6.0), r"got 6\.0\.\.5\.0 m"),
        (lambda: LineSensor(fan_deg=0.0), "fan_deg must lie in 0..360"),
        (lambda: LineSensor(width=1), "2 pixels or more"),
        (lambda: LineSensor(baseline_m=np.nan), "baseline_m must be"),
    ],
)
def test_impossible_sensors_are_refused(make, message):
    with pytest.raises(InputError, match=message):
        make()


def test_a_partner_without_bounds_sees_all():
    assert Partner((0.1, 0, 0)).sees(np.array([[0.0, 0, -1], [5, 5, 0.1]])).all()
    assert Partner((0.1, 0, 0), (1.0, np.inf)).sees(np.array([[1.2, 0, 1], [1, 9, 1]])).tolist() == [
        False,
        True,
    ]
