# SPDX-License-Identifier: MIT
"""Instruments by name: noise as in their data sheets, time by their speed, other settings by `like`."""

import numpy as np
import pytest

from nbv.scanning.beam import Intensity
from nbv.scanning.effects import Effects, Quantisation
from nbv.scanning.noise_models import ConstantNoise, TableNoise, range_sigma_m
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import PinholeSensor, SphericalSensor, missing_errors, with_effects
from nbv.scanning.sensor_profile import load_profile, load_sensor, sensor_from_profile
from scenes import LabelledMesh, Pose, Scene

TABLE = TableNoise(
    range_m=(10, 25, 50), reflectivity=(0.1, 0.9), sd_m=((0.4e-3, 0.5e-3, 2e-3), (0.3e-3, 0.3e-3, 0.5e-3))
)
SHEETS = [
    ("faro_focus_s350", 10.0, 0.9, 0.3e-3),
    ("faro_focus_s350", 10.0, 0.1, 0.4e-3),
    ("faro_focus_s350", 25.0, 0.9, 0.3e-3),
    ("faro_focus_s350", 25.0, 0.1, 0.5e-3),
    ("leica_rtc360", 10.0, 0.89, 0.4e-3),
    ("leica_rtc360", 20.0, 0.89, 0.5e-3),
    ("leica_p40", 10.0, 0.78, 0.4e-3),
    ("leica_p40", 50.0, 0.78, 0.5e-3),
    ("leica_blk360", 10.0, 0.78, 4e-3),
    ("leica_blk360", 20.0, 0.78, 7e-3),
    ("riegl_vz400i", 100.0, 0.9, 3e-3),
    ("trimble_x7", 30.0, 0.8, 2.5e-3),
    ("velodyne_vlp16", 20.0, 0.5, 30e-3),
    ("ouster_os1_64", 20.0, 0.1, 10e-3),
    ("ouster_os1_64", 50.0, 0.1, 20e-3),
    ("livox_mid360", 0.2, 0.8, 30e-3),
    ("livox_mid360", 10.0, 0.8, 20e-3),
    ("azure_kinect", 3.0, 0.5, 17e-3),
    ("realsense_l515", 1.0, 0.95, 2.5e-3),
    ("realsense_l515", 9.0, 0.95, 15.5e-3),
    ("photoneo_phoxi_m", 0.65, 0.5, 0.1e-3),
    ("konica_vivid910", 0.6, 0.5, 8e-6),
]


@pytest.mark.parametrize(("name", "range_m", "reflectivity", "sd_m"), SHEETS)
def test_noise_is_that_of_the_data_sheet(name, range_m, reflectivity, sd_m):
    noise = load_sensor(name).effects.noise
    sigma = range_sigma_m(noise, np.array([range_m]), np.zeros(1), 1.0, reflectivity)
    assert float(sigma.max()) == pytest.approx(sd_m, rel=0.01)  # fitted ones are rounded


def test_between_the_entries_noise_is_linear_along_range_and_light():
    middle = TABLE.sigma_m(np.array([17.5]), np.zeros(1), 0.5)
    assert middle[0] == pytest.approx((0.4e-3 + 0.5e-3 + 0.3e-3 + 0.3e-3) / 4)
    tilted = TABLE.sigma_m(
        np.array([10.0]), np.radians([60.0]), 0.2
    )  # half the light of 20 % is that of 10 %
    assert tilted[0] == pytest.approx(0.4e-3)
    assert TABLE.sigma_m(np.array([0.5]), np.zeros(1), 1.0)[0] == 0.3e-3


def test_beyond_the_table_noise_grows_with_the_range_and_with_the_root_of_darkness():
    far = TABLE.sigma_m(np.array([50.0, 100.0]), np.zeros(2), 0.1)
    assert far == pytest.approx([2e-3, 2e-3 + 50 * 1.5e-3 / 25])
    dark = TABLE.sigma_m(np.full(2, 50.0), np.zeros(2), np.array([0.1, 0.05]))
    rate = (2e-3 - 0.5e-3) / (0.1**-0.5 - 0.9**-0.5)
    assert dark == pytest.approx([2e-3, 2e-3 + rate * (0.05**-0.5 - 0.1**-0.5)])


def test_bright_surfaces_grow_as_dark_ones_do_at_the_same_light():
    white = TABLE.sigma_m(np.array([50.0, 150.0]), np.zeros(2), 0.9)
    black = TABLE.sigma_m(
        np.array([50.0, 50 + 100 / 3]), np.zeros(2), 0.1
    )  # 9 times the light, 3 times as far
    assert np.diff(white) == pytest.approx(np.diff(black))


def test_noise_never_falls_with_range_or_darkness():
    ranges = np.linspace(0.1, 300, 500)
    for white in (1.0, 0.5, 0.1, 0.02):
        assert (np.diff(TABLE.sigma_m(ranges, np.zeros(500), white)) >= -1e-15).all()
    light = np.linspace(0.01, 1.0, 500)
    for distance in (5.0, 30.0, 200.0):
        assert (np.diff(TABLE.sigma_m(np.full(500, distance), np.zeros(500), light)) <= 1e-15).all()


def test_one_entry_holds_everywhere():
    alone = TableNoise(range_m=(30,), reflectivity=(0.8,), sd_m=((0.002,),))
    assert (alone.sigma_m(np.array([1.0, 500.0]), np.radians([0.0, 80.0]), 0.1) == 0.002).all()


@pytest.mark.parametrize("white", [0.1, 0.5])
def test_scans_have_the_noise_of_the_table(white):
    wall = LabelledMesh(
        np.array([[10.0, -9, -9], [10, 9, -9], [10, 9, 9], [10, -9, 9]]),
        np.array([[0, 1, 2], [0, 2, 3]]),
        np.zeros(2, int),
    )
    scene = Scene(wall, (None,), ("wall",), "wall", "object")
    effects = Effects(noise=TABLE, intensity=Intensity(reflectivity=white))
    sensor = PinholeSensor(fov_deg=1.0, width=100, height=100)
    scan = scan_scene(scene, Pose.looking_at((0, 0, 0), (1, 0, 0)), sensor, effects=effects, rng=0)
    errors = scan.range_error()[scan.valid]
    expected = float(TABLE.sigma_m(np.array([10.0]), np.zeros(1), white)[0])
    assert np.std(errors) == pytest.approx(expected, rel=4 / np.sqrt(2 * errors.size))
    assert "noise table (range_m [10 25 50]" in scan.noise


def test_a_table_survives_being_written():
    sensor = with_effects(PinholeSensor(), Effects(noise=TABLE))
    assert sensor_from_profile(sensor.to_json()) == sensor


def test_scan_time_is_pixels_over_speed():
    sensor = SphericalSensor(width=1000, height=300, points_per_s=50_000)
    assert sensor.scan_time_s == pytest.approx(6.0)
    assert SphericalSensor().scan_time_s is None
    assert load_sensor("velodyne_vlp16").scan_time_s == pytest.approx(0.1, rel=0.05)  # one turn at 10 Hz
    assert load_sensor("ouster_os1_64").scan_time_s == pytest.approx(0.1)


def test_another_setting_of_an_instrument(tmp_path):
    file = tmp_path / "quarter.toml"
    file.write_text("like = 'faro_focus_s350'\nwidth = 10240\nheight = 4267\n[pointing]\nsd_deg = 0.01\n")
    mine, theirs = load_profile(file), load_profile("faro_focus_s350")
    assert mine.sensor.name == "quarter"
    assert mine.sensor.scan_time_s == pytest.approx(10240 * 4267 / 976e3)
    assert mine.sensor.effects.noise == theirs.sensor.effects.noise
    assert mine.sensor.effects.pointing.sd_deg == 0.01
    assert mine.sources["noise"] == theirs.sources["noise"]
    assert not {"width", "height", "pointing"} & set(mine.sources)


def test_a_profile_without_noise_says_so():
    assert missing_errors(load_sensor("generic60"), "none") == ()
    assert missing_errors(load_sensor("generic60"), "gaussian-2mm") == ()
    assert missing_errors(load_sensor("kinect_v1"), "profile") == ()
    (text,) = missing_errors(load_sensor("panorama"), "profile")
    assert "the profile of panorama states no errors: its scans have no random error" in text
    stepped = with_effects(load_sensor("panorama"), Effects(quantisation=Quantisation(range_step_m=0.01)))
    (text,) = missing_errors(stepped, "profile")
    assert "states quantisation but no [noise]: its ranges have no random error" in text
    assert (
        missing_errors(with_effects(stepped, Effects(noise=ConstantNoise(constant_m=0.0))), "profile") == ()
    )
