# SPDX-License-Identifier: MIT
"""Files of mere points as scans: ours keep pose and pixels, others need the scanner's place."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scenes.checks import InputError
from scenes.io.checks.limits import limits
from scenes.io.clouds.las import read_las_points
from scenes.io.describe import describe
from scenes.io.formats.header import scan_header
from scenes.io.formats.returns import ScanReturns, cloud_of, scan_of
from scenes.io.formats.station import scan_from_station
from scenes.io.point_files import read_points
from scenes.io.scan_files import read_scan, write_scan
from scenes.io.scan_request import ScanRequest, read_request
from scenes.pose import Pose
from scenes.scan.projection import SphericalProjection
from scenes.scan.range_image import RangeImage
from tests.helpers.scan_examples import POSE, PROJECTIONS, example_scan

STOOD = np.array([500_012.5, 5_000_003.25, 101.6])


def box_scan(shift: Any = (0.0, 0.0, 0.0)) -> RangeImage:
    """A panorama inside a box of 6 m, coloured by direction."""
    grid = SphericalProjection.regular(120, 40, 360.0, (-40.0, 39.0))
    pose = Pose.from_parts(POSE.rotation, np.asarray(shift, dtype=np.float64))
    rays = grid.directions()
    reach = 3.0 / np.abs(pose.rotate(rays)).max(axis=-1)
    colour = np.rint((rays + 1) / 2 * 255).astype(np.float32) / np.float32(255)
    return RangeImage(reach, grid, pose, colour=colour)


@pytest.mark.parametrize("suffix", [".las", ".laz", ".xyz", ".txt", ".asc", ".csv"])
def test_files_of_ours_are_points_for_others_and_scans_for_us(tmp_path: Path, suffix: str) -> None:
    scan = example_scan(PROJECTIONS["panorama"], off_rays_m=0.004)
    write_scan(scan, tmp_path / f"a{suffix}")
    cloud = read_points(tmp_path / f"a{suffix}")
    np.testing.assert_allclose(cloud.points, scan.points()[scan.valid], atol=1e-5)
    assert cloud.warnings == ()
    back = read_scan(tmp_path / f"a{suffix}")
    np.testing.assert_array_equal(back.valid, scan.valid)
    assert (back.name, back.sigma_m, back.sensor, back.noise) == ("küche <b>", 0.002, "a scanner", "constant")


def test_las_opens_elsewhere_with_colour_and_scaled_intensity(tmp_path: Path) -> None:
    laspy = pytest.importorskip("laspy")
    scan = example_scan(PROJECTIONS["pinhole"])
    light = np.where(scan.valid, np.linspace(0, 4, scan.ranges.size).reshape(scan.shape), 0)
    write_scan(replace(scan, intensity=light.astype(np.float32)), tmp_path / "a.las")
    las = laspy.read(tmp_path / "a.las")
    assert (las.header.version.minor, las.point_format.id) == (4, 7)
    assert scan.colour is not None
    assert int(las.red[0]) == 257 * round(float(scan.colour[scan.valid][0, 0]) * 255)
    assert int(las.intensity.max()) == 65535
    assert (las.row[0], las.column[0]) == tuple(np.argwhere(scan.valid)[0])
    assert (np.asarray(las.return_number) == 1).all()


def test_a_long_header_is_spread_over_records(tmp_path: Path) -> None:
    grid = SphericalProjection.regular(5000, 2, 360.0, (0.0, 1.0))
    scan = RangeImage(np.full(grid.shape, 4.0), grid, POSE)
    for suffix in (".las", ".csv"):
        write_scan(scan, tmp_path / f"a{suffix}")
        back = read_scan(tmp_path / f"a{suffix}")
        np.testing.assert_array_equal(back.projection.directions(), grid.directions())
        assert len(read_points(tmp_path / f"a{suffix}").points) == 10_000


def test_coarser_steps_for_what_is_far_apart(tmp_path: Path) -> None:
    grid = SphericalProjection.regular(12, 3, 360.0, (-1.0, 1.0))
    for reach, step in ((3.0, 1e-5), (1e5, 1e-4), (1e8, 1e-1)):
        scan = RangeImage(np.full(grid.shape, reach), grid, POSE)
        if step > 1e-2:
            with pytest.raises(InputError, match=r"m apart do not fit into LAS; use \.npz"):
                write_scan(scan, tmp_path / "a.las")
            continue
        write_scan(scan, tmp_path / "a.las")
        np.testing.assert_allclose(
            read_scan(tmp_path / "a.las").points(), scan.points(), atol=step / 2 * 1.01
        )


@pytest.mark.parametrize("suffix", [".las", ".csv", ".xyz"])
def test_an_empty_scan_is_no_file_of_points(tmp_path: Path, suffix: str) -> None:
    scan = RangeImage(np.full((23, 31), np.inf), PROJECTIONS["pinhole"], POSE)
    with pytest.raises(InputError, match=r"has no return; a file of points would be empty, use \.npz"):
        write_scan(scan, tmp_path / f"a{suffix}")


def test_points_of_others_are_refused_as_scans_with_the_cure(tmp_path: Path) -> None:
    laspy = pytest.importorskip("laspy")
    las = laspy.create(point_format=0, file_version="1.2")
    las.xyz = np.eye(3)
    las.write(tmp_path / "a.las")
    (tmp_path / "a.xyz").write_text("1 2 3\n4 5 6\n")
    (tmp_path / "a.csv").write_text("x,y,z\n1,2,3\n")
    (tmp_path / "a.pts").write_text("1\n1 2 3\n")
    for name in ("a.las", "a.xyz", "a.csv", "a.pts"):
        with pytest.raises(InputError, match=rf"{name}: holds points without .*\(--origin X,Y,Z\)"):
            read_scan(tmp_path / name)


def test_damaged_text_scans_are_refused(tmp_path: Path) -> None:
    write_scan(example_scan(PROJECTIONS["pinhole"], colour=False), tmp_path / "a.csv")
    lines = (tmp_path / "a.csv").read_text().splitlines()
    (tmp_path / "b.csv").write_text("\n".join([*lines[:2], *(line + ",1" for line in lines[2:])]))
    with pytest.raises(InputError, match="its lines hold 6 numbers, its header names 5 columns"):
        read_scan(tmp_path / "b.csv")
    (tmp_path / "c.csv").write_text("\n".join([*lines, lines[-1]]))
    with pytest.raises(InputError, match="do not each have a pixel of their own in 23 x 31: was the file"):
        read_scan(tmp_path / "c.csv")
    (tmp_path / "d.csv").write_text("\n".join([*lines[:3], lines[3].replace("0", "x")]))
    with pytest.raises(InputError, match=r"d\.csv: cannot be read as csv scan"):
        read_scan(tmp_path / "d.csv")
    with limits(file_bytes=10), pytest.raises(InputError, match="exceed the limit file_bytes=10"):
        read_scan(tmp_path / "a.csv")


def test_pixels_outside_the_image_are_refused() -> None:
    scan = example_scan(PROJECTIONS["pinhole"])
    cloud, header = cloud_of(scan), scan_header(scan)
    n_points = len(cloud.points)
    with pytest.raises(InputError, match="do not each have a pixel"):
        scan_of(header, n_points, [ScanReturns(cloud.points, cloud.row + 1000, cloud.column)])
    with pytest.raises(InputError, match="do not each have a pixel"):
        scan_of(header, n_points, [cloud, cloud])
    huge = {**header, "projection": {**header["projection"], "width": 10_000, "height": 10_000}}
    with pytest.raises(InputError, match="points in a grid of 10000 x 10000: is its header damaged"):
        scan_of(huge, n_points, [cloud])


@pytest.mark.parametrize(("high", "shift"), [(255, 0), (255 * 257, 8)], ids=["8 bits", "16 bits"])
def test_las_colours_of_8_bits_in_16_are_known(tmp_path: Path, high: int, shift: int) -> None:
    laspy = pytest.importorskip("laspy")
    las = laspy.create(point_format=2, file_version="1.2")
    las.xyz = np.eye(3)
    las.red, las.green, las.blue = np.array([high, 0, 0]), np.array([0, high, 0]), np.array([0, 0, high])
    las.write(tmp_path / "a.las")
    colour = read_las_points(tmp_path / "a.las").colour
    assert colour is not None
    np.testing.assert_array_equal(colour, np.eye(3) * (high >> shift))


def test_a_station_says_that_it_was_made_of_points_and_keeps_colours() -> None:
    scan = box_scan(STOOD)
    assert scan.colour is not None
    found = scan_from_station(scan.points().reshape(-1, 3), STOOD, colour=scan.colour.reshape(-1, 3))
    said = "points projected to a spherical image from (500012.5, 5000003.25, 101.6), "
    assert found.sensor == f"{said}{found.valid.sum()} of 4800 kept"
    assert found.colour is not None
    expected = scan.world_from_sensor.inverse().rotate(found.rays())  # colours are those of the directions
    off = found.colour - (expected + 1) / 2
    assert np.abs(off[found.valid]).max() < 0.01


def test_unstructured_e57_with_a_pose_is_projected(tmp_path: Path) -> None:
    pye57 = pytest.importorskip("pye57")
    scan = box_scan(STOOD)
    local = scan.points()[scan.valid] - STOOD
    fields = {f"cartesian{axis}": local[:, k].copy() for k, axis in enumerate("XYZ")}
    with pye57.E57(str(tmp_path / "a.e57"), mode="w") as file:
        file.write_scan_raw(fields, name="hall", rotation=np.array([1.0, 0, 0, 0]), translation=STOOD)
    found = read_scan(tmp_path / "a.e57")
    assert "projected to a spherical image from (500012.5, 5000003.25, 101.6)" in found.sensor
    np.testing.assert_allclose(found.origin, STOOD)
    assert np.linalg.norm(found.points()[found.valid] - STOOD, axis=1).min() > 2.999
    cloud = read_points(tmp_path / "a.e57")
    assert cloud.origins is not None
    np.testing.assert_allclose(cloud.origins[0], STOOD)


def test_an_unorganised_pcd_with_a_viewpoint_is_projected(tmp_path: Path) -> None:
    points = box_scan().points().reshape(-1, 3)
    head = f"""VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH {len(points)}\nHEIGHT 1
VIEWPOINT {{}} 1 0 0 0\nPOINTS {len(points)}\nDATA ascii\n"""
    rows = "\n".join(" ".join(f"{value:.6f}" for value in point) for point in points)
    (tmp_path / "a.pcd").write_text(head.format("10 20 1") + rows + "\n")
    found = read_scan(tmp_path / "a.pcd")
    np.testing.assert_allclose(found.origin, [10, 20, 1])
    assert "projected" in found.sensor
    assert np.abs(found.points()[found.valid] - [10, 20, 1]).max() < 3.001
    (tmp_path / "b.pcd").write_text(head.format("0 0 0") + rows + "\n")
    with pytest.raises(InputError, match=r"is unorganised \(HEIGHT 1, 4800 points\).*--origin X,Y,Z"):
        read_scan(tmp_path / "b.pcd")


def test_colours_reach_the_points_of_every_format_that_has_them(tmp_path: Path) -> None:
    scan = box_scan()
    assert scan.colour is not None
    for suffix in (".npz", ".ply", ".pcd", ".ptx", ".e57", ".las"):
        write_scan(scan, tmp_path / f"a{suffix}")
        cloud = read_points(tmp_path / f"a{suffix}")
        assert cloud.colour is not None
        rays = scan.world_from_sensor.inverse().rotate(
            cloud.points / np.linalg.norm(cloud.points, axis=1)[:, None]
        )
        assert np.abs(cloud.colour / 255 - (rays + 1) / 2).max() < 0.003
    text = "ply\nformat ascii 1.0\nelement vertex 1\n" + "".join(f"property float {a}\n" for a in "xyz")
    text += "".join(f"property float {name}\n" for name in ("red", "green", "blue"))
    (tmp_path / "b.ply").write_text(text + "end_header\n1 2 3 1.0 0.5 0\n")
    np.testing.assert_array_equal(read_points(tmp_path / "b.ply").colour, [[255, 128, 0]])


@pytest.mark.parametrize(
    ("shift", "steps"),
    [((691_234.5, 5_334_567.25, 512.0), "0.062 and 0.5"), ((4.2e4, 3.9e4, -30.0), "0.0039")],
)
def test_coordinates_in_single_precision_far_away_are_doubted_by_info_and_complete(
    tmp_path: Path, shift: tuple[float, ...], steps: str
) -> None:
    scan = box_scan(shift)
    points = scan.points()[scan.valid].astype(np.float32)
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n"
    head += "".join(f"property float {axis}\n" for axis in "xyz") + "end_header\n"
    path = tmp_path / "a.ply"
    path.write_bytes(head.encode() + points.tobytes())
    doubt = f"stored in 32 bits, so they are rounded to steps of {steps} m"
    assert any(doubt in text for text in describe(path)["warnings"])
    request = ScanRequest((str(path),), origins=(tuple(scan.origin.tolist()),))
    try:
        told = read_request(request).doubts
    except InputError as error:  # the steps are too coarse for a scan
        told = (str(error),)
    assert any(doubt in text for text in told)
    near = tmp_path / "b.xyz"  # tenths of a millimetre, in text
    np.savetxt(near, scan.points()[scan.valid], "%.4f")
    assert not any("32 bits" in text for text in read_points(near).warnings)
