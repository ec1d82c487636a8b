# SPDX-License-Identifier: MIT
"""Planners turn scans of a world whose z is not up, and report it."""

import json

import numpy as np
import pytest

from completion.registration.pipeline import register_scans
from completion.room.pipeline import estimate_up
from nbv.coverage.surface_classes import KnownSurfaces
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import PinholeSensor
from nbv.scans.registering import ups_of
from nbv.scans.scan_record import read_predictions
from nbv.scans.seen_rooms import SeenRooms
from nbv.scans.upright import UprightScans
from scenes.checks import InputError
from scenes.inclination import Up, axis_direction
from scenes.io.scan_files import read_scans, write_scan
from scenes.pose import Pose
from scenes.world.builtin import builtin_scene
from tests.helpers.data_paths import data_path, requires_data
from tests.helpers.long_cases import first_in_gate
from tests.nbv.commands.test_cli import run, succeed

SENSOR = PinholeSensor(fov_deg=80, width=96, height=96, name="small")
SMALL = 'kind = "pinhole"\nname = "small"\nfov_deg = 80.0\nwidth = 96\nheight = 96\n'
VIEWS = (((0.6, 0.6, 1.6), (5.0, 4.0, 0.8)), ((5.2, 0.8, 1.6), (1.0, 4.0, 0.6)))


def scans_of(turn):
    room = builtin_scene("two_occluders")
    return [
        scan_scene(room, Pose.looking_at(np.array(eye), np.array(target)), SENSOR, rng=0).transform(turn)
        for eye, target in VIEWS
    ]


def lying(axis):
    """The turn of a world in which z is up into one in which the axis is."""
    return Up(axis_direction(axis)).drawing_from_world.inverse()


@pytest.mark.parametrize("axis", first_in_gate(3, ["z", "y", "-y", "x", "-x", "-z"]))
def test_scans_are_turned_so_that_their_floor_is_level(axis):
    given = scans_of(lying(axis))
    turned = UprightScans.of(given, n_threads=1)
    np.testing.assert_allclose(turned.up.direction, axis_direction(axis), atol=1e-9)
    points = np.concatenate([scan.points()[scan.valid] for scan in turned.scans])
    assert np.quantile(points[:, 2], 0.001) == pytest.approx(0.0, abs=0.01)  # the floor
    rooms = SeenRooms.of(turned.scans, KnownSurfaces.of(turned.scans, relates=False, n_threads=1))
    assert rooms is not None
    assert rooms.rooms.rooms[0].level_m == pytest.approx(0.0, abs=0.05)
    there = turned.world_from_scans.apply(given[0].origin[None])[0]
    np.testing.assert_allclose(there, turned.scans[0].origin, atol=1e-12)


def test_what_is_turned_is_said_and_z_is_left_alone():
    plain, turned = (UprightScans.of(scans_of(lying(axis)), n_threads=1) for axis in ("z", "-y"))
    assert plain.doubts("plan.json") == ()
    assert (
        plain.scans[0].world_from_sensor.matrix.tolist()
        == Pose.looking_at(*map(np.array, VIEWS[0])).matrix.tolist()
    )
    (told,) = turned.doubts("plan.json")
    assert "up is (0.00, -1.00, 0.00) in the files' axes, sd" in told
    assert "turned so that z is up: world_from_scans in plan.json; --up z says otherwise" in told
    assert turned.to_json()["up"] == [0.0, -1.0, 0.0]


TABLES = {
    "learn0": (0.006, -0.800, -0.600),
    "learn17": (-0.043, -0.751, -0.659),
    "learn25": (-0.003, -0.777, -0.630),
    "learn29": (-0.050, -0.726, -0.686),
    "learn33": (0.002, -0.824, -0.566),
    "learn39": (0.000, -0.824, -0.566),
}
REAL = {
    "pcl/office1.pcd": (0.01, 1.0, -0.03),
    "e57/pumpA.e57": (0, 0, 1),
    **{f"mOSD/{name}.pcd": normal for name, normal in TABLES.items()},
    "align3d_sample1": (0.01, -0.962, -0.272),
    "align3d_sample2": (0.025, 1.0, 0.0),
    "open3d_redwood": (-0.01, 1.0, 0.0),
    "tdtk": (0, 0, 1),
}
"""Normals of floors by hand, and of tables: of the plane with most points in each cloud, by RANSAC."""


@requires_data
@pytest.mark.long
@pytest.mark.parametrize("name", first_in_gate(0, REAL))
def test_planners_find_up_of_real_scans(name):
    scans = read_scans(data_path(f"range/{name}"))
    turned = UprightScans.of(scans, n_threads=1)
    np.testing.assert_allclose(turned.up.direction, estimate_up(scans, n_threads=1).direction, atol=0.01)
    level = turned.world_from_scans.rotate(np.array([REAL[name]]) / np.linalg.norm(REAL[name]))[0]
    assert np.degrees(np.arccos(min(level[2], 1.0))) < 2.5
    assert (not turned.doubts("plan.json")) == (REAL[name] == (0, 0, 1))


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("lying")
    (folder / "small.toml").write_text(SMALL)
    for axis in ("z", "y"):
        for number, scan in enumerate(scans_of(lying(axis)), start=1):
            write_scan(scan, folder / f"{axis}{number}.npz")
    return folder


def plan_of(files, axis, out, *more, scans=(1,)):
    words = [word for number in scans for word in ("--scans", files / f"{axis}{number}.npz")]
    done = succeed("plan", *words, "--sensor", files / "small.toml", *more, "-o", out)
    return json.loads((out / "plan.json").read_text()), done.stderr


@pytest.mark.long
def test_a_plan_of_scans_that_lie_is_that_of_scans_that_stand(files, tmp_path):
    standing, _ = plan_of(files, "z", tmp_path / "z")
    lain, told = plan_of(files, "y", tmp_path / "y")
    assert "up is (0.00, 1.00, 0.00)" in told
    assert "up is" in (tmp_path / "y" / "report.html").read_text()
    assert lain["up"] == [0.0, 1.0, 0.0]
    assert (standing["up"], standing["world_from_scans"]) == ([0.0, 0.0, 1.0], np.eye(4).tolist())
    assert {room["name"] for room in lain["rooms"]} == {room["name"] for room in standing["rooms"]}
    here, there = (np.array(content["views"][0]["world_from_sensor"])[:3, 3] for content in (standing, lain))
    np.testing.assert_allclose(there, here, atol=0.05)
    said, told = plan_of(files, "y", tmp_path / "said", "--up", "y")
    assert "up is" not in told
    assert said["views"] == lain["views"]


@pytest.mark.long
def test_coverage_of_scans_finds_up_too(files, tmp_path):
    areas = []
    for axis in ("z", "y"):
        words = ("--scans", files / f"{axis}1.npz", "--sensor", files / "small.toml")
        told = succeed("coverage", *words, "-o", tmp_path / axis).stderr
        assert ("up is (0.00, 1.00, 0.00)" in told) == (axis == "y")
        held = json.loads((tmp_path / axis / "coverage.json").read_text())
        areas.append((held["surface"]["measured_m2"], held["rooms"][0]["floor_m2"]))
    np.testing.assert_allclose(areas[1], areas[0], rtol=0.02)


def test_an_earlier_plan_is_read_in_the_scans_own_world(tmp_path):
    turn = Up(axis_direction("y")).drawing_from_world
    known, station = (
        Pose.looking_at(np.array(eye), np.array([3.0, 1.6, 3.0]))
        for eye in ([0.5, 1.6, 0.5], [5.0, 1.6, 0.5])
    )
    content = {
        "world_from_scans": turn.matrix.tolist(),
        "resumed_from": {"world_from_sensor": [(turn @ known).matrix.tolist()]},
        "record": [{"said": None}],
        "views": [{"world_from_sensor": (turn @ station).matrix.tolist(), "predicted_gain_m2": 3.0}],
    }
    (tmp_path / "plan.json").write_text(json.dumps(content))
    first, second = read_predictions(tmp_path / "plan.json", [known, station])
    assert first is None
    assert second.station == 1
    assert second.off_m == pytest.approx(0.0, abs=1e-9)


def test_an_axis_that_points_down_is_for_scans_alone(tmp_path):
    done = run("plan", "builtin:two_occluders", "--up", "-y", "-o", tmp_path)
    assert done.exit_code == 2
    assert "--up -y is for scans alone" in " ".join(done.stderr.replace("\u2502", " ").split())


def test_each_scan_to_be_registered_has_its_own_up():
    scans = [scan.with_facts(name=f"s{k}") for k, scan in enumerate(scans_of(lying("y")))]
    tilted = [scans[0], scans[1].transform(lying("-y"))]
    ups, told = ups_of(tilted, n_threads=1)
    assert ups[0].tolist() == [0.0, 1.0, 0.0]
    np.testing.assert_allclose(ups[1], lying("-y").rotate(np.array([[0.0, 1.0, 0.0]]))[0], atol=0.02)
    assert all("up is" in text for text in told)
    with pytest.raises(InputError, match=r"expected up with shape \(3,\) or \(2, 3\), got \(3, 3\)"):
        register_scans(scans, upright=True, up=np.eye(3))
