# SPDX-License-Identifier: MIT
"""Dimensions: intervals that hold known rooms, joint errors that cancel or add, advice by its rule."""

import csv
import io
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from completion.export.building.model import OpeningOutline
from completion.export.decisions import COLUMNS, DecisionSheet, advice, decision_sheet, told_rule
from completion.export.room_dimensions import opening_sizes
from completion.uncertainty.joint_errors import NO_ERRORS, RelatedErrors, SharedErrors
from scenes.checks import InputError
from tests.helpers.exchange_examples import length, panorama, parts_of
from tests.helpers.exchange_houses import HIGH_M, SLAB_M, completed_house


def by_kind(done):
    found = {}
    for one in done.decisions().dimensions:
        found.setdefault(one.kind, []).append(one)
    return found


@pytest.fixture(scope="module")
def room():
    return by_kind(panorama())


@pytest.mark.parametrize(
    ("kind", "truths"),
    [
        ("room width", (6.0, 5.0)),
        ("room height", (2.7,)),
        ("room area", (30.0,)),
        ("room volume", (81.0,)),
    ],
)
def test_the_room_of_known_size_lies_in_the_intervals(room, kind, truths):
    found = room[kind]
    assert len(found) == len(truths)
    for one, truth in zip(found, truths, strict=True):
        assert one.low <= truth <= one.high
        assert one.half < 0.01 * truth
        assert advice(one) == "rely"


@pytest.mark.long
def test_a_house_has_widths_by_storey_and_thicknesses_between_its_rooms():
    found = by_kind(completed_house())
    (slab,), (wall,) = found["slab thickness"], found["wall thickness"]
    assert slab.low <= SLAB_M <= slab.high
    assert wall.low <= 0.15 <= wall.high
    assert sorted(round(one.value, 2) for one in found["room width"]) == [3.0, 3.0, 3.0, 4.0, 4.0]
    assert all(one.low <= HIGH_M <= one.high for one in found["room height"])
    heights = {round(float(one.ends[0, 2]), 1) for one in found["room width"]}
    assert len(heights) == 2  # a plan for each storey


@pytest.mark.long
def test_openings_and_columns_of_the_office_hold():
    found = by_kind(panorama("office"))
    for kind, window, door in (("opening width", 0.9, 0.6), ("opening height", 0.9, 2.0)):
        one, other = sorted(found[kind], key=lambda told: abs(told.value - window))
        assert one.low <= window <= one.high
        assert other.low <= door <= other.high  # half of it is hidden
    (radius,), (tall,) = found["column radius"], found["column height"]
    assert radius.low <= 0.15 <= radius.high
    assert tall.low <= 2.6 <= tall.high
    assert len(tall.surfaces) == 3  # the column, floor and ceiling


def test_errors_that_surfaces_share_add_up_or_cancel():
    one = np.array([[1.0], [0.0], [0.0]])
    errors = replace(
        NO_ERRORS,
        separate=(np.diag([1.0, 0, 0]),) * 2,
        shared=SharedErrors((3, 3), ({0: one, 1: one},)),
        ranges=(np.zeros((3, 2)),) * 2,
        freedom=(np.inf,) * 2,
        shares=np.array([[1.0, 0.0], [0.0, 1.0]]),
        pose_sd=np.zeros(2),
    )
    first, shift = np.array([1.0, 0, 0]), np.array([1.0, 0, 0])
    still = {0: np.zeros(3), 1: np.zeros(3)}
    assert errors.variance({0: first, 1: first}, still) == pytest.approx(4.0)
    assert errors.variance({0: first, 1: -first}, still) == pytest.approx(0.0)
    moved = replace(errors, pose_sd=np.array([0.3, 0.4]))
    assert moved.variance({0: first, 1: -first}, {0: shift, 1: -shift}) == pytest.approx(0.25)
    together = replace(moved, shares=np.array([[1.0, 0.0], [1.0, 0.0]]))
    assert together.variance({0: first, 1: -first}, {0: shift, 1: -shift}) == pytest.approx(0.0)
    scaled = replace(errors, ranges=(np.full((3, 2), 0.5), np.full((3, 2), 0.5)))
    assert scaled.variance({0: first, 1: first}, still) == pytest.approx(4.0 + 2.0)


def test_relations_tell_of_surfaces_that_they_moved_and_of_others_the_worst():
    covariance = np.zeros((6, 6))
    covariance[0, 3] = covariance[3, 0] = -0.5
    errors = replace(
        NO_ERRORS,
        separate=(np.diag([1.0, 0, 0]),) * 3,
        shared=SharedErrors((3, 3, 3), ()),
        related=RelatedErrors((0, 1), (0, 3, 6), covariance, (True, False)),
        ranges=(np.zeros((3, 2)),) * 3,
        freedom=(np.inf, np.inf, 4.0),
        shares=np.zeros((3, 0)),
    )
    first = np.array([1.0, 0, 0])
    still = dict.fromkeys(range(3), np.zeros(3))
    assert errors.variance({0: first, 1: first}, still) == pytest.approx(1.0)
    assert errors.variance({1: first, 2: first}, still) == pytest.approx(2.0)
    assert errors.variance({0: first, 2: first}, still) == pytest.approx(4.0)
    assert errors.half_interval({0: first}, still, level=0.95) == pytest.approx(1.96, abs=0.001)
    assert errors.half_interval({2: first}, still, level=0.95) == pytest.approx(2.776, abs=0.001)
    anew = errors.only([False, True, True])
    assert anew.variance({0: first, 1: first}, still) == pytest.approx(2.0)


def test_advice_follows_its_rule():
    assert advice(length(4.0, 0.0099)) == "rely"
    assert advice(length(4.0, 0.0101)) == "check"
    assert advice(length(4.0, 0.015), 0.02) == "rely"
    assert advice(length(4.0, 0.001, share=0.4)) == "check"
    assert advice(length(4.0, 0.001, existence=0.79)) == "do not build"
    area = replace(length(12.0, 0.06), unit="m2", across_m=7.0)
    assert advice(area) == "rely"
    assert "at most 20 mm" in told_rule(0.02)


def test_the_sheet_is_a_table_that_programs_read():
    sheet = panorama().decisions(0.001)
    rows = list(csv.DictReader(io.StringIO(sheet.to_csv())))
    assert tuple(rows[0]) == COLUMNS
    assert rows[0]["dimension"].startswith("room width, surfaces ")
    for row in rows:
        assert float(row["low_m"]) <= float(row["value_m"]) <= float(row["high_m"])
        assert row["advice"] == "check"  # none is known to a millimetre
    assert sheet.counts() == {"rely": 0, "check": len(rows), "do not build": 0}
    assert DecisionSheet((), 0.01).to_csv() == ",".join(COLUMNS) + "\n"


def test_of_a_mesh_no_interval_is_known_until_somebody_says_how_wrong_it_is():
    errors = replace(panorama().errors, is_known=False)
    building = parts_of(panorama())
    sheet = decision_sheet(replace(building, model=replace(building.model, errors=errors)))
    assert {one.high for one in sheet.dimensions} == {np.inf}
    assert min(one.low for one in sheet.dimensions) == 0
    assert sheet.counts()["rely"] == 0
    assert "--sigma M says it" in sheet.told_doubt
    assert panorama().decisions().told_doubt == ""


@pytest.mark.parametrize("wrong", [0.0, -1.0, float("nan"), float("inf")])
def test_a_tolerance_is_a_length(wrong):
    with pytest.raises(InputError, match="give a positive length"):
        panorama().decisions(wrong)


def test_an_opening_without_an_outline_has_no_size():
    outline = OpeningOutline(1, "window", np.zeros((0, 3)), (), width_m=1.0, height_m=1.0, seen_share=1.0)
    wall = SimpleNamespace(normal=np.array([1.0, 0.0, 0.0]))
    face = SimpleNamespace(element=wall, is_upright=True, openings=(outline,))
    building = SimpleNamespace(model=SimpleNamespace(errors=NO_ERRORS), faces=(face,))
    assert opening_sizes(building) == ()
