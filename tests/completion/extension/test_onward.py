# SPDX-License-Identifier: MIT
"""What is known of places past the rectangle of a plane, and what it makes probable."""

from dataclasses import replace

import numpy as np
import pytest

from completion.evidence.chart_grid import ChartGrid
from completion.evidence.evidence import Evidence, Label
from completion.extension.confidence import (
    EVEN_M,
    KNOWN,
    WEIGHTS,
    Onward,
    Prospects,
    RectangleSides,
    as_far_as_probable,
    hidden_widths,
    known_beyond,
    probability_beyond,
)
from completion.extension.extent import Extent
from scenes.surfaces.catalogue import Plane

WALL = Plane(np.zeros(3), np.array([0.0, 0, 1]), np.array([1.0, 0, 0]))
EXTENT = Extent(
    chart=WALL, enclosures=(), cuts=(), neighbours=(), own_low=np.array([0.2, 0.2]),
    own_high=np.array([1.0, 0.8]), ends=np.array([[-np.inf, -1.0], [np.inf, np.inf]]),
    end_probability=np.array([[0.0, 0.25], [0.0, 0.0]]),
    ended=np.zeros((2, 2), dtype=np.bool_), full_turn=False, encloses=False,
)  # fmt: skip
SIDES = RectangleSides(np.array([[0.1, 0.2], [0.3, 0.4]]), np.array([[0.5, 0.6], [0.7, 0.8]]), 0.15)


def known(uv, extent=EXTENT, base=0.5):
    """`KNOWN` of one place by its names' first words, and its side."""
    values, side = known_beyond(np.array([uv]), np.array([base]), extent, SIDES)
    return dict(zip(KNOWN, values[0], strict=True)), int(side[0])


@pytest.mark.parametrize(
    ("uv", "side", "past", "past_m", "passed", "hidden"),
    [
        ((0.5, 0.5), -1, 0, 0, 0.4, 0.8),
        ((0.1, 0.5), 0, 0.1 / 0.8, 0.1, 0.1, 0.5),
        ((1.4, 0.5), 1, 0.4 / 0.8, 0.4, 0.3, 0.7),
        ((0.5, -1.0), 2, 1.2 / 0.6, 1.2, 0.2, 0.6),
        ((1.4, 1.05), 1, 0.5, 0.4, 0.3, 0.7),  # past two sides
        ((1.4, 1.4), 3, 1.0, 0.6, 0.4, 0.8),
    ],
)
def test_the_side_that_a_place_is_farthest_past_tells(uv, side, past, past_m, passed, hidden):
    found, at = known(uv)
    assert at == side
    if side < 0:
        return
    values = list(found.values())
    np.testing.assert_allclose(values[:3], [np.log(past + 0.02), np.log(past_m + 0.02), 0.15])
    np.testing.assert_allclose(values[6:8], [passed, hidden])


def test_walls_have_ends_and_things_stand():
    wall = replace(EXTENT, encloses=True, is_level=True)
    for extent, expected in ((EXTENT, [0, 0, 0, 0, 0.25]), (wall, [1, 0, 1, 1, 0])):
        values = list(known((0.5, -0.5), extent)[0].values())
        np.testing.assert_allclose([*values[3:6], *values[8:10]], expected)
    values = list(known((0.5, 1.5), wall)[0].values())
    assert values[8] == 0  # nothing closes that side


def test_the_edges_tell_the_more_the_better_the_outline_was_seen():
    assert list(known((0.5, 1.5), base=0.2)[0].values())[10] == pytest.approx(0.8 * 0.5)
    values, _ = known_beyond(
        np.array([[0.5, 1.5]]), np.array([0.2]), EXTENT, replace(SIDES, passed_outline=0.9)
    )
    assert values[0, 10] == pytest.approx(0.8)


@pytest.mark.parametrize("encloses", [False, True])
@pytest.mark.parametrize("least", [0.2, 0.5, 0.8])
def test_past_its_reach_a_plane_is_improbable_whatever_is_seen(encloses, least):
    shape = replace(EXTENT, encloses=encloses)
    low, high = as_far_as_probable(shape, least).reach
    uv = np.random.default_rng(0).uniform(-9, 10, (20_000, 2))
    past = ((uv < low) | (uv > high)).any(axis=1)
    assert past.any()
    for passed, hidden, outline in ((0, 1, 0), (1, 1, 0), (0, 0, 1), (0.5, 0.5, 0.2)):
        sides = RectangleSides(np.full((2, 2), float(passed)), np.full((2, 2), float(hidden)), outline)
        values, _ = known_beyond(uv, np.ones(len(uv)), shape, sides)
        assert probability_beyond(values)[past].max() <= least
    best = RectangleSides(np.zeros((2, 2)), np.ones((2, 2)), 0.0)
    nearer = np.tile((shape.own_low + shape.own_high) / 2, (2, 1))
    np.fill_diagonal(nearer, shape.own_high + (high - shape.own_high) / 2)
    values, _ = known_beyond(nearer, np.ones(2), shape, best)
    is_anywhere = high.max() > shape.own_high.max() + 1e-6
    assert not is_anywhere or probability_beyond(values).max() > least  # half as far it may be


def test_odds_that_do_not_fall_with_the_distance_bound_nothing():
    level = WEIGHTS * np.where(np.arange(len(WEIGHTS)) == 1, -1.0, 1.0)
    assert np.isinf(as_far_as_probable(EXTENT, 0.5, level).reach).all()


def test_sides_are_looked_at_line_by_line():
    grid = ChartGrid.over(WALL, np.array([0.0, 0.0]), np.array([1.2, 1.0]), 0.1, full_turn=False)
    u, v = grid.axes()
    observed = ((u > 0.2) & (u < 1.0)) & ((v > 0.2) & (v < 0.8))[:, None]
    labels = np.full(grid.shape, Label.OCCLUDED, np.int8)
    right = observed.any(axis=0).nonzero()[0].max() + 1
    rows = observed.any(axis=1).nonzero()[0]
    labels[rows[:2], right] = Label.FREE
    nothing, none = np.zeros(grid.shape, np.int32), np.zeros(grid.shape, dtype=np.bool_)
    evidence = Evidence(labels, observed, observed, nothing, nothing, nothing, none, none)
    sides = RectangleSides.of(grid, evidence, EXTENT)
    share = 2 / len(rows)
    np.testing.assert_allclose(sides.passed, [[0, 0], [share, 0]])
    np.testing.assert_allclose(sides.hidden, [[1, 1], [1 - share, 1]])
    assert 0 < sides.passed_outline < 0.1
    first = labels.copy()
    first[rows[0], right - 5 :] = Label.FREE  # this line ends early, and does not count
    shorter = observed.copy()
    shorter[rows[0], right - 5 :] = False
    evidence = Evidence(first, shorter, shorter, nothing, nothing, nothing, none, none)
    assert RectangleSides.of(grid, evidence, EXTENT).passed[1, 0] == pytest.approx(1 / len(rows))


def test_it_is_less_probable_farther_away_and_past_a_side_that_was_seen_to_end():
    def at(uv, sides=SIDES):
        return probability_beyond(known_beyond(np.array([uv]), np.ones(1), EXTENT, sides)[0])[0]

    assert 1 > at((1.1, 0.5)) > at((1.5, 0.5)) > at((3.0, 0.5)) > 0
    ended = replace(SIDES, passed=np.ones((2, 2)), hidden=np.zeros((2, 2)))
    unseen = replace(SIDES, passed=np.zeros((2, 2)), hidden=np.ones((2, 2)))
    assert at((1.2, 0.5), ended) < 0.3 < at((1.2, 0.5), unseen)
    assert len(WEIGHTS) == len(KNOWN) + 1


def test_a_wide_hidden_part_of_a_wall_may_hold_a_door():
    grid = ChartGrid.over(WALL, np.array([0.0, 0.0]), np.array([4.0, 3.0]), 0.02, full_turn=False)
    u, v = grid.axes()
    hidden = ((np.abs(u - 1) < 0.6) & (np.abs(v - 1.5) < 0.9)[:, None]) | (
        (np.abs(u - 3) < 0.1) & (np.abs(v - 1.5) < 0.9)[:, None]
    )
    width = hidden_widths(hidden, grid)
    assert not width[~hidden].any()
    wide, narrow = width[75, 50], width[75, 150]
    assert 0.6 / 1.5 <= wide <= 0.6 + 0.04  # by steps of half
    assert 0.1 / 1.5 <= narrow <= 0.1 + 0.04
    none = np.zeros(3, dtype=np.bool_)
    kind, known = np.full(3, Onward.WALL_WITHIN, np.int8), np.zeros((3, len(KNOWN)))
    found = Prospects(
        np.ones(3),
        kind,
        np.zeros(3),
        np.array([0, narrow, wide]),
        known,
        end_features=np.zeros((3, 4)),
        is_said=none,
    )
    bare, slit, door = found.probability()
    assert bare > slit > door
    assert slit > 0.98 * bare
    assert door == pytest.approx(bare / (1 + (wide / EVEN_M) ** 2))
    assert found.probability(even_m=2.0)[2] > door


def test_what_a_person_said_goes_on_does():
    row = np.full((1, len(KNOWN)), -50.0)
    kind = np.array([Onward.BEYOND], np.int8)
    one = Prospects(
        np.ones(1),
        kind,
        np.ones(1),
        np.ones(1),
        row,
        end_features=np.zeros((1, 4)),
        is_said=np.ones(1, dtype=np.bool_),
    )
    assert one.probability() == 1
