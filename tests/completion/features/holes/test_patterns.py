# SPDX-License-Identifier: MIT
"""Patterns: their derivatives, parts of their lattices, fits, and how many of them chance makes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from completion.features.holes.circles import HoleCandidates
from completion.features.holes.lattices import log_chance
from completion.features.holes.patterns import CIRCLE, GRID, KINDS, LEAST_SEEN, ROW, Pattern, fit_pattern
from completion.features.holes.pipeline import false_fit_probability

PATTERNS = (
    Pattern(ROW, (5, 1), np.array([3.0, -2.0, 0.7, 11.0]), 2.0),
    Pattern(GRID, (3, 4), np.array([1.0, 5.0, -0.3, 9.0, 14.0]), 2.0),
    Pattern(CIRCLE, (6, 1), np.array([-4.0, 2.0, 1.1, 20.0]), 2.0),
)


@pytest.mark.parametrize("pattern", PATTERNS, ids=KINDS)
def test_slopes_are_those_of_finite_differences(pattern: Pattern) -> None:
    for k in range(len(pattern.x)):
        step = 1e-6 * np.eye(len(pattern.x))[k]
        two = [replace(pattern, x=pattern.x + sign * step).centres for sign in (1, -1)]
        np.testing.assert_allclose(pattern.slopes[:, :, k], (two[0] - two[1]) / 2e-6, atol=1e-6)


@pytest.mark.parametrize("pattern", PATTERNS, ids=KINDS)
def test_some_of_its_holes_determine_a_pattern(pattern: Pattern) -> None:
    places = np.array([0, 1, 3, 4])
    begun = replace(pattern, x=pattern.x + 0.02)
    fit = fit_pattern(begun, places, pattern.centres[places], np.zeros(len(pattern.x), dtype=np.bool_))
    np.testing.assert_allclose(fit.centres, pattern.centres, atol=1e-6)


def test_a_part_of_a_lattice_has_its_holes() -> None:
    grid = PATTERNS[1]
    part = grid.resize((1, 2), (2, 2))
    wanted = grid.centres.reshape(3, 4, 2)[1:3, 2:4].reshape(-1, 2)
    np.testing.assert_allclose(part.centres, wanted, atol=1e-12)


def test_chance_makes_few_regular_patterns_and_more_of_more_circles() -> None:
    rng, row = np.random.default_rng(0), PATTERNS[0]
    everywhere = rng.uniform(-50, 50, (30, 2))
    centres = np.concatenate([row.centres, everywhere])
    radii = np.concatenate([np.full(5, 2.0), rng.uniform(1, 5, 30)])
    at = np.arange(5)

    def chance(evidence: float, off: float) -> float:
        moved = centres.copy()
        moved[:5] += off * rng.normal(size=(5, 2))
        candidates = HoleCandidates(moved, radii, np.concatenate([np.full(5, evidence), np.full(30, 10.0)]))
        return log_chance(row, at, at, candidates, area=1e4, spacing=1.0)

    assert chance(20.0, 0.0) < -20
    assert chance(20.0, 0.0) < chance(5.0, 0.0) < chance(5.0, 0.5)


def test_of_as_evident_false_patterns_there_are_fewer_but_never_none() -> None:
    for kind in KINDS:
        for n_seen in (LEAST_SEEN[kind], LEAST_SEEN[kind] + 1):
            shares = [
                false_fit_probability(kind, evidence, n_seen=n_seen)
                for evidence in (-20.0, 0.0, 3.0, 6.0, 100.0)
            ]
            assert shares[0] == 1.0
            assert shares == sorted(shares, reverse=True)
            assert shares[-1] > 0
