# SPDX-License-Identifier: MIT
"""Changes between two checks: verdicts, offsets beyond both intervals, what comes and goes."""

import copy
from dataclasses import replace

import numpy as np
import pytest

from completion.asbuilt.findings import Extra, Interval
from nbv.inspection.changes import changes_since
from nbv.inspection.record import check_record
from scenes.checks import InputError
from scenes.mesh.design import Element
from tests.nbv.inspection.checks import example_check

CHECK = example_check()
BEFORE = check_record(CHECK)


def changed(k, **values):
    """The check with other findings on element `k`."""
    elements = list(CHECK.elements)
    elements[k] = replace(elements[k], **values)
    return replace(CHECK, elements=tuple(elements))


def test_the_same_check_has_not_changed():
    assert changes_since(BEFORE, CHECK) == []


@pytest.mark.parametrize(
    ("k", "verdict", "part"),
    [
        (0, "deviates", "IfcSlab floor: within before, deviates now."),
        (3, "within", "measured for the first time, hidden before, within now"),
        (1, "hidden", "not measured any more, deviates before, hidden now"),
        (4, "within", "missing before, within now"),
    ],
)
def test_verdicts_that_changed_are_told(k, verdict, part):
    (change,) = changes_since(BEFORE, changed(k, verdict=verdict, offset=None))
    assert (change.before, change.now, change.surface) == (CHECK.elements[k].verdict, verdict, k)
    assert change.difference is None
    assert part in change.sentence


@pytest.mark.parametrize(
    ("low_mm", "along", "is_change"),
    [
        (-18.59, (0, 1, 0), True),  # just above the highest before, -18.6 mm
        (-18.61, (0, 1, 0), False),
        (18.59 - 2.6, (0, -1, 0), True),  # the same the other way round
        (18.61 - 2.6, (0, -1, 0), False),
        (0.0, (1, 0, 0), False),  # of another direction: nothing to compare
    ],
)
def test_offsets_changed_where_their_intervals_have_nothing_in_common(low_mm, along, is_change):
    low = low_mm / 1000
    offset = Interval(low + 0.0013, low, low + 0.0026, along)
    found = changes_since(BEFORE, changed(1, offset=offset))
    assert len(found) == is_change
    for change in found:
        assert change.now == change.before == "deviates"
        assert "its offset changed by" in change.sentence
        sign = along[1]
        assert sign * change.difference.value == pytest.approx(low * sign + 0.0013 * sign + 0.0199)
        assert not change.difference.low <= 0 <= change.difference.high


def test_what_is_not_known_has_not_changed():
    unknown = Interval(float("nan"), -0.01, float("nan"), (0, 1, 0))
    assert changes_since(BEFORE, changed(1, offset=unknown)) == []
    assert changes_since(check_record(changed(1, offset=unknown)), CHECK) == []


def test_elements_are_found_again_by_their_global_id_or_their_order():
    named = changed(1, element=Element("renamed", "IfcWall", CHECK.elements[1].element.global_id))
    assert changes_since(BEFORE, named) == []
    bare = tuple(
        replace(one, element=Element("wall", "IfcWall"), verdict="within" if k == 2 else one.verdict)
        for k, one in enumerate(CHECK.elements)
    )
    before = copy.deepcopy(BEFORE)
    for held in before["elements"]:
        held |= {"global_id": "", "name": "wall", "class": "IfcWall"}
    (change,) = changes_since(before, replace(CHECK, elements=bare))
    assert (change.surface, change.before, change.now) == (2, "undecided", "within")


def test_elements_that_come_and_go_are_told():
    fewer = replace(CHECK, elements=CHECK.elements[1:])
    (gone,) = changes_since(BEFORE, fewer)
    assert (gone.element, gone.before, gone.now, gone.surface) == ("IfcSlab floor", "within", "", -1)
    (new,) = changes_since(check_record(fewer), CHECK)
    assert (new.before, new.now, new.surface) == ("", "within", 0)


def test_extras_are_the_same_where_their_boxes_overlap():
    crate, leaf = CHECK.extra
    grown = Extra("extra-7", crate.box_m + np.array([[-0.2], [0.1]]), 8.0, crate.points)
    moved = Extra("extra-8", leaf.box_m + 1.0, 1.8, leaf.points, near="floor")
    new, gone = changes_since(BEFORE, replace(CHECK, extra=(grown, moved)))
    assert (new.element, new.before, new.now) == ("extra-8", "", "extra")
    assert new.sentence == "extra-8 is new: 1.80 m2 of no element, near floor."
    assert (gone.element, gone.before, gone.now) == ("extra-2", "extra", "")
    assert [one.element for one in changes_since(BEFORE, replace(CHECK, extra=()))] == ["extra-1", "extra-2"]


@pytest.mark.parametrize(
    ("damage", "part"),
    [
        ({"format": "unseen-plan/1"}, "is no check of a design: its format is 'unseen-plan/1'"),
        ({"elements": None}, "is a damaged check: TypeError"),
        ({"elements": [{"verdict": "within"}]}, "is a damaged check: KeyError at 'global_id'"),
        ({"extra": [{"box_m": [1, 2]}]}, "is a damaged check"),
    ],
)
def test_what_is_no_check_is_refused_in_one_line(damage, part):
    with pytest.raises(InputError, match=part) as caught:
        changes_since({**BEFORE, **damage}, CHECK)
    assert "\n" not in str(caught.value)


def test_a_check_of_another_design_is_refused():
    check = example_check()
    held = check_record(check)
    others = [{**one, "global_id": f"9{k}", "name": f"other {k}"} for k, one in enumerate(held["elements"])]
    with pytest.raises(InputError, match="is of another design"):
        changes_since({**held, "elements": others}, check)
