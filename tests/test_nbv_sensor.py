# SPDX-License-Identifier: MIT
"""Sensors: apertures against closed forms, profiles read and refused."""

from pathlib import Path

import numpy as np
import pytest

from nbv.sensor import PinholeSensor, SphericalSensor, load_sensor, sensor_from_profile, sensor_names
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
    ],
)
def test_aperture_has_the_solid_angle_of_the_closed_form(sensor, solid_angle):
    share = solid_angle / (4 * np.pi)
    rays = directions()
    assert abs(sensor.sees(rays).mean() - share) < 4 * np.sqrt(share * (1 - share) / len(rays))


@pytest.mark.parametrize("name", sensor_names())
def test_every_pixel_of_a_profile_lies_in_its_aperture(name):
    sensor = load_sensor(name)
    inside = sensor.sees(sensor.projection.directions())
    assert sensor.name == name
    assert inside.all() or getattr(sensor, "aperture", "") == "circular"
    assert not sensor.sees(np.array([[0.0, 1.0, 0.0]]))[0]


@pytest.mark.parametrize(
    "sensor", [PinholeSensor(fov_deg=50, width=30, height=20), SphericalSensor(width=99)]
)
def test_profile_round_trip(sensor):
    assert sensor_from_profile(sensor.to_json()) == sensor


def test_profile_from_a_file(tmp_path: Path):
    file = tmp_path / "mine.toml"
    file.write_text('kind = "pinhole"\nfov_deg = 40\nwidth = 8\nheight = 6\n')
    sensor = load_sensor(file)
    assert sensor.name == "mine"
    assert sensor.projection.shape == (6, 8)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("kind = 'pinhole'\nfov = 60", "unknown entry 'fov'"),
        ("kind = 'pinhole'\nwidth = 2.5", r"width must be int, got 2\.5"),
        ("kind = 'pinhole'\nfov_deg = true", "fov_deg must be float, got True"),
        ("kind = 'pinhole'\nfov_deg = 190", "between 0 and 180"),
        ("kind = 'pinhole'\nmin_range_m = 5.0\nmax_range_m = 2.0", r"got 5\.0\.\.2\.0 m"),
        ("kind = 'pinhole'\naperture = 'round'", "square or circular"),
        ("kind = 'spherical'\nazimuth_span_deg = 400", "0..360"),
        ("kind = 'spherical'\nelevation_min_deg = 95", "must rise within"),
        ("kind = 'spherical'\nheight = 1", "1 x 2 pixels"),
        ("kind = 'line'", "kind must be one of"),
        ("kind = ", "is not TOML"),
    ],
)
def test_unusable_profiles_are_refused_with_the_cause(tmp_path: Path, text, message):
    file = tmp_path / "bad.toml"
    file.write_text(text)
    with pytest.raises(InputError, match=message):
        load_sensor(file)


def test_unknown_names_and_files_are_refused(tmp_path: Path):
    with pytest.raises(InputError, match=r"no sensor named 'nosuch'; there are .*generic60"):
        load_sensor("nosuch")
    with pytest.raises(InputError, match="cannot read sensor"):
        load_sensor(tmp_path / "absent.toml")
