# SPDX-License-Identifier: MIT
"""COLMAP models: poses by the names of images, points by the names of columns."""

from pathlib import Path

import numpy as np
import pytest

from scenes.checks import InputError
from scenes.io.point_files import read_points
from scenes.io.scan_files import read_scan, read_scans
from scenes.io.scan_request import ScanRequest, read_request
from tests.helpers.data_paths import data_path, requires_data

FRAMES = "reported/rgbd_camera_traps/r03_distorted_camera"  # 000000 to 000002, of the same places
MODEL = "reported/colmap_names_ignored"
PLACES = [(2.9, 1.0, 1.5), (2.8, 1.0, 1.5), (2.7, 1.0, 1.5)]
POINTS3D = """# 3D point list with one line of data per point:
#   POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)
# Number of points: 3, mean track length: 2.5
63390 1.5 2.5 3.5 115 121 122 1.03 16 6542 15 7345
63376 -1.5 0.5 4.0 117 118 120 0.2 16 6519
7 0 1 2 1 2 3 0.1 16 6519 15 7322 14 7212 8 3991
"""


def image_line(number: int, name: str) -> str:
    """An image that stands at x = its number."""
    return f"{number} 1 0 0 0 {-number} 0 0 1 {name}\n\n"


@requires_data
@pytest.mark.parametrize(
    ("name", "frames"), [("images_other_names.txt", [1, 2]), ("images_two_of_three.txt", [0, 2])]
)
def test_poses_are_matched_by_name_and_other_frames_are_counted(name: str, frames: list[int]) -> None:
    poses = str(data_path(f"{MODEL}/{name}"))
    given = read_request(ScanRequest((str(data_path(FRAMES)),), poses=poses))
    np.testing.assert_allclose([scan.origin for scan in given.scans], [PLACES[k] for k in frames], atol=1e-6)
    assert [scan.name.rpartition("#")[2] for scan in given.scans] == [str(k + 1) for k in frames]
    assert [path.rpartition("#")[2] for path in given.names] == [str(k + 1) for k in frames]
    assert f"1 of 3 frames have no pose in {name} and were left out" in " ".join(given.doubts)


@requires_data
def test_a_frame_is_picked_by_name_too(tmp_path: Path) -> None:
    folder, file = str(data_path(FRAMES)), tmp_path / "images.txt"
    file.write_text(image_line(5, "cam/000002.jpg") + image_line(4, "cam/000000.jpg"))
    assert read_scan(f"{folder}#3", poses=file).origin[0] == pytest.approx(5)
    with pytest.raises(InputError, match=r"none of its 2 images, .* 1 frames asked for, as '000001\.jpg'"):
        read_scan(f"{folder}#2", poses=file)
    several = read_request(ScanRequest((f"{folder}#3", f"{folder}#1"), poses=str(file)))
    assert [scan.origin[0] for scan in several.scans] == pytest.approx([5, 4])


@requires_data
def test_names_that_do_not_tell_are_refused(tmp_path: Path) -> None:
    folder, file = data_path(FRAMES), tmp_path / "images.txt"
    file.write_text(image_line(1, "left/000002.jpg") + image_line(2, "right/000002.jpg"))
    with pytest.raises(InputError, match=r"images\.txt: several images are named '000002'"):
        read_scans(folder, poses=file)
    file.write_text(image_line(1, "photo.jpg"))
    with pytest.raises(InputError, match=r"images\.txt: none of its 1 images, as 'photo\.jpg'"):
        read_scans(folder, poses=file)


@pytest.mark.parametrize("drop", [(), (0, 2), (2,)])
def test_points3d_is_read_by_its_header(tmp_path: Path, drop: tuple[int, ...]) -> None:
    lines = [line for k, line in enumerate(POINTS3D.splitlines()) if k not in drop]
    (tmp_path / "points3D.txt").write_text("\n".join(lines) + "\n")
    cloud = read_points(tmp_path / "points3D.txt")
    np.testing.assert_array_equal(cloud.points, [[1.5, 2.5, 3.5], [-1.5, 0.5, 4.0], [0, 1, 2]])
