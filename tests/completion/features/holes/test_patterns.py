# SPDX-License-Identifier: MIT
"""Patterns: their derivatives, parts of their lattices, fits, and how many of them chance makes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from completion.features.holes.circles import HoleCandidates, rim_scores
from completion.features.holes.lattices import Looks, log_chance
from completion.features.holes.patterns import CIRCLE, GRID, KINDS, ROW, Pattern, fit_pattern
from completion.features.holes.pipeline import false_fit_probability
from completion.features.holes.plates import HolePlate, survey

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
        shares = [false_fit_probability(kind, evidence) for evidence in (-20.0, 0.0, 3.0, 6.0, 100.0)]
        assert shares[0] == 1.0
        assert shares == sorted(shares, reverse=True)
        assert shares[-1] > 0


def test_each_kind_that_is_looked_for_is_another_chance_of_a_false_one() -> None:
    for kind in KINDS:
        alone = false_fit_probability(kind, 5.0)
        assert 1 / 125 < alone < 1 / 3
        assert false_fit_probability(kind, 5.0, n_kinds=3) == pytest.approx(3 * alone)
        assert false_fit_probability(kind, 1e3, n_kinds=3) == false_fit_probability(kind, 1e3)


def test_a_place_is_as_rare_as_few_others_look_like_it_but_for_those_of_its_pattern() -> None:
    places = np.column_stack([np.arange(4000.0), np.zeros(4000)])
    thrown = Looks(places, np.sort(np.random.default_rng(0).normal(size=4000)))
    likely = np.array([-9.0, thrown.evidence[3601], 9.0])
    nowhere, ends = np.array([[-9.0, 0.0]]), np.array([[3999.0, 0.0]])
    wanted = np.log(4001 / np.array([4001, 400, 1]))
    np.testing.assert_allclose(thrown.rarity_where_lost(likely, nowhere, 1.0), wanted)
    assert (thrown.rarity(likely) > wanted).all()
    assert thrown.rarity_where_lost(likely, ends, 200.0)[1] == pytest.approx(np.log(3801 / 200), abs=0.01)


def test_a_place_that_is_lost_whole_says_nothing_and_a_rim_the_more_the_more_is_left() -> None:
    rng, radius = np.random.default_rng(1), 4.0
    flat = rng.uniform(-30, 30, (3600, 2))
    flat = flat[np.hypot(*flat.T) > radius]
    turn = np.arctan2(flat[:, 1], flat[:, 0]) % (2 * np.pi)

    def evidence(lost: float) -> float:
        kept = flat[(np.hypot(*flat.T) > radius + 6.0) | (turn > lost * 2 * np.pi)]
        space = np.column_stack([kept, np.zeros(len(kept))])
        noise, everything = 0.1, np.ones(len(kept), dtype=np.bool_)
        plate = HolePlate(np.zeros(3), np.eye(3), kept, space[:, 2], everything, noise)
        return float(
            rim_scores(survey(plate), np.zeros((1, 2)), np.array([radius]), np.array([0.1])).evidence[0]
        )

    seen = [evidence(lost) for lost in (0.0, 0.25, 0.5, 0.75, 1.0)]
    assert seen == sorted(seen, reverse=True)
    assert seen[0] > 15
    assert abs(seen[-1]) < 0.5
