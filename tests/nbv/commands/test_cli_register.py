# SPDX-License-Identifier: MIT
"""`unseen register`: poses, files with poses, a check of poses, and failures in one line."""

import json
import re

import numpy as np
import pytest
from typer.testing import CliRunner

from nbv.cli import app
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import SphericalSensor
from nbv.scans.registering import copies_of, copies_told
from scenes.io.scan_files import read_scans, write_scan, write_scans
from scenes.pose import Pose
from scenes.world.builtin import builtin_scene

CAMERA = SphericalSensor(
    azimuth_span_deg=360, elevation_min_deg=-60, elevation_max_deg=60, width=320, height=108
)
POSES = [Pose.looking_at((1.2, 2.9, 1.5), (3.5, 1.0, 1.5)), Pose.looking_at((2.2, 3.1, 1.4), (3.2, 0.8, 1.4))]


def run(*arguments, command="register"):
    return CliRunner().invoke(app, [command, *(str(argument) for argument in arguments)])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Two scans with their poses, and the same without."""
    here, scene = tmp_path_factory.mktemp("register"), builtin_scene("office")
    scans = [
        scan_scene(scene, pose, CAMERA, noise="gaussian-2mm", rng=k, truth=False)
        for k, pose in enumerate(POSES)
    ]
    lost = [scan.with_facts(world_from_sensor=Pose.identity()) for scan in scans]
    for k, (scan, other) in enumerate(zip(scans, lost, strict=True)):
        write_scan(scan, here / f"posed_{k}.npz")
        write_scan(other, here / f"lost_{k}.ply")
    write_scans(lost, here / "both.e57")
    elsewhere = Pose.looking_at((0.8, 0.9, 1.5), (3.0, 2.5, 1.5))
    stranger = scan_scene(builtin_scene("two_occluders"), elsewhere, CAMERA, rng=7, truth=False)
    write_scan(stranger.with_facts(world_from_sensor=Pose.identity()), here / "stranger.ply")
    return here


@pytest.fixture(scope="module")
def registered(folder):
    result = run(folder / "lost_0.ply", folder / "lost_1.ply", "-o", folder / "out", "--json")
    assert result.exit_code == 0, result.output
    return folder / "out", json.loads(result.stdout)


def test_clouds_without_a_grid_are_placed_by_the_origin_of_each(folder):
    clouds = [folder / f"cloud_{k}.xyz" for k in range(2)]
    for k, cloud in enumerate(clouds):
        (scan,) = read_scans(folder / f"lost_{k}.ply")
        points = np.random.default_rng(k).permutation(scan.points()[scan.valid])
        np.savetxt(cloud, points)
    refused = run(*clouds, "-o", folder / "out_clouds")
    assert refused.exit_code == 1
    assert "--origin X,Y,Z" in refused.stderr
    result = run(*clouds, *["--origin", "0,0,0"] * 2, "-o", folder / "out_clouds", "--json")
    assert result.exit_code == 0, result.output
    assert json.loads(result.stdout)["groups"] == [[0, 1]]
    posed = [read_scans(folder / "out_clouds" / "posed" / cloud.name)[0] for cloud in clouds]
    moved = posed[0].origin - posed[1].origin
    true = POSES[0].translation - POSES[1].translation
    assert np.linalg.norm(moved) == pytest.approx(np.linalg.norm(true), abs=0.02)
    once = run(*clouds, "--origin", "0,0,0", "-o", folder / "out_clouds")
    assert "1 places for 2 scans; give --origin X,Y,Z once a scan" in once.stderr


def test_poses_are_found_and_written(registered):
    out, said = registered
    assert said["groups"] == [[0, 1]]
    record = json.loads((out / "registration.json").read_text())
    assert record["groups"] == 1
    true = POSES[0].inverse() @ POSES[1]
    held = np.array(record["scans"][1]["world_from_sensor"])
    np.testing.assert_allclose(held, true.matrix, atol=5e-3)
    assert record["pairs"][0]["verdict"] == "registered"
    posed = [read_scans(out / "posed" / name)[0] for name in ("lost_0.ply", "lost_1.ply")]
    np.testing.assert_allclose(posed[1].world_from_sensor.matrix, held, atol=1e-6)
    page = (out / "report.html").read_text()
    assert "Registration" in page
    assert "what is left between its scans" in page


@pytest.mark.long
def test_an_e57_keeps_its_scans_together(folder):
    result = run(folder / "both.e57", "-o", folder / "e57", "-q")
    assert result.exit_code == 0, result.output
    assert len(read_scans(folder / "e57" / "posed" / "both.e57")) == 2


def test_poses_that_come_with_scans_are_checked(folder):
    good = run(folder / "posed_0.npz", folder / "posed_1.npz", "--check", "-o", folder / "good", "--json")
    assert json.loads(good.stdout)["pairs"]["registered"] == 1
    assert not (folder / "good" / "posed").exists()
    start = folder / "start.txt"
    start.write_text("1.2 2.9 1.5 0 0 0 1\n2.2 3.1 1.4 0 0 0 1\n")
    bad = run(
        folder / "posed_0.npz",
        folder / "posed_1.npz",
        "--check",
        "--start",
        start,
        "-o",
        folder / "bad",
        "--json",
    )
    assert json.loads(bad.stdout)["pairs"]["registered"] == 0


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["lost_0.ply"], "at least two scans"),
        (["lost_0.ply", "missing.ply"], "missing.ply"),
        (["lost_0.ply", "lost_1.ply", "--level", "2"], "between 0 and 1"),
        (["lost_0.ply", "lost_1.ply", "--check"], "without poses"),
    ],
)
def test_what_cannot_be_registered_is_told_in_a_line(folder, arguments, said):
    named = [folder / one if one.endswith(".ply") else one for one in arguments]
    result = run(*named, "-o", folder / "none")
    assert result.exit_code != 0
    assert said in result.output
    assert "Traceback" not in result.output
    assert not (folder / "none" / "registration.json").exists()


@pytest.mark.long
def test_contradicted_scans_that_are_placed_together_are_told(folder, monkeypatch):
    """Whatever share of contradictions is worth a word, both scans and the two reasons are named."""
    monkeypatch.setattr("nbv.scans.registering.NOTICED_SHARE", -1.0)
    result = run(folder / "lost_0.ply", folder / "lost_1.ply", "-o", folder / "told", "--json")
    told = [text for text in json.loads(result.stdout)["warnings"] if "beams contradict" in text]
    assert len(told) == 1
    assert "or they are two places that look alike" in told[0]


@pytest.fixture(scope="module")
def completed(folder):
    named = [folder / name for name in ("lost_0.ply", "stranger.ply", "lost_1.ply")]
    result = run(*named, "--register", "--no-texture", "-o", folder / "done", "--json", command="complete")
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout), json.loads((folder / "done" / "completion.json").read_text())


@pytest.mark.long
def test_scans_are_registered_before_they_are_completed(completed):
    """Two scans stand as they stood, and what has no pose is left out and named."""
    said, record = completed
    assert said["scans"] == 2
    first, second = (np.array(one["world_from_sensor"]) for one in record["poses"]["scans"])
    np.testing.assert_allclose(
        np.linalg.inv(first) @ second, (POSES[0].inverse() @ POSES[1]).matrix, atol=5e-3
    )
    assert any("1 scan is left out" in text and "stranger.ply" in text for text in said["warnings"])


def test_a_sentence_says_what_was_placed(completed):
    """How many scans, how well their poses are known, and what was left alone and why."""
    told = completed[0]["placed"]
    assert re.match(
        r"1 scan to lost_0.ply, its pose with a standard deviation of [\d.]+ mm and [\d.e-]+ deg", told
    )
    assert "; left alone: stranger.ply (" in told
    assert ": " in told.split("stranger.ply (")[1]


@pytest.mark.long
def test_coverage_by_scans_registers_them(folder):
    named = [text for name in ("lost_0.ply", "lost_1.ply") for text in ("--scans", folder / name)]
    result = run(*named, "--register", "-o", folder / "covered", command="coverage")
    assert result.exit_code == 0, result.output
    assert "placed    1 scan to lost_0.ply, its pose with" in result.output
    assert "2 scans measured" in result.output


@pytest.mark.long
def test_the_same_scan_twice_counts_once_and_is_told(folder):
    """A copy proves nothing and adds nothing: the scan is completed as it is by itself."""
    named = [folder / "lost_0.ply", folder / "lost_0.ply"]
    twice = run(*named, "--register", "--no-texture", "-o", folder / "twice", "--json", command="complete")
    assert twice.exit_code == 0, twice.output
    once = run(named[0], "--no-texture", "-o", folder / "once", "--json", command="complete")
    said, alone = json.loads(twice.stdout), json.loads(once.stdout)
    assert [said[key] for key in ("scans", "surfaces")] == [alone[key] for key in ("scans", "surfaces")]
    assert said["placed"] == "1 scan, by itself"
    assert any("is the same scan as lost_0.ply#1" in text for text in said["warnings"])


def test_a_copy_beside_other_scans_is_left_out():
    scene = builtin_scene("office")
    scans = [scan_scene(scene, pose, CAMERA, noise="gaussian-2mm", rng=0, truth=False) for pose in POSES]
    again = scans[0].with_facts(world_from_sensor=Pose.identity())
    assert copies_of([scans[0], scans[1], again, again]) == {2: 0, 3: 0}
    told = copies_told(["a", "b", "c", "d"], {2: 0, 3: 0})
    assert told == [
        "c is the same scan as a: that they fit says nothing",
        "d is the same scan as a: that they fit says nothing",
    ]


@pytest.mark.long
def test_registering_the_same_scan_twice_is_told(folder):
    named = [folder / "lost_0.ply", folder / "lost_0.ply"]
    result = run(*named, "-o", folder / "same", "--json")
    assert result.exit_code == 0, result.output
    assert any("is the same scan as" in text for text in json.loads(result.stdout)["warnings"])


@pytest.mark.parametrize(
    ("command", "arguments", "said"),
    [
        ("complete", ["lost_0.ply", "stranger.ply", "--register"], "no two of 2 scans can be placed"),
        ("complete", ["lost_0.ply", "--register"], "at least two scans"),
        ("complete", ["lost_0.ply", "lost_1.ply", "--register", "--scheduler", "x:1"], "in one process"),
        ("coverage", ["builtin:office", "--scans", "lost_0.ply", "--register"], "not to SCENE"),
    ],
)
def test_what_cannot_be_registered_first_is_told_in_a_line(folder, command, arguments, said):
    named = [folder / one if one.endswith(".ply") else one for one in arguments]
    result = run(*named, "-o", folder / "nothing", command=command)
    assert result.exit_code != 0
    assert said in " ".join(result.output.replace("│", " ").split())
    assert "Traceback" not in result.output
    assert not (folder / "nothing" / "report.html").exists()
