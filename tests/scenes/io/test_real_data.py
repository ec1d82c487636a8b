# SPDX-License-Identifier: MIT
"""Real scans from public sources read as their sources say; numbers from the data's README."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import least_squares

from scenes.checks import InputError
from scenes.io.scan_files import read_scan, read_scans, write_scan
from scenes.scan.colour import unit_colour
from scenes.scan.projection import PinholeProjection, SphericalProjection
from tests.helpers.data_paths import bench_path, data_path, requires_bench, requires_data

ICL = (481.2, -480.0, 319.5, 239.5)


@requires_data
@pytest.mark.parametrize(
    ("name", "camera", "valid"),
    [
        ("pcl/office1.pcd", (525.0, 525.0, 320.0, 240.0), 0.828),
        ("mOSD/learn0.pcd", (525.0, 525.0, 319.5, 239.5), 0.593),
        ("mOSD/learn33.pcd", (525.0, 525.0, 319.5, 239.5), 0.583),
        ("pcl/table_scene_mug_stereo_textured.pcd", (964.36, 964.36, 319.81, 223.36), 0.681),
    ],
)
def test_intrinsics_of_organised_pcd(name: str, camera: tuple[float, ...], valid: float) -> None:
    scan = read_scan(data_path(f"range/{name}"))
    assert isinstance(scan.projection, PinholeProjection)
    found = (scan.projection.fx, scan.projection.fy, scan.projection.cx, scan.projection.cy)
    np.testing.assert_allclose(found, camera, atol=0.005)
    assert scan.valid.mean() == pytest.approx(valid, abs=1e-3)
    assert scan.colour is not None
    assert 0.3 < unit_colour(scan.colour).mean() < 0.9


@requires_data
def test_the_mug_scene_keeps_its_points_and_plane() -> None:
    scan = read_scan(data_path("range/pcl/table_scene_mug_stereo_textured.pcd"))
    points = scan.points_in_sensor()[scan.valid]
    distance = points @ [-0.0161854, 0.837724, 0.545855] - 0.528787  # PCL's documented table plane
    near = np.abs(distance) < 0.01
    assert near.mean() > 0.5
    assert np.median(np.abs(distance[near])) < 0.003


@requires_data
def test_pump_is_addressable_by_the_files_own_rows_and_columns() -> None:
    scan = read_scan(data_path("range/e57/pumpA.e57"))
    assert scan.shape == (1074, 345)
    assert int(scan.valid.sum()) == 155_201
    assert isinstance(scan.projection, SphericalProjection)
    assert (np.diff(scan.projection.elevations) > 0).all()  # row 0 is the lowest
    assert (np.diff(scan.projection.azimuths) > 0).all()  # columns run to the right
    seen = scan.projection.pixels(scan.points_in_sensor()[scan.valid])
    off = np.hypot(*(seen - np.argwhere(scan.valid)).T)
    assert np.nanmedian(off) < 0.5
    pipe = scan.points()[721:1000, 227:240][scan.valid[721:1000, 227:240]]
    assert len(pipe) > 3000
    radius = _radius_about_z(pipe)
    assert radius == pytest.approx(0.0877, abs=0.0015)  # vertical axis: 87.0-87.5 mm, free axis 87.7 +- 0.8


def _radius_about_z(points: NDArray[np.float64]) -> float:
    """Radius of the upright cylinder through a strip of points, robustly."""
    middle = np.median(points[:, :2], axis=0)
    start = [*(middle * (1 + 0.08 / np.linalg.norm(middle))), 0.08]  # the axis lies behind the strip

    def off(guess: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.hypot(points[:, 0] - guess[0], points[:, 1] - guess[1]) - guess[2]

    return float(least_squares(off, start, loss="cauchy", f_scale=0.001).x[2])


@requires_data
def test_pump_survives_e57_and_ply(tmp_path: Path) -> None:
    scan = read_scan(data_path("range/e57/pumpA.e57"))
    for suffix in (".e57", ".ply"):
        write_scan(scan, f"{tmp_path}/pump{suffix}")
        back = read_scan(f"{tmp_path}/pump{suffix}")
        np.testing.assert_allclose(back.points(), scan.points(), atol=1e-14, rtol=0)
        np.testing.assert_array_equal(back.colour, scan.colour)


@requires_data
@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("e57/corrupt_crc.e57", "corrupt_crc.e57: cannot be read as E57 scan: checksum mismatch"),
        ("e57/tiny_spherical.e57", "has no rowIndex and no columnIndex: it is an unstructured cloud"),
        ("e57/pipeSpherical.e57", "export the scan as structured"),
        ("e57/translationWithoutRotation.e57", "3 points are too few for a scan; at least 100 are needed"),
        ("e57/cartesian_invalid_state_single.e57", "unstructured"),
        ("ptx/no-color.ptx", "15 points in a grid of 1 x 15 are too few to estimate its projection"),
        ("ptx/multiple-and-transform.ptx#1", r"pose is not rigid: \|R'R - 1\| = 3"),
        ("pyransac3d/caixa.ply", "is a PLY without sensor position and pixel grid"),
        ("cape_tunnel", "is not an RGB-D folder"),
        ("icl_nuim#1", r"tells the intrinsics \(--intrinsics FX,FY,CX,CY\)"),
    ],
)
def test_what_cannot_be_used_is_told_why(name: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        read_scan(data_path(f"range/{name}"))


@requires_data
def test_icl_nuim_frames_agree_in_the_world() -> None:
    folder = data_path("range/icl_nuim")
    first = read_scan(f"{folder}#1", intrinsics=ICL, depth_scale=5000)
    fifth = read_scan(f"{folder}#5", intrinsics=ICL, depth_scale=5000)
    assert np.linalg.norm(first.origin - fifth.origin) == pytest.approx(1.26, abs=0.01)
    points = first.points()[first.valid]
    pixels = fifth.pixels(points)
    seen = np.isfinite(pixels).all(axis=1)
    row, column = np.rint(pixels[seen]).astype(int).T
    expected = fifth.world_from_sensor.inverse().apply(points[seen])[:, 2]
    difference = np.abs(fifth.points_in_sensor()[row, column, 2] - expected)
    assert seen.mean() == pytest.approx(0.285, abs=0.005)
    assert np.median(difference) < 0.008  # 7.4 mm, and 9.1 mm from frame 5 into frame 1


@requires_data
@pytest.mark.parametrize(("name", "n_frames"), [("open3d_redwood", 5), ("align3d_sample1", 6)])
def test_neighbouring_frames_agree(name: str, n_frames: int) -> None:
    scans = read_scans(data_path(f"range/{name}"))
    assert len(scans) == n_frames
    points = scans[-1].points()[scans[-1].valid]
    pixels = scans[0].pixels(points)
    seen = np.isfinite(pixels).all(axis=1)
    row, column = np.rint(pixels[seen]).astype(int).T
    expected = np.linalg.norm(points[seen] - scans[0].origin, axis=1)
    assert np.median(np.abs(scans[0].ranges[row, column] - expected)) < 0.015


@requires_bench
@pytest.mark.parametrize("name", ["office", "drum_and_post"])
def test_benchmark_scans_open(name: str) -> None:
    scans = read_scans(bench_path(f"{name}.npz"))
    assert len(scans) == 10
    with np.load(bench_path(f"{name}.npz")) as arrays:
        np.testing.assert_allclose(
            scans[3].world_from_sensor.matrix, arrays["world_from_sensor"][3], atol=1e-9
        )
        np.testing.assert_allclose(scans[3].ranges[240], arrays["range_tenth_mm"][3, 240] / 1e4)
    with pytest.raises(InputError, match="holds 10 scans; pick one with"):
        read_scan(bench_path(f"{name}.npz"))
    assert read_scan(f"{bench_path(f'{name}.npz')}#10").name == f"{name}#10"


@requires_bench
def test_a_benchmark_instance_that_is_no_scan_is_refused() -> None:
    with pytest.raises(InputError, match="which is no scan"):
        read_scan(bench_path("room_candidates.npz"))
