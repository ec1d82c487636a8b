# SPDX-License-Identifier: MIT
"""`unseen complete` with a person's say, and with the limits that it takes."""

import json

import pytest
from typer.testing import CliRunner

from nbv.cli import app
from nbv.report.blocks.page import Page
from scenes.io.scan_files import write_scan
from tests.helpers.completion_examples import example


@pytest.fixture(autouse=True, scope="module")
def _without_pictures():
    """Reports take longer than all the rest; what they say of edits is tested where it is written."""
    with pytest.MonkeyPatch.context() as patch:
        page = Page("", "", "", (), None, (), {}, 0)
        patch.setattr("nbv.report.completion_report.completion_page", lambda *_, **__: page)
        yield


def run(*arguments):
    return CliRunner().invoke(app, ["complete", *(str(argument) for argument in arguments), "--no-texture"])


@pytest.fixture(scope="module")
def scan(tmp_path_factory):
    file = tmp_path_factory.mktemp("scan") / "room.npz"
    write_scan(example("two_occluders", pixels=72), file)
    return file


@pytest.fixture(scope="module")
def first(scan, tmp_path_factory):
    """The first run, from which the file of edits is made."""
    out = tmp_path_factory.mktemp("first")
    assert run(scan, "-o", out, "--quiet").exit_code == 0
    return out


def test_a_person_adds_edits_to_completion_json_and_runs_again(scan, first, tmp_path):
    held = json.loads((first / "completion.json").read_text())
    held["edits"] = [{"do": "reject", "surface": 1}, {"do": "accept", "surface": 4}]
    file = tmp_path / "say.json"
    file.write_text(json.dumps(held))
    result = run(scan, "--edits", file, "-o", tmp_path / "again", "--json")
    assert result.exit_code == 0, result.stderr
    assert json.loads(result.stdout)["edits"] == 2
    again = json.loads((tmp_path / "again" / "completion.json").read_text())
    assert again["surfaces"][0]["user"]["actions"] == ["reject"]
    assert again["surfaces"][0]["hypothesised_m2"] == 0 < held["surfaces"][0]["hypothesised_m2"]
    assert again["surfaces"][3]["hypothesised_m2"] >= held["surfaces"][3]["hypothesised_m2"]
    manifest = json.loads((tmp_path / "again" / "manifest.json").read_text())
    assert manifest["options"]["edits"] == "say.json"
    assert len(manifest["inputs"]) == 2
    words = run(scan, "--edits", file, "-o", tmp_path / "again").stdout
    assert "edits     2, by which" in words


def test_edits_of_another_place_are_refused_in_one_line(scan, first, tmp_path):
    held = json.loads((first / "completion.json").read_text())
    held["surfaces"][2]["anchor"] = [40.0, 2.0, 1.0]
    held["edits"] = [{"do": "reject", "surface": 3}]
    file = tmp_path / "say.json"
    file.write_text(json.dumps(held))
    result = run(scan, "--edits", file, "-o", tmp_path / "out")
    assert (result.exit_code, result.stdout) == (1, "")
    assert len(result.stderr.strip().splitlines()) == 1
    for words in ("say.json: edit 1 (reject)", "surface 3 should be at (40.000", "meant for other scans"):
        assert words in result.stderr
    missing = run(scan, "--edits", tmp_path / "none.json", "-o", tmp_path / "out")
    assert missing.exit_code == 1
    assert "none.json: no such file" in missing.stderr


@pytest.mark.long
def test_what_is_not_known_well_enough_is_not_continued(tmp_path):
    noisy = tmp_path / "noisy.npz"
    write_scan(example("two_occluders", "gaussian-2mm", pixels=72), noisy)
    inferred = [
        json.loads(run(noisy, "--max-sd", metres, "-o", tmp_path, "--json").stdout)["hypothesised_m2"]
        for metres in (0.02, 1e-6)
    ]
    assert inferred[0] > 1 > inferred[1] == 0
    assert run(noisy, "--max-sd", -1, "-o", tmp_path).exit_code == 2
