# SPDX-License-Identifier: MIT
"""`unseen check`: a room of six elements with a moved wall and no door, its files, options and errors."""

import json
import re
import zipfile
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from typer.testing import CliRunner

from completion.asbuilt.pipeline import CheckOptions
from nbv.cli import app
from nbv.commands import check as command
from nbv.commands.check import check_options, lines_of, summary_of
from nbv.commands.options.scans import CheckCommandOptions
from nbv.inspection.changes import changes_since
from nbv.inspection.checking import CheckedDesign
from nbv.inspection.record import check_record
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import SphericalSensor, View
from scenes.io.scan_files import read_scan, write_scan
from scenes.io.scene_files import load_scene, save_scene
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.mesh.orientation import world_from_file_up
from scenes.pose import Pose
from scenes.world.scene import Scene
from tests.nbv.inspection.checks import example_check, example_design

SENSOR = SphericalSensor(
    azimuth_span_deg=360, elevation_min_deg=-60, elevation_max_deg=60, width=360, height=120
)
EYES = ((1.0, 1.0, 1.6), (2.5, 2.4, 1.5))
FILES = {
    "check.json",
    "elements.csv",
    "deviation.ply",
    "design.glb",
    "issues.bcf",
    "report.html",
    "manifest.json",
}


def run(*arguments):
    return CliRunner().invoke(app, ["check", *(str(argument) for argument in arguments)])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The design as OBJ, and two scans of it with the northern wall 20 mm off, and no door."""
    here, design = tmp_path_factory.mktemp("check"), example_design()
    names = tuple(element.name for element in design.elements)
    save_scene(Scene(design.mesh, (None,) * len(names), names, "room"), here / "room.obj")
    places = design.mesh.vertices.copy()
    places[16:24, 1] -= 0.02
    stands = design.mesh.face_surface != 4
    mesh = LabelledMesh(places, design.mesh.faces[stands], design.mesh.face_surface[stands])
    built = Scene(mesh, (None,) * len(names), names, "built", mode="room")
    for k, eye in enumerate(EYES, start=1):
        view = View(Pose.looking_at(eye, np.add(eye, (1, 0.2, 0))), SENSOR)
        write_scan(scan_scene(built, view, noise="gaussian-2mm", rng=k, truth=False), here / f"s{k}.npz")
    return here


@pytest.fixture(scope="module")
def checked(folder):
    result = run(folder / "room.obj", folder / "s1.npz", folder / "s2.npz", "-o", folder / "out", "--json")
    assert result.exit_code == 0, result.output
    return folder / "out", json.loads(result.stdout)


@pytest.mark.long
def test_a_check_finds_what_was_planted_and_writes_its_files(checked):
    out, said = checked
    assert {path.name for path in out.iterdir() if not path.name.startswith(".")} == FILES
    record = json.loads((out / "check.json").read_text())
    verdicts = {one["name"]: one["verdict"] for one in record["elements"]}
    assert verdicts["wall_north"] == "deviates"
    assert verdicts["wall_east"] == "within"
    assert record["scans"] == ["s1.npz", "s2.npz"]
    assert said["elements"] == 6
    assert sum(said["verdicts"].values()) == 6
    manifest = json.loads((out / "manifest.json").read_text())
    assert [Path(one["input"]).name for one in manifest["inputs"]] == ["room.obj", "s1.npz", "s2.npz"]


@pytest.mark.long
def test_the_number_of_threads_changes_no_byte(folder, checked):
    out, _ = checked
    again = folder / "again"
    result = run(
        folder / "room.obj", folder / "s1.npz", folder / "s2.npz", "-o", again, "--quiet", "--threads", 1
    )
    assert (result.exit_code, result.stdout, result.stderr) == (0, "", "")
    for name in FILES - {"manifest.json"}:
        assert (again / name).read_bytes() == (out / name).read_bytes(), name


@pytest.mark.long
def test_next_stations_and_changes_are_written_too(folder, checked):
    before = checked[0] / "check.json"
    words = ("--next", 1, "--before", before, "--tolerance", 0.05, "--infer", "--bcf", "2.1")
    result = run(folder / "room.obj", folder / "s1.npz", folder / "s2.npz", *words, "-o", folder / "next")
    assert result.exit_code == 0, result.output
    record = json.loads((folder / "next/check.json").read_text())
    assert record["changes"]
    assert json.loads((folder / "next/plan.json").read_text())["views"] is not None
    assert "since the earlier check" in result.stdout


@pytest.fixture
def quick(monkeypatch):
    """A command whose check is made by hand; returns what the check was asked for."""
    asked = {}

    def check_design(scene, scans, tolerance_m, **named):
        asked.update(named, scene=scene, scans=scans, tolerance_m=tolerance_m)
        return CheckedDesign(example_check())

    monkeypatch.setattr(command, "check_design", check_design)
    return asked


@pytest.fixture
def typed(monkeypatch):
    """What was typed, as the command gets it."""
    got = []
    monkeypatch.setattr(command, "run_check", lambda _shared, asked: got.append(asked))
    return got


@pytest.mark.parametrize(("words", "field", "value"), [
    (("--tolerance", "0.02"), "tolerance_m", 0.02),
    (("--tolerance", "0.02", "--tolerance", "IfcDoor*=0.005"), "tolerances", {"IfcDoor*": 0.005}),
    (("--registration-sd", "0.004,0.01"), "registration", (0.004, 0.01)),
    (("--align", "no"), "align", False),
    (("--only", "IfcWall*", "--only", "door"), "only", ("IfcWall*", "door")),
    (("--without", "door"), "without", ("door",)),
    (("--false-alarms", "0.5"), "false_alarms", 0.5),
    (("--no-return", "free"), "no_return_is_free", True),
    (("--sigma", "0.003"), "sigma_m", 0.003),
])  # fmt: skip
def test_each_option_reaches_the_check(typed, words, field, value):
    result = run("room.obj", "s1.npz", *words)
    assert result.exit_code == 0, result.output
    assert getattr(check_options(typed[0]), field) == value
    assert getattr(CheckOptions(), field) != value
    assert {"tolerance_m": "tolerances", "no_return_is_free": "no_return"}.get(field, field) in typed[
        0
    ].record()


def test_a_python_call_takes_the_defaults_of_the_command_line():
    assert check_options(CheckCommandOptions(design="a.ifc", scans=("s.e57",))) == CheckOptions()


def test_units_versions_and_bands_are_used(folder, quick, tmp_path):
    bands, out = tmp_path / "bands.toml", tmp_path / "out"
    bands.write_text("fine = 0.003\ncoarse = 0.012\n")
    words = ("--design-units", "cm", "--loa", bands, "--bcf", "2.1", "-o", out, "--quiet")
    result = run(folder / "room.obj", folder / "s1.npz", *words)
    assert (result.exit_code, result.output) == (0, "")
    assert quick["options"].loa_bands_m == {"fine": 0.003, "coarse": 0.012}
    assert "bands.toml" in json.dumps(json.loads((out / "manifest.json").read_text())["inputs"])
    extent = np.ptp(quick["scene"].mesh.bounds(), axis=0)
    assert extent == pytest.approx([0.042, 0.034, 0.027])
    assert 1 < float(np.median(quick["scans"][0].ranges[quick["scans"][0].valid])) < 4  # in metres
    with zipfile.ZipFile(out / "issues.bcf") as archive:
        assert b"2.1" in archive.read("bcf.version")
    assert {path.name for path in out.iterdir() if not path.name.startswith(".")} == FILES


def test_unregistered_scans_are_placed_or_refused(folder, quick, tmp_path, monkeypatch):
    pose = Pose.looking_at((9.0, 1.0, 1.0), (1.0, 1.0, 1.0))
    found = SimpleNamespace(is_placed=True, poses=(pose,), sentences=("1 scan was placed",))
    monkeypatch.setattr(command, "place_on_design", lambda *_given, **_named: found)
    words = (folder / "room.obj", folder / "s1.npz", "--register", "-o", tmp_path / "out")
    result = run(*words)
    assert result.exit_code == 0, result.output
    assert np.allclose(quick["scans"][0].world_from_sensor.matrix, pose.matrix)
    assert "1 scan was placed" in result.stderr
    found.is_placed, found.sentences = False, ("two places fit as well",)
    refused = run(*words)
    assert refused.exit_code == 1
    assert "two places fit as well" in refused.stderr
    assert "--poses FILE" in refused.stderr


@pytest.mark.parametrize(("words", "code", "cause"), [
    (("--tolerance", "-1"), 2, "is no tolerance above 0"),
    (("--tolerance", "IfcWall"), 2, "write 0.010, or IfcDoor*=0.005"),
    (("--registration-sd", "-1,0"), 2, "both 0 or more"),
    (("--register", "--poses", "p.txt"), 2, "leave --poses out"),
    (("--bcf", "4"), 2, "2.1"),
    (("--next", "0"), 2, "greater than or equal to 1"),
    (("--loa", "missing.toml"), 1, "missing.toml"),
    (("--before", "missing.json"), 1, "missing.json"),
    (("--next", "1", "--sensor", "nobody"), 1, "no sensor named 'nobody'"),
])  # fmt: skip
def test_unusable_options_fail_in_one_line(folder, tmp_path, words, code, cause):
    result = run(folder / "room.obj", folder / "s1.npz", *words, "-o", tmp_path / "out")
    assert result.exit_code == code
    assert cause in " ".join(result.stderr.replace("\u2502", " ").split())
    if code == 1:
        assert len(result.stderr.strip().splitlines()) == 1
        assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(("words", "cause"), [
    (("--design-units", "mm"), "the scans do not fit the design: it spans 0.006"),
    (("--design-units", "ft"), "[0-9]+% with --units ft --design-units m; give that|do not fit the design"),
])  # fmt: skip
def test_scans_that_do_not_fit_the_design_fail_in_one_line(folder, tmp_path, words, cause):
    result = run(folder / "room.obj", folder / "s1.npz", *words, "-o", tmp_path / "out")
    assert result.exit_code == 1
    assert re.search(cause, result.stderr)
    assert len([line for line in result.stderr.strip().splitlines() if "warning" not in line]) == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("up", ["y", "z"])
def test_scans_of_a_design_that_is_y_up_keep_the_axis_on_which_they_fit(folder, quick, tmp_path, up):
    design = load_scene(folder / "room.obj")
    save_scene(design, tmp_path / "room.glb")  # y up
    scan = read_scan(folder / "s1.npz")
    given = scan if up == "z" else scan.transform(world_from_file_up("y").inverse())
    write_scan(given, tmp_path / "s.npz")
    result = run(tmp_path / "room.glb", tmp_path / "s.npz", "--up", "y", "-o", tmp_path / "out")
    assert result.exit_code == 0, result.output
    assert np.allclose(quick["scans"][0].world_from_sensor.matrix, scan.world_from_sensor.matrix, atol=1e-9)
    assert ("only the design was turned" in result.stderr) == (up == "z")


def test_the_summary_counts_what_was_found():
    check = example_check()
    changes = changes_since(check_record(check), check)
    summary = summary_of(CheckedDesign(check, changes=changes))
    assert summary["verdicts"]["deviates"] == 1
    assert sum(summary["verdicts"].values()) == summary["elements"] == 6
    assert (summary["extra"], summary["changes"]) == (2, 0)
    lines = lines_of(CheckedDesign(check, changes=changes))
    assert lines[0] == "6 elements: 1 within, 1 deviates, 1 undecided, 1 missing, 1 hidden, 1 not seen"
    assert "moved by (1.00 ± 0.78, 0.00 ± 0.78, -9.80 ± 0.78) mm" in lines[3]
    held = replace(check, alignment=replace(check.alignment, is_free=False))
    assert "control network" in lines_of(CheckedDesign(held))[3]
