# SPDX-License-Identifier: MIT
"""Effects: stages are independent, seeded, off unless asked for, and told in scans, files and profiles."""

from dataclasses import fields, replace

import numpy as np
import pytest

from nbv.scanning.beam import Dropout, Footprint, Intensity, reflectivity_of_colour
from nbv.scanning.effects import (
    NO_EFFECTS,
    Effects,
    PointingNoise,
    Quantisation,
    named_effects,
    normal_numbers,
    stage_streams,
)
from nbv.scanning.noise_models import ConstantNoise, TerrestrialNoise
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import PinholeSensor, SphericalSensor
from nbv.scanning.sensor_profile import load_sensor, sensor_from_profile
from scenes.checks import InputError
from tests.helpers.sheet_scenes import EAST, before_wall, sheets

SENSOR = PinholeSensor(fov_deg=40, width=48, height=40)
ALL = Effects(
    footprint=Footprint(divergence_rad=0.02, exit_diameter_m=0.01, returns="mean"),
    intensity=Intensity(reference_range_m=2.0),
    dropout=Dropout(specular_loss=0.5, min_intensity=1e-4),
    noise=ConstantNoise(constant_m=0.004),
    pointing=PointingNoise(sd_deg=0.05),
    quantisation=Quantisation(range_step_m=1e-4),
)


def scan(effects, seed=0, **options):
    return scan_scene(before_wall(), EAST, SENSOR, effects=effects, rng=seed, **options)


def bytes_of(scanned):
    points = b"" if scanned.sensor_points is None else scanned.sensor_points.tobytes()
    return scanned.ranges.tobytes() + points + scanned.colour.tobytes()


def test_without_effects_ranges_are_exact():
    for asked in ({"noise": "none"}, {"effects": NO_EFFECTS}, {}):
        clean = scan_scene(before_wall(), EAST, SENSOR, rng=1, **asked)
        depth = (clean.ranges * SENSOR.projection.directions()[..., 2])[clean.valid]
        assert np.minimum(np.abs(depth - 2), np.abs(depth - 3)).max() < 1e-9
        assert (clean.ranges == clean.truth.ranges)[clean.valid].all()
        assert (clean.noise, clean.sigma_m, clean.intensity) == ("none", 0.0, None)


def test_the_same_seed_gives_the_same_bytes_for_any_number_of_threads():
    first = scan(ALL)
    assert bytes_of(scan(ALL, n_threads=1)) == bytes_of(first) == bytes_of(scan(ALL, n_threads=2))
    assert bytes_of(scan(ALL, seed=1)) != bytes_of(first)
    rng = np.random.default_rng(4)
    assert bytes_of(scan(ALL, seed=rng)) != bytes_of(scan(ALL, seed=rng))


@pytest.mark.parametrize("stage", [field.name for field in fields(Effects)])
def test_each_stage_changes_the_scan(stage):
    alone, without = Effects(**{stage: getattr(ALL, stage)}), replace(ALL, **{stage: None})
    if stage == "intensity":
        assert scan(alone).intensity is not None
        assert scan(without).intensity is None
        return
    assert bytes_of(scan(alone)) != bytes_of(scan(NO_EFFECTS))
    assert bytes_of(scan(without)) != bytes_of(scan(ALL))


def test_switching_a_stage_off_leaves_the_draws_of_the_others_as_they_were():
    effects = replace(ALL, quantisation=None, footprint=None)
    full = scan(effects)
    kept = full.valid
    calm = scan(replace(effects, dropout=None))
    assert (calm.ranges[kept] == full.ranges[kept]).all()
    assert (calm.sensor_points[kept] == full.sensor_points[kept]).all()
    assert calm.valid.sum() > kept.sum()
    still = scan(replace(effects, noise=None))
    assert (still.valid == kept).all()
    direction = full.sensor_points[kept] / full.ranges[kept][:, None]
    plain = still.sensor_points[kept] / still.ranges[kept][:, None]
    assert np.abs(direction - plain).max() < 1e-12
    straight = scan(replace(effects, pointing=None))
    assert (straight.valid == kept).all()
    axis = SENSOR.projection.directions()[..., 2]
    depth = full.sensor_points[..., 2]
    assert np.abs(straight.ranges * axis - depth)[kept].max() < 1e-12


def test_streams_depend_on_the_seed_and_their_own_name():
    several = stage_streams(3, ("dropout", "noise"))
    alone = stage_streams(3, ("noise",))
    assert several["noise"].random(4).tolist() == alone["noise"].random(4).tolist()
    assert several["dropout"].random() != stage_streams(3, ("noise",))["noise"].random()
    assert stage_streams(4, ("noise",))["noise"].random() != stage_streams(3, ("noise",))["noise"].random()


def test_normal_numbers_do_not_depend_on_the_number_of_threads():
    n = 200_000
    drawn = normal_numbers(np.random.default_rng(1), n, 1)
    assert (drawn == normal_numbers(np.random.default_rng(1), n, 2)).all()
    assert (drawn[:70_000] == normal_numbers(np.random.default_rng(1), 70_000)).all()
    assert abs(drawn.mean()) < 3.5 / np.sqrt(n)
    assert abs(drawn.std() - 1) < 3.5 / np.sqrt(2 * n)
    assert normal_numbers(np.random.default_rng(1), 0).shape == (0,)


def test_the_scan_says_what_was_active_with_its_parameters():
    text = scan(ALL).noise
    for part in ("footprint (divergence_rad 0.02", "returns mean", "noise constant (constant_m 0.004)"):
        assert part in text
    assert scan(replace(NO_EFFECTS, footprint=ALL.footprint)).sigma_m is None
    assert scan(ALL).sigma_m == pytest.approx(np.hypot(0.004, 1e-4 / np.sqrt(12)))


def test_profile_asks_for_the_sensors_own_effects():
    sensor = replace(SENSOR, effects=ALL)
    by_name = scan_scene(before_wall(), EAST, sensor, noise="profile", rng=0)
    assert bytes_of(by_name) == bytes_of(scan(ALL))
    assert scan_scene(before_wall(), EAST, sensor, rng=0).noise == "none"
    assert sensor_from_profile(sensor.to_json()) == sensor


@pytest.mark.parametrize("name", ["phase_terrestrial", "kinect_v1", "realsense_d435"])
def test_effects_of_profiles_survive_json(name):
    sensor = load_sensor(name)
    assert sensor_from_profile(sensor.to_json()) == sensor
    assert sensor.effects.describe() != "none"


def test_names_stand_for_their_numbers():
    assert named_effects("terrestrial-1mm-0.002mm").noise == TerrestrialNoise(
        constant_m=1e-3, signal_per_m=2e-6
    )
    assert named_effects("gaussian-2.5mm").noise == ConstantNoise(constant_m=0.0025)
    assert named_effects("none").describe() == "none"


def test_noise_and_effects_are_not_both_given():
    with pytest.raises(InputError, match="give noise or effects, not both; noise is 'gaussian-2mm'"):
        scan_scene(before_wall(), EAST, SENSOR, noise="gaussian-2mm", effects=ALL)


def test_truth_can_be_left_out():
    assert scan(ALL, truth=False).truth is None
    assert bytes_of(scan(ALL, truth=False)) == bytes_of(scan(ALL))


def test_intensity_follows_lambert_and_the_inverse_square():
    scene = sheets((4.0, -20, 20, -20, 20), colours=(1.0,))
    sensor = SphericalSensor(120, -30, 30, 61, 31)
    effects = Effects(intensity=Intensity(reference_range_m=2.0))
    bright = scan_scene(scene, EAST, sensor, effects=effects)
    expected = np.cos(bright.truth.incidence) * (2 / bright.ranges) ** 2
    assert bright.valid.any()
    assert np.abs(bright.intensity - expected)[bright.valid].max() < 1e-6
    assert (bright.intensity[~bright.valid] == 0).all()
    dark = Effects(intensity=Intensity(reflectivity=0.1, reference_range_m=2.0))
    assert np.allclose(scan_scene(scene, EAST, sensor, effects=dark).intensity, bright.intensity * 0.1)


def test_reflectivity_is_the_luminance_of_the_colour():
    colours = np.array([[1, 1, 1], [0, 0, 0], [0, 1, 0], [0.5, 0.5, 0.5]], np.float32)
    assert reflectivity_of_colour(colours) == pytest.approx([1, 0, 0.7152, 0.21404], abs=1e-5)
    varied = np.repeat(np.random.default_rng(0).random((5000, 3), np.float32), 2, axis=0)
    encoded = varied.astype(np.float64)
    linear = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    found = reflectivity_of_colour(varied)
    np.testing.assert_allclose(found, linear @ [0.2126, 0.7152, 0.0722], rtol=0, atol=5e-8)
    np.testing.assert_array_equal(reflectivity_of_colour(np.array([[-1, -1, -1], [2, 2, 2]])), [0.0, 1.0])


def test_weak_and_oblique_echoes_are_lost():
    scene = sheets((4.0, -20, 20, -20, 20), colours=(1.0,))
    sensor = SphericalSensor(150, -30, 30, 151, 31)
    whole = scan_scene(scene, EAST, sensor)
    oblique = scan_scene(scene, EAST, sensor, effects=Effects(dropout=Dropout(max_incidence_deg=50)))
    assert (oblique.valid == (whole.valid & (whole.truth.incidence <= np.radians(50)))).all()
    light = Intensity(reference_range_m=4.0)
    weak = Effects(intensity=light, dropout=Dropout(min_intensity=0.5))
    kept = scan_scene(scene, EAST, sensor, effects=weak)
    expected = np.cos(whole.truth.incidence) * (4 / whole.truth.ranges) ** 2 >= 0.5
    assert (kept.valid == (whole.valid & expected)).mean() > 0.999


def test_gloss_costs_the_stated_share_of_echoes():
    dropout, theta = Dropout(specular_loss=0.6, specular_exponent=10), np.radians(15)
    lit, n = np.ones(200_000, np.float32), 200_000
    lost = 1 - dropout.draw_kept(lit, np.full(n, theta), np.random.default_rng(0)).mean()
    share = 0.6 * (1 - np.cos(2 * theta) ** 10)
    assert abs(lost - share) < 3 * np.sqrt(share * (1 - share) / n)
    assert dropout.draw_kept(lit, np.zeros(n), np.random.default_rng(0)).all()
    beyond = 1 - dropout.draw_kept(lit, np.full(n, np.radians(60)), np.random.default_rng(1)).mean()
    assert abs(beyond - 0.6) < 3 * np.sqrt(0.24 / n)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Dropout(min_intensity=-1.0), "min_intensity must be 0 or more"),
        (lambda: Dropout(max_incidence_deg=91.0), "max_incidence_deg must be between 0 and 90"),
        (lambda: Dropout(specular_loss=1.5), "specular_loss must be between 0 and 1"),
        (lambda: Intensity(reflectivity=2.0), "reflectivity must be between 0 and 1"),
        (lambda: Intensity(reference_range_m=0.0), "reference_range_m must be"),
    ],
)
def test_impossible_options_are_refused(make, message):
    with pytest.raises(InputError, match=message):
        make()
