# SPDX-License-Identifier: MIT
"""Up is what was said, or estimated with its deviation; no coordinate is turned by it."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from completion import CompletionOptions, complete
from completion.room.pipeline import estimate_up
from nbv import PinholeSensor, scan_scene
from nbv.cli import app
from nbv.report.completion_report import scans_of
from scenes import Pose, builtin_scene
from scenes.checks import InputError
from scenes.inclination import AXES, Up, axis_direction
from scenes.io.scan_files import read_scans, write_scan
from scenes.io.scan_request import ScanRequest, read_request
from scenes.scan.range_image import RangeImage
from tests.helpers.data_paths import data_path, requires_data
from tests.helpers.long_cases import first_in_gate


def lying(up: str) -> Pose:
    """The turn of a world in which z is up into one in which the axis is."""
    return Up(axis_direction(up)).drawing_from_world.inverse()


def camera(
    target: tuple[float, float, float], eye: tuple[float, float, float] = (0.5, 0.5, 1.6)
) -> RangeImage:
    sensor = PinholeSensor(fov_deg=70, width=96, height=72)
    return scan_scene(builtin_scene("two_occluders"), Pose.looking_at(eye, target), sensor, rng=0)


@pytest.mark.parametrize("up", AXES)
def test_drawings_are_turned_so_that_up_is_z(up: str) -> None:
    said = Up.along(up)
    assert said is not None
    assert said.word == ""
    np.testing.assert_allclose(said.drawing_from_world.rotate(said.direction[None]), [[0, 0, 1]], atol=1e-12)


@pytest.mark.parametrize("up", first_in_gate(2, AXES))
@pytest.mark.parametrize("target", [(3.0, 3.0, 1.0), (3.0, 2.0, 0.2), (3.0, 3.0, 1.6)])
def test_cameras_tell_up_in_any_world(up: str, target: tuple[float, float, float]) -> None:
    found = estimate_up([camera(target).transform(lying(up))])
    assert found.is_decided
    assert found.direction @ axis_direction(up) > np.cos(np.radians(1.0))
    assert (found.word == "") == (up == "z")


def test_a_camera_that_looks_down_stays_where_it_is() -> None:
    """As of a single depth image: y is down and tilted, for the camera looked down by 25 degrees."""
    scan = camera((3.0, 3.0, 0.0)).with_facts(world_from_sensor=Pose.identity())
    found = estimate_up([scan])
    heights = scan.points()[scan.valid] @ found.direction
    lowest, count = np.unique(np.round(heights, 2), return_counts=True)
    assert lowest[np.argmax(count)] == pytest.approx(-1.6, abs=0.02)  # the floor, below the camera
    assert "coordinates stay as they are" in found.word


def test_without_level_surface_the_camera_decides() -> None:
    scan = camera((3.0, 3.0, 1.6)).with_facts(world_from_sensor=Pose.identity())
    blind = RangeImage(
        np.where(np.arange(72)[:, None] < 70, np.inf, scan.ranges), scan.projection, Pose.identity()
    )
    found = estimate_up([blind])
    assert found.direction @ [0.0, -1.0, 0.0] > 0.6
    assert not found.is_decided
    assert "undecided" in found.word


@pytest.mark.parametrize("up", first_in_gate(1, ["y", "z"]))
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
    found = estimate_up(list(read_request(request).scans))
    is_right = found.direction @ axis_direction(up) > np.cos(np.radians(1.0))
    assert is_right or not found.is_decided


def test_an_unknown_axis_is_refused() -> None:
    with pytest.raises(InputError, match="up must be auto, x, y, z, -x, -y, -z, got 'w'"):
        axis_direction("w")


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
    level = [plane for plane in planes if abs(plane["plane"]["normal"][1]) > 0.99]
    assert "floor" in {plane["role"] for plane in level}
    assert all(plane["role"] != "wall" for plane in level)
    record = json.loads((out / "completion.json").read_text())
    assert record["up"][1] < -0.999
    told = [text for text in record["warnings"] if "up is" in text]
    assert len(told) == (not options)
    assert json.loads((out / "manifest.json").read_text())["options"]["up"] == (options or ("", "auto"))[1]


REAL = {
    "pcl/office1.pcd": ((0.01, 1.0, -0.03), {}),
    "mOSD/learn0.pcd": ((0.006, -0.8, -0.601), {}),
    "align3d_sample1": ((0.01, -0.962, -0.272), {}),
    "icl_nuim": ((0, 1, 0), {"intrinsics": (481.2, -480, 319.5, 239.5), "depth_scale": 5000}),
    "align3d_sample2": ((0.025, 1.0, 0.0), {}),
    "open3d_redwood": ((-0.01, 1.0, 0.0), {}),
    "nyu_dining": ((-0.097, -0.951, -0.293), {"intrinsics": (518, 519, 325.5, 253.5), "depth_scale": 1000}),
    "e57/pumpA.e57": ((0, 0, 1), {}),
    "tdtk": ((0, 0, 1), {}),
    "nvblox_3dmatch": ((0, 1, 0), {}),
}
"""Normals of the main floors, by hand: of the plane that a person calls the floor, or the table, in each."""


@requires_data
@pytest.mark.parametrize("name", first_in_gate(2, REAL))
def test_up_of_real_scans(name: str) -> None:
    up, camera = REAL[name]
    found = estimate_up(read_scans(data_path(f"range/{name}"), **camera))  # type: ignore[arg-type]
    angle = np.degrees(np.arccos(np.clip(found.direction @ up / np.linalg.norm(up), -1, 1)))
    assert angle < 2.5
    assert found.is_decided


@pytest.mark.parametrize("direction", [(0.0, 0.0, 0.0), (np.nan, 0.0, 1.0), (1.0, 0.0)])
def test_what_is_no_direction_is_refused(direction: tuple[float, ...]) -> None:
    with pytest.raises(InputError, match="up"):
        Up(np.array(direction))


def test_a_direction_of_any_length_is_one() -> None:
    np.testing.assert_allclose(Up(np.array([0.0, -3.0, 0.0])).direction, [0, -1, 0])


def test_cameras_held_in_all_ways_leave_up_undecided_without_level_surface() -> None:
    scan = camera((3.0, 3.0, 1.6))
    upside = Pose.from_parts(np.diag([-1.0, -1.0, 1.0]), np.zeros(3))
    blind = RangeImage(np.full(scan.shape, np.inf), scan.projection, Pose.identity())
    found = estimate_up([blind, blind.with_facts(world_from_sensor=upside)])
    assert np.isfinite(found.direction).all()
    assert not found.is_decided


def test_a_report_tells_where_a_camera_looks_by_what_is_up() -> None:
    """A camera that looks 25 degrees down, in a world in which -y is up: z of its direction tells nothing."""
    scan = camera((3.0, 3.0, 0.0)).transform(lying("-y"))
    done = complete(scan, CompletionOptions(texture=False, relations=None, features=None), rng=0)
    _, _, position, _, elevation, *_ = scans_of(done).rows[0]
    true = np.degrees(np.arcsin(-1.6 / np.linalg.norm([2.5, 2.5, 1.6])))
    assert float(elevation.text) == pytest.approx(true, abs=1.5)
    assert position.text == ", ".join(f"{value:.2f}" for value in scan.origin)  # in the world of its pose
