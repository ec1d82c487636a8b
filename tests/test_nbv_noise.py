# SPDX-License-Identifier: MIT
"""Noise: measured standard deviations against the published formulas."""

import numpy as np
import pytest

from nbv.noise import noise_model
from scenes.checks import InputError

N = 40_000


def nguyen(z, theta):
    return 0.0012 + 0.0019 * (z - 0.4) ** 2 + 1e-4 / np.sqrt(z) * theta**2 / (np.pi / 2 - theta) ** 2


@pytest.mark.parametrize(
    ("name", "ranges", "incidence", "sigma"),
    [
        ("gaussian-1mm", 3.0, 0.0, 0.001),
        ("gaussian-2.5mm", 9.0, 1.2, 0.0025),
        ("constant-ppm", 50.0, 0.0, 0.001 + 50 * 10e-6),
        ("constant-2mm-20ppm", 100.0, 0.0, 0.004),
        ("nguyen2012", 2.0, 0.5, 0.0012 + 0.0019 * 1.6**2),
        ("nguyen2012", 2.0, np.radians(80), nguyen(2.0, np.radians(80))),
    ],
)
def test_standard_deviation_agrees_with_the_formula(name, ranges, incidence, sigma):
    model = noise_model(name)
    r, i = np.full(N, ranges), np.full(N, incidence)
    assert np.allclose(model.sigma_m(r, i), sigma)
    error = model.disturb(r, i, rng=0) - ranges
    assert abs(error.std() - sigma) < 3 * sigma / np.sqrt(2 * N)
    assert abs(error.mean()) < 3 * sigma / np.sqrt(N)


def test_khoshelham_is_quantised_noise_of_depth():
    model = noise_model("khoshelham2012")
    r = np.full(N, 3.0)
    assert np.allclose(model.sigma_m(r, r * 0), 1.425e-3 * 9)
    noisy = model.disturb(r, r * 0, rng=1)
    steps = np.diff(np.unique(noisy))
    assert steps.min() > 2.85e-3 * noisy.min() ** 2 * 0.95
    spread = np.hypot(1.425e-3, 2.85e-3 / np.sqrt(12)) * 9  # noise, and a step's uniform rounding
    assert abs(noisy.std() - spread) < 0.02 * spread


def test_depth_noise_is_turned_into_range_noise_off_the_axis():
    model = noise_model("nguyen2012")
    r, cosine = np.array([2.0]), 0.8
    assert np.allclose(model.sigma_m(r, r * 0, cosine), model.sigma_m(r * cosine, r * 0) / cosine)


def test_incidence_is_clipped_before_the_pole_and_missing_ranges_stay_missing():
    model = noise_model("nguyen2012")
    assert np.isfinite(model.sigma_m(np.ones(1), np.array([np.pi / 2]))).all()
    noisy = model.disturb(np.array([np.inf, 1.0]), np.array([np.nan, 0.0]), rng=0)
    assert np.isinf(noisy[0])
    assert np.isfinite(noisy[1])


def test_a_pixels_noise_does_not_depend_on_the_others():
    model = noise_model("gaussian-1mm")
    full = model.disturb(np.full(9, 2.0), np.zeros(9), rng=3)
    holes = model.disturb(np.where(np.arange(9) % 2, np.inf, 2.0), np.zeros(9), rng=3)
    assert (holes[::2] == full[::2]).all()


def test_none_changes_nothing():
    assert (noise_model("none").disturb(np.arange(1.0, 5.0), np.zeros(4), rng=0) == np.arange(1.0, 5.0)).all()


@pytest.mark.parametrize("name", ["gaussian", "gaussian--1mm", "Nguyen", ""])
def test_unknown_models_are_refused(name):
    with pytest.raises(InputError, match="no noise model named"):
        noise_model(name)
