# SPDX-License-Identifier: MIT
"""Organised clouds whose sensor has other axes than ours: recognised, named, and left where they are."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from scenes.checks import InputError
from scenes.io.point_files import read_points
from scenes.io.scan_files import read_scan
from scenes.pose import Pose, quaternion_of
from scenes.scan.projection import PinholeProjection, Projection, SphericalProjection

WIDE = PinholeProjection(160, 120, 120.0, 120.0, 79.5, 59.5)
NARROW = PinholeProjection(120, 90, 400.0, 400.0, 59.5, 44.5)  # a sphere fits nearly as well
PANORAMA = SphericalProjection.regular(180, 60, 360.0, (-40.0, 40.0))
OPENGL = np.diag([1.0, -1.0, -1.0])
VEHICLE = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])
HELD = Pose.looking_at(np.array([2.9, 1.3, 1.5]), np.array([3.0, 4.0, 1.2]), np.array([0.0, 0.0, 1.0]))


def sensor_points(projection: Projection, noise_sigma_m: float = 0.001) -> NDArray[np.float64]:
    """Points in our sensor frame on the inside of a box."""
    rays = projection.directions()
    ranges = (np.array([1.8, 1.4, 2.7]) / np.maximum(np.abs(rays), 1e-12)).min(axis=-1)
    ranges += np.random.default_rng(0).normal(0, noise_sigma_m, ranges.shape)
    return np.asarray(rays * ranges[..., None])


def write_pcd(path: Path, points: NDArray[Any], viewpoint: Pose) -> Path:
    x, y, z, w = quaternion_of(viewpoint.rotation)
    rows, columns = points.shape[:2]
    place = " ".join(map(repr, [*viewpoint.translation.tolist(), w, x, y, z]))
    header = (
        "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\n"
        f"WIDTH {columns}\nHEIGHT {rows}\nVIEWPOINT {place}\nPOINTS {rows * columns}\nDATA binary\n"
    )
    path.write_bytes(header.encode() + points.astype("<f4").tobytes())
    return path


@pytest.mark.parametrize("viewpoint", [Pose.identity(), HELD])
@pytest.mark.parametrize(
    ("projection", "axes", "words"),
    [
        (WIDE, OPENGL, "OpenGL, ARKit and Blender (x right, y up, z backwards)"),
        (NARROW, OPENGL, "OpenGL, ARKit and Blender (x right, y up, z backwards)"),
        (WIDE, VEHICLE, "vehicles (x forward, y left, z up)"),
        (PANORAMA, VEHICLE, "vehicles (x forward, y left, z up)"),
    ],
)
def test_axes_are_named_and_no_point_moves(
    tmp_path: Path, projection: Projection, axes: NDArray[Any], words: str, viewpoint: Pose
) -> None:
    points = sensor_points(projection) @ axes.T
    scan = read_scan(write_pcd(tmp_path / "a.pcd", points, viewpoint))
    assert scan.projection.kind == projection.kind
    np.testing.assert_allclose(scan.points(), viewpoint.apply(points), atol=1e-6)
    np.testing.assert_allclose(scan.world_from_sensor.rotation, viewpoint.rotation @ axes, atol=1e-9)
    (warning,) = scan.warnings
    assert words in warning
    if isinstance(scan.projection, PinholeProjection) and isinstance(projection, PinholeProjection):
        assert scan.projection.fx == pytest.approx(projection.fx, rel=1e-3)
        assert scan.projection.fy == pytest.approx(projection.fy, rel=1e-3)


@pytest.mark.parametrize("projection", [WIDE, NARROW, PANORAMA])
@pytest.mark.parametrize("in_world", [False, True])
def test_our_own_axes_give_no_word(tmp_path: Path, projection: Projection, in_world: bool) -> None:
    points = sensor_points(projection)
    stored = HELD.apply(points) if in_world else points
    scan = read_scan(write_pcd(tmp_path / "a.pcd", stored, HELD))
    np.testing.assert_allclose(scan.points(), HELD.apply(points), atol=1e-5)
    assert scan.warnings == ()


def test_world_points_turned_like_a_vehicle_are_not_turned_again(tmp_path: Path) -> None:
    viewpoint = Pose.from_parts(VEHICLE, np.zeros(3))
    points = sensor_points(WIDE)
    scan = read_scan(write_pcd(tmp_path / "a.pcd", viewpoint.apply(points), viewpoint))
    np.testing.assert_allclose(scan.points(), viewpoint.apply(points), atol=1e-5)
    assert scan.warnings == ()


@pytest.mark.parametrize(
    ("signs", "words"),
    [
        ([-1, 1, 1], "columns run right to left"),
        ([1, -1, 1], "rows run from bottom to top"),
        ([-1, -1, -1], "columns run right to left"),
    ],
)
def test_left_handed_axes_are_named(tmp_path: Path, signs: list[int], words: str) -> None:
    points = sensor_points(WIDE) * np.array(signs)
    scan = read_scan(write_pcd(tmp_path / "a.pcd", points, Pose.identity()))
    np.testing.assert_allclose(scan.points(), points, atol=1e-6)
    assert words in scan.warnings[-1]
    assert "left-handed" in scan.warnings[-1]


def test_an_upside_down_camera_is_not_mirrored(tmp_path: Path) -> None:
    points = sensor_points(WIDE) * np.array([-1, -1, 1])
    assert read_scan(write_pcd(tmp_path / "a.pcd", points, Pose.identity())).warnings == ()


def test_what_fits_no_axes_is_refused_with_those_that_were_tried(tmp_path: Path) -> None:
    points = sensor_points(WIDE)
    points[:, ::2] += [0.5, 0.3, 0.4]  # two scans in one grid
    path = write_pcd(tmp_path / "a.pcd", points, Pose.identity())
    with pytest.raises(
        InputError, match=r"fit no known projection.*tried too: the camera axes of OpenGL"
    ) as e:
        read_scan(path)
    assert str(path) in str(e.value)


@pytest.mark.parametrize(
    ("names", "kind", "scale"), [("r g b", "U", 1), ("red green blue", "F", 1 / 255), ("R G B", "U", 257)]
)
def test_colours_in_fields_of_their_own(tmp_path, names, kind, scale):
    points = np.random.default_rng(0).random((200, 3)) * [5, 4, 2.7]
    colour = " ".join(repr(value * scale) for value in (200, 100, 50))
    size = {"U": 2, "F": 4}[kind]
    path = tmp_path / "a.pcd"
    path.write_text(
        f"VERSION 0.7\nFIELDS x y z {names}\nSIZE 4 4 4 {size} {size} {size}\n"
        f"TYPE F F F {kind} {kind} {kind}\n"
        "COUNT 1 1 1 1 1 1\nWIDTH 200\nHEIGHT 1\nVIEWPOINT 2 1 1.5 0 0 0 0\nPOINTS 200\nDATA ascii\n"
        + "".join(f"{x:.5f} {y:.5f} {z:.5f} {colour}\n" for x, y, z in points)
    )
    cloud = read_points(path)
    assert (cloud.colour == [200, 100, 50]).all()
    assert any("VIEWPOINT has the quaternion 0, 0, 0, 0" in warning for warning in cloud.warnings)
