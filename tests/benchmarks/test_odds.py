# SPDX-License-Identifier: MIT
"""Weights of the log odds are found again from places that were drawn by them."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.metrics.odds import log_likelihood, most_likely_odds, probability

WEIGHTS = np.array([0.5, -1.2, 2.0, 0.0])


def drawn(n=20_000):
    rng = np.random.default_rng(0)
    known = np.column_stack([rng.normal(size=n), rng.random(n), np.full(n, 3.0)])
    return known, rng.random(n) < probability(known, WEIGHTS)


def test_weights_are_found_again_and_what_is_even_has_none():
    known, right = drawn()
    weights = most_likely_odds(known, right, np.ones(len(known)), ridge=1e-6)
    assert weights == pytest.approx(WEIGHTS, abs=0.15)
    assert abs(weights[3]) < 1e-6


def test_no_other_weights_are_likelier():
    known, right = drawn()
    even = np.ones(len(known))
    best = log_likelihood(probability(known, most_likely_odds(known, right, even, ridge=1e-9)), right, even)
    for change in 0.2 * np.eye(3, 4):
        assert log_likelihood(probability(known, WEIGHTS + change), right, even) < best
