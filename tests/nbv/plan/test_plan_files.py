# SPDX-License-Identifier: MIT
"""Plans as CSV and as trajectories: headings by the map, read back as poses, used where poses are taken."""

import csv
import json

import numpy as np
import pytest

from nbv.plan.plan import COLUMNS, aim_of, stations_csv
from nbv.scanning.sensor import PinholeSensor, View
from scenes.io.poses.trajectory import read_poses, read_timed_poses
from scenes.io.scan_files import read_scans
from scenes.pose import Pose
from tests.nbv.commands.test_cli import TINY, assert_fails_in_one_line, run, succeed

CHAIR = "builtin:chair_before_wall"


@pytest.mark.parametrize(
    ("target", "heading", "pitch"),
    [
        ((0, 5, 0), 0, 0),
        ((5, 0, 0), 90, 0),
        ((0, -5, 0), 180, 0),
        ((-5, 0, 0), 270, 0),
        ((3, 3, 0), 45, 0),
        ((0, 5, 5), 0, 45),
        ((4, 0, -4 * np.sqrt(3)), 90, -60),
    ],
)
def test_heading_is_that_of_the_map_and_pitch_is_up(target, heading, pitch):
    aim = aim_of(Pose.looking_at((0, 0, 0), target))
    assert aim.heading_deg == pytest.approx(heading, abs=1e-9)
    assert aim.pitch_deg == pytest.approx(pitch)
    assert aim.roll_deg == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize("roll", [-170.0, -30.0, 25.0, 90.0])
def test_heading_pitch_and_roll_tell_the_whole_rotation(roll):
    angle = np.radians(roll)
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    upright = Pose.looking_at((1, 2, 3), (4, 9, 2))
    aim = aim_of(Pose.from_parts(upright.rotation @ turn, upright.translation))
    assert aim.roll_deg == pytest.approx(roll)
    assert aim.heading_deg == pytest.approx(aim_of(upright).heading_deg)
    assert aim.pitch_deg == pytest.approx(aim_of(upright).pitch_deg)


@pytest.mark.parametrize("height", [-5, 5])
def test_straight_up_and_down_have_the_heading_of_an_image_edge(height):
    pose = Pose.looking_at((0, 0, 0), (0, 0, height), up=(1, 0, 0))
    aim = aim_of(pose)
    assert aim.pitch_deg == pytest.approx(90 * np.sign(height))
    assert aim.heading_deg == pytest.approx(90 if height < 0 else 270)
    assert aim.roll_deg == 0


def test_stations_are_numbered_and_say_when_they_are_visited():
    sensor = PinholeSensor(fov_deg=60, width=8, height=8)
    views = [View(Pose.looking_at((k, 0, 1), (k, 9, 1)), sensor, 2.5, None) for k in range(3)]
    rows = list(csv.DictReader(stations_csv(views, (2, 0, 1)).splitlines()))
    assert tuple(rows[0]) == COLUMNS
    assert [row["number"] for row in rows] == ["1", "2", "3"]
    assert [row["visit"] for row in rows] == ["2", "3", "1"]
    assert [row["x_m"] for row in rows] == ["0.0000", "1.0000", "2.0000"]
    assert rows[0]["gain_m2"] == "2.5"
    assert rows[0]["met_fraction"] == ""
    assert [row["visit"] for row in csv.DictReader(stations_csv(views).splitlines())] == ["", "", ""]


@pytest.fixture(scope="module")
def planned(tmp_path_factory):
    """A folder with a sensor, and a plan of two views in `plan`."""
    folder = tmp_path_factory.mktemp("planned")
    (folder / "tiny.toml").write_text(TINY)
    arguments = ("--sensor", folder / "tiny.toml", "--views", 2, "-o", folder / "plan", "-q")
    succeed("plan", CHAIR, *arguments)
    return folder


def test_the_files_of_a_plan_hold_its_poses(planned):
    views = json.loads((planned / "plan" / "plan.json").read_text())["views"]
    times, poses = read_timed_poses(planned / "plan" / "trajectory.txt")
    assert times.tolist() == [1.0, 2.0]
    for view, pose in zip(views, poses, strict=True):
        np.testing.assert_allclose(pose.matrix, view["world_from_sensor"], atol=1e-12)
    rows = list(csv.DictReader((planned / "plan" / "plan.csv").read_text().splitlines()))
    for row, pose, view in zip(rows, poses, views, strict=True):
        np.testing.assert_allclose([float(row[f"{axis}_m"]) for axis in "xyz"], pose.translation, atol=5.1e-5)
        assert float(row["heading_deg"]) == pytest.approx(aim_of(pose).heading_deg, abs=1e-4)
        assert float(row["met_fraction"]) == view["met_fraction"]
    listed = json.loads((planned / "plan" / "manifest.json").read_text())["outputs"]
    assert {"plan.csv", "trajectory.txt"} <= {entry["name"] for entry in listed}


@pytest.mark.long
def test_coverage_of_the_trajectory_is_that_of_the_plan(planned, tmp_path):
    file = planned / "plan" / "trajectory.txt"
    arguments = ("--plan", file, "--sensor", planned / "tiny.toml", "-o", tmp_path, "--json")
    found = json.loads(succeed("coverage", CHAIR, *arguments).stdout)
    planned_met = json.loads((planned / "plan" / "plan.json").read_text())["coverage"]["met"]
    assert found["stations"] == 2
    assert found["coverage"]["met"] == pytest.approx(planned_met, abs=1e-9)


@pytest.mark.parametrize("out", ["scans.e57", "folder"])
def test_scans_from_the_poses_of_a_file(planned, tmp_path, out):
    arguments = (CHAIR, "--poses", planned / "plan" / "trajectory.txt", "--sensor", planned / "tiny.toml")
    noisy = ("--noise", "gaussian-2mm", "--json")
    summary = json.loads(succeed("scan", *arguments, *noisy, "-o", tmp_path / out).stdout)
    assert summary["scans"] == 2
    scans, poses = read_scans(tmp_path / out), read_poses(planned / "plan" / "trajectory.txt")
    for scan, pose in zip(scans, poses, strict=True):
        np.testing.assert_allclose(scan.world_from_sensor.matrix, pose.matrix, atol=1e-12)
    one = (*arguments[:2], f"{arguments[2]}#2", *arguments[3:], *noisy, "-o", tmp_path / "one.npz")
    succeed("scan", *one)
    (alone,) = read_scans(tmp_path / "one.npz")
    step_m = 1e-4 if out == "folder" else 1e-12  # the second scan is the same when it is taken alone
    np.testing.assert_allclose(alone.points(), scans[1].points(), atol=step_m)
    again = succeed("scan", *arguments, *noisy, "-o", tmp_path / out)
    assert again.exit_code == 0


def test_unusable_poses_are_refused(planned, tmp_path):
    poses = planned / "plan" / "trajectory.txt"
    out = ("-o", tmp_path / "a.npz")
    assert_fails_in_one_line(
        run("scan", CHAIR, "--poses", f"{poses}#9", *out), "there are 2 poses, counted from 1"
    )
    assert_fails_in_one_line(run("scan", CHAIR, "--poses", tmp_path / "no.txt", *out), "no.txt: no such file")
    several = run("scan", CHAIR, "--poses", poses, "--sensor", planned / "tiny.toml", *out)
    assert_fails_in_one_line(several, "a.npz: holds one scan, not 2; write an .e57 file or a folder")
    assert run("scan", CHAIR, "--poses", poses, "--at", "0,0,1", *out).exit_code == 2
    assert run("scan", CHAIR, "--at", "0,0,1", *out).exit_code == 2
