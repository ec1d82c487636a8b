# SPDX-License-Identifier: MIT
"""What is known of places past the rectangle of a plane, and what it makes probable."""

from dataclasses import replace

import numpy as np
import pytest

from completion.evidence.chart_grid import ChartGrid
from completion.evidence.evidence import Evidence, Label
from completion.extension.beyond import (
    KNOWN,
    WEIGHTS,
    Role,
    Sides,
    as_far_as_probable,
    past_sides,
    probability_beyond,
    roles,
)
from completion.extension.confidence import EVEN_M, Onward, Prospects, hidden_widths
from completion.extension.extent import Extent
from scenes.surfaces.catalogue import Plane

WALL = Plane(np.zeros(3), np.array([0.0, 0, 1]), np.array([1.0, 0, 0]))
EXTENT = Extent(
    chart=WALL, enclosures=(), cuts=(), neighbours=(), own_low=np.array([0.2, 0.2]),
    own_high=np.array([1.0, 0.8]), ends=np.array([[-np.inf, -1.0], [np.inf, np.inf]]),
    end_probability=np.array([[0.0, 0.25], [0.0, 0.0]]),
    ended=np.zeros((2, 2), dtype=np.bool_), full_turn=False, encloses=False,
    rises=np.array([[0.0, -1.0], [0.0, 1.0]]),
)  # fmt: skip
SIDES = Sides(np.array([[0.1, 0.2], [0.3, 0.4]]), np.array([[0.5, 0.6], [0.7, 0.8]]), 0.15)


def known(uv, extent=EXTENT, base=0.5, sides=SIDES):
    """`KNOWN` of one place by its names' first words, its side and its role."""
    found = past_sides(np.array([uv]), np.array([base]), extent, sides)
    return dict(zip(KNOWN, found.known[0], strict=True)), int(found.side[0]), Role(found.role[0])


def probability(uv, extent=EXTENT, sides=SIDES, base=1.0):
    """Of places (n, 2)."""
    found = past_sides(np.array(uv), np.full(len(uv), base), extent, sides)
    return probability_beyond(found.known, found.role)


@pytest.mark.parametrize(
    ("uv", "side", "past", "past_m", "other", "passed", "hidden"),
    [
        ((0.5, 0.5), -1, 0, 0, 0, 0.4, 0.8),
        ((0.1, 0.5), 0, 0.1 / 0.8, 0.1, 0, 0.1, 0.5),
        ((1.4, 0.5), 1, 0.4 / 0.8, 0.4, 0, 0.3, 0.7),
        ((0.5, -1.0), 2, 1.2 / 0.6, 1.2, 0, 0.2, 0.6),
        ((1.4, 1.05), 1, 0.5, 0.4, 0.25 / 0.6, 0.3, 0.7),  # past two sides
        ((1.4, 1.4), 3, 1.0, 0.6, 0.4 / 0.8, 0.4, 0.8),
    ],
)
def test_the_side_that_a_place_is_farthest_past_tells(uv, side, past, past_m, other, passed, hidden):
    found, at, _ = known(uv)
    assert at == side
    if side < 0:
        return
    values = list(found.values())
    expected = [np.log(past + 0.02), np.log(past_m + 0.02), np.log(1 + other / 0.02), 0.5, 0.15]
    np.testing.assert_allclose(values[:5], expected)
    np.testing.assert_allclose(values[5:7], [passed, hidden])


def test_walls_have_ends_and_things_stand():
    for extent, expected in ((EXTENT, [1, 0.25]), (replace(EXTENT, encloses=True), [1, 0])):
        np.testing.assert_allclose(list(known((0.5, -0.5), extent)[0].values())[7:], expected)
        assert list(known((0.5, 1.5), extent)[0].values())[7] == 0  # nothing closes that side


def test_a_place_has_the_role_of_its_plane_and_of_the_way_there():
    ways = {(0.5, -0.5): Role.DOWN, (0.5, 1.5): Role.UP, (2.0, 0.5): Role.ASIDE, (-1.0, 0.5): Role.ASIDE}
    for uv, role in ways.items():
        assert known(uv, replace(EXTENT, encloses=True))[2] == role
        thing = Role.THING_DOWN if role == Role.DOWN else Role.THING_ASIDE
        assert known(uv)[2] == thing
    for faces_up, role in ((1.0, Role.FLOOR), (-1.0, Role.CEILING)):
        level = replace(EXTENT, faces_up=faces_up, rises=np.full((2, 2), 0.01))
        assert (roles(level) == Role.THING_LEVEL).all()
        assert (roles(replace(level, encloses=True)) == role).all()
    slope = np.array([[0.0, -0.6], [0.0, 0.6]])  # the lower side of a sloping ceiling is a lower side
    assert roles(replace(EXTENT, encloses=True, faces_up=-0.8, rises=slope))[0, 1] == Role.DOWN


@pytest.mark.parametrize("encloses", [False, True])
@pytest.mark.parametrize("faces_up", [-1.0, 0.0, 1.0])
@pytest.mark.parametrize("least", [0.2, 0.5, 0.8])
def test_past_its_reach_a_plane_is_improbable_whatever_is_seen(encloses, faces_up, least):
    shape = replace(EXTENT, encloses=encloses, faces_up=faces_up)
    low, high = as_far_as_probable(shape, least).reach
    rng = np.random.default_rng(0)
    uv = np.exp(rng.uniform(-3, 20, (100_000, 2))) * rng.choice([-1, 1], (100_000, 2))
    past = ((uv < low) | (uv > high)).any(axis=1)
    assert past.any()
    for passed, hidden, outline in ((0, 1, 0), (1, 1, 0), (0, 0, 1), (1, 0, 1), (0.5, 0.5, 0.2)):
        sides = Sides(np.full((2, 2), float(passed)), np.full((2, 2), float(hidden)), outline)
        assert probability(uv, shape, sides)[past].max() <= least


def test_a_reach_is_not_longer_than_it_must_be():
    shape = replace(EXTENT, encloses=True)
    reach = as_far_as_probable(shape, 0.75).reach
    middle, best = (shape.own_low + shape.own_high) / 2, 0.0
    for row, axis in np.ndindex(2, 2):
        half = middle.copy()
        half[axis] = ((shape.own_low, shape.own_high)[row][axis] + reach[row, axis]) / 2
        for hidden in (0.0, 1.0):
            sides = Sides(np.zeros((2, 2)), np.full((2, 2), hidden), 0.0)
            best = max(best, *probability([half], shape, sides))
    assert best > 0.75  # half as far it may be


def test_odds_that_do_not_fall_with_the_distance_bound_nothing():
    rising = WEIGHTS.copy()
    rising[:, 1] = 1.0
    assert np.isinf(as_far_as_probable(EXTENT, 0.5, rising).reach).all()


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
    sides = Sides.of(grid, evidence, EXTENT)
    share = 2 / len(rows)
    np.testing.assert_allclose(sides.passed, [[0, 0], [share, 0]])
    np.testing.assert_allclose(sides.hidden, [[1, 1], [1 - share, 1]])
    assert 0 < sides.passed_outline < 0.1
    first = labels.copy()
    first[rows[0], right - 5 :] = Label.FREE  # this line ends early, and does not count
    shorter = observed.copy()
    shorter[rows[0], right - 5 :] = False
    evidence = Evidence(first, shorter, shorter, nothing, nothing, nothing, none, none)
    assert Sides.of(grid, evidence, EXTENT).passed[1, 0] == pytest.approx(1 / len(rows))


def test_it_is_less_probable_farther_away_and_past_a_side_that_was_seen_to_end():
    wall = replace(EXTENT, encloses=True)
    near, far, farther = probability([(1.1, 0.5), (1.5, 0.5), (3.0, 0.5)], wall)
    assert 1 > near > far > farther > 0
    ended = Sides(np.ones((2, 2)), np.zeros((2, 2)), 1.0)
    unseen = Sides(np.zeros((2, 2)), np.full((2, 2), 0.5), 0.0)
    assert probability([(1.2, 0.5)], wall, ended, base=0.1) < 0.1
    assert probability([(1.2, 0.5)], wall, unseen) > 0.5
    assert WEIGHTS.shape == (len(Role), len(KNOWN) + 1)


def test_walls_go_down_rather_than_aside_or_up():
    wall = replace(EXTENT, encloses=True)
    down, up, aside = probability([(0.6, 0.0), (0.6, 1.0), (1.2, 0.5)], wall)
    assert down > aside > up


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
        np.zeros(3, np.int8),
        known,
        past_end=np.zeros((3, 4)),
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
        np.zeros(1, np.int8),
        row,
        past_end=np.zeros((1, 4)),
        is_said=np.ones(1, dtype=np.bool_),
    )
    assert one.probability() == 1
