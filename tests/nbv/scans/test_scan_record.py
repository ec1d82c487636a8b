# SPDX-License-Identifier: MIT
"""Scan record: what an earlier plan said of scans, and what they brought."""

import json
from types import SimpleNamespace

import numpy as np
import pytest

from nbv.scans.measured_area import MeasuredArea
from nbv.scans.scan_record import last_scan_in_words, read_predictions, record_scans
from scenes.checks import InputError
from scenes.pose import Pose


def at(x, y=0.0):
    place = np.array([x, y, 1.6])
    return Pose.looking_at(place, place + [1.0, 0.0, 0.0])


def plan_file(tmp_path, **more):
    content = {
        "resumed_from": {"world_from_sensor": [at(0).matrix.tolist(), at(1).matrix.tolist()]},
        "record": [
            {"said": None},
            {"said": {"station": 2, "off_m": 0.25, "predicted_gain_m2": 7.5}},
        ],
        "views": [
            {"world_from_sensor": at(5).matrix.tolist(), "predicted_gain_m2": 11.0},
            {"world_from_sensor": at(8).matrix.tolist(), "predicted_gain_m2": None},
        ],
    }
    file = tmp_path / "plan.json"
    file.write_text(json.dumps({**content, **more}))
    return file


def test_scans_that_were_known_keep_what_was_said_and_others_are_the_nearest_station(tmp_path):
    predictions = read_predictions(plan_file(tmp_path), [at(0), at(1), at(5.3), at(20), at(8.0, 0.4)])
    assert [None if one is None else one.station for one in predictions] == [None, 2, 1, None, 2]
    assert predictions[1].off_m == 0.25
    assert predictions[2].off_m == pytest.approx(0.3)
    assert predictions[2].predicted_gain_m2 == 11.0
    assert predictions[4].predicted_gain_m2 is None


def test_a_station_is_given_to_one_scan_alone(tmp_path):
    predictions = read_predictions(plan_file(tmp_path), [at(0), at(5.1), at(5.2)])
    assert [None if one is None else one.station for one in predictions] == [None, 1, None]


def test_what_is_no_earlier_plan_is_refused(tmp_path):
    with pytest.raises(InputError, match="was made after other scans than these"):
        read_predictions(plan_file(tmp_path), [at(3)])
    with pytest.raises(InputError, match="is not a plan of next stations: its record has 1 scans"):
        read_predictions(plan_file(tmp_path, record=[{"said": None}]), [at(0)])
    for wrong in ({"resumed_from": None}, {"views": [{}]}, {"views": 3}, {"record": [1, 2]}):
        with pytest.raises(InputError, match=r"is not a plan of next stations.*give the plan\.json"):
            read_predictions(plan_file(tmp_path, **wrong), [at(0)])


def test_what_each_scan_brought_is_what_it_added():
    gains = (None, SimpleNamespace(expected_m2=12.0, settled_m2=9.0))
    scans = [SimpleNamespace(world_from_sensor=at(x)) for x in (0, 1)]
    coverage = SimpleNamespace(
        scan_map=SimpleNamespace(scans=scans, gains=gains),
        growth=(MeasuredArea(10.0, 5.0), MeasuredArea(18.0, 4.0)),
    )
    first, second = record_scans(coverage)
    assert (first.measured_m2, first.met_m2, first.expected_m2) == (15.0, 10.0, None)
    assert (second.measured_m2, second.met_m2) == (7.0, 8.0)
    assert "achieved 9.0" in last_scan_in_words([first, second])[0]
    assert last_scan_in_words([first]) == []
