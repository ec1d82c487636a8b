# SPDX-License-Identifier: MIT
"""Files of lidars and of point registration: KITTI's and nuScenes' sweeps, legacy VTK, refusals."""

import numpy as np
import pytest

from scenes.checks import InputError
from scenes.io.describe import describe
from scenes.io.point_files import read_points
from scenes.io.poses.trajectory import write_poses
from scenes.io.scan_files import read_scan
from scenes.pose import Pose
from tests.helpers.lidar_sweeps import HDL32, HDL64, OUSTER128, VLP16, sweep

SWEPT = sweep(VLP16, 1.0)
N = len(SWEPT.points)


def write_sweep(path, swept, *, ring, most=1.0):
    light = np.random.default_rng(0).uniform(0, most, len(swept.points))
    columns = [swept.points, light[:, None], *([swept.ring[:, None]] if ring else [])]
    np.hstack(columns).astype("<f4").tofile(path)
    return path


@pytest.mark.parametrize(
    ("name", "beams", "by", "ring", "most"),
    [
        ("000000.bin", HDL64, "beam", False, 1.0),  # KITTI
        ("000001.bin", OUSTER128[::4], "firing", False, 255.0),
        ("n015__LIDAR_TOP__1532402927647951.pcd.bin", HDL32, "firing", True, 255.0),  # nuScenes
        ("sweep.bin", VLP16, "beam", True, 100.0),
    ],
)
def test_a_sweep_is_a_scan_about_its_lidar(tmp_path, name, beams, by, ring, most):
    swept = sweep(beams, 1.0, by=by)
    path = write_sweep(tmp_path / name, swept, ring=ring, most=most)
    scan = read_scan(path)
    assert scan.shape[0] == len(np.unique(swept.ring))
    assert not scan.origin.any()
    np.testing.assert_allclose(read_points(path).points, swept.points, atol=1e-5)
    assert describe(path)["kind"] == "scan"


def test_poses_of_sweeps_move_the_axes_of_the_file(tmp_path):
    path = write_sweep(tmp_path / "0.bin", SWEPT, ring=False)
    pose = Pose.looking_at((3, 2, 1), (4, 4, 1))
    write_poses(tmp_path / "poses.txt", [pose])
    scan = read_scan(path, poses=tmp_path / "poses.txt")
    moved = {tuple(row) for row in np.round(pose.apply(SWEPT.points.astype(np.float32).astype(float)), 3)}
    seen = {tuple(row) for row in np.round(scan.points()[scan.valid], 3)}
    assert len(seen & moved) > 0.9 * len(seen)
    np.testing.assert_allclose(scan.origin, (3, 2, 1), atol=1e-6)


def test_what_is_no_point_of_a_sweep_is_left_out_with_a_count(tmp_path):
    table = np.column_stack([SWEPT.points, np.zeros(N)]).astype("<f4")
    table[::50] = np.nan
    table.tofile(tmp_path / "0.bin")
    cloud = read_points(tmp_path / "0.bin")
    assert len(cloud.points) == N - len(table[::50])
    assert cloud.warnings[0].startswith(f"{len(table[::50])} of {N} points are not finite")


@pytest.mark.parametrize(
    "data",
    [
        np.arange(4000, dtype="<u8").tobytes(),  # COLMAP's images
        np.random.default_rng(0).bytes(16_000),
        SWEPT.points.astype("<f4").tobytes()[:-4],  # cut
        np.column_stack([SWEPT.points, np.full(N, 1e4)]).astype("<f4").tobytes(),
        SWEPT.points.astype(">f4").tobytes(),
        np.zeros(4000, "<f4").tobytes(),
    ],
)
def test_other_files_of_that_suffix_are_refused_by_name(tmp_path, data):
    (tmp_path / "0.bin").write_bytes(data)
    with pytest.raises(InputError, match=r"0.bin: its \d+ bytes are no sweep of KITTI .* nuScenes"):
        read_points(tmp_path / "0.bin")


def vtk(points, normals, colour, *, is_text, kind="float", cells="VERTICES", line="\n"):
    """A legacy file: libpointmatcher's order of sections, VTK's own METADATA behind an array."""
    forms = {"float": ">f4", "double": ">f8"}

    def numbers(values, form):
        if is_text:
            return line.join(" ".join(f"{x:.7g}" for x in row) for row in values).encode() + line.encode()
        return np.asarray(values).astype(form).tobytes() + b"\n"

    n = len(points)
    shade = colour / 255 if is_text else colour
    parts = [
        f"# vtk DataFile Version 3.0{line}a cloud{line}{'ASCII' if is_text else 'BINARY'}{line}"
        f"DATASET POLYDATA{line}POINTS {n} {kind}{line}",
        numbers(points, forms[kind]),
        f"METADATA{line}INFORMATION 0{line}{line}{cells} {n} {2 * n}{line}",
        b"".join(b"1 %d\n" % k for k in range(n)) if is_text else np.full((n, 2), 1, ">i4").tobytes() + b"\n",
        f"POINT_DATA {n}{line}SCALARS intensity float 1{line}LOOKUP_TABLE default{line}",
        numbers(np.ones((n, 1)), ">f4"),
        f"NORMALS normals {kind}{line}",
        numbers(normals, forms[kind]),
        f"COLOR_SCALARS lut {colour.shape[1]}{line}",
        numbers(shade, "u1"),
    ]
    return b"".join(part.encode() if isinstance(part, str) else part for part in parts)


@pytest.mark.parametrize(
    "how",
    [
        {"is_text": True},
        {"is_text": True, "kind": "double", "line": "\r\n"},
        {"is_text": False},
        {"is_text": False, "kind": "double", "cells": "POLYGONS"},
    ],
)
@pytest.mark.parametrize("n_colours", [3, 4])
def test_points_of_legacy_vtk_files_with_normals_and_colours(tmp_path, how, n_colours):
    rng = np.random.default_rng(0)
    points, normals = rng.normal(size=(50, 3)), np.tile([0.0, 0.6, -0.8], (50, 1))
    colour = rng.integers(0, 256, (50, n_colours))
    (tmp_path / "c.vtk").write_bytes(vtk(points, normals, colour, **how))
    cloud = read_points(tmp_path / "c.vtk")
    np.testing.assert_allclose(cloud.points, points, atol=1e-6)
    np.testing.assert_allclose(cloud.normals, normals, atol=1e-6)
    np.testing.assert_array_equal(cloud.colour, colour[:, :3])
    assert ("its polygons are not read: it is taken as points" in cloud.warnings) == ("cells" in how)


@pytest.mark.parametrize(
    ("change", "cause"),
    [
        (lambda data: b"x" + data, "is no legacy VTK file"),
        (lambda data: data.replace(b"POLYDATA", b"STRUCTURED_POINTS"), "STRUCTURED_POINTS without points"),
        (lambda data: data[:400], "truncated: 150 numbers announced at byte"),
        (lambda data: data.replace(b"POINTS 50 float", b"POINTS 50 quark"), "type 'quark'; known: float"),
        (lambda data: data.replace(b"POINTS 50 ", b"POINTS 99999999 "), "truncated: 299999997 numbers"),
    ],
)
def test_damaged_vtk_files_are_refused_in_a_line(tmp_path, change, cause):
    data = vtk(np.ones((50, 3)), np.ones((50, 3)), np.ones((50, 3), np.uint8), is_text=False)
    (tmp_path / "c.vtk").write_bytes(change(data))
    with pytest.raises(InputError, match=f"c.vtk: .*{cause}"):
        read_points(tmp_path / "c.vtk")
    with pytest.raises(InputError, match="--origin X,Y,Z"):
        read_scan(tmp_path / "c.vtk")
