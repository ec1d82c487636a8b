# SPDX-License-Identifier: MIT
"""Files of boundaries: what they may say, and each fault in one line with its cure."""

import json

import numpy as np
import pytest

from completion import read_boundaries
from completion.fitting.patches.joins import JoinKind
from scenes.checks import InputError

FLOOR = {"shape": "plane", "parameters": {"point": [0, 0, 0], "normal": [0, 0, 2]}}
TUBE = {"shape": "cylinder", "point": [0, 0, 0], "direction": [0, 0, 1], "radius": 0.05}


def written(folder, held):
    file = folder / "between.json"
    file.write_text(held if isinstance(held, str) else json.dumps(held))
    return file


def test_surfaces_are_pasted_named_or_short(tmp_path) -> None:
    fit = {**FLOOR, "standard_deviation": {"offset": 1e-5, "normal": 2e-4}, "rms": 1e-4, "n": 300}
    (tmp_path / "floor.json").write_text(json.dumps(fit))
    sides = {
        "u0": {"surface": "floor.json", "join": "tangent"},
        "v1": {"surface": TUBE, "join": "orthogonal", "note": "the boss"},
        "u1": {"surface": FLOOR, "join": "connected"},
    }
    asked = read_boundaries(written(tmp_path, {**sides, "free": True, "controls": [9, 12], "note": "x"}))
    assert list(asked.boundaries) == ["u0", "u1", "v1"]
    assert asked.boundaries["u0"].join is JoinKind.TANGENT
    assert asked.boundaries["u0"].deviations == {"offset": 1e-5, "normal": 2e-4}
    assert asked.boundaries["u1"].surface.normal_direction == pytest.approx(np.array([0, 0, 1.0]))
    assert asked.boundaries["v1"].surface.radius == 0.05
    assert (asked.free, asked.controls, [file.name for file in asked.files]) == (
        True,
        (9, 12),
        ["floor.json"],
    )


def side(**changed):
    return {"u0": {"surface": FLOOR, "join": "tangent"} | changed}


FAULTS = [
    ({}, "names no boundary; write"),
    ({"w0": 1}, "knows u0, u1, v0, v1, free, controls, note, not 'w0'"),
    ("[1]", "is JSON, but not an object"),
    ({"u0": 3}, 'u0: needs a "surface" and a "join" alone'),
    (side(kind="x"), 'u0: needs a "surface" and a "join" alone'),
    (side(join="smooth"), '"join" is one of connected, tangent, orthogonal, got \'smooth\''),
    (side(surface=3), 'u0: "surface" must be the output of `unseen fit`'),
    (side(surface={"shape": "sphere"}), "needs a \"shape\" of plane or cylinder, got 'sphere'"),
    (side(surface={"shape": "plane", "parameters": []}), '"parameters" are an object'),
    (side(surface={"shape": "plane", "point": [0, 0, 0]}), "needs point, normal; 'normal' is missing"),
    (side(surface={"shape": "plane", "point": [0, 0], "normal": [0, 0, 1]}), '"point" is three numbers'),
    (side(surface={**TUBE, "radius": "5"}), '"radius" is a number'),
    (side(surface={**TUBE, "radius": -1}), "radius must be a positive number"),
    (side(surface={"shape": "plane", "point": [0, 0, 0], "normal": [0, 0, 0]}), "normal has length 0"),
    (side(surface={**FLOOR, "standard_deviation": {"offset": "x"}}), '"standard_deviation" holds numbers'),
    (side(surface="gone.json"), "its surface gone.json: .*no such file"),
    (side(surface="../gone.json"), "leads out of the folder"),
    ({**side(), "free": 1}, '"free" is true or false'),
    ({**side(), "controls": [10]}, '"controls" are two whole numbers'),
    ({**side(), "v0": {"surface": {**FLOOR, "parameters": {"point": [0, 0, 0], "normal": [1, 0, 0]}},
                       "join": "tangent"}}, "exclude each other at their corner"),
]  # fmt: skip


@pytest.mark.parametrize(("held", "text"), FAULTS)
def test_faults_name_the_file_and_the_cure(tmp_path, held, text) -> None:
    file = written(tmp_path, held)
    with pytest.raises(InputError, match=text) as refusal:
        read_boundaries(file)
    assert str(refusal.value).startswith(str(file))
