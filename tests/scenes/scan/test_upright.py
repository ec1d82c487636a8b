# SPDX-License-Identifier: MIT
"""Up is what was said, or estimated with a word about it: a floor is not called a wall."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from nbv import PinholeSensor, scan_scene
from nbv.cli import app
from scenes import Pose, builtin_scene
from scenes.checks import InputError
from scenes.io.scan_files import read_scans, write_scan
from scenes.io.scan_request import ScanRequest, read_request
from scenes.scan.range_image import RangeImage
from scenes.scan.upright import upright
from tests.helpers.data_paths import data_path, requires_data
from tests.helpers.long_cases import first_in_gate

UP = {"x": (1, 0, 0), "y": (0, 1, 0), "z": (0, 0, 1), "-x": (-1, 0, 0), "-y": (0, -1, 0), "-z": (0, 0, -1)}


def lying(up: str) -> Pose:
    """The turn of a world in which z is up into one in which the axis is."""
    return upright([], up, of_points=False)[0].inverse()  # type: ignore[arg-type]


def camera(
    target: tuple[float, float, float], eye: tuple[float, float, float] = (0.5, 0.5, 1.6)
) -> RangeImage:
    sensor = PinholeSensor(fov_deg=70, width=96, height=72)
    return scan_scene(builtin_scene("two_occluders"), Pose.looking_at(eye, target), sensor, rng=0)


@pytest.mark.parametrize("up", UP)
def test_what_was_said_is_done(up: str) -> None:
    turn, word = upright([], up, of_points=False)  # type: ignore[arg-type]
    np.testing.assert_allclose(turn.apply(np.array([UP[up]], float)), [[0, 0, 1]], atol=1e-12)
    assert word == ""


@pytest.mark.parametrize("up", UP)
@pytest.mark.parametrize("target", [(3.0, 3.0, 1.0), (3.0, 2.0, 0.2), (3.0, 3.0, 1.6)])
def test_cameras_tell_up_in_any_world(up: str, target: tuple[float, float, float]) -> None:
    scan = camera(target).transform(lying(up))
    turn, word = upright([scan], "auto", of_points=False)
    found = turn.apply(np.array([UP[up]], float))[0]
    assert found[2] > np.cos(np.radians(1.0))
    assert (word == "") == (up == "z")
    assert (f"nearest to {up}," in word) == (up != "z")


def test_a_camera_frame_without_pose_becomes_upright() -> None:
    """As of a single depth image: y is down and tilted, for the camera looked down by 25 degrees."""
    scan = camera((3.0, 3.0, 0.0)).with_facts(world_from_sensor=Pose.identity())
    turn, word = upright([scan], "auto", of_points=False)
    points = turn.apply(scan.points()[scan.valid])
    lowest, count = np.unique(np.round(points[:, 2], 2), return_counts=True)
    assert lowest[np.argmax(count)] == pytest.approx(-1.6, abs=0.02)  # the floor, below the camera
    assert "--up z keeps" in word


def test_cameras_that_look_steeply_down_do_not_turn_a_world() -> None:
    for height in (-0.5, -3.0, -5.0):
        turn, word = upright([camera((2.0, 2.0, height))], "auto", of_points=False)
        np.testing.assert_array_equal(turn.matrix, np.eye(4))
        assert word == ""


def test_without_level_surface_the_camera_decides() -> None:
    scan = camera((3.0, 3.0, 1.6)).with_facts(world_from_sensor=Pose.identity())
    blind = RangeImage(
        np.where(np.arange(72)[:, None] < 70, np.inf, scan.ranges), scan.projection, Pose.identity()
    )
    turn, word = upright([blind], "auto", of_points=False)
    assert turn.apply(np.array([[0.0, -1.0, 0.0]]))[0, 2] > 0.6
    assert "nearest to -y" in word


@pytest.mark.parametrize("up", first_in_gate(1, ["x", "y", "z", "-y"]))
def test_points_without_a_grid_may_lie(up: str, tmp_path) -> None:
    rays = np.random.default_rng(0).normal(size=(40_000, 3))
    rays[:, 2] -= 0.3
    stood, low, high = np.array([1.0, 2.0, 1.6]), np.zeros(3), np.array([7.0, 5.0, 2.6])
    with np.errstate(divide="ignore"):
        reach = np.where(rays > 0, (high - stood) / rays, (low - stood) / rays).min(axis=1)
        table = (0.8 - 1.6) / rays[:, 2]
    on_table = np.abs(stood + table[:, None] * rays - [3.5, 2.5, 0.8]).max(axis=1) < 1.0
    reach = np.where(on_table & (rays[:, 2] < 0), table, reach)
    turn = lying(up)
    np.savetxt(tmp_path / "room.xyz", turn.apply(stood + reach[:, None] * rays))
    place = tuple(float(c) for c in turn.apply(stood[None])[0])
    request = ScanRequest((str(tmp_path / "room.xyz"),), origins=(place,), up="auto")
    given = read_request(request)
    heights = given.scans[0].points()[given.scans[0].valid][:, 2] - given.scans[0].origin[2]
    assert (heights.min(), heights.max()) == pytest.approx((-1.6, 1.0), abs=1e-6)
    assert any("by the area of level surfaces" in text for text in given.doubts) == (up != "z")


def test_an_unknown_axis_is_refused() -> None:
    with pytest.raises(InputError, match="up must be auto, x, y, z, -x, -y, -z, got 'w'"):
        upright([], "w", of_points=False)  # type: ignore[arg-type]


@pytest.mark.long
@pytest.mark.parametrize("options", [(), pytest.param(("--up", "-y"), marks=pytest.mark.long)])
def test_complete_calls_a_floor_a_floor(tmp_path, options: tuple[str, ...], monkeypatch) -> None:
    write_scan(camera((3.0, 3.0, 0.6)).transform(lying("-y")), tmp_path / "room.npz")
    out = tmp_path / "out"
    done = CliRunner().invoke(
        app, ["complete", str(tmp_path / "room.npz"), *options, "--no-texture", "-o", str(out)]
    )
    assert done.exit_code == 0, done.stderr
    planes = json.loads((out / "polygons.json").read_text())["surfaces"]
    level = [plane for plane in planes if abs(plane["plane"]["normal"][2]) > 0.99]
    assert "floor" in {plane["role"] for plane in level}
    assert all(plane["role"] != "wall" for plane in level)
    told = [text for text in json.loads((out / "completion.json").read_text())["warnings"] if "up is" in text]
    assert len(told) == (not options)
    assert json.loads((out / "manifest.json").read_text())["options"]["up"] == (options or ("", "auto"))[1]


REAL = {
    "align3d_sample1": ("-y", {}),
    "align3d_sample2": ("y", {}),
    "open3d_redwood": ("y", {}),
    "icl_nuim": ("y", {"intrinsics": (481.2, -480, 319.5, 239.5), "depth_scale": 5000}),
    "nyu_dining": ("-y", {"intrinsics": (518, 519, 325.5, 253.5), "depth_scale": 1000}),
    "pcl/office1.pcd": ("y", {}),
    "mOSD/learn0.pcd": ("-y", {}),
    "e57/pumpA.e57": ("z", {}),
    "tdtk": ("z", {}),
}


@requires_data
@pytest.mark.parametrize("name", first_in_gate(4, REAL))
def test_up_of_real_scans(name: str) -> None:
    axis, camera = REAL[name]
    scans = read_scans(data_path(f"range/{name}"), **camera)  # type: ignore[arg-type]
    _, word = upright(scans, "auto", of_points=False)
    assert word == "" if axis == "z" else f"nearest to {axis}," in word
