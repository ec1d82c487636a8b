# SPDX-License-Identifier: MIT
"""Depth encodings and COLMAP poses: closed forms, what cannot be, and what is suspected."""

import json
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from scipy.spatial.transform import Rotation

from scenes.checks import InputError
from scenes.io.poses.trajectory import read_poses
from scenes.io.rgbd.depth import depth_in_metres, suspected_encoding
from scenes.io.scan_files import read_scan, read_scans
from tests.helpers.scan_examples import POSE

DEPTH_MM = np.arange(500, 8000, 25).reshape(12, 25)


def sun3d(depth_mm: NDArray[np.int64]) -> NDArray[np.uint16]:
    words = depth_mm.astype(np.uint16)
    return (words << 3) | (words >> 13)


def folder_of(path: Path, counts: NDArray[np.uint16], **camera: object) -> Path:
    (path / "depth").mkdir(parents=True)
    Image.fromarray(counts).save(path / "depth" / "1.png")
    values = {"fx": 30.0, "fy": 30.0, "cx": 12.0, "cy": 6.0, **camera}
    (path / "camera.json").write_text(json.dumps(values))
    return path


def test_sun3d_bits_are_turned_back(tmp_path: Path) -> None:
    high = DEPTH_MM + 9000  # beyond 8192 the upper bits wrap around
    for name, depth in (("low", DEPTH_MM), ("high", high)):
        folder = folder_of(tmp_path / name, sun3d(depth), depth_scale=1000, depth_encoding="sun3d")
        np.testing.assert_allclose(read_scan(folder).points_in_sensor()[..., 2], depth / 1000)


def test_raw_kinect_disparities_become_metres_in_either_byte_order(tmp_path: Path) -> None:
    disparity = np.arange(300, 1092, dtype=np.uint16)[:780].reshape(30, 26)
    disparity[0, 0], disparity[0, 1] = 2047, 0  # nothing measured
    expected = 351.3 / (1092.5 - disparity)
    expected[0, :2] = np.nan
    for name, counts in (("right", disparity), ("swapped", disparity.byteswap())):
        folder = folder_of(tmp_path / name, counts, depth_encoding="kinect-disparity")
        np.testing.assert_allclose(read_scan(folder).points_in_sensor()[..., 2], expected)


def test_what_an_encoding_cannot_hold_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"camera\.json: unknown depth_encoding 'zip'; known: linear, sun3d"):
        read_scan(folder_of(tmp_path / "a", sun3d(DEPTH_MM), depth_encoding="zip"))
    wrong = np.full((12, 24), 0xFFFF, np.uint16)
    with pytest.raises(InputError, match=r"1\.png: kinect-disparity has 11 bits, the image holds 65535"):
        read_scan(folder_of(tmp_path / "b", wrong, depth_encoding="kinect-disparity"))
    with pytest.raises(InputError, match="sun3d depth needs 16-bit integers, but the image has another type"):
        depth_in_metres(np.array([[0.5]]), "sun3d", 1000)


def test_encodings_are_suspected_from_the_values() -> None:
    assert "100% of its values are multiples of 8" in suspected_encoding(sun3d(DEPTH_MM).astype(np.float64))
    disparity = np.arange(300, 1000, dtype=np.uint16).byteswap().astype(np.float64)
    assert "wrong order" in suspected_encoding(disparity)
    for counts in (DEPTH_MM, DEPTH_MM * 5, np.zeros((3, 3)), DEPTH_MM / 1000):
        assert suspected_encoding(counts.astype(np.float64)) == ""


def colmap_lines(names: list[str]) -> str:
    """An image each, at x = its place in the list, all turned as POSE; the second line of each is empty."""
    lines = [
        "# Image list with two lines of data per image:",
        "#   IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, ...",
    ]
    turn = POSE.rotation.T
    x, y, z, w = Rotation.from_matrix(turn).as_quat()
    for k, name in enumerate(names):
        tx, ty, tz = -turn @ [k, 2.0, 3.0]
        lines += [f"{k + 7} {w} {x} {y} {z} {tx} {ty} {tz} 1 {name}", "100.5 20.25 -1" if k else ""]
    return "\n".join(lines) + "\n"


def test_colmap_images_are_turned_around_and_put_in_natural_order(tmp_path: Path) -> None:
    (tmp_path / "images.txt").write_text(colmap_lines(["frame 10.png", "frame 9.png", "frame 2.png"]))
    poses = read_poses(tmp_path / "images.txt")
    assert [round(float(pose.translation[0]), 9) for pose in poses] == [2, 1, 0]
    for pose in poses:
        np.testing.assert_allclose(pose.rotation, POSE.rotation, atol=1e-12)
        np.testing.assert_allclose(pose.translation[1:], [2, 3])


def test_colmap_poses_serve_a_folder(tmp_path: Path) -> None:
    folder = folder_of(tmp_path / "a", DEPTH_MM.astype(np.uint16), depth_scale=1000)
    Image.fromarray(DEPTH_MM.astype(np.uint16)).save(folder / "depth" / "2.png")
    (tmp_path / "images.txt").write_text(colmap_lines(["1.png", "2.png"]))
    scans = read_scans(folder, poses=tmp_path / "images.txt")
    np.testing.assert_allclose([scan.origin[0] for scan in scans], [0, 1], atol=1e-12)


def test_unusable_colmap_files_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "images.txt"
    file.write_text(colmap_lines(["a.png"]) + "8 1 0 0 0 1 2\n\n")
    with pytest.raises(InputError, match=r"images\.txt: image 2 has 7 words; expected IMAGE_ID QW QX"):
        read_poses(file)
    file.write_text("1 0 0 0 0 1 2 3 1 a.png\n\n")
    with pytest.raises(
        InputError, match=r"image 'a\.png' has the quaternion .* of length 0, which is no rotation"
    ):
        read_poses(file)
