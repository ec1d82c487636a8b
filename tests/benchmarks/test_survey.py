# SPDX-License-Identifier: MIT
"""The suite behind docs/results/building-study.md, in a small house: its counts and order."""

import numpy as np
import pytest

from benchmarks.suites import survey as suite
from nbv.visibility.site_options import SiteOptions
from tests.helpers.buildings import house


@pytest.fixture(scope="module")
def building():
    return suite.Building.of(house(3).scene(), SiteOptions(heights_m=(1.6,)))


def test_minutes_are_of_stations_and_of_walking():
    assert suite.Cost(3.0, 1.0, 1.0).minutes(10, 120.0) == pytest.approx(42.0)
    assert suite.Cost(3.0, 1.0, 0.5).minutes(0, 120.0) == pytest.approx(4.0)


def test_stations_are_counted_until_the_share():
    survey = suite.Survey(np.zeros((3, 3)), np.array([0.5, 0.95, 0.97]))
    assert [survey.until(share) for share in (0.5, 0.9, 0.95, 0.99)] == [1, 2, 2, None]


@pytest.mark.long
def test_rules_are_made_finer_until_they_suffice_and_cover_takes_no_more(building):
    share = 0.95
    found = dict(suite.rule_surveys(building, share))
    enough = {name: survey for name, survey in found.items() if survey.until(share)}
    assert {name.split(",")[0] for name in enough} == {"rule:grid5m", "rule:rooms-and-doorways"}
    for survey in enough.values():
        assert survey.until(share) == len(survey.stations) >= survey.enough >= 1
    cover = building.planned("cover", share, 0)
    assert cover.until(share) == len(cover.stations)
    assert cover.until(share) <= min(survey.enough for survey in enough.values())


@pytest.mark.long
def test_shares_of_a_rule_are_those_of_a_plan_by_it(building):
    survey = building.by_rule(suite.grid_places(building.site), 0.1)
    plan = building.planned("rule:grid5m", 1.0, 0)
    assert len(plan.stations) == len(survey.stations)
    assert survey.shares[-1] == pytest.approx(plan.shares[-1])


@pytest.mark.long
def test_a_row_tells_what_was_never_reached(building):
    cost = suite.Cost(3.0, 1.0, 1.0)
    short = suite.Survey(np.zeros((2, 3)), np.array([0.2, 0.4]))
    assert "never: 40.0 % after 2" in suite.row("short", building, short, 0.95, cost)
    places = building.standing.candidates.positions[[0, 0]]
    done = suite.Survey(places, np.array([0.5, 1.0]))
    assert suite.row("nbv", building, done, 0.95, cost) == "| nbv | 2 |  | 0 | 0 | 8 |"
