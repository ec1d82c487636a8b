# SPDX-License-Identifier: MIT
"""check.json and elements.csv: names that others rely on, no number where there is none, the same numbers."""

import csv
import io
import json
from dataclasses import replace

import pytest

from completion.asbuilt.findings import VERDICTS, Interval
from nbv.inspection.record import check_record, elements_csv
from scenes.mesh.design import Element
from tests.nbv.inspection.checks import example_check


def test_the_record_has_the_promised_names_and_is_strict_json():
    record = json.loads(json.dumps(check_record(example_check()), allow_nan=False))
    assert record["format"] == "unseen-check/1"
    assert {"shift_m", "turn_deg", "sd_m", "tau_m"} < set(record["alignment"])
    assert record["loa_bands_m"]["LOA50"] == 0.001
    assert (record["faces_tested"], record["z"], record["false_alarms_expected"]) == (247, 3.71, 0.05)
    wall = record["elements"][1]
    expected = {
        "global_id": f"0{1:021d}", "class": "IfcWall", "name": "wall south", "storey": "Ground",
        "verdict": "deviates", "kind": "offset", "tolerance_m": 0.01, "directions_measured": [[0, 1, 0]],
        "offset_m": {"value": -0.0199, "low": -0.0212, "high": -0.0186, "along": [0, 1, 0]},
        "bow": None, "loa": {"represented": "LOA20", "measured": "LOA40"},
        "share": {"measured": 0.61, "inferred": 0.22, "unknown": 0.17}, "hidden": [],
        "not_seen": {"out_of_range": 0.1, "hidden": 0.29},
    }  # fmt: skip
    assert {name: wall[name] for name in expected} == expected
    assert sum(wall["faces"][0]["histogram"]["beams"]) == 900
    assert record["elements"][3]["hidden"][0] == {"by": "extra-1", "stations": ["s1", "s2"], "area_m2": 5.2}
    assert record["elements"][3]["faces"][0]["histogram"] is None
    assert record["elements"][3]["inference"]["probability"] == 0.83
    assert record["extra"][0]["id"] == "extra-1"
    assert list(record["verdicts"]) == list(VERDICTS)
    assert sum(record["verdicts"].values()) == 6


def test_numbers_that_are_none_are_null():
    check = example_check()
    nothing = float("nan")
    offset = Interval(nothing, -float("inf"), nothing)
    first = replace(check.elements[0], exposed_m2=nothing, offset=offset)
    record = check_record(replace(check, elements=(first,), z=nothing))
    json.dumps(record, allow_nan=False)
    assert record["z"] is record["elements"][0]["exposed_m2"] is None
    assert record["elements"][0]["offset_m"] == {"value": None, "low": None, "high": None}


def test_the_table_has_a_row_an_element_and_the_numbers_of_the_record():
    check = example_check()
    first = replace(check.elements[0], element=Element("=1+1", "IfcSlab"))
    check = replace(check, elements=(first, *check.elements[1:]))
    rows = list(csv.DictReader(io.StringIO(elements_csv(check))))
    held = check_record(check)["elements"]
    assert [row["verdict"] for row in rows] == [one["verdict"] for one in held]
    assert rows[0]["name"] == "'=1+1"
    assert float(rows[1]["offset_low_m"]) == held[1]["offset_m"]["low"]
    assert float(rows[1]["thickness_high_m"]) == held[1]["thickness"]["high"]
    assert float(rows[1]["tilt_rad"]) == held[1]["tilt"]["value"]
    assert rows[1]["bow_m"] == rows[3]["offset_m"] == rows[3]["offset_along_x"] == ""
    assert (rows[3]["hidden_by"], rows[3]["hidden_from"]) == ("extra-1; column", "s1; s2")
    assert float(rows[5]["not_seen_out_of_range"]) == 1
    assert elements_csv(replace(check, elements=())) == "surface\n"


@pytest.mark.parametrize("origin", [(0, 0, 0), (5e5, 5.6e6, 100)])
def test_the_same_check_gives_the_same_record(origin):
    assert check_record(example_check(origin)) == check_record(example_check(origin))
