# SPDX-License-Identifier: MIT
"""Sensor profiles: every shipped number has its source; files are read, or refused with the cure."""

import tomllib
from importlib import resources
from pathlib import Path

import numpy as np
import pytest

from nbv.scanning.effects import Effects
from nbv.scanning.noise_models import StereoNoise
from nbv.scanning.sensor import PinholeSensor, SphericalSensor
from nbv.scanning.sensor_profile import load_profile, load_sensor, sensor_from_profile, sensor_names
from nbv.scanning.triangulation import LineSensor, TriangulationSensor
from scenes.checks import InputError

UNSOURCED = {"kind", "name", "model", "like"}  # names, not numbers
TABLE = "kind = 'pinhole'\n[noise]\nmodel = 'table'\nrange_m = {}\nreflectivity = {}\nsd_m = {}\n"


def entries(table, within=()):
    """Paths of all entries of a profile but its names."""
    for key, value in table.items():
        if isinstance(value, dict):
            yield from entries(value, (*within, key))
        elif key not in UNSOURCED:
            yield (*within, key)


@pytest.mark.parametrize("name", sensor_names())
def test_every_number_of_a_shipped_profile_has_its_source(name):
    table = tomllib.loads((resources.files("nbv.scanning") / "sensors" / f"{name}.toml").read_text("utf-8"))
    sources = table.pop("sources")
    assert set(entries(sources)) == set(entries(table))
    profile = load_profile(name)
    assert sources.items() <= profile.sources.items()
    resolved = {key: value for key, value in profile.sensor.to_json().items() if key in profile.sources}
    assert set(entries(table)) <= set(entries(resolved))
    assert set(profile.sources) == set(table) - UNSOURCED | set(load_profile(table.get("like", name)).sources)


def test_the_shipped_sensors_are_of_every_kind():
    kinds = {load_sensor(name).kind for name in sensor_names()}
    assert kinds == {"pinhole", "spherical", "line", "triangulation"}
    generic = {"generic60", "generic60cone", "panorama", "line_profiler"}
    settings = {"phase_terrestrial", "pulsed_terrestrial", "triangulation_laser"}
    assert generic | settings < set(sensor_names())
    assert len(set(sensor_names()) - generic - settings) >= 12  # instruments by name


def test_effects_of_a_users_file(tmp_path: Path):
    file = tmp_path / "mine.toml"
    file.write_text(
        "kind = 'triangulation'\nbaseline_m = 0.1\n[noise]\nmodel = 'stereo'\n"
        "subpixel_px = 0.1\nfocal_px = 500\nbaseline_m = 0.1\n[sources]\nbaseline_m = 'measured'\n"
    )
    profile = load_profile(file)
    assert profile.sensor.effects == Effects(noise=StereoNoise(subpixel_px=0.1, focal_px=500, baseline_m=0.1))
    assert profile.sources == {"baseline_m": "measured"}


@pytest.mark.parametrize("name", sensor_names())
def test_every_pixel_of_a_profile_lies_in_its_aperture(name):
    sensor = load_sensor(name)
    inside = sensor.sees(sensor.projection.every(3).directions())
    assert sensor.name == name
    assert inside.all() or getattr(sensor, "aperture", "") == "circular"
    assert not sensor.sees(np.array([[0.0, 1.0, 0.0]]))[0]


@pytest.mark.parametrize(
    "sensor",
    [
        PinholeSensor(fov_deg=50, width=30, height=20),
        SphericalSensor(width=99),
        LineSensor(width=9),
        TriangulationSensor(),
    ],
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
        ("kind = 'pinhole'\nfov = 60", r"bad\.toml: unknown entry 'fov'; there are fov_deg"),
        ("kind = 'pinhole'\nwidth = 2.5", r"width must be an integer, got 2\.5"),
        ("kind = 'pinhole'\nfov_deg = true", "fov_deg must be a number, got True"),
        ("kind = 'pinhole'\nfov_deg = 190", "between 0 and 180"),
        ("kind = 'pinhole'\nmin_range_m = 5.0\nmax_range_m = 2.0", r"got 5\.0\.\.2\.0 m"),
        ("kind = 'pinhole'\naperture = 'round'", "square or circular"),
        ("kind = 'spherical'\nazimuth_span_deg = 400", "0..360"),
        ("kind = 'spherical'\nelevation_min_deg = 95", "must rise within"),
        ("kind = 'spherical'\nheight = 1", "1 x 2 pixels"),
        ("kind = 'sonar'", "kind must be one of"),
        ("kind = ", "is not TOML"),
        ("kind = 'pinhole'\nname = 3", "name must be a text, got 3"),
        ("kind = 'pinhole'\nnoise = 'loud'", r"noise must be a table like \[noise\], got 'loud'"),
        (
            "kind = 'pinhole'\n[noise]\nmodel = 'loud'",
            r"noise\.model must be one of constant, khosh.*got 'loud'",
        ),
        ("kind = 'pinhole'\n[noise]\nmodel = 'constant'", r"noise\.constant_m is missing; add constant_m ="),
        (
            "kind = 'pinhole'\n[noise]\nmodel = 'constant'\nconstant_m = -1.0",
            r"bad\.toml: noise\.constant_m must",
        ),
        (
            "kind = 'pinhole'\n[footprint]\ndivergence_rad = 'a'",
            r"footprint\.divergence_rad must be a number",
        ),
        ("kind = 'pinhole'\n[dropout]\nloss = 1", r"unknown entry 'dropout\.loss'; there are min_intensity"),
        ("kind = 'pinhole'\nsources = 3", "sources must be a table, got 3"),
        ("kind = 'pinhole'\n[sources]\nfov_deg = 'x'", r"sources\.fov_deg is the source of no entry"),
        ("kind = 'pinhole'\nwidth = 9\n[sources]\nwidth = 3", r"sources\.width must be a text that names"),
        ("kind = 'triangulation'\nbaseline_m = 0.0", "baseline_m must be finite and not zero"),
        ("like = 'mine'", r"like must be one of azure_kinect, .*got 'mine'"),
        ("like = 'generic60'\nsources = {fov_deg = 'x'}", r"sources\.fov_deg is the source of no entry"),
        ("kind = 'spherical'\nfinest_step_deg = 0.5\nwidth = 1000", "0.36 deg apart.* 0.5 deg or more: 720"),
        ("kind = 'pinhole'\npoints_per_s = 0", "points_per_s must"),
        (TABLE.format("[10, 20]", "0.1", "[[1, 2]]"), r"noise\.reflectivity must be a list of numbers"),
        (TABLE.format("[10, 20]", "[0.1]", "[1, 2]"), r"noise\.sd_m must be a list of lists of numbers"),
        (TABLE.format("[20, 10]", "[0.1]", "[[1, 2]]"), r"noise\.range_m must be numbers that rise"),
        (TABLE.format("[]", "[0.1]", "[[]]"), r"noise\.range_m must be numbers that rise, got \[\]"),
        (TABLE.format("[10, 20]", "[0.1, 0.9]", "[[1, 2]]"), r"sd_m must have 2 x 2 numbers"),
        (TABLE.format("[10, 20]", "[0.1]", "[[1, 2, 3]]"), r"sd_m must have 1 x 2 numbers"),
        (TABLE.format("[10, 20]", "[0.1]", "[[1, -2]]"), r"noise\.sd_m must"),
        (TABLE.format("[10, 20]", "[90]", "[[1, 2]]"), r"noise\.reflectivity must"),
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
    with pytest.raises(InputError, match="no such file"):
        load_sensor(tmp_path / "absent.toml")
