# SPDX-License-Identifier: MIT
"""Noise of beams on faces: factors that residuals were drawn with are found."""

import numpy as np
import pytest

from completion.asbuilt.noise import fitted_sigma

N = 60_000
BIAS = 0.04  # a robust variance over a bin is that of its quieter beams


def drawn(factors, rng, n=N):
    """Ranges, cosines and residuals whose variance has known factors."""
    random = np.random.default_rng(rng)
    ranges, cosine = random.uniform(0.5, 8.0, n), random.uniform(0.2, 1.0, n)
    c0, c1, c2, c3 = factors
    variance = (c0 + c1 * ranges**2 + c2 * ranges**4) * cosine**2 + c3 * ranges**2 * (1 - cosine**2)
    return ranges, cosine, np.sqrt(variance), random.normal(0, np.sqrt(variance))


@pytest.mark.parametrize(
    "factors",
    [(4e-6, 0, 0, 0), (1e-6, 2.5e-7, 0, 0), (1e-6, 0, 4e-8, 0), (4e-6, 0, 0, 1e-6), (1e-6, 1e-7, 1e-8, 4e-7)],
)
def test_drawn_noise_is_found(factors) -> None:
    ranges, cosine, sigma, residual = drawn(factors, 1)
    found = fitted_sigma(residual, ranges, cosine, np.zeros(N, int), np.ones(N, bool))
    assert np.median(np.abs(found / sigma - 1)) < BIAS
    assert np.quantile(np.abs(found / sigma - 1), 0.95) < 0.08


def test_each_instrument_has_its_own() -> None:
    kinds = np.repeat([0, 1], N)
    parts = [drawn((4e-6, 0, 0, 0), 1), drawn((1e-4, 0, 0, 0), 2)]
    ranges, cosine, sigma, residual = (np.concatenate(column) for column in zip(*parts, strict=True))
    found = fitted_sigma(residual, ranges, cosine, kinds, np.ones(2 * N, bool))
    sigmas = [np.median(found[kinds == k] / sigma[kinds == k]) for k in (0, 1)]
    assert sigmas == pytest.approx([1, 1], abs=BIAS)


def test_a_tenth_of_beams_on_other_things_changes_little() -> None:
    ranges, cosine, sigma, residual = drawn((4e-6, 0, 0, 1e-6), 3)
    residual[::10] += 0.03
    found = fitted_sigma(residual, ranges, cosine, np.zeros(N, int), np.ones(N, bool))
    assert np.median(found / sigma) == pytest.approx(1.0, abs=0.2)


def test_beams_that_are_not_used_get_it_too_and_too_few_tell_nothing() -> None:
    ranges, cosine, sigma, residual = drawn((4e-6, 0, 0, 0), 4)
    used = np.arange(N) % 2 == 0
    residual[~used] = 1.0
    found = fitted_sigma(residual, ranges, cosine, np.zeros(N, int), used)
    assert np.median(found[~used] / sigma[~used]) == pytest.approx(1.0, abs=BIAS)
    few = np.arange(N) < 150
    assert np.isnan(fitted_sigma(residual, ranges, cosine, np.zeros(N, int), few)).all()
