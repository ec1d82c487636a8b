# SPDX-License-Identifier: MIT
"""3DTK folders: centimetres, left-handed, y up; the scanner's own grid, and its numbers for no return."""

from pathlib import Path

import numpy as np
import pytest

from scenes.checks import FloatArray, InputError
from scenes.io.clouds.uos import read_uos_pose
from scenes.io.describe import describe
from scenes.io.point_files import read_points
from scenes.io.scan_files import read_scan, read_scans
from tests.helpers.data_paths import data_path, requires_data

FULL_CM = 3276.7


def box_in_cm(rows: int = 60, columns: int = 90) -> FloatArray:
    """What a scanner that sweeps about x sees of a room, in 3DTK's frame; some without return."""
    lat, lon = np.meshgrid(
        np.radians(np.linspace(60, -60, rows) + 0.3), np.radians(np.linspace(-44, 45, columns) + 0.3)
    )
    rays = np.stack([np.sin(lat), np.cos(lat) * np.sin(lon), np.cos(lat) * np.cos(lon)], axis=-1)
    sides = np.array([[-100.0, -100.0, -50.0], [200.0, 150.0, 350.0]])
    with np.errstate(divide="ignore"):
        reach = np.where(rays > 0, sides[1] / rays, sides[0] / rays).min(axis=-1)
    reach[::7, ::9] = FULL_CM
    return (rays * reach[..., None]).reshape(-1, 3)


def write(folder: Path, number: int, points: FloatArray, pose: str | None) -> None:
    folder.mkdir(exist_ok=True)
    np.savetxt(folder / f"scan{number:03d}.3d", points, fmt="%.5f")
    if pose is not None:
        (folder / f"scan{number:03d}.pose").write_text(pose)


def test_a_room_is_upright_in_metres_and_not_mirrored(tmp_path: Path) -> None:
    write(tmp_path / "dat", 0, box_in_cm(), "0 0 0\n0 0 0\n")
    (scan,) = read_scans(tmp_path / "dat")
    assert scan.shape == (60, 90)
    assert scan.valid.sum() == 60 * 90 - 13 * 7
    points = scan.points()[scan.valid]
    np.testing.assert_allclose(points.min(axis=0)[1:], [-2.0, -1.0], atol=1e-6)  # right is -y, floor below
    np.testing.assert_allclose(points.max(axis=0), [3.5, 1.0, 1.5], atol=1e-6)
    assert "91 of 5400 ranges are 32.767" in " ".join(scan.warnings)
    assert "centimetres, left-handed, y up" in " ".join(scan.warnings)
    assert np.linalg.det(scan.world_from_sensor.rotation) == pytest.approx(1)


def test_poses_go_from_the_scan_to_the_world(tmp_path: Path) -> None:
    """The same room from two places: its walls stay where they are."""
    turn = np.radians(30)  # about y, which is up
    world = box_in_cm()
    there = np.array([20.0, 10.0, -15.0])
    matrix = np.array([[np.cos(turn), 0, np.sin(turn)], [0, 1, 0], [-np.sin(turn), 0, np.cos(turn)]])
    write(tmp_path / "dat", 0, world, "0 0 0\n0 0 0\n")
    write(tmp_path / "dat", 1, (world - there) @ matrix, "20 10 -15\n0 30 0\n")
    pose = read_uos_pose(tmp_path / "dat" / "scan001.pose")
    seen = (world - there) @ matrix / 100
    np.testing.assert_allclose(
        pose.apply(np.column_stack([seen[:, 2], -seen[:, 0], seen[:, 1]])),
        np.column_stack([world[:, 2], -world[:, 0], world[:, 1]]) / 100,
        atol=1e-9,
    )


def test_one_file_is_one_scan_and_units_are_its_own(tmp_path: Path) -> None:
    write(tmp_path, 3, box_in_cm(), None)
    file = tmp_path / "scan003.3d"
    assert describe(file)["format"] == "3dtk"
    np.testing.assert_array_equal(read_scan(file).ranges, read_scan(file, units="cm").ranges)
    with pytest.raises(InputError, match="3dtk is in cm by its format; leave out --units"):
        read_scan(file, units="mm")


@pytest.mark.parametrize(
    ("pose", "said"),
    [
        ("0 0 0\n0 0\n", r"scan000\.pose: expected six finite numbers .* got 5"),
        ("0 0 0\n0 0 nan\n", "expected six finite numbers"),
        ("a b c\n", "cannot be read as a 3DTK pose"),
    ],
)
def test_damaged_poses_are_refused_in_one_line(tmp_path: Path, pose: str, said: str) -> None:
    write(tmp_path, 0, box_in_cm(), pose)
    with pytest.raises(InputError, match=said):
        read_scans(tmp_path)


def test_bad_scans_are_refused_and_points_that_are_not_finite_counted(tmp_path: Path) -> None:
    write(tmp_path, 0, np.ones((5, 3)), None)
    with pytest.raises(InputError, match=r"scan000\.3d: 5 points are too few"):
        read_scan(tmp_path)
    points = box_in_cm()
    points[4] = np.nan
    write(tmp_path, 0, points, None)
    assert "1 of 5400 points are not finite" in " ".join(read_scan(tmp_path).warnings)
    (tmp_path / "scan000.3d").unlink()
    (tmp_path / "scan000.3d").symlink_to("/etc/hostname")
    with pytest.raises(InputError, match="lies outside the folder"):
        read_scan(tmp_path)


@pytest.mark.long
@requires_data
def test_the_arcade_keeps_its_points_and_its_grid() -> None:
    scans = read_scans(data_path("range/tdtk"))
    for scan, n_full in zip(scans, (1481, 1313), strict=True):
        assert scan.shape == (360, 226)
        assert scan.valid.sum() >= 0.995 * (81360 - n_full)
        assert f"{n_full} of 81360 ranges" in " ".join(scan.warnings)
        points = scan.points()[scan.valid]
        level, _ = np.histogram(points[:, 2], bins=np.arange(-1, 3, 0.1))
        assert np.argmax(level) in (5, 6)  # the floor, .4 m below the scanner


@pytest.mark.long
def test_points_are_in_metres_whatever_is_said_of_the_unit(tmp_path: Path) -> None:
    """A folder and a file of it, with its own unit or none; another one is refused by both."""
    write(tmp_path / "dat", 0, box_in_cm(), "0 0 0\n0 0 0\n")
    (scan,) = read_scans(tmp_path / "dat")
    expected = scan.points()[scan.valid]
    for path in (tmp_path / "dat", tmp_path / "dat" / "scan000.3d"):
        for units in ("m", "cm"):
            np.testing.assert_allclose(read_points(path, units).points, expected, atol=1e-9)
        with pytest.raises(InputError, match="3dtk is in cm by its format; leave out --units"):
            read_points(path, "mm")
