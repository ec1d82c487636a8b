# SPDX-License-Identifier: MIT
"""Command line with scans: plans resumed from them, next stations and coverage without a scene, zones."""

import csv
import json
from dataclasses import replace

import numpy as np
import pytest

from nbv.plan.plan import read_plan
from scenes.io.meshes.ply import read_mesh_ply
from scenes.io.scan_files import read_scan
from scenes.io.scan_request import ScanRequest, read_request
from tests.helpers.long_cases import first_in_gate
from tests.nbv.commands.test_cli import assert_fails_in_one_line, contents, run, succeed

ROOM = "builtin:two_occluders"
SMALL = 'kind = "pinhole"\nname = "small"\nfov_deg = 70.0\nwidth = 120\nheight = 120\n'
AT = (("0.6,0.6,1.6", "5,4,0.8"), ("5.2,0.8,1.6", "1,4,0.6"))
WEST, EAST = "0,0,0,3,5,2.7", "3,-1,-1,7,6,4"
EVERYWHERE = "-9,-9,-9,9,9,9"


@pytest.fixture(scope="module")
def taken(tmp_path_factory):
    """A sensor profile, two scans, and candidates."""
    folder = tmp_path_factory.mktemp("taken")
    (folder / "small.toml").write_text(SMALL)
    for name, (at, look) in zip(("a", "b"), AT, strict=True):
        file = folder / f"{name}.npz"
        succeed("scan", ROOM, "--at", at, "--look", look, "--sensor", folder / "small.toml", "-o", file, "-q")
    x, y = np.meshgrid([0.6, 1.2, 3.4, 4.6, 5.4], [0.6, 1.2, 3.0, 4.2])
    positions = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, 1.6)])
    turns = np.radians(np.arange(0, 360, 45))
    directions = np.column_stack([np.cos(turns), np.sin(turns), np.full(8, -0.4)])
    np.savez(folder / "candidates.npz", positions=positions, directions=directions)
    return folder


def plan_from(taken, *arguments):
    both = ("--scans", taken / "a.npz", "--scans", taken / "b.npz", "--sensor", taken / "small.toml")
    return run("plan", *both, *arguments)


@pytest.mark.long
@pytest.mark.parametrize("method", first_in_gate(1, ["nbv", "cover"]))
def test_a_plan_resumes_from_scans(taken, tmp_path, method):
    out = tmp_path / method
    fixed = ("--candidates", taken / "candidates.npz", "--polish-steps", 0, "--views", 3)
    said = plan_from(taken, ROOM, "--method", method, *fixed, "-o", out, "--json")
    assert said.exit_code == 0, said.stderr
    summary, written = json.loads(said.stdout), json.loads((out / "plan.json").read_text())
    assert len(written["views"]) == 3
    assert written["resumed_from"]["scans"] == summary["resumed_from"]["scans"] == 2
    assert 0 < written["resumed_from"]["met"] < written["views"][0]["met_fraction"]
    assert written["coverage"]["met"] == pytest.approx(written["views"][-1]["met_fraction"])
    for baseline in written["baselines"].values():
        assert baseline["curve"][0] > written["resumed_from"]["met"] - 0.02
        assert baseline["met"] == baseline["curve"][-1]
    inputs = json.loads((out / "manifest.json").read_text())["inputs"]
    assert [record["input"] for record in inputs if str(record["input"]).endswith("b.npz")]


@pytest.mark.long
def test_region_and_keep_out_reach_plan_json(taken, tmp_path):
    zones = ("--region", WEST, "--keep-out", EAST, "--keep-out", "-1,-1,-1,0.8,0.8,4")
    fixed = ("--candidates", taken / "candidates.npz", "--views", 2, "-o", tmp_path, "--json")
    said = plan_from(taken, ROOM, *fixed, *zones)
    assert said.exit_code == 0, said.stderr
    written = json.loads((tmp_path / "plan.json").read_text())
    assert written["region"] == [[0, 0, 0], [3, 5, 2.7]]
    assert len(written["keep_out"]) == 2
    assert written["coverage"]["total_m2"] < 100
    positions = [np.array(view["world_from_sensor"])[:3, 3] for view in written["views"]]
    assert all(position[0] < 3 for position in positions)


@pytest.fixture(scope="module")
def following(taken, tmp_path_factory):
    """Two next stations, and what was said of them."""
    out = tmp_path_factory.mktemp("next")
    said = plan_from(taken, "--views", 2, "--threads", 1, "-o", out, "--json")
    assert said.exit_code == 0, said.stderr
    return out, json.loads(said.stdout)


def test_the_next_station_without_a_scene(following):
    out, summary = following
    assert set(contents(out)) == {"plan.json", "plan.csv", "trajectory.txt", "coverage.json", "report.html"}
    plan = read_plan(out / "plan.json")
    assert summary["views"] == len(plan.views) == 2
    (room,) = summary["rooms"]
    assert room["level_m"] == pytest.approx(0, abs=0.02)
    assert room["stations"] == [1, 2]
    assert plan.coverage is None
    assert plan.target is None
    assert all(view.predicted_gain_m2 > 0 for view in plan.views)
    coverage = json.loads((out / "coverage.json").read_text())
    assert coverage["surface"] == summary["surface"]


@pytest.mark.long
def test_the_next_station_is_the_same_again_and_said_in_words(taken, following, tmp_path):
    text = plan_from(taken, "--views", 2, "--threads", 2, "-o", tmp_path).stdout
    assert "station 1 in room 1: at " in text
    assert "not areas of surface" in text
    assert contents(tmp_path) == contents(following[0])


@pytest.mark.long
def test_the_record_holds_what_was_predicted_against_what_was_measured(taken, tmp_path):
    small = ("--sensor", taken / "small.toml", "--threads", 1, "-o", tmp_path / "next", "--json")
    first = json.loads(succeed("plan", "--scans", taken / "a.npz", *small).stdout)
    (entry,) = first["record"]
    assert entry["said"] is None
    assert entry["expected_m2"] is None
    plan = read_plan(tmp_path / "next" / "plan.json")
    station = plan.views[0].world_from_sensor
    at, look = (",".join(map(str, p)) for p in (station.translation, station.apply([0.0, 0.0, 1.0])))
    file = tmp_path / "next.npz"
    succeed("scan", ROOM, "--at", at, "--look", look, "--sensor", taken / "small.toml", "-o", file, "-q")
    both = ("--scans", taken / "a.npz", "--scans", file)
    second = json.loads(succeed("plan", *both, *small).stdout)
    assert second["record"][0]["said"] is None
    entry = second["record"][1]
    assert entry["said"]["station"] == 1
    assert entry["said"]["predicted_gain_m2"] == pytest.approx(plan.views[0].predicted_gain_m2)
    assert 0 < entry["settled_m2"] <= entry["expected_m2"]
    # named, the earlier plan says the same; that of other scans is refused when it is named
    other = tmp_path / "other"
    known = ("--before", tmp_path / "next" / "plan.json", "-o", other)
    again = json.loads(succeed("plan", *both, *small, *known).stdout)
    assert again["record"][1]["said"] == entry["said"]
    b = ("--scans", taken / "b.npz", "--sensor", taken / "small.toml", *known)
    assert_fails_in_one_line(run("plan", *b), "was made after other scans than these")
    kept = run("plan", *b[:4], "-o", tmp_path / "next", "-q")
    assert kept.exit_code == 0, kept.stderr


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--before", "none.json"), "none.json"),
        (("--start", "1,1"), "--start is for plans of a known scene: give SCENE"),
        (("--without", "*door*"), "--without is for plans of a known scene: give SCENE"),
        (("--rooms", "9"), "there is no room 9: the scans show 1 room"),
        ((ROOM, "--before", "plan.json"), "leave SCENE out, or --before"),
    ],
)
def test_what_next_stations_cannot_take_is_refused(taken, tmp_path, options, said):
    result = plan_from(taken, *options, "-o", tmp_path)
    assert result.exit_code == (2 if "SCENE" in said else 1)
    assert said in result.stderr


@pytest.mark.long
def test_the_files_of_a_next_station_serve_as_a_plan(following, tmp_path):
    report = ("--plan", following[0] / "plan.json", "-o", tmp_path, "--json")
    found = json.loads(succeed("coverage", "builtin:chair_before_wall", *report).stdout)
    assert found["stations"] == 2


def test_up_turns_nothing_but_for_planners(taken):
    paths = ScanRequest((str(taken / "a.npz"), str(taken / "b.npz")), up="y")
    given = read_request(paths)
    flat, lying = given.scans, given.with_z_up("y").scans
    assert flat[0].origin.tolist() == read_request(replace(paths, up="z")).scans[0].origin.tolist()
    for one, other in zip(flat, lying, strict=True):
        x, y, z = one.origin
        assert other.origin.tolist() == pytest.approx([x, -z, y])  # y of the file is up


def test_coverage_of_scans_without_a_scene(taken, tmp_path):
    arguments = ("--scans", taken / "a.npz", "--sensor", taken / "small.toml")
    summary = json.loads(succeed("coverage", *arguments, "-o", tmp_path, "--json").stdout)
    assert set(contents(tmp_path)) == {"coverage.json", "coverage.csv", "coverage.ply", "report.html"}
    assert summary["surface"]["inferred_m2"] > 0
    assert summary["mode"] == "standard"
    rows = list(csv.DictReader((tmp_path / "coverage.csv").read_text().splitlines()))
    assert len(rows) == len(summary["surfaces"])
    assert sum(float(row["observed_m2"]) for row in rows) == pytest.approx(
        summary["surface"]["recognised_m2"]
    )
    ply = read_mesh_ply(tmp_path / "coverage.ply")
    assert set(np.unique(ply.vertex_properties["state"])) == {0, 1, 2, 3, 4}
    careful = ("--inference", "conservative", "-o", tmp_path / "careful", "--json")
    less = json.loads(succeed("coverage", *arguments, *careful).stdout)
    assert less["surface"]["inferred_m2"] < summary["surface"]["inferred_m2"]
    manifest = json.loads((tmp_path / "careful" / "manifest.json").read_text())
    assert manifest["options"]["inference"] == "conservative"
    report = (tmp_path / "careful" / "report.html").read_text()
    assert report.count("conservative") > (tmp_path / "report.html").read_text().count("conservative")


@pytest.mark.parametrize(
    "arguments",
    [
        ("plan",),
        ("plan", "--scans", "a.npz", "--method", "cover"),
        ("plan", "--scans", "a.npz", "--region", "1,2,3"),
        ("plan", "--scans", "a.npz", "--keep-out", "a,b,c,d,e,f"),
        ("plan", "--scans", "a.npz", "--intrinsics", "1,2"),
        ("coverage", "--plan", "plan.json"),
        ("coverage",),
    ],
)
def test_wrong_usage_exits_with_2(arguments):
    assert run(*arguments).exit_code == 2


def test_unusable_input_is_one_line_with_the_cure(taken, tmp_path):
    out = ("-o", tmp_path)
    upside_down = ("--region", "1,1,1,0,2,2")
    for result, word in (
        (plan_from(taken, *upside_down, *out), "X0 < X1"),
        (plan_from(taken, ROOM, *upside_down, *out), "X0 < X1"),
        (plan_from(taken, "--keep-out", EVERYWHERE, *out), "make the boxes smaller"),
        (plan_from(taken, ROOM, "--keep-out", EVERYWHERE, *out), "make the boxes smaller"),
        (plan_from(taken, ROOM, "--region", "20,20,20,21,21,21", *out), "the scene goes from"),
        (plan_from(taken, "--sensor", "line_profiler", *out), "plan with a sensor that has an aperture"),
        (plan_from(taken, "builtin:pipe_rack", *out), "must be in the scene's coordinates"),
        (plan_from(taken, "--scans", tmp_path / "missing.npz", *out), "missing.npz"),
        (run("coverage", "--scans", tmp_path / "missing.npz", *out), "missing.npz"),
    ):
        assert_fails_in_one_line(result, word)


def test_scans_without_poses_are_refused_with_the_cure(taken, tmp_path):
    files = []
    for name in ("a", "b"):
        files.append(tmp_path / f"{name}.npz")
        with np.load(taken / f"{name}.npz", allow_pickle=False) as held:
            parts = dict(held)
        header = json.loads(str(parts["header"]))
        header["world_from_sensor"] = np.eye(4).tolist()
        np.savez(files[-1], **{**parts, "header": json.dumps(header)})
    for command in ("plan", "coverage"):
        result = run(command, "--scans", files[0], "--scans", files[1], "-o", tmp_path / "out")
        assert_fails_in_one_line(result, "2 scans without poses", "--poses FILE")


@pytest.mark.long
def test_mere_points_serve_where_the_scanner_is_said_to_have_stood(taken, tmp_path):
    scan = read_scan(taken / "a.npz")
    np.savetxt(tmp_path / "a.xyz", scan.points()[scan.valid])
    stood = ",".join(map(str, scan.origin))
    out = ("-o", tmp_path / "out", "--json")
    arguments = ("--scans", tmp_path / "a.xyz", "--sensor", taken / "small.toml", *out)
    found = json.loads(succeed("coverage", *arguments, "--origin", stood).stdout)
    assert found["surface"]["measured_m2"] > 25
    assert_fails_in_one_line(run("coverage", *arguments), "a.xyz", "--origin X,Y,Z")


@pytest.mark.parametrize("suffix", [".las", ".laz", ".xyz", ".csv"])
def test_scans_are_written_as_points_and_read_back(taken, tmp_path, suffix):
    file = tmp_path / f"a{suffix}"
    succeed("scan", ROOM, "--at", AT[0][0], "--look", AT[0][1], "--sensor", taken / "small.toml", "-o", file)
    back, scan = read_scan(file), read_scan(taken / "a.npz")
    np.testing.assert_array_equal(back.valid, scan.valid)
    np.testing.assert_allclose(back.points(), scan.points(), atol=1e-5)
