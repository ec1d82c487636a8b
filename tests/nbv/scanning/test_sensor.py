# SPDX-License-Identifier: MIT
"""Sensors: apertures against closed forms."""

import numpy as np
import pytest

from nbv.scanning.sensor import PinholeSensor, SphericalSensor
from nbv.scanning.sensor_profile import sensor_from_profile
from nbv.scanning.triangulation import LineSensor, TriangulationSensor
from scenes.checks import InputError


def directions(n: int = 200_000) -> np.ndarray:
    drawn = np.random.default_rng(0).standard_normal((n, 3))
    return drawn / np.linalg.norm(drawn, axis=1, keepdims=True)


@pytest.mark.parametrize(
    ("sensor", "solid_angle"),
    [
        (PinholeSensor(fov_deg=60), 4 * np.arcsin(np.sin(np.radians(30)) ** 2)),
        (PinholeSensor(fov_deg=60, aperture="circular"), 2 * np.pi * (1 - np.cos(np.radians(30)))),
        (SphericalSensor(), 2 * np.pi * (1 + np.sin(np.radians(60)))),
        (SphericalSensor(azimuth_span_deg=90, elevation_min_deg=0), np.pi / 2),
        (TriangulationSensor(width=100, height=100), 4 * np.arcsin(np.sin(np.radians(30)) ** 2)),
        (LineSensor(fan_deg=90, width=10), np.pi / 2 * 2 * np.sin(np.radians(4.5))),
    ],
)
def test_aperture_has_the_solid_angle_of_the_closed_form(sensor, solid_angle):
    share = solid_angle / (4 * np.pi)
    rays = directions()
    assert abs(sensor.sees(rays).mean() - share) < 4 * np.sqrt(share * (1 - share) / len(rays))


def test_a_calibrated_camera_sees_what_falls_on_its_pixels():
    camera = PinholeSensor.from_intrinsics(640, 480, fx=600, fy=-590, cx=300.0, cy=250.0)
    points = np.random.default_rng(0).normal(size=(4000, 3)) * [1.5, 1.5, 2]
    row, column = camera.projection.pixels(points).T
    inside = (row >= -0.5) & (row <= 479.5) & (column >= -0.5) & (column <= 639.5)
    assert (camera.sees(points) == inside).all()
    assert 100 < inside.sum() < 3000
    corners = np.degrees(np.arctan([300.5 / 600, 339.5 / 600]))
    assert camera.fov_deg == pytest.approx(corners.sum())
    again = sensor_from_profile(camera.to_json())
    assert again == camera
    assert again.projection.fy == -590


def test_a_centred_camera_is_the_same_by_angle_and_by_focal_length():
    one = PinholeSensor(fov_deg=60, width=320, height=240)
    focal = one.projection.fx
    other = PinholeSensor.from_intrinsics(320, 240, fx=focal, fy=focal, cx=159.5, cy=119.5)
    assert other.fov_deg == pytest.approx(60)
    points = np.random.default_rng(1).normal(size=(2000, 3))
    assert (one.sees(points) == other.sees(points)).all()


@pytest.mark.parametrize(
    ("wrong", "text"),
    [
        ({"fx": 0.0}, "focal lengths must be"),
        ({"fx": float("nan")}, "focal lengths must be"),
        ({"cx": 1e12}, "principal point within"),
        ({"range_m": (5.0, 1.0)}, "ranges must satisfy"),
    ],
)
def test_intrinsics_that_no_camera_has_are_refused(wrong, text):
    usual = {"fx": 500.0, "fy": 500.0, "cx": 319.5, "cy": 239.5}
    with pytest.raises(InputError, match=text):
        PinholeSensor.from_intrinsics(640, 480, **{**usual, **wrong})


def test_a_part_of_the_intrinsics_or_a_circle_beside_them_is_refused():
    with pytest.raises(InputError, match="give all four or none"):
        PinholeSensor(fx_px=500.0)
    with pytest.raises(InputError, match="no circular aperture"):
        PinholeSensor(fx_px=500.0, fy_px=500.0, cx_px=159.5, cy_px=159.5, aperture="circular")
