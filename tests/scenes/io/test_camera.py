# SPDX-License-Identifier: MIT
"""Cameras of RGB-D folders: intrinsics of another size, lens distortion, colour of another size."""

import json
import re
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from scenes.checks import FloatArray, InputError
from scenes.io.scan_files import read_scan, read_scans
from scenes.scan.projection import PinholeProjection
from tests.helpers.data_paths import data_path, requires_data

TRAPS = "reported/rgbd_camera_traps"
SIZE = 256, 192
CAMERA = {"fx": 212.0, "fy": 212.0, "cx": 127.5, "cy": 95.5}
LENS = {"k1": -0.28, "k2": 0.08, "p1": 0.002, "p2": -0.001, "k3": 0.01}
COLOUR_CAMERA = {"fx": 1590.0, "fy": 1590.0, "cx": 959.5, "cy": 719.5}


def folder_of(folder: Path, camera: dict[str, Any], colour_size: tuple[int, int] = SIZE) -> Path:
    """A folder with one frame, whose depths are different in all pixels of a row."""
    columns, _ = np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))
    depth, colour = (2000 + columns).astype(np.uint16), np.full((*colour_size[::-1], 3), 128, np.uint8)
    for name, image in (("depth", depth), ("color", colour)):
        (folder / name).mkdir(parents=True)
        cv2.imwrite(str(folder / name / "0.png"), image)
    (folder / "camera.json").write_text(json.dumps({"depth_scale": 1000, **camera}))
    return folder


def distort(places: FloatArray) -> FloatArray:
    """The Brown-Conrady model, term by term, of normalised image coordinates (n, 2)."""
    x, y = places.T
    r2 = x**2 + y**2
    radial = 1 + LENS["k1"] * r2 + LENS["k2"] * r2**2 + LENS["k3"] * r2**3
    return np.column_stack(
        [
            x * radial + 2 * LENS["p1"] * x * y + LENS["p2"] * (r2 + 2 * x**2),
            y * radial + LENS["p1"] * (r2 + 2 * y**2) + 2 * LENS["p2"] * x * y,
        ]
    )


@requires_data
def test_a_principal_point_outside_of_the_image_is_refused() -> None:
    with pytest.raises(InputError, match=r"000000\.png: .*\(959\.5, 719\.5\) lies outside of its 256 x 192"):
        read_scans(data_path(f"{TRAPS}/r08_intrinsics_of_colour_no_size"))


@pytest.mark.parametrize("given", [(212.0, 212.0, -3.0, 95.5), (212.0, 212.0, 127.5, 192.0)])
def test_given_intrinsics_of_another_image_are_refused(tmp_path: Path, given: tuple[float, ...]) -> None:
    fx, fy, cx, cy = given
    with pytest.raises(InputError, match="lies outside of its 256 x 192 pixels"):
        read_scan(folder_of(tmp_path / "a", CAMERA), intrinsics=(fx, fy, cx, cy))


def test_intrinsics_of_a_stated_size_are_scaled(tmp_path: Path) -> None:
    scan = read_scan(folder_of(tmp_path / "a", {**COLOUR_CAMERA, "width": 1920, "height": 1440}))
    assert scan.projection == PinholeProjection(*SIZE, *CAMERA.values())
    assert scan.warnings == ("intrinsics of 1920 x 1440 pixels were scaled to 256 x 192",)
    with pytest.raises(InputError, match=r"its camera file says \(1920, 1080\)"):
        read_scan(folder_of(tmp_path / "b", {**COLOUR_CAMERA, "width": 1920, "height": 1080}))


@requires_data
def test_distortion_of_the_handed_folder_is_taken_out() -> None:
    for scan in read_scans(data_path(f"{TRAPS}/r03_distorted_camera")):
        middle, corner = scan.points_in_sensor()[96, 128], scan.points_in_sensor()[10, 10]
        assert scan.projection == PinholeProjection(*SIZE, *CAMERA.values())
        assert abs(middle[0] / middle[2] * 212 + 127.5 - 128) < 0.01
        assert np.abs(corner[:2] / corner[2] * 212 + [127.5, 95.5] - 10).max() < 0.75


@pytest.mark.parametrize("lens", [LENS, {"distortion_model": "plumb_bob", "distortion": list(LENS.values())}])
def test_points_lie_where_the_lens_saw_them(tmp_path: Path, lens: dict[str, Any]) -> None:
    scan = read_scan(folder_of(tmp_path / "a", {**CAMERA, **lens}))
    points = scan.points_in_sensor()[scan.valid]
    assert len(points) > 0.9 * scan.ranges.size
    seen = distort(points[:, :2] / points[:, 2:]) * 212 + [127.5, 95.5]
    np.testing.assert_allclose(seen, np.rint(seen), atol=1e-3)
    np.testing.assert_allclose(1000 * points[:, 2], 2000 + np.rint(seen[:, 0]), atol=1e-6)
    off = scan.pixels(scan.points()[scan.valid]) - np.argwhere(scan.valid)
    assert np.nanmax(np.abs(off)) < 1.0
    assert scan.warnings == ("lens distortion was taken out: up to 34.4 pixels at the corners",)


@pytest.mark.parametrize("k1", [-0.5, -0.9, -2.0])
def test_pixels_that_no_ray_reaches_are_left_out_with_a_count(tmp_path: Path, k1: float) -> None:
    scan = read_scan(folder_of(tmp_path, {**CAMERA, "k1": k1}))
    points = scan.points_in_sensor()[scan.valid]
    flat = points[:, :2] / points[:, 2:]
    radius = np.linalg.norm(flat, axis=1)
    assert 0 < len(points) < scan.ranges.size
    assert radius.max() < 1.01 * np.sqrt(-1 / (3 * k1))  # there r (1 + k1 r^2) turns back
    seen = flat * (1 + k1 * radius**2)[:, None] * 212 + [127.5, 95.5]
    np.testing.assert_allclose(seen, np.rint(seen), atol=0.2)
    assert re.search(
        r"\d+ of 49152 pixels, which no ray of the lens reaches, were left out", scan.warnings[1]
    )


def test_distortion_that_is_not_known_is_refused_and_unknown_keys_are_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"camera\.json: its distortion_model 'OPENCV_FISHEYE' is not known"):
        read_scan(folder_of(tmp_path / "a", {**CAMERA, "distortion_model": "OPENCV_FISHEYE", "k1": 0.1}))
    with pytest.raises(InputError, match=r"expected 4, 5 or 8 numbers"):
        read_scan(folder_of(tmp_path / "b", {**CAMERA, "distortion": [0.1, 0.2, 0.3]}))
    plain = read_scan(folder_of(tmp_path / "c", {**CAMERA, "k1": 0, "distortion_model": "kannala"}))
    assert (plain.sensor_points, plain.warnings) == (None, ())
    named = read_scan(folder_of(tmp_path / "d", {**CAMERA, "skew": 0.1, "cx_px": 3}))
    assert named.warnings == ("camera.json: keys that are not known were left out: cx_px, skew",)


def test_colour_of_another_size_is_resized_where_the_sides_have_one_ratio(tmp_path: Path) -> None:
    for name, size in (("a", (1920, 1440)), ("b", (128, 96))):
        scan = read_scan(folder_of(tmp_path / name, CAMERA, size))
        assert scan.colour is not None
        assert scan.colour.shape == (192, 256, 3)
        assert (scan.colour == 128).all()
    with pytest.raises(InputError, match="is 1920 x 1080, its depth image 256 x 192; register the depth"):
        read_scan(folder_of(tmp_path / "c", CAMERA, (1920, 1080)))
