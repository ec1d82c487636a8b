# SPDX-License-Identifier: MIT
"""Steps between the coordinates that files can hold: E57, single precision, and what is told of them."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scenes.checks import InputError
from scenes.io.meshes.ply_writer import write_mesh_ply
from scenes.io.point_files import read_part_file, read_points
from scenes.io.scan_files import read_scan, write_scan
from scenes.io.scan_request import ScanRequest, read_request
from tests.helpers.e57_fields import STATION, Record, grid_fields, room_points, write_records

pytest.importorskip("pye57")
AZIMUTHS, ELEVATIONS = np.arange(-178.5, 180, 3.0), np.arange(59.0, -60, -2.0)
CARTESIAN = tuple(f"cartesian{axis}" for axis in "XYZ")


def room(**record: Any) -> Record:
    return Record(grid_fields(room_points(AZIMUTHS, ELEVATIONS)), **record)


def spherical(range_step: float, angle_step: float) -> Record:
    record = room()
    x, y, z = (record.fields.pop(name) for name in CARTESIAN)
    record.fields["sphericalRange"] = np.sqrt(x**2 + y**2 + z**2)
    record.fields["sphericalAzimuth"] = np.arctan2(y, x)
    record.fields["sphericalElevation"] = np.arctan2(z, np.hypot(x, y))
    record.scales = {"sphericalRange": range_step, "sphericalAzimuth": angle_step,
                     "sphericalElevation": angle_step}  # fmt: skip
    return record


@pytest.mark.parametrize("step", [0.01, 0.002, 0.0005])
@pytest.mark.parametrize("has_grid", [True, False])
def test_scaled_integers_have_the_step_of_their_scale(tmp_path: Path, step: float, has_grid: bool) -> None:
    record = room(scales=dict.fromkeys(CARTESIAN, step))
    if not has_grid:
        del record.fields["rowIndex"], record.fields["columnIndex"]
    path = write_records(tmp_path / "a.e57", [record])
    scan, cloud = read_scan(path), read_points(path)
    assert scan.step_m == cloud.step_m == pytest.approx(step)
    for warnings in (scan.warnings, cloud.warnings):
        told = [text for text in warnings if f"rounded to steps of {1000 * step:.3g} mm" in text]
        assert len(told) == (step > 1e-3)
    doubts = [text for text in read_request(ScanRequest((str(path),))).doubts if "steps" in text]
    assert len(doubts) == (step > 1e-3)


def test_doubles_have_no_step(tmp_path: Path) -> None:
    path = write_records(tmp_path / "a.e57", [room()])
    assert read_scan(path).step_m == read_points(path).step_m == 0.0


@pytest.mark.parametrize(("range_step", "angle_step"), [(0.005, 1e-5), (1e-4, 2e-3), (2e-3, 1e-7)])
def test_steps_of_angles_grow_with_the_range(tmp_path: Path, range_step: float, angle_step: float) -> None:
    scan = read_scan(write_records(tmp_path / "a.e57", [spherical(range_step, angle_step)]))
    median = float(np.median(scan.ranges[scan.valid]))
    assert scan.step_m == pytest.approx(max(range_step, angle_step * median), rel=0.01)


@pytest.mark.parametrize(("offset", "step"), [(5e5, 2**-5), (3e4, 2**-9), (0.0, 0.0)])
def test_single_precision_far_from_the_origin(tmp_path: Path, offset: float, step: float) -> None:
    points = room_points(AZIMUTHS, ELEVATIONS).reshape(-1, 3) + STATION + [offset, 0.0, 0.0]
    record = Record({name: points[:, k].astype(np.float32) for k, name in enumerate(CARTESIAN)}, pose=None)
    held = {"E57": write_records(tmp_path / "a.e57", [record])}
    np.savez(tmp_path / "a.npz", points=points.astype(np.float32))
    held["npz"] = tmp_path / "a.npz"
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n"
    head += "".join(f"property float {axis}\n" for axis in "xyz") + "end_header\n"
    held["ply"] = tmp_path / "a.ply"
    held["ply"].write_bytes(head.encode() + points.astype("<f4").tobytes())
    for path in held.values():
        assert read_points(path).step_m == pytest.approx(step)


def test_a_part_file_tells_the_step_and_the_warnings_of_a_mesh(tmp_path: Path) -> None:
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]]) + [1e5, 0, 0]
    faces = np.array([[0, 1, 2], [1, 3, 2], [1, 3, 2]])
    write_mesh_ply(tmp_path / "a.ply", corners + 0.25, faces, {}, [])
    held = read_part_file(tmp_path / "a.ply")
    assert held.step_m == pytest.approx(2**-7)
    assert any("are there more than once" in text for text in held.warnings)
    assert any("stored in 32 bits" in text for text in held.warnings)


@pytest.mark.parametrize("shape", [(2, 66_000), (66_000, 2)])
def test_more_rows_or_columns_than_two_bytes_count(tmp_path: Path, shape: tuple[int, int]) -> None:
    rows, columns = shape
    up = np.linspace(20, -20, rows)
    points = room_points(np.linspace(-60, 60, columns), up)
    scan = read_scan(write_records(tmp_path / "theirs.e57", [Record(grid_fields(points))]))
    write_scan(scan, tmp_path / "ours.e57")
    assert read_scan(tmp_path / "ours.e57").shape == shape


def test_kilometres_read_as_metres_are_refused(tmp_path: Path) -> None:
    points = 1e-3 * room_points(AZIMUTHS, ELEVATIONS)
    path = write_records(tmp_path / "a.e57", [Record(grid_fields(points))])
    with pytest.raises(
        InputError, match=r"median range is 0\.002\d? m, which no scanner measures; give --units"
    ):
        read_request(ScanRequest((str(path),)))


def test_names_count_empty_scans(tmp_path: Path) -> None:
    full, empty, away = room(), Record({name: values[:0] for name, values in room().fields.items()}), room()
    away.pose = ((1, 0, 0, 0), (9.0, 9.0, 1.5))
    path = write_records(tmp_path / "a.e57", [empty, full, empty, away])
    given = read_request(ScanRequest((str(path),)))
    assert given.names == (f"{path}#2", f"{path}#4")
    assert given.pick([1]).names == (f"{path}#4",)
