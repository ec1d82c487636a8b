# SPDX-License-Identifier: MIT
"""Summaries pool areas before they divide, their intervals hold, and completions become hypotheses."""

import json

import numpy as np
import pytest

from benchmarks.cases.rooms import Case, hypothesis_of
from benchmarks.metrics.bootstrap import difference_interval, interval, quantiles
from benchmarks.metrics.completion import score
from benchmarks.metrics.inferred import Tally, total
from benchmarks.store import Store
from benchmarks.suites.completion import evaluate, mode_methods, tasks_of
from benchmarks.suites.summary import (
    confidence_table,
    figures_table,
    headline,
    outside_table,
    reasons_table,
    strata_table,
    summarise,
)
from completion import CompletionOptions, complete
from nbv.scanning.effects import NO_EFFECTS
from nbv.scanning.sensor import PinholeSensor, View
from scenes.checks import InputError
from scenes.world.builtin import builtin_scene
from tests.helpers.completion_examples import VIEWS
from tests.helpers.evaluation_examples import plain_wall

SENSOR = PinholeSensor(fov_deg=65, width=120, height=100)


def chair_case(breaks: bool = False) -> Case:
    view = View(VIEWS["chair_before_wall"], SENSOR)
    boxes = np.array([[[-1.0, 1.1, 0.0], [1.0, 1.3, 1.0]]] if breaks else np.zeros((0, 2, 3)))
    return Case("chair", builtin_scene("chair_before_wall"), (view,), boxes)


def tally(hidden: float, found: float, claimed: float, right: float) -> Tally:
    return Tally(np.array(hidden), np.full(3, found), np.array(claimed), np.full(3, right))


def test_figures_are_of_pooled_areas() -> None:
    pooled = total([tally(1.0, 0.5, 1.0, 1.0), tally(3.0, 3.0, 4.0, 3.0)])
    assert pooled.recall.tolist() == [3.5 / 4] * 3
    assert pooled.precision.tolist() == [4 / 5] * 3
    assert pooled.iou.tolist() == pytest.approx([3.5 / 5] * 3)
    assert pooled.f1.tolist() == pytest.approx([2 * 0.875 * 0.8 / 1.675] * 3)
    assert np.isnan(total([]).iou).all()
    # Where found and right area agree, 1 / IoU = 1 / R + 1 / P - 1, as in the published table.
    same = tally(2.0, 1.5, 1.8, 1.5)
    assert 1 / same.iou[0] == pytest.approx(1 / same.recall[0] + 1 / same.precision[0] - 1)


def test_intervals_hold_the_figure_and_shrink_with_cases() -> None:
    rng = np.random.default_rng(0)
    cases = [tally(1.0, found, 1.0, found) for found in rng.uniform(0.5, 0.9, 400)]
    recall = headline("recall")
    few, many = interval(cases[:10], recall), interval(cases, recall)
    assert few[0] is not None and few[1] is not None and many[0] is not None and many[1] is not None  # noqa: PT018
    assert few[0] < 0.7 < few[1]
    # Uniform on 0.4: sd 0.4 / sqrt(12); of a mean of n over sqrt(n), times 2 * 1.96.
    assert many[1] - many[0] == pytest.approx(3.92 * 0.4 / np.sqrt(12 * 400), rel=0.15)
    assert interval([], recall) == [None, None]
    assert quantiles(np.full(3, np.nan)) == [None, None]


def test_differences_are_of_the_same_cases() -> None:
    rng = np.random.default_rng(1)
    found = rng.uniform(0.2, 0.8, 30)
    ours = [tally(1.0, value + 0.1, 1.0, value + 0.1) for value in found]
    others = [tally(1.0, value, 1.0, value) for value in found]
    low, high = difference_interval(ours, others, headline("recall"))
    assert (low, high) == pytest.approx((0.1, 0.1))  # however much the cases differ among themselves
    assert difference_interval([], [], headline("recall")) == [None, None]
    with pytest.raises(InputError, match="of the same cases: got 30 and 29"):
        difference_interval(ours, others[1:], headline("recall"))


@pytest.mark.long
def test_a_completion_becomes_a_hypothesis_in_the_world() -> None:
    case = chair_case()
    scans = case.scans(NO_EFFECTS, 0)
    completed = complete(scans, CompletionOptions(texture=False))
    found = hypothesis_of(completed, scans)
    assert found.vertices == pytest.approx(
        completed.world_from_reference.apply(completed.hypothesised.vertices)
    )
    assert ((found.confidence >= 0.3) & (found.confidence <= 1)).all()  # 0.5 at the centres of cells
    names = [case.scene.surface_names[k] for k in found.true_surface]
    assert names[:2] == ["wall", "floor"] or names[:2] == ["floor", "wall"]
    result = score(case.model, case.cells(scans), scans, found)
    wall = result.areas.pooled([case.scene.surface_names.index("wall")])
    assert wall.iou[1] > 0.9


def test_scores_do_not_depend_on_threads() -> None:
    wall = plain_wall()
    one, two = (
        score(wall.model, wall.cells, [wall.scan], wall.rectangle(offset=0.01), n_threads=n) for n in (1, 2)
    )
    for name in ("hidden", "found", "claimed", "right"):
        assert getattr(one.areas, name).tobytes() == getattr(two.areas, name).tobytes()


@pytest.mark.long
def test_rooms_that_break_the_prior_are_summarised_apart() -> None:
    cases = [chair_case(), chair_case(breaks=True)]
    tasks = tasks_of(cases, "none", mode_methods(["standard"]), 0)
    outcomes = list(evaluate(tasks, Store()))
    record = summarise(outcomes)
    json.dumps(record, allow_nan=False)
    rows = record["rows"]
    assert (record["n_cases"], record["n_breaking"]) == (2, 1)
    assert rows["S7 breaks the prior"]["hidden_m2"] == pytest.approx(rows["whole, without S7"]["hidden_m2"])
    inside = rows["S7 where it breaks"]
    assert 0 < inside["hidden_m2"] < rows["S7 breaks the prior"]["hidden_m2"]
    assert record["confidence_where_it_breaks"]["calibration_error"] is not None
    assert record["violation_audited_ppm"] == 0
    assert (
        record["confidence"]["calibration_error_interval"]
        == [pytest.approx(record["confidence"]["calibration_error"])] * 2
    )  # both cases are the same
    assert sum(row["claimed_m2"] for row in record["reasons"].values()) == pytest.approx(
        2 * rows["S7 breaks the prior"]["claimed_m2"]
    )
    assert "| interior |" in reasons_table(record["reasons"])
    assert "Calibration error" in confidence_table(record["confidence"])
    text = "\n".join([strata_table(record), figures_table({"a": record}), outside_table({"a": record})])
    assert "| S7 where it breaks |" in text
    assert "| S5 out of frame |" in text
    assert all(len({row.count("|") for row in part.splitlines()}) == 1 for part in (strata_table(record),))
