# SPDX-License-Identifier: MIT
"""Sensors: apertures against closed forms."""

import numpy as np
import pytest

from nbv.scanning.sensors.sensor import PinholeSensor, SphericalSensor
from nbv.scanning.sensors.triangulation import LineSensor, TriangulationSensor


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
