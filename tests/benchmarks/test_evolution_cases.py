# SPDX-License-Identifier: MIT
"""Cases of the evolution benchmark: the truth is near the least value, and smooth ones are found."""

import numpy as np
import pytest

from benchmarks.suites.evolution import CASES, many_starts


def test_least_squares_finds_the_smooth_part_and_the_exact_solver_agrees() -> None:
    case = CASES["smooth"](3)
    _, place = many_starts(case, 0, 600)[-1]
    assert case.objective(place[None])[0] == pytest.approx(1.0, rel=0.2)  # squared deviations
    radius, angle = case.errors(place)
    assert radius < 2.0
    assert angle < 1.0
    assert case.exact()[1] < 1e-6


def test_gates_and_truncation_do_what_they_say() -> None:
    gated, free = CASES["30 % outliers, gated"](1), CASES["30 % outliers, truncated"](1)
    places = np.random.default_rng(0).uniform(gated.lower, gated.upper, (20, 11))
    assert (gated.objective(places) <= 9.0).all()
    np.testing.assert_array_equal(gated.objective(places), free.objective(places))
    over = np.maximum(0, gated.angles_deg(places) - 0.05).sum(axis=1)
    np.testing.assert_allclose(gated.violation(places), over)
    assert (free.violation(places) == 0).all()


def test_the_true_opening_has_the_most_evidence_nearby() -> None:
    case = CASES["beams that flip"](4)
    left, right, bottom, top = case.truth
    true = np.array([(left + right) / 2, right - left, bottom, top - bottom])
    assert case.errors(true)[0] == pytest.approx(0.0, abs=1e-9)
    others = true + np.random.default_rng(0).choice([-0.3, 0.3], (50, 4))
    assert case.objective(true[None])[0] < case.objective(others).min()
