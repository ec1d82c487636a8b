# SPDX-License-Identifier: MIT
"""`unseen feature`: its files, what is given, failures in one line, and what completion makes of it."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from benchmarks.cases.walls import opening_case
from nbv.cli import app
from scenes.io.clouds.npz import write_npz
from scenes.io.point_files import read_points
from tests.completion.features.solids.solid_points import stairs_points

CASE = opening_case(102, "doorway", 0.3)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("feature")
    write_npz(CASE.scan.thin(100_000), made / "wall.npz")
    rng = np.random.default_rng(0)
    np.savetxt(made / "flat.xyz", np.column_stack([rng.uniform(0, 1, (400, 2)), rng.normal(0, 1e-3, 400)]))
    result = run("feature", made / "wall.npz", "--find", "doorway", "--json", "-o", made / "out")
    assert result.exit_code == 0, result.output
    (made / "told.json").write_text(result.stdout)
    return made


def run(*words):
    return CliRunner().invoke(app, [str(word) for word in words])


def test_files_hold_the_doorway_and_every_point(folder) -> None:
    held = json.loads((folder / "out" / "features.json").read_text())
    door = held["features"][0]
    assert (door["kind"], door["status"], held["complete"]) == ("doorway", "found", True)
    assert np.shape(door["corners"]) == (4, 3)
    assert door["sides"]["right"]["seen"] != ("right" in door["unseen"])
    hole = CASE.hole
    assert np.array(door["corners"])[:, 2].max() == pytest.approx(hole[3], abs=0.01)
    told = json.loads((folder / "told.json").read_text())
    assert told["found"] == 1
    cloud = read_points(folder / "out" / "features.ply")
    assert len(cloud.points) == CASE.scan.thin(100_000).valid.sum()
    header = (folder / "out" / "features.ply").read_bytes()[:600].decode("ascii", "replace")
    assert "property int feature" in header
    assert "property int face" in header
    assert "confirmed" in (folder / "out" / "report.html").read_text()


@pytest.mark.long
def test_completion_uses_what_a_file_found_and_nothing_else(folder) -> None:
    found = folder / "out" / "features.json"
    words = ("complete", folder / "wall.npz", "--no-texture", "--quiet", "--features")
    counts = {}
    for name, said in (("file", found), ("off", "off")):
        result = run(*words, said, "-o", folder / name)
        assert result.exit_code == 0, result.output
        record = json.loads((folder / name / "completion.json").read_text())
        numbers = [one["feature"] for surface in record["surfaces"] for one in surface["openings"]]
        counts[name] = (len(record["features"]), numbers.count(1))
    assert counts == {"file": (1, 1), "off": (0, 0)}


def test_features_that_are_none_are_refused_before_the_work(folder, tmp_path) -> None:
    good = json.loads((folder / "out" / "features.json").read_text())
    for change, text in (
        ({"corners": [[0, 0, 0]] * 4}, "two corners lie at one place"),
        ({"corners": [[0, 0, 0]]}, "corners must be four points, got 1"),
        ({"evidence": "much"}, "evidence must be a number or null"),
        ({"sides": {}}, "has no sides left, right, bottom, top"),
        ({"corners": [[x, 0, z] for x, z in ((90, 0), (91, 0), (91, 2), (90, 2))]}, "lies in no wall"),
    ):
        bad = tmp_path / "bad.json"
        bad.write_text(json.dumps({"features": [{**good["features"][0], **change}]}))
        result = run("complete", folder / "wall.npz", "--no-texture", "--features", bad, "-o", tmp_path / "o")
        assert result.exit_code == 1, result.output
        assert text in result.output


def test_what_is_known_is_held(folder) -> None:
    (folder / "known.json").write_text(json.dumps({"doorway": {"width": 1.032}}))
    words = ("feature", folder / "wall.npz", "--find", "doorway", "--given", folder / "known.json")
    result = run(*words, "--json", "-o", folder / "held")
    door = json.loads(result.stdout)["features"][0]
    assert door["held"] == ["width"]
    assert door["standard_deviation"]["width"] == 0


def test_failures_are_one_line_that_names_file_cause_and_cure(folder, tmp_path) -> None:
    (tmp_path / "bad.json").write_text('{"doorway": {"colour": 3}}')
    (tmp_path / "none.json").write_text('{"width": -1}')
    (tmp_path / "half.json").write_text('{"hole-row": {"count": 2.5}}')
    (tmp_path / "empty.xyz").write_text("")
    np.savetxt(tmp_path / "same.xyz", np.ones((60, 3)))
    wall, flat = folder / "wall.npz", folder / "flat.xyz"
    for words, code, text in (
        ((wall, "--find", "gate"), 2, "'gate' is none of doorway, window"),
        (
            (wall, "--find", "doorway", "--given", tmp_path / "bad.json"),
            1,
            "colour cannot be given; of doorway",
        ),
        ((wall, "--find", "doorway", "--given", tmp_path / "none.json"), 1, "width must be a number above 0"),
        ((wall, "--find", "doorway", "--given", tmp_path / "no.json"), 1, "no.json"),
        ((flat, "--find", "doorway"), 1, "--origin"),
        ((tmp_path / "empty.xyz", "--find", "hole-row"), 1, "empty.xyz"),
        ((tmp_path / "same.xyz", "--find", "hole-row"), 1, "all 60 points lie at one place"),
        ((flat, "--find", "hole-row", "--given", tmp_path / "half.json"), 1, "whole number from 2 to 1000"),
        ((tmp_path / "none.ply", "--find", "hole-row"), 1, "none.ply"),
        ((wall, "--find", "doorway", "--evaluations", "0"), 2, "--evaluations"),
    ):
        result = run("feature", *words, "-o", tmp_path / "out")
        assert result.exit_code == code, result.output
        assert text in " ".join(result.output.replace("│", " ").split()), result.output
        assert not (tmp_path / "out" / "features.json").exists()


def test_a_plane_has_no_holes(folder) -> None:
    result = run("feature", folder / "flat.xyz", "--find", "hole-row", "--json", "-o", folder / "none")
    assert result.exit_code == 0, result.output
    told = json.loads(result.stdout)
    assert told["found"] == 0
    assert told["features"][0]["reason"]


def test_the_up_axis_of_points_is_used(tmp_path) -> None:
    points = stairs_points(np.random.default_rng(1))
    np.savetxt(tmp_path / "stairs.xyz", points[:, [0, 2, 1]] * [1.0, 1.0, -1.0])
    counts = {}
    for up in ("y", "z"):
        words = ("feature", tmp_path / "stairs.xyz", "--find", "stairs", "--up", up, "--json")
        result = run(*words, "-o", tmp_path / up)
        assert result.exit_code == 0, result.output
        flights = json.loads(result.stdout)["features"]
        counts[up] = [flight["count"] for flight in flights if flight["status"] == "found"]
    assert counts["y"] == [6]
    assert counts["z"] != [6]
