# SPDX-License-Identifier: MIT
"""Summaries answer the first question: what is unknown, what can be relied on, how far poses may be off."""

import json
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh
from typer.testing import CliRunner

from completion.export.decisions import DecisionSheet, advice
from completion.export.dimension import Dimension, Support
from nbv.cli import app
from nbv.commands.complete import lines_of_decisions
from nbv.run.wording import square_metres

ROOM = "builtin:two_occluders"


def run(*words):
    result = CliRunner().invoke(app, [str(word) for word in words])
    assert result.exit_code == 0, result.output
    return result.stdout


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Two noisy scans of a room from places beside each other."""
    folder = tmp_path_factory.mktemp("summaries")
    (folder / "small.toml").write_text('kind = "pinhole"\nfov_deg = 75.0\nwidth = 120\nheight = 120\n')
    for number, at in enumerate(("1,1,1.6", "1.4,0.9,1.5")):
        words = ("--sensor", folder / "small.toml", "--noise", "gaussian-2mm", "--seed", number)
        run("scan", ROOM, *words, "--at", at, "--look", "3.2,3,1", "-o", folder / f"{number}.npz", "-q")
    return folder


def completed(folder, *words):
    done = ("--texture", "off", "-o", folder / "done")
    return run("complete", folder / "0.npz", *done, *words)


def test_complete_tells_measured_inferred_and_unknown_area(folder):
    told, held = completed(folder), json.loads(completed(folder, "--json"))
    assert held["unknown_m2"] > 0
    for word, name in (
        ("measured", "observed_m2"),
        ("inferred", "hypothesised_m2"),
        ("unknown", "unknown_m2"),
    ):
        assert re.search(rf"^{word} +{square_metres(held[name])} m2 ", told, re.MULTILINE), told
    bold = json.loads(completed(folder, "--json", "--inference", "bold"))
    assert bold["hypothesised_m2"] > held["hypothesised_m2"]
    assert bold["unknown_m2"] < held["unknown_m2"]


def test_complete_tells_the_tolerance_that_would_be_kept(folder):
    strict = completed(folder, "--rely", "1e-5")
    needed = re.search(r"rely on (\d+) more with a wider tolerance: --rely (\S+) for the nearest", strict)
    assert needed, strict
    assert ": rely 0, " in strict
    assert int(re.search(r": rely (\d+), ", completed(folder, "--rely", needed[2]))[1]) >= 1


def length(half, *, share=1.0, existence=1.0, surfaces=(1, 2)):
    supports = tuple(Support(SimpleNamespace(number=number), np.zeros(3)) for number in surfaces)
    return Dimension(
        kind="room height", value=3.0, low=3.0 - half, high=3.0 + half, supports=supports,
        ends=np.zeros((2, 3)), measured_share=share, existence=existence,
    )  # fmt: skip


def test_what_would_make_dimensions_ones_to_rely_on():
    hidden, absent = length(0.001, share=0.4, surfaces=(7, 3)), length(0.001, existence=0.5, surfaces=(9, 2))
    loose = [length(0.0231), length(0.0304)]
    lines = lines_of_decisions(DecisionSheet((length(0.001), hidden, absent, *loose), 0.01))
    assert [line.strip() for line in lines[1:]] == [
        "rely on 2 more with a wider tolerance: --rely 0.024 for the nearest",
        "rely on 1 more once half of each is measured: scan surfaces 3, 7",
        "rely on 1 more once their ends are seen: scan surfaces 2, 9",
    ]
    assert advice(loose[0], 0.024) == "rely"
    area = replace(length(0.24), unit="m2", across_m=7.0)
    assert "--rely 0.035 " in lines_of_decisions(DecisionSheet((area,), 0.01))[1]
    unknown = replace(loose[0], low=-np.inf, high=np.inf)
    assert len(lines_of_decisions(DecisionSheet((unknown,), 0.01))) == 1
    assert len(lines_of_decisions(DecisionSheet((length(0.001),), 0.01))) == 1


def test_register_tells_the_largest_deviation_and_contradiction(folder):
    scans = (folder / "0.npz", folder / "1.npz", "-o", folder / "registered")
    told, held = run("register", *scans), json.loads(run("register", *scans, "--json"))
    assert held["groups"] == [[0, 1]]
    found = re.search(r"deviation  standard deviation of a pose: (\S+) mm at most \(1.npz\), (\S+) deg", told)
    assert float(found[1]) == pytest.approx(1000 * held["largest_deviation_m"], rel=0.05)
    assert 0 < held["largest_deviation_m"] < 0.05
    worst = re.search(r"worst +0.npz and 1.npz: (\S+) % contradicted", told)
    assert float(worst[1]) == pytest.approx(100 * held["most_contradicted"], abs=0.051)


def test_part_tells_its_dimensions_by_kind(tmp_path):
    trimesh.creation.annulus(0.01, 0.03, 0.02, sections=128).export(tmp_path / "ring.stl")
    told = run("part", tmp_path / "ring.stl", "-o", tmp_path / "out")
    assert "60.000 mm x 60.000 mm x 20.000 mm" in told
    assert re.search(r"^dimensions 1 outer diameter, 1 hole diameter; least certain: ", told, re.MULTILINE)


@pytest.mark.long
def test_plan_tells_the_knees_of_its_curve(folder):
    sensor = ("--sensor", folder / "small.toml")
    told = run(
        "plan", ROOM, *sensor, "--method", "cover", "--views", 3, "--polish-steps", 100, "-o", folder / "plan"
    )
    assert re.search(r"^\d views? reach(es)? \d+ %, all 3 reach \d+ % of the area: ", told, re.MULTILINE)
