# SPDX-License-Identifier: MIT
"""Folders of frame-NNNNNN.{depth,color,pose}, numbers for no return, and poses as matrices."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from scenes.checks import InputError
from scenes.io.poses.trajectory import read_poses
from scenes.io.scan_files import read_scan, read_scans, write_scan
from scenes.pose import Pose
from scenes.scan.projection import PinholeProjection, SphericalProjection
from scenes.scan.range_image import RangeImage, saturation_start, without_saturated

CAMERA = (585.0, 585.0, 3.5, 2.5)
SHAPE = (6, 8)


def fill(folder: Path, n_frames: int = 3, colour: str = "png", depth: int = 1500) -> Path:
    for k in range(n_frames):
        counts = np.full(SHAPE, depth, np.uint16)
        counts[0, :3] = 65535
        Image.fromarray(counts).save(folder / f"frame-{k:06d}.depth.png")
        Image.fromarray(np.full((*SHAPE, 3), 10 * k, np.uint8)).save(folder / f"frame-{k:06d}.color.{colour}")
        rows = [f"1 0 0 {k}\t", "0\t1 0 0", "0 0 1 0", "0 0 0 1 "]
        (folder / f"frame-{k:06d}.pose.txt").write_text("\n".join(rows) + "\n")
    return folder


@pytest.mark.parametrize("colour", ["png", "jpg"])
def test_seven_scenes_are_read_in_millimetres_with_their_poses(tmp_path: Path, colour: str) -> None:
    scans = read_scans(fill(tmp_path, colour=colour), intrinsics=CAMERA)
    assert [float(scan.origin[0]) for scan in scans] == [0, 1, 2]
    for scan in scans:
        assert (~scan.valid).sum() == 3
        np.testing.assert_allclose(scan.points_in_sensor()[scan.valid][:, 2], 1.5)
        assert scan.warnings[0].startswith("3 of 48 depths are 65535: a full number")


def test_the_camera_is_asked_for_or_lies_there(tmp_path: Path) -> None:
    fill(tmp_path)
    with pytest.raises(InputError, match=r"intrinsics .*585,585,320,240 for 7-Scenes"):
        read_scans(tmp_path)
    (tmp_path / "camera-intrinsics.txt").write_text("585 0 3.5\n0 585 2.5\n0 0 1\n")
    assert read_scan(f"{tmp_path}#2").projection == PinholeProjection(8, 6, *CAMERA)


@pytest.mark.parametrize("lost", ["nan " * 16, "-inf -inf -inf -inf\n" * 4, None])
def test_frames_without_pose_are_left_out_with_a_count(tmp_path: Path, lost: str | None) -> None:
    fill(tmp_path)
    pose = tmp_path / "frame-000001.pose.txt"
    pose.unlink() if lost is None else pose.write_text(lost)
    scans = read_scans(tmp_path, intrinsics=CAMERA)
    assert [float(scan.origin[0]) for scan in scans] == [0, 2]
    assert "1 of 3 frames has no pose and was left out" in scans[0].warnings


def test_unusable_poses_of_frames_are_refused(tmp_path: Path) -> None:
    fill(tmp_path)
    pose = tmp_path / "frame-000001.pose.txt"
    pose.write_text("nan " * 4 + "1 " * 12)
    with pytest.raises(InputError, match=r"frame-000001\.pose\.txt: pose 1 is not usable"):
        read_scans(tmp_path, intrinsics=CAMERA)
    pose.write_text("1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n" * 2)
    with pytest.raises(InputError, match=r"frame-000001\.pose\.txt holds 2 poses; expected one"):
        read_scans(tmp_path, intrinsics=CAMERA)
    for path in tmp_path.glob("*.pose.txt"):
        path.unlink()
    with pytest.raises(InputError, match="3 frames without poses"):
        read_scans(tmp_path, intrinsics=CAMERA)


def test_poses_as_matrices_of_any_form(tmp_path: Path) -> None:
    poses = [Pose.looking_at((k, 1, 2), (5, k, 1)) for k in range(4)]
    forms = {
        "square": "\n".join(
            "\n".join(" ".join(map(repr, map(float, row))) for row in p.matrix) for p in poses
        ),
        "kitti": "\n".join(" ".join(map(repr, map(float, p.matrix[:3].ravel()))) for p in poses),
        "whole": "\n".join(" ".join(map(repr, map(float, p.matrix.ravel()))) for p in poses),
    }
    for name, text in forms.items():
        (tmp_path / name).write_text(text)
        for found, pose in zip(read_poses(tmp_path / name), poses, strict=True):
            np.testing.assert_allclose(found.matrix, pose.matrix, atol=1e-12)
    (tmp_path / "cut").write_text(forms["square"].rsplit("\n", 1)[0])
    with pytest.raises(InputError, match="15 lines of four numbers are no whole number of 4x4"):
        read_poses(tmp_path / "cut")


def test_poses_as_matrices_serve_a_folder(tmp_path: Path) -> None:
    (tmp_path / "depth").mkdir()
    for k in (1, 2):
        Image.fromarray(np.full(SHAPE, 1000, np.uint16)).save(tmp_path / "depth" / f"{k}.png")
    (tmp_path / "pose.txt").write_text("1 0 0 4 0 1 0 0 0 0 1 0\n1 0 0 5 0 1 0 0 0 0 1 0\n")
    scans = read_scans(tmp_path, intrinsics=CAMERA, depth_scale=1000)
    assert [float(scan.origin[0]) for scan in scans] == [4, 5]


@pytest.mark.parametrize(("code", "left_out"), [(65535, True), (32767, True), (8191, True), (9000, False)])
def test_full_numbers_of_depth_images_are_no_return(tmp_path: Path, code: int, left_out: bool) -> None:
    (tmp_path / "depth").mkdir()
    counts = np.full((40, 40), 1500, np.uint16)
    counts[:8, :8] = code  # a wall beyond a door has one depth as well: only full numbers are codes
    Image.fromarray(counts).save(tmp_path / "depth" / "1.png")
    scan = read_scan(tmp_path, intrinsics=(500, 500, 20, 20), depth_scale=1000)
    assert (~scan.valid).sum() == 64 * left_out
    assert any(f"64 of 1600 depths are {code}" in text for text in scan.warnings) == left_out


def room(far: float | None) -> RangeImage:
    grid = SphericalProjection.regular(90, 60, 90.0, (-30.0, 30.0))
    ranges = 4.0 / np.abs(grid.directions()).max(axis=-1)
    if far is not None:
        ranges[5:40:5, 5:60:5] = far
    return RangeImage(ranges, grid, Pose.identity(), name="room")


def test_ranges_that_are_full_over_and_over_are_no_return_in_other_formats(tmp_path: Path) -> None:
    full = room(120.0)
    write_scan(full, tmp_path / "full.e57")
    found = read_scan(tmp_path / "full.e57")
    assert (~found.valid).sum() == 7 * 11
    assert any(text.startswith("77 of 5400 ranges are 120 ") for text in found.warnings)
    write_scan(full, tmp_path / "full.npz")  # our own say what is no return
    assert read_scan(tmp_path / "full.npz").valid.all()


@pytest.mark.parametrize("far", [None, 4.2, 5.0])
def test_true_ranges_stay(far: float | None) -> None:
    assert without_saturated(room(far)).valid.all()


def test_a_ring_of_equal_ranges_is_none_and_neither_is_a_strayed_one() -> None:
    grid = SphericalProjection.regular(200, 40, 360.0, (-60.0, -3.0))
    floor = RangeImage(1.6 / grid.directions()[..., 1], grid, Pose.identity())
    assert without_saturated(floor).valid.all()
    ranges = np.random.default_rng(0).uniform(1, 5, 1000)
    assert saturation_start(np.append(ranges, [30.0] * 19)) == np.inf
    assert saturation_start(np.append(ranges, [30.0] * 20)) == 30.0
    assert saturation_start(np.append(ranges, [30.0] * 20 + [27.0] * 2)) == np.inf
    assert saturation_start(np.zeros(0)) == np.inf


@pytest.mark.parametrize(("name", "text"), [("poses.json", "[]"), ("poses.txt", "# none\n")])
def test_a_file_without_poses_is_refused_by_name(tmp_path, name, text):
    (tmp_path / name).write_text(text, "utf-8")
    with pytest.raises(InputError, match=rf"{name}: holds no poses"):
        read_poses(tmp_path / name)
