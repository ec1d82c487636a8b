# SPDX-License-Identifier: MIT
"""Recordings of phones and data sets: the room stands where it is, in every layout."""

import csv
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from scenes.checks import InputError
from scenes.io.scan_files import open_scans, read_scan, read_scans
from scenes.pose import Pose
from scenes.scan.range_image import RangeImage
from tests.helpers.rgbd_rooms import (
    Y_UP,
    Frame,
    off_walls,
    save,
    see_room,
    write_arkitscenes,
    write_polycam,
    write_record3d,
    write_rtabmap,
    write_scannet,
    write_stray,
    write_video,
)

STEP_M = 0.0005  # half of a millimetre
Write = Callable[[Path, list[Frame]], None]
WRITERS: dict[str, tuple[str, Write]] = {
    "stray": ("Stray Scanner", write_stray),
    "stray, own intrinsics": ("Stray Scanner", partial(write_stray, own=True)),
    "stray, arrays": ("Stray Scanner", partial(write_stray, suffix="npy")),
    "stray, z up": ("Stray Scanner", partial(write_stray, world=np.eye(4))),
    "polycam": ("Polycam", write_polycam),
    "polycam, ARKit's cameras alone": ("Polycam", partial(write_polycam, corrected=False)),
    "rtabmap, numbers": ("RTAB-Map", write_rtabmap),
    "rtabmap, times": ("RTAB-Map", partial(write_rtabmap, form="stamp")),
    "rtabmap, matrices": ("RTAB-Map", partial(write_rtabmap, form="matrix")),
    "rtabmap, robot": ("RTAB-Map", partial(write_rtabmap, robot=True)),
    "scannet": ("ScanNet", write_scannet),
    "scannet, aligned": ("ScanNet", partial(write_scannet, aligned=True)),
    "arkitscenes": ("ARKitScenes", write_arkitscenes),
    "arkitscenes, late": ("ARKitScenes", partial(write_arkitscenes, late_s=0.001)),
}


@pytest.fixture(scope="module")
def frames() -> list[Frame]:
    return see_room()


def check_room(scans: list[RangeImage], frames: list[Frame], step_m: float = STEP_M) -> None:
    """Points lie on the walls to the step of depth, which counts along the ray; y may be up in the world."""
    assert len(scans) == len(frames)
    if any("the world of ARKit" in sentence for sentence in scans[0].warnings):
        is_turned = np.allclose(scans[0].world_from_sensor.matrix, Y_UP @ frames[0].matrix, atol=1e-6)
        scans = [scan.transform(Pose(Y_UP.T)) for scan in scans] if is_turned else scans
    for scan, frame in zip(scans, frames, strict=True):
        slant = float((1 / scan.projection.directions()[..., 2]).max())
        np.testing.assert_allclose(scan.world_from_sensor.matrix, frame.matrix, atol=1e-6)
        assert scan.valid.all()
        assert off_walls(scan.points()[scan.valid]) < slant * step_m + 1e-5


def said(scans: list[RangeImage]) -> str:
    return " ".join(sentence for scan in scans for sentence in scan.warnings)


@pytest.mark.parametrize("name", WRITERS)
def test_the_room_stands_where_it_is(tmp_path: Path, frames: list[Frame], name: str) -> None:
    layout, write = WRITERS[name]
    write(tmp_path, frames)
    source = open_scans(tmp_path)
    assert (source.kind, source.registered) == (f"rgbd ({layout})", True)
    scans = source.read()
    check_room(scans, frames)
    if layout != "Stray Scanner":
        assert [round(float(np.mean(scan.colour)), -1) for scan in scans if scan.colour is not None] == [
            frame.grey for frame in frames
        ]
    assert ("the world of ARKit has y up" in said(scans)) == (layout in ("Stray Scanner", "Polycam"))


@pytest.mark.parametrize("per_frame", [True, False])
def test_record3d_is_in_the_world_of_its_first_camera(
    tmp_path: Path, frames: list[Frame], per_frame: bool
) -> None:
    write_record3d(tmp_path / "EXR_RGBD", frames, per_frame=per_frame)
    scans = read_scans(tmp_path)
    back = frames[0].matrix @ np.linalg.inv(scans[0].world_from_sensor.matrix)
    for scan, frame in zip(scans, frames, strict=True):
        np.testing.assert_allclose(back @ scan.world_from_sensor.matrix, frame.matrix, atol=1e-6)
        points = scan.points()[scan.valid] @ back[:3, :3].T + back[:3, 3]
        assert off_walls(points) < 1e-5
        assert scan.colour is not None
    np.testing.assert_allclose(scans[0].world_from_sensor.rotation[:, 1], [0, -1, 0], atol=1e-9)
    assert "y is up only as far as the phone was held level" in said(scans)


@pytest.mark.parametrize("name", ["stray", "polycam", "arkitscenes", "stray, own intrinsics"])
def test_depths_of_the_lowest_confidence_are_no_return(
    tmp_path: Path, frames: list[Frame], name: str
) -> None:
    WRITERS[name][1](tmp_path, frames)
    for number, path in enumerate(sorted(tmp_path.rglob("confidence/*.png"))):
        levels = np.full((48, 64), 255 if name == "polycam" else 1, np.uint8)
        levels[:, : 2 + number] = 0
        save(path, levels)
    scans = read_scans(tmp_path)
    assert [int((~scan.valid).sum()) for scan in scans] == [48 * (2 + k) for k in range(4)]
    assert "96 of 3072 depths have the lowest confidence and were left out" in said(scans[:1])


@pytest.mark.parametrize("name", WRITERS)
def test_frames_without_pose_are_left_out_with_a_count(
    tmp_path: Path, frames: list[Frame], name: str
) -> None:
    layout, write = WRITERS[name]
    write(tmp_path, frames)
    if layout == "Polycam":
        folder = "corrected_cameras" if (tmp_path / "keyframes/corrected_cameras").is_dir() else "cameras"
        sorted((tmp_path / "keyframes" / folder).iterdir())[1].unlink()
    elif layout == "ScanNet":
        (tmp_path / "pose" / "1.txt").write_text("-inf -inf -inf -inf\n" * 4)
    else:
        texts = (path for path in tmp_path.iterdir() if path.suffix in (".csv", ".txt", ".traj"))
        (file,) = (path for path in texts if path.stem != "camera_matrix")
        lines = file.read_text().splitlines()
        second = 1 if layout == "ARKitScenes" else 2  # after a header
        lines[second : second + 1] = [" ".join(["nan"] * 12)] if name == "rtabmap, matrices" else []
        file.write_text("\n".join(lines))
    scans = read_scans(tmp_path)
    check_room(scans, [frames[0], *frames[2:]])
    assert "1 of 4 frames has no pose and was left out" in said(scans)


def test_frames_without_intrinsics_are_left_out_with_a_count(tmp_path: Path, frames: list[Frame]) -> None:
    write_arkitscenes(tmp_path, frames)
    for path in sorted((tmp_path / "lowres_wide_intrinsics").iterdir())[:2]:
        path.unlink()
    scans = read_scans(tmp_path)
    check_room(scans, frames[2:])
    assert "2 of 4 frames have no intrinsics and were left out" in said(scans)


@pytest.mark.parametrize("scale", [30, 10])
def test_the_video_gives_colours_and_the_size_of_the_intrinsics(
    tmp_path: Path, frames: list[Frame], scale: int
) -> None:
    write_stray(tmp_path, frames, scale=scale)
    write_video(tmp_path / "rgb.mp4", frames, (64 * scale, 48 * scale))
    scans = read_scans(tmp_path)
    check_room(scans, frames)
    greys = [float(np.mean(scan.colour)) for scan in scans if scan.colour is not None]
    np.testing.assert_allclose(greys, [frame.grey for frame in frames], atol=6)


@pytest.mark.parametrize("video", [b"", b"no video at all" * 100])
def test_without_a_readable_video_there_is_no_colour(
    tmp_path: Path, frames: list[Frame], video: bytes
) -> None:
    write_stray(tmp_path, frames)
    (tmp_path / "rgb.mp4").write_bytes(video)
    scans = read_scans(tmp_path)
    check_room(scans, frames)
    assert all(scan.colour is None for scan in scans)
    assert "rgb.mp4 could not be read: the frames have no colour" in said(scans)


def test_columns_of_odometry_count_by_name(tmp_path: Path, frames: list[Frame]) -> None:
    write_stray(tmp_path, frames)
    rows = list(csv.DictReader((tmp_path / "odometry.csv").read_text().splitlines(), skipinitialspace=True))
    names = ["qw", "frame", "z", "y", "x", "qz", "qy", "qx"]
    text = "\n".join([",".join(names), *(",".join(row[name] for name in names) for row in rows)])
    (tmp_path / "odometry.csv").write_text(text)
    check_room(read_scans(tmp_path), frames)
    (tmp_path / "odometry.csv").write_text(text.replace("qz", "roll", 1))
    with pytest.raises(InputError, match=r"odometry\.csv: has no column qz"):
        open_scans(tmp_path)


@pytest.mark.parametrize(
    ("files", "message"),
    [
        ({"a.r3d": "PK"}, "packed by LZFSE, which is not read here; in Record3D export the recording as EXR"),
        ({"a.sens": "x"}, "unpack it by ScanNet's SensReader"),
        ({"metadata": {"w": 2, "h": 2, "K": [1, 0, 0, 0, 1, 0, 0, 0, 1], "poses": [[0, 0, 0, 1, 0, 0, 0]]},
          "rgbd/0.depth": "bvx2"}, r"0\.depth: holds depth packed by LZFSE"),
    ],
)  # fmt: skip
def test_packed_recordings_are_refused_with_their_cure(
    tmp_path: Path, files: dict[str, object], message: str
) -> None:
    for name, content in files.items():
        path = tmp_path / name
        save(path, content) if path.suffix or name == "metadata" else None
    with pytest.raises(InputError, match=message):
        read_scans(tmp_path)
    for name in files:
        if name.endswith((".r3d", ".sens")):
            with pytest.raises(InputError, match=message):
                read_scan(tmp_path / name)


def test_poses_of_other_frames_and_of_several_cameras_are_refused(
    tmp_path: Path, frames: list[Frame]
) -> None:
    write_polycam(tmp_path / "a", frames)
    for path in (tmp_path / "a/keyframes/depth").iterdir():
        path.rename(path.with_name(f"other{path.name}"))
    with pytest.raises(InputError, match=r"none of its 4 poses, as that of '281\d+', is of one of the 4"):
        open_scans(tmp_path / "a")
    write_rtabmap(tmp_path / "b", frames)
    (tmp_path / "b/map_camera_poses_1.txt").write_text("#\n")
    with pytest.raises(InputError, match="holds poses of several cameras"):
        open_scans(tmp_path / "b")
