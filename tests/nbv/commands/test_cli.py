# SPDX-License-Identifier: MIT
"""Command line: every command on a small case, its exit codes, one-line errors and pure JSON."""

import json
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from completion.observe.tolerance import EvidenceOptions
from completion.result import labelled_points as observed_points
from nbv.cli import app
from nbv.commands.complete import coarser_cells
from nbv.report.blocks.page import Page
from nbv.run import manifest
from scenes.checks import InputError
from tests.helpers.data_paths import ROOT
from tests.helpers.long_cases import first_in_gate

TINY = 'kind = "pinhole"\nname = "tiny"\nfov_deg = 70.0\nwidth = 72\nheight = 72\n'
CHAIR = "builtin:chair_before_wall"


def run(*arguments):
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def succeed(*arguments):
    result = run(*arguments)
    assert result.exit_code == 0, result.stderr
    return result


def pixels_of(file):
    with Image.open(file) as opened:
        return np.array(opened)


def contents(folder, *leave_out):
    files = {file.name: file.read_bytes() for file in sorted(Path(folder).iterdir())}
    return {name: data for name, data in files.items() if not name.endswith(("manifest.json", *leave_out))}


@pytest.fixture(scope="module")
def sensor(tmp_path_factory):
    file = tmp_path_factory.mktemp("sensor") / "tiny.toml"
    file.write_text(TINY)
    return file


@pytest.fixture(scope="module")
def scan(tmp_path_factory, sensor):
    file = tmp_path_factory.mktemp("scan") / "chair.npz"
    succeed(
        "scan", CHAIR, "--at", "0.3,-1.6,1.1", "--look", "0,1,0.8", "--sensor", sensor, "-o", file, "--json"
    )
    return file


@pytest.fixture(scope="module")
def plan(tmp_path_factory, sensor):
    out = tmp_path_factory.mktemp("plan")
    arguments = ("--sensor", sensor, "--views", 3, "--threads", 1, "-o", out, "--json")
    return out, json.loads(succeed("plan", "builtin:two_occluders", *arguments).stdout)


def assert_fails_in_one_line(result, *words):
    assert result.exit_code == 1, result.output
    assert result.stdout == ""
    assert len(result.stderr.strip().splitlines()) == 1
    for word in words:
        assert word in result.stderr


def test_help_names_the_commands_and_only_those_that_work():
    text = succeed("--help").stdout
    for command in (
        "demo",
        "scan",
        "plan",
        "coverage",
        "check",
        "complete",
        "texture",
        "fit",
        "info",
        "study",
    ):
        assert command in text


def test_unseen_alone_shows_the_three_jobs():
    text = succeed().stdout
    for line in ("unseen plan", "unseen complete", "unseen coverage", "unseen check"):
        assert line in text


SLOW = {"numpy", "scipy", "trimesh", "numba", "matplotlib", "cv2", "jinja2", "pydantic", "rich"}
REPORTS = {"matplotlib", "jinja2", "scipy.stats"}


@pytest.mark.parametrize(
    ("program", "unwanted"),
    first_in_gate(
        2,
        [
            ("from nbv.cli import app; app(['plan', '--help'], standalone_mode=False)", SLOW),
            (
                "from nbv.cli import app; app(['info', SCAN], standalone_mode=False)",
                {"matplotlib", "jinja2", "scipy.stats", "completion.options", "completion.fitting.pipeline"},
            ),
            ("import nbv.commands.complete", REPORTS),
        ],
    ),
    ids=["help", "info", "complete"],
)
def test_a_command_imports_nothing_slow_that_it_does_not_need(scan, program, unwanted):
    check = f"import sys\n{program.replace('SCAN', repr(str(scan)))}\nprint({unwanted!r} & set(sys.modules))"
    ran = subprocess.run([sys.executable, "-c", check], check=True, cwd=ROOT, capture_output=True, text=True)
    assert ran.stdout.endswith("set()\n"), ran.stdout


@pytest.mark.parametrize(
    "arguments",
    [
        ("nonsense",),
        ("scan", CHAIR),
        ("scan", CHAIR, "--at", "1,2", "--look", "0,0,0"),
        ("scan", CHAIR, "--at", "1,2,nan", "--look", "0,0,0"),
        ("plan", CHAIR, "--method", "best"),
        ("plan", CHAIR, "--time-budget", "-3"),
        ("plan", CHAIR, "--k", "0"),
        ("plan", CHAIR, "--views", "0"),
        ("plan", CHAIR, "--max-memory", "lots"),
        ("plan", CHAIR, "--max-memory", "0GB"),
        ("coverage", CHAIR),
        ("coverage", CHAIR, "--plan", "a", "--scans", "b"),
        ("complete",),
        ("complete", "a.npz", "--intrinsics", "1,2,3"),
        ("complete", "a.npz", "--mode", "wild"),
        ("complete", "a.npz", "--export", "dwg"),
        ("texture", "a.png"),
        ("texture", "a.png", "--grow", "12"),
        ("texture", "a.png", "--grow", "12x9", "--mask", "b.png"),
        ("info", "a", "--up", "w"),
        ("info", "a", "--threads", "0"),
    ],
)
def test_wrong_usage_exits_with_2(arguments):
    result = run(*arguments)
    assert result.exit_code == 2
    assert result.stdout == ""


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (("info", "missing.glb"), "missing.glb"),
        (("scan", "builtin:castle", "--at", "0,0,1", "--look", "1,0,1"), "castle"),
        (("scan", CHAIR, "--at", "0,0,1", "--look", "0,0,1"), "same point"),
        (("scan", CHAIR, "--at", "0,0,1", "--look", "1,0,1", "--sensor", "huge9"), "huge9"),
        (("scan", CHAIR, "--at", "0,0,1", "--look", "1,0,1", "--noise", "loud"), "loud"),
        (("plan", "missing.glb"), "missing.glb"),
        (("plan", "builtin:two_occluders", "--target", "1.5"), "target"),
        (("plan", "builtin:two_occluders", "--candidates", "missing.npz"), "missing.npz"),
        (("coverage", "builtin:two_occluders", "--plan", "missing.json"), "missing.json"),
        (("coverage", "builtin:two_occluders", "--scans", "missing.npz"), "missing.npz"),
        (("complete", "missing.e57"), "missing.e57"),
        (("texture", "missing.png", "--grow", "4x4"), "missing.png"),
    ],
)
def test_unusable_input_exits_with_1_and_one_line(arguments, word, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert_fails_in_one_line(run(*arguments), f"unseen {arguments[0]}: ", word)


def test_a_folder_given_as_a_file_and_a_file_given_as_a_folder(tmp_path, scan):
    assert_fails_in_one_line(run("info", tmp_path), str(tmp_path))
    assert_fails_in_one_line(run("plan", tmp_path), "folder")
    at = ("--at", "0,-1,1", "--look", "0,1,1")
    assert_fails_in_one_line(run("scan", CHAIR, *at, "-o", tmp_path), "folder")
    assert_fails_in_one_line(run("scan", CHAIR, *at, "-o", tmp_path / "no" / "a.npz"), "no folder")
    assert_fails_in_one_line(run("scan", CHAIR, *at, "-o", tmp_path / "a.docx"), "docx")
    occupied = tmp_path / "occupied"
    occupied.write_text("a file")
    assert_fails_in_one_line(run("complete", scan, "-o", occupied), "occupied")


def test_scan_writes_the_file_and_its_manifest(scan):
    held = json.loads(scan.with_name("chair.npz.manifest.json").read_text())
    assert held["command"] == "scan"
    assert held["options"]["sensor"]["width"] == 72
    assert held["options"]["noise"] == "none"
    assert [record["name"] for record in held["outputs"]] == ["chair.npz"]
    assert held["inputs"][0] == {"input": CHAIR}
    assert "sha256" in held["inputs"][1]


def test_scan_options_each_change_something(tmp_path, sensor):
    base = ("scan", CHAIR, "--at", "0.3,-1.6,1.1", "--look", "0,1,0.8", "--sensor", sensor)
    changes = {
        "plain": (),
        "moved": ("--at", "0.2,-1.6,1.1"),
        "turned": ("--look", "0.1,1,0.8"),
        "noise": ("--noise", "gaussian-2mm"),
        "seeded": ("--noise", "gaussian-2mm", "--seed", 1),
        "other": ("--sensor", "kinect_v1"),
        "its own noise": ("--sensor", "kinect_v1", "--noise", "profile"),
        "without truth": ("--no-truth",),
    }
    for name, change in changes.items():
        succeed(*base, *change, "-o", tmp_path / f"{name}.npz", "--quiet")
    assert len({(tmp_path / f"{name}.npz").read_bytes() for name in changes}) == len(changes)


@pytest.mark.long
def test_scan_says_what_was_active_and_info_repeats_it(tmp_path):
    at = ("--at", "0.3,-1.6,1.1", "--look", "0,1,0.8", "-o", tmp_path / "a.npz")
    said = succeed("scan", CHAIR, *at, "--sensor", "kinect_v1", "--noise", "profile").stdout
    active = "noise khoshelham2012 (per_m 0.001425); quantisation (inverse_depth_step_per_m 0.00285)"
    assert f"kinect_v1: range errors: {active}" in said
    described = json.loads(succeed("info", tmp_path / "a.npz", "--json").stdout)["scans"][0]
    assert (described["sensor"], described["noise"]) == ("kinect_v1", active)
    report = ("coverage", CHAIR, "--scans", tmp_path / "a.npz", "-o", tmp_path / "out", "--quiet")
    succeed(*report)
    assert "khoshelham2012 (per_m 0.001425)" in (tmp_path / "out/report.html").read_text()
    manifest = json.loads((tmp_path / "a.npz.manifest.json").read_text())
    assert "Khoshelham" in manifest["options"]["sources"]["noise"]["per_m"]
    assert manifest["options"]["effects"] == active


def test_scan_says_that_a_profile_has_no_noise_and_how_long_it_takes(tmp_path, sensor):
    at = ("--at", "0.3,-1.6,1.1", "--look", "0,1,0.8", "-o", tmp_path / "a.npz", "--noise", "profile")
    done = succeed("scan", CHAIR, *at, "--sensor", sensor)
    assert "states no errors: its scans have no random error" in done.stderr
    fast = tmp_path / "fast.toml"
    lines = ("kind = 'pinhole'", "width = 40", "height = 30", "points_per_s = 400")
    fast.write_text("\n".join([*lines, "[noise]", "model = 'constant'", "constant_m = 0.001", ""]))
    done = succeed("scan", CHAIR, *at, "--sensor", fast)
    assert "warning" not in done.stderr
    assert "(constant_m 0.001); 3 s or more of measuring" in done.stdout


def test_quiet_prints_nothing(tmp_path, sensor):
    arguments = (
        "scan",
        CHAIR,
        "--at",
        "0,-1,1",
        "--look",
        "0,1,1",
        "--sensor",
        sensor,
        "-o",
        tmp_path / "a.ply",
    )
    result = succeed(*arguments, "--quiet")
    assert result.output == ""


def test_info_as_a_table_as_json_and_as_a_file(scan, tmp_path):
    assert "chair_before_wall" in succeed("info", CHAIR).stdout
    described = json.loads(succeed("info", scan, "--json").stdout)
    assert described["scans"][0]["rows"] == 72
    succeed("info", scan, "-o", tmp_path / "info.json")
    assert json.loads((tmp_path / "info.json").read_text())["count"] == 1
    assert (tmp_path / "info.json.manifest.json").exists()


def test_plan_writes_what_the_contract_names(plan):
    out, summary = plan
    assert set(contents(out)) == {
        "plan.json", "plan.csv", "trajectory.txt", "coverage.json", "report.html", "stations.csv",
        "stations.json", "floor-plan-1.svg", "floor-plans.pdf",
    }  # fmt: skip
    stations = json.loads(succeed("info", out / "stations.csv", "--json").stdout)
    assert stations["kind"] == "stations of a plan"
    written = json.loads((out / "plan.json").read_text())
    assert set(written) == {
        "method", "sensor", "requirement", "seed", "n_candidates", "views", "coverage", "lower_bound",
        "stopped_because", "inference", "resumed_from", "region", "keep_out", "rooms", "platforms",
        "time", "lost_if_blocked", "most_in_time",
        "baselines", "rules",
    }  # fmt: skip
    assert list(written["baselines"]) == ["random", "farthest-point", "visibility-only greedy", "greedy"]
    assert len(written["baselines"]["random"]["curve"]) == len(written["views"])
    assert written["seed"] == 0
    assert summary["views"] == len(written["views"]) <= 3
    assert summary["coverage"] == written["coverage"]
    assert summary["inference"] is None
    assert written["inference"] == []
    assert json.loads((out / "manifest.json").read_text())["options"]["max_incidence_deg"] == 60.0


@pytest.mark.long
def test_offline_plan_takes_its_requirement_and_budgets(sensor, tmp_path):
    candidates = tmp_path / "candidates.npz"
    positions = np.array([[3.0, 1.0, 1.6], [1.0, 4.0, 1.0], [5.0, 1.0, 1.0]])
    np.savez(candidates, positions=positions, directions=np.vstack([np.eye(3), -np.eye(3)]))
    out = tmp_path / "out"
    required = ("--max-range", 6, "--min-density", 20, "--max-sd", 0.05, "--registration-sd", 0.002)
    averaged = ("--averaging-radius", 0.01, "--k", 2, "--noise", "khoshelham2012", "--max-incidence", 70)
    budgets = (
        "--polish-steps",
        200,
        "--time-budget",
        100,
        "--overlap",
        0.1,
        "--candidates",
        candidates,
        "--seed",
        3,
    )
    arguments = ("--method", "cover", "--sensor", sensor, "--target", 0.9, "-o", out, "--json")
    found = succeed("plan", "builtin:two_occluders", *arguments, *required, *averaged, *budgets).stdout
    summary, written = json.loads(found), json.loads((out / "plan.json").read_text())
    assert written["requirement"] == {
        "max_incidence_deg": 70.0, "max_range_m": 6.0, "min_density_per_m2": 20.0, "max_sd_m": 0.05,
        "registration_sd_m": 0.002, "averaging_radius_m": 0.01, "k": 2, "target": 0.9,
    }  # fmt: skip
    assert written["lower_bound"] == summary["lower_bound"]
    assert set(written["lower_bound"]) == {"views", "kind"}
    assert 1 <= written["lower_bound"]["views"] <= len(written["views"])
    assert written["seed"] == 3
    stations = json.loads((out / "stations.json").read_text())
    assert set(stations) == {"tour", "overlaps", "groups"}
    assert sorted(stations["tour"]["order"]) == list(range(1, len(written["views"]) + 1))
    coverage = json.loads((out / "coverage.json").read_text())
    patches = coverage["unreachable_patches"]
    assert set(patches[0]) == {"surface", "name", "reason", "area_m2", "centre"}
    share = sum(patch["area_m2"] for patch in patches) / coverage["total_m2"]
    assert share == pytest.approx(coverage["unreachable"])
    unusable = run("plan", "builtin:two_occluders", *arguments[:-1], "--max-sd", 0.05)
    assert unusable.exit_code == 1
    assert "whose errors are known" in unusable.stderr


@pytest.mark.long
def test_plan_is_the_same_for_any_number_of_threads(plan, sensor, tmp_path):
    arguments = ("--sensor", sensor, "--views", 3, "--threads", 2, "-o", tmp_path, "--quiet")
    succeed("plan", "builtin:two_occluders", *arguments)
    assert contents(tmp_path) == contents(plan[0])


@pytest.mark.long
def test_coverage_of_a_plan_agrees_with_the_plan(plan, tmp_path):
    out, summary = plan
    arguments = ("--plan", out / "plan.json", "-o", tmp_path, "--json")
    found = json.loads(succeed("coverage", "builtin:two_occluders", *arguments).stdout)
    assert found["coverage"]["met"] == pytest.approx(summary["coverage"]["met"], abs=1e-12)
    assert set(contents(tmp_path)) == {"coverage.json", "coverage.csv", "coverage.ply", "report.html"}
    rows = (tmp_path / "coverage.csv").read_text().splitlines()
    assert rows[0].startswith("id,name,area_m2,met")
    assert len(rows) == 1 + len(json.loads((tmp_path / "coverage.json").read_text())["surfaces"])
    stricter = json.loads(
        succeed("coverage", "builtin:two_occluders", *arguments, "--max-incidence", 30).stdout
    )
    assert stricter["coverage"]["met"] < found["coverage"]["met"]


def test_coverage_of_scans(scan, tmp_path):
    arguments = ("--scans", scan, "-o", tmp_path, "--json")
    found = json.loads(succeed("coverage", CHAIR, *arguments).stdout)
    assert found["stations"] == 1
    assert 0 < found["coverage"]["met"] < 1
    for stricter in (
        ("--k", 2),
        ("--min-density", 1e9),
        ("--max-sd", 0.001, "--registration-sd", 0.002, "--sensor", "kinect_v1"),
    ):
        less = json.loads(succeed("coverage", CHAIR, *arguments, *stricter).stdout)
        assert less["coverage"]["met"] == 0
        assert json.loads((tmp_path / "manifest.json").read_text())["options"]["k"] == (
            2 if "--k" in stricter else 1
        )


@pytest.fixture(scope="module")
def completed(tmp_path_factory, scan):
    out = tmp_path_factory.mktemp("complete")
    return out, json.loads(succeed("complete", scan, "--threads", 1, "-o", out, "--json").stdout)


def test_complete_writes_what_the_contract_names(completed):
    out, summary = completed
    names = {
        "completed.glb",
        "model.ply",
        "observed.ply",
        "hypothesised.ply",
        "polygons.json",
        "decisions.csv",
        "completion.json",
    }
    names.add("report.html")
    assert set(contents(out)) == names
    assert summary["hypothesised_m2"] > 0
    record = json.loads((out / "completion.json").read_text())
    assert len(record["surfaces"]) == summary["surfaces"]
    manifest = json.loads((out / "manifest.json").read_text())
    assert {output["name"] for output in manifest["outputs"]} == names
    assert manifest["options"]["resolved"]["mode"] == "standard"
    assert len(manifest["inputs"][0]["sha256"]) == 64


@pytest.mark.long
def test_inputs_are_hashed_once_for_journal_report_and_manifest(scan, tmp_path, monkeypatch):
    hashed, sha256_of = [], manifest.sha256_of
    monkeypatch.setattr(manifest, "sha256_of", lambda path: hashed.append(path) or sha256_of(path))
    succeed("complete", scan, "--mode", "conservative", "--no-texture", "-o", tmp_path)
    assert hashed.count(scan) == 1


@pytest.mark.long
def test_complete_is_the_same_for_any_number_of_threads(completed, scan, tmp_path):
    succeed("complete", scan, "--threads", 2, "-o", tmp_path, "--quiet")
    assert contents(tmp_path) == contents(completed[0])


@pytest.mark.long
def test_complete_options_each_change_something(scan, tmp_path, monkeypatch):
    monkeypatch.setattr(
        "nbv.report.completion_report.completion_page", lambda *_, **__: Page("", "", "", (), None, (), {}, 0)
    )
    plain = ("--no-texture", "--quiet")
    changes = {
        "plain": plain,
        "sigma": (*plain, "--sigma", 0.01),
        "millimetres": (*plain, "--units", "mm"),
        "coarse": (*plain, "--resolution", 0.08),
        "uneven": (*plain, "--flatness", 0.02),
        "floors": (*plain, "--only", "floors,cylinders"),
        "large": (*plain, "--min-area", 5.0),
        "textured": ("--quiet",),
        "seeded": ("--quiet", "--seed", 5),
    }
    models = set()
    for name, change in changes.items():
        succeed("complete", scan, *change, "-o", tmp_path / name)
        models.add((tmp_path / name / "completed.glb").read_bytes())
    assert len(models) == len(changes)


@pytest.mark.long
def test_the_cells_and_the_search_are_told(scan, tmp_path, monkeypatch):
    monkeypatch.setattr(observed_points, "_MOST_POINTS", 500)
    succeed(
        "complete", scan, "--resolution", 0.08, "--texture", "budget", "--observed", "full", "-o", tmp_path
    )
    record = json.loads((tmp_path / "completion.json").read_text())
    assert record["observed_step"] == 1
    surfaces = record["surfaces"]
    planes = [surface for surface in surfaces if surface["kind"] == "plane"]
    assert planes
    assert all(surface["cell_m"] == pytest.approx(0.08, rel=0.1) for surface in planes)
    textured = [surface["texture"]["search"] for surface in surfaces if surface["texture"] is not None]
    assert set(textured) == {"budget"}


@pytest.mark.long
def test_what_is_wanted_is_told(scan, tmp_path, monkeypatch):
    monkeypatch.setattr(observed_points, "_MOST_POINTS", 500)
    said = succeed(
        "complete", scan, "--only", "floors, pipes", "--only", "ceilings", "--no-texture", "-o", tmp_path
    )
    assert "left as measured: " in said.stdout
    assert "rows and columns of the scans; --observed full writes them all" in said.stdout
    record = json.loads((tmp_path / "completion.json").read_text())
    assert record["choice"]["only"] == ["floors", "pipes", "ceilings"]
    assert record["choice"]["n_left_out"] > 0
    assert record["observed_step"] > 1
    page = (tmp_path / "report.html").read_text()
    assert "Only floors, pipes, ceilings were asked for" in page
    assert "flat to 1 mm" in page


@pytest.mark.parametrize(
    ("option", "value", "word"),
    [
        ("--only", "walls,doors", "'doors' is none of walls, floors, ceilings, pipes, planes, cylinders"),
        ("--only", "", "'' is none of walls"),
        ("--min-area", "-1", "'--min-area': Input should be greater"),
        ("--min-area", "nan", "Input should be greater"),
        ("--flatness", "-0.01", "'--flatness': Input should be greater"),
        ("--flatness", "inf", "--flatness is a finite number of metres, got inf"),
    ],
)
def test_nonsense_about_what_is_wanted_is_refused_in_one_line(option, value, word, scan, tmp_path):
    said = CliRunner().invoke(app, ["complete", str(scan), option, value, "-o", str(tmp_path / "out")])
    assert said.exit_code in (1, 2)
    assert word in " ".join(said.stderr.split())
    assert "Traceback" not in said.stderr


@pytest.mark.parametrize("side", ["nan", "inf", "0", "-1", "2", "1e-9"])
def test_sides_of_cells_that_make_no_sense_are_refused(side, tmp_path):
    said = CliRunner().invoke(app, ["complete", "a.npz", "--resolution", side, "-o", str(tmp_path / "out")])
    assert said.exit_code in (1, 2)
    assert not (tmp_path / "out").exists()
    with pytest.raises(InputError, match="cell_m must be between"):
        EvidenceOptions(cell_m=float(side))


def test_cells_that_are_larger_than_asked_for_are_told():
    grid = SimpleNamespace(cell_area=0.02**2)
    completion = SimpleNamespace(patches=[SimpleNamespace(grid=grid)])
    assert coarser_cells(completion, None) == coarser_cells(completion, 0.02) == []
    (said,) = coarser_cells(completion, 0.001)
    assert said == "too many cells of 0.001 m; these surfaces have larger ones: 1 (0.02 m)"


@pytest.mark.long
def test_complete_in_conservative_mode_infers_less(tmp_path, sensor):
    scan = tmp_path / "room.npz"
    at = ("--at", "0.5,0.5,1.5", "--look", "5,4,1")
    succeed("scan", "builtin:two_occluders", *at, "--sensor", sensor, "-o", scan, "--quiet")
    arguments = ("complete", scan, "--no-texture", "-o", tmp_path, "--json")
    careful, standard = (
        json.loads(succeed(*arguments, "--mode", mode).stdout) for mode in ("conservative", "standard")
    )
    assert careful["mode"] == "conservative"
    assert careful["hypothesised_m2"] < standard["hypothesised_m2"]


@pytest.mark.long
def test_scans_without_poses_are_refused_with_the_cure(scan, tmp_path, sensor):
    at_origin = tmp_path / "frame"
    (at_origin / "depth").mkdir(parents=True)
    for number in (1, 2):
        depth = np.full((24, 32), 1000 + number, np.uint16)
        Image.fromarray(depth).save(at_origin / "depth" / f"{number}.png")
    camera = ("--intrinsics", "30,30,15.5,11.5", "--depth-scale", 1000)
    assert_fails_in_one_line(run("complete", at_origin, *camera, "-o", tmp_path / "a"), "--poses")
    both = (f"{at_origin}#1", f"{at_origin}#2")
    assert_fails_in_one_line(run("complete", *both, *camera, "-o", tmp_path / "b"), "--poses", "2 scans")
    poses = tmp_path / "poses.txt"
    poses.write_text("0 0 0 0 0 0 1\n0.1 0 0 0 0 0 1\n")
    arguments = (*both, *camera, "--poses", poses, "-o", tmp_path / "c", "--json")
    assert json.loads(succeed("complete", *arguments).stdout)["scans"] == 2
    poses.write_text("0 0 0 0 0 0 1\n" * 3)
    assert_fails_in_one_line(
        run("complete", *both, *camera, "--poses", poses, "-o", tmp_path / "d"), "3 poses"
    )


@pytest.fixture(scope="module")
def image(tmp_path_factory):
    file = tmp_path_factory.mktemp("image") / "checks.png"
    rng = np.random.default_rng(0)
    checks = np.kron(np.indices((10, 10)).sum(axis=0) % 2, np.ones((3, 3)))[..., None] * [200, 150, 90]
    Image.fromarray((checks + rng.integers(0, 30, checks.shape)).astype(np.uint8)).save(file)
    mask = np.zeros((30, 30), np.uint8)
    mask[12:18, 10:20] = 7
    Image.fromarray(mask).save(file.with_name("mask.png"))
    return file


def test_texture_fills_and_keeps_what_is_known(image, tmp_path):
    out = tmp_path / "filled.png"
    summary = json.loads(
        succeed("texture", image, "--mask", image.with_name("mask.png"), "-o", out, "--json").stdout
    )
    before, after = pixels_of(image), pixels_of(out)
    hole = pixels_of(image.with_name("mask.png")) > 0
    assert summary["filled"] == hole.sum()
    assert (before[~hole] == after[~hole]).all()
    with np.load(f"{out}.provenance.npz") as provenance:
        rows, columns = provenance["source_rows"], provenance["source_cols"]
    assert (after == before[rows, columns]).all()
    assert Path(f"{out}.manifest.json").exists()


def test_texture_options_each_change_something(image, tmp_path):
    changes = {
        "plain": (),
        "seed": ("--seed", 3),
        "window": ("--window", 5),
        "order": ("--order", "window"),
        "size": ("--grow", "14x12"),
    }
    for name, change in changes.items():
        succeed("texture", image, "--grow", "16x12", *change, "-o", tmp_path / f"{name}.png", "--quiet")
    assert len({(tmp_path / f"{name}.png").read_bytes() for name in changes}) == len(changes)
    with Image.open(tmp_path / "size.png") as grown:
        assert grown.size == (12, 14)


@pytest.mark.parametrize("suffix", [".png", ".webp", ".tif", ".jpg"])
def test_texture_keeps_alpha_where_the_format_can(suffix, tmp_path):
    rng = np.random.default_rng(1)
    Image.fromarray(rng.integers(0, 255, (12, 12, 4)).astype(np.uint8)).save(tmp_path / "in.png")
    out = tmp_path / f"out{suffix}"
    succeed("texture", tmp_path / "in.png", "--grow", "8x8", "--window", 3, "-o", out, "--quiet")
    with Image.open(out) as grown:
        assert grown.mode == ("RGB" if suffix == ".jpg" else "RGBA")


def test_texture_refuses_what_it_cannot_use(image, tmp_path):
    small = tmp_path / "small.png"
    Image.fromarray(np.zeros((4, 4), np.uint8)).save(small)
    out = ("-o", tmp_path / "a.png")
    assert_fails_in_one_line(run("texture", image, "--mask", small, *out), "shape")
    assert_fails_in_one_line(run("texture", image, "--grow", "4x4", "--window", 4, *out), "odd")
    assert_fails_in_one_line(run("texture", image, "--grow", "4x4", "-o", tmp_path / "a.txt"), ".txt")
    broken = tmp_path / "broken.png"
    broken.write_bytes(image.read_bytes()[:60])
    assert_fails_in_one_line(run("texture", broken, "--grow", "4x4", *out), "broken.png")
    deep = tmp_path / "deep.png"
    Image.fromarray(np.full((9, 9), 40_000, np.uint16)).save(deep)
    assert_fails_in_one_line(run("texture", deep, "--grow", "4x4", *out), "8 bits")
    everything = tmp_path / "all.png"
    Image.fromarray(np.full((30, 30), 255, np.uint8)).save(everything)
    assert_fails_in_one_line(run("texture", image, "--mask", everything, *out), "nothing to sample from")
    larger = tmp_path / "larger.png"
    Image.fromarray(np.full((31, 30), 255, np.uint8)).save(larger)
    assert_fails_in_one_line(run("texture", image, "--mask", larger, *out), "(30, 30), got (31, 30)")
    unreal = tmp_path / "unreal.tif"
    Image.fromarray(np.full((9, 9), np.nan, np.float32)).save(unreal)
    assert_fails_in_one_line(run("texture", unreal, "--grow", "4x4", *out), "8 bits")


def test_texture_gives_the_obvious_result_where_there_is_one(image, tmp_path):
    out = tmp_path / "a.png"
    nothing = tmp_path / "nothing.png"
    Image.fromarray(np.zeros((30, 30), np.uint8)).save(nothing)
    summary = json.loads(succeed("texture", image, "--mask", nothing, "-o", out, "--json").stdout)
    assert summary["quality"]["confidence"] == 1
    assert summary["quality"]["seam"] is None
    assert summary["filled"] == 0
    assert (pixels_of(out) == pixels_of(image)).all()
    dot = tmp_path / "dot.png"
    Image.fromarray(np.full((1, 1), 9, np.uint8)).save(dot)
    succeed("texture", dot, "--grow", "3x4", "-o", out, "--quiet")
    assert (pixels_of(out) == np.full((3, 4), 9)).all()
    # No window of 11 lies within what is known: the template narrows.
    most = tmp_path / "most.png"
    Image.fromarray(np.pad(np.full((28, 28), 255, np.uint8), 1)).save(most)
    succeed("texture", image, "--mask", most, "--window", 11, "-o", out, "--quiet")
    known = pixels_of(most) == 0
    assert (pixels_of(out)[known] == pixels_of(image)[known]).all()


@pytest.mark.parametrize("suffix", [".jpg", ".tif", ".png", ".webp"])
def test_texture_turns_images_upright_as_their_exif_says(suffix, tmp_path):
    rows, columns = np.indices((16, 24))
    upright = np.where((rows < 8) & (columns < 8), 250, 20 + 4 * columns).astype(np.uint8)
    exif = Image.Exif()
    exif[0x0112] = 6  # the first row is the right-hand side
    turned = Image.fromarray(np.rot90(upright))
    turned.save(
        tmp_path / f"turned{suffix}", exif=exif, **({"compression": "tiff_lzw"} if suffix == ".tif" else {})
    )
    mask = np.zeros((16, 24), np.uint8)
    mask[12:14, 4:8] = 255
    Image.fromarray(mask).save(tmp_path / "mask.png")
    out = tmp_path / "out.png"
    succeed(
        "texture", tmp_path / f"turned{suffix}", "--mask", tmp_path / "mask.png", "--window", 5, "-o", out
    )
    found = pixels_of(out)
    found = found if found.ndim == 2 else found[..., 0]
    assert found.shape == upright.shape
    assert np.abs(found.astype(int) - upright)[mask == 0].mean() < 4  # JPEG and WebP lose a little


def test_texture_refuses_a_tiff_that_would_be_scrambled(tmp_path):
    exif = Image.Exif()
    exif[0x0112] = 8
    Image.fromarray(np.zeros((9, 14), np.uint8)).save(tmp_path / "side.tif", exif=exif)
    failed = run("texture", tmp_path / "side.tif", "--grow", "4x4", "-o", tmp_path / "a.png")
    assert_fails_in_one_line(failed, "lying on its side")


def test_texture_of_a_surface_separates_its_shading(tmp_path):
    rows, columns = np.indices((40, 40))
    light = np.exp(-0.03 * rows - 0.017 * columns)
    wall = np.rint((120 + 80 * (columns // 4 % 2)) * light).astype(np.uint8)
    Image.fromarray(wall).save(tmp_path / "wall.png")
    mask = np.zeros(wall.shape, np.uint8)
    mask[12:28, 12:28] = 1
    Image.fromarray(mask).save(tmp_path / "mask.png")
    off = {}
    for name, more in {"as it is": (), "surface": ("--surface",)}.items():
        out = tmp_path / f"{name}.png"
        arguments = (tmp_path / "wall.png", "--mask", tmp_path / "mask.png", "--window", 9, *more, "-o", out)
        summary = json.loads(succeed("texture", *arguments, "--json").stdout)
        assert isinstance(summary["alarms"], list)
        off[name] = np.abs(pixels_of(out).astype(int) - wall).max()
    assert off["surface"] <= 3 < off["as it is"]
    usage = run("texture", tmp_path / "wall.png", "--grow", "4x4", "--surface")
    assert usage.exit_code == 2


def test_doubtful_units_are_warned_of_where_scenes_and_scans_are_used(tmp_path, sensor):
    (tmp_path / "tiny.off").write_text("OFF\n3 1 0\n0 0 0\n0.01 0 0\n0 0.01 0\n3 0 1 2\n")
    aim = ("--at", "0,0,1", "--look", "0,0,0", "--sensor", sensor)
    result = succeed("scan", tmp_path / "tiny.off", *aim, "-o", tmp_path / "a.npz")
    assert result.stderr.startswith(
        "unseen scan: warning: the diagonal is 14.1 mm; if that is wrong, --units"
    )
    quiet = succeed("scan", tmp_path / "tiny.off", *aim, "-o", tmp_path / "a.npz", "-q", "--json")
    assert quiet.stderr == ""
    assert "--units says" in json.loads(quiet.stdout)["warnings"][0]
    empty = succeed("complete", tmp_path / "a.npz", "-o", tmp_path / "out")
    assert "warning: " in empty.stderr


def test_a_scan_that_meets_nothing_is_told(tmp_path):
    away = succeed("scan", "builtin:chair_before_wall", "--sensor", "generic60", "--at", "50,50,1",
                   "--look", "80,80,1", "-o", tmp_path / "a.npz")  # fmt: skip
    assert "warning: scan has no returns: does it look away from the scene" in away.stderr
