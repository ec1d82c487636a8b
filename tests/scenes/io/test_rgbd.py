# SPDX-License-Identifier: MIT
"""RGB-D folders in every layout, their cameras and poses, and the refusals with their cures."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from scenes.checks import InputError
from scenes.io.poses.trajectory import natural_key
from scenes.io.scan_files import read_scan, read_scans
from scenes.scan.projection import PinholeProjection

CAMERA = (6.0, 5.0, 3.5, 2.5)
SHAPE = (6, 8)


def save(values: "np.ndarray[Any, Any]", path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(values).save(path)


def fill_plain(folder: Path, n_frames: int = 2, depth: int = 2000, colour: str = "color") -> None:
    for k in range(1, n_frames + 1):
        save(np.full(SHAPE, depth + k, np.uint16), folder / "depth" / f"{k}.png")
        save(np.full((*SHAPE, 3), 10 * k, np.uint8), folder / colour / f"{k}.png")
    (folder / "pose.txt").write_text("".join(f"{k} 0 0 0 0 0 1\n" for k in range(1, n_frames + 1)))


@pytest.mark.parametrize("colour", ["color", "colour", "rgb", "image"])
def test_plain_folder_with_options(tmp_path: Path, colour: str) -> None:
    fill_plain(tmp_path, 11, colour=colour)
    scans = read_scans(tmp_path, intrinsics=CAMERA, depth_scale=1000)
    assert [float(scan.origin[0]) for scan in scans] == list(range(1, 12))  # 10 after 9
    np.testing.assert_allclose(scans[9].points_in_sensor()[..., 2], 2.010, rtol=1e-12)
    assert scans[9].colour is not None
    assert (scans[9].colour[0, 0, 0], scans[9].colour.dtype) == (100, np.uint8)
    ray = np.array([(7 - 3.5) / 6.0, (5 - 2.5) / 5.0, 1.0])
    np.testing.assert_allclose(scans[9].points_in_sensor()[5, 7], 2.010 * ray)


def test_zero_depth_means_nothing_came_back(tmp_path: Path) -> None:
    fill_plain(tmp_path, 1, depth=-1)  # frame 1 holds depth + 1
    assert not read_scan(tmp_path, intrinsics=CAMERA, depth_scale=1000).valid.any()


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("camera.json", '{"fx": 6, "fy": 5, "cx": 3.5, "cy": 2.5, "depth_scale": 1000}'),
        ("intrinsics.txt", "6 5 3.5 2.5 1000"),
    ],
)
def test_a_camera_file_tells_everything(tmp_path: Path, name: str, text: str) -> None:
    fill_plain(tmp_path)
    (tmp_path / name).write_text(text)
    scan = read_scan(f"{tmp_path}#1")
    assert scan.projection == PinholeProjection(8, 6, *CAMERA)
    np.testing.assert_allclose(scan.points_in_sensor()[..., 2], 2.001)
    assert read_scan(f"{tmp_path}#1", intrinsics=(9, 9, 1, 1)).projection.pixel_angle == 1 / 9
    half = read_scan(f"{tmp_path}#1", depth_scale=2000)
    np.testing.assert_allclose(half.ranges, scan.ranges / 2)


def test_a_matrix_file_is_a_camera_without_scale(tmp_path: Path) -> None:
    fill_plain(tmp_path)
    (tmp_path / "intrinsics.txt").write_text("6 0 3.5\n0 5 2.5\n0 0 1\n")
    with pytest.raises(InputError, match=r"tells the depth values a metre \(--depth-scale N"):
        read_scan(f"{tmp_path}#1")
    assert read_scan(f"{tmp_path}#1", depth_scale=1000).projection == PinholeProjection(8, 6, *CAMERA)


def test_nothing_is_assumed_of_an_unknown_camera(tmp_path: Path) -> None:
    fill_plain(tmp_path)
    with pytest.raises(InputError, match=r"--intrinsics FX,FY,CX,CY\) and the depth values a metre"):
        read_scan(f"{tmp_path}#1")
    with pytest.raises(InputError, match="must be a positive number of depth values a metre, got -5"):
        read_scan(f"{tmp_path}#1", intrinsics=CAMERA, depth_scale=-5)


def test_redwood_layout(tmp_path: Path) -> None:
    fill_plain(tmp_path)
    (tmp_path / "pose.txt").unlink()
    block = "1 0 0 {x}\n0 1 0 0\n0 0 1 0\n0 0 0 1\n"
    (tmp_path / "trajectory.log").write_text("".join(f"{k} {k} 2\n" + block.format(x=k + 4) for k in (0, 1)))
    matrix = [6, 0, 0, 0, 5, 0, 3.5, 2.5, 1]  # column by column
    values = {"width": 8, "height": 6, "intrinsic_matrix": matrix}
    (tmp_path / "camera_primesense.json").write_text(json.dumps(values))
    scans = read_scans(tmp_path)
    assert [float(scan.origin[0]) for scan in scans] == [4, 5]
    assert scans[0].projection == PinholeProjection(8, 6, *CAMERA)
    np.testing.assert_allclose(scans[1].points_in_sensor()[..., 2], 2.002)
    (tmp_path / "camera_primesense.json").write_text(json.dumps(values | {"width": 640}))
    with pytest.raises(InputError, match=r"is 8 x 6, its camera file says \(640, 6\)"):
        read_scans(tmp_path)


@pytest.mark.parametrize("associated", [False, True])
def test_tum_layout(tmp_path: Path, associated: bool) -> None:
    fill_plain(tmp_path, 3, depth=10000, colour="rgb")
    (tmp_path / "pose.txt").unlink()
    if associated:
        rows = [f"{k}.01 rgb/{k}.png {k}.0 depth/{k}.png\n" for k in (1, 2, 3)]
        (tmp_path / "associations.txt").write_text("".join(rows))
    else:
        (tmp_path / "depth.txt").write_text(
            "# depth\n" + "".join(f"{k}.0 depth/{k}.png\n" for k in (1, 2, 3))
        )
        (tmp_path / "rgb.txt").write_text("".join(f"{k}.015 rgb/{k}.png\n" for k in (1, 2, 3)))
    poses = "".join(f"{t} {t} 0 0 0 0 0 1\n" for t in (1.0, 1.5, 2.01, 3.2))
    (tmp_path / "groundtruth.txt").write_text("# timestamp tx ...\n" + poses)
    scans = read_scans(tmp_path, intrinsics=CAMERA)
    assert [float(scan.origin[0]) for scan in scans] == [1.0, 2.01]  # the third is 0.2 s from any pose
    np.testing.assert_allclose(scans[1].points_in_sensor()[..., 2], 10002 / 5000)
    assert scans[1].colour is not None
    assert scans[1].colour[0, 0, 0] == 20


def test_align3d_layout(tmp_path: Path) -> None:
    pose = np.eye(4)
    pose[:3, 3] = [1, 2, 3]
    entries = []
    for k in (0, 1):
        info = {"kcam": {"matrix": [[6, 0, 3.5], [0, 5, 2.5], [0, 0, 1]], "image_size": [8, 6]}}
        info |= {"depth_scale": 0.001, "rt_cam": {"matrix": pose.tolist()}}  # type: ignore[dict-item]
        entries.append({"info": info, "depth_image": f"{k}_depth.png", "rgb_image": f"{k}_rgb.png"})
    save(np.full(SHAPE, 1500, np.uint16), tmp_path / "1_depth.png")
    save(np.zeros((*SHAPE, 3), np.uint8), tmp_path / "1_rgb.png")
    (tmp_path / "frames.json").write_text(json.dumps({"root": entries}))
    (scan,) = read_scans(tmp_path)  # the frame without images is skipped
    np.testing.assert_allclose(scan.points()[..., 2], 4.5)
    entries[0]["depth_image"] = "../../etc/passwd"
    (tmp_path / "frames.json").write_text(json.dumps({"root": entries}))
    with pytest.raises(InputError, match=r"names '../../etc/passwd', which lies outside the folder"):
        read_scans(tmp_path)


def test_frames_without_poses_are_refused_but_one_is_read(tmp_path: Path) -> None:
    fill_plain(tmp_path)
    (tmp_path / "pose.txt").unlink()
    with pytest.raises(InputError, match=r"2 frames without poses; give --poses FILE, put a pose\.txt there"):
        read_scans(tmp_path, intrinsics=CAMERA, depth_scale=1000)
    scan = read_scan(f"{tmp_path}#2", intrinsics=CAMERA, depth_scale=1000)
    np.testing.assert_array_equal(scan.world_from_sensor.matrix, np.eye(4))


def test_unequal_numbers_and_sizes_are_refused(tmp_path: Path) -> None:
    fill_plain(tmp_path)
    (tmp_path / "pose.txt").write_text("0 0 0 0 0 0 1\n")
    with pytest.raises(InputError, match=r"holds 2 depth images, but pose\.txt has 1 poses"):
        read_scans(tmp_path)
    (tmp_path / "pose.txt").unlink()
    save(np.zeros((12, 12, 3), np.uint8), tmp_path / "color" / "1.png")
    with pytest.raises(InputError, match=r"1\.png: is 12 x 12, its depth image 8 x 6; register the depth"):
        read_scan(f"{tmp_path}#1", intrinsics=CAMERA, depth_scale=1000)
    (tmp_path / "color" / "2.png").unlink()
    with pytest.raises(InputError, match="holds 1 colour and 2 depth images"):
        read_scans(tmp_path)


def test_images_that_cannot_hold_depth_are_refused(tmp_path: Path) -> None:
    fill_plain(tmp_path)
    save(np.zeros(SHAPE, np.uint8), tmp_path / "depth" / "1.png")
    with pytest.raises(
        InputError, match=r"depth/1\.png: has mode L \(8 bits a channel\), which cannot hold depth"
    ):
        read_scan(f"{tmp_path}#1", intrinsics=CAMERA, depth_scale=1000)
    (tmp_path / "depth" / "1.png").write_bytes(b"")
    with pytest.raises(InputError, match=r"1\.png: is empty \(0 bytes\)"):
        read_scan(f"{tmp_path}#1", intrinsics=CAMERA, depth_scale=1000)
    (tmp_path / "depth" / "1.png").write_bytes(b"\x89PNG\r\n\x1a\n broken")
    with pytest.raises(InputError, match=r"1\.png: is no image that is known"):
        read_scan(f"{tmp_path}#1", intrinsics=CAMERA, depth_scale=1000)


@pytest.mark.parametrize("text", ["1 2 3", "{}", "[", '{"fx": "a", "fy": 1, "cx": 1, "cy": 1}'])
def test_unusable_camera_files_are_named(tmp_path: Path, text: str) -> None:
    fill_plain(tmp_path)
    name = "camera.txt" if text[0].isdigit() else "camera.json"
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=name):
        read_scans(tmp_path)


def test_natural_order() -> None:
    names = ["10.png", "9.png", "a2.png", "a10.png", "1.png"]
    assert sorted(names, key=natural_key) == ["1.png", "9.png", "10.png", "a2.png", "a10.png"]
    assert sorted(["m².png", "m1.png"], key=natural_key) == ["m1.png", "m².png"]  # no decimal digit


def test_a_trajectory_with_times_serves_the_frames_nearest_to_them(tmp_path: Path) -> None:
    fill_plain(tmp_path, 3, depth=10000, colour="rgb")
    (tmp_path / "pose.txt").unlink()
    (tmp_path / "depth.txt").write_text("".join(f"{k}.0 depth/{k}.png\n" for k in (1, 2, 3)))
    (tmp_path / "rgb.txt").write_text("".join(f"{k}.015 rgb/{k}.png\n" for k in (1, 2, 3)))
    stamps = [round(0.9 + 0.01 * k, 2) for k in range(220)]  # 100 poses a second
    lines = [f"{time} {time} 0 0 0 0 0 1\n" for time in stamps]
    (tmp_path / "estimate.txt").write_text("".join(lines))
    scans = read_scans(tmp_path, intrinsics=CAMERA, poses=tmp_path / "estimate.txt")
    assert [float(scan.origin[0]) for scan in scans] == [1.0, 2.0, 3.0]
    (tmp_path / "short.txt").write_text("".join(lines[:150]))
    with pytest.raises(
        InputError, match=r"1 of 3 frames have no pose within 0\.02 s, the first at 3\.000000"
    ):
        read_scans(tmp_path, intrinsics=CAMERA, poses=tmp_path / "short.txt")
    second = read_scan(f"{tmp_path}#2", intrinsics=CAMERA, poses=tmp_path / "short.txt")
    assert float(second.origin[0]) == 2.0
