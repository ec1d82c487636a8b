# SPDX-License-Identifier: MIT
"""Depth maps of COLMAP and of radiance fields as scans; lens distortion of them; files of floats."""

import json
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scenes.checks import InputError
from scenes.io.rgbd.depth import read_depth_image
from scenes.io.scan_files import open_scans, read_scan, read_scans
from scenes.scan.projection import PinholeProjection
from scenes.scan.range_image import RangeImage
from tests.helpers.rgbd_rooms import (
    Frame,
    exr_bytes,
    off_walls,
    pixels_of,
    save,
    see_room,
    write_colmap,
    write_model,
    write_splats,
    write_transforms,
)

Write = Callable[[Path, list[Frame]], None]
CENTRED = PinholeProjection(64, 48, 50.0, 49.0, 31.5, 23.5)
LENS = {"k1": -0.21, "k2": 0.06, "p1": 0.002, "p2": -0.001}


def write_model_beside(folder: Path, frames: list[Frame], suffix: str, model: str) -> None:
    """Depth renders in folders as the images', beside a model of COLMAP."""
    write_model(folder / model, frames, "PINHOLE", pixels_of(half=0.5), (64, 48), binary=suffix == "npy")
    for k, frame in enumerate(frames):
        save(folder / "depth/left" / f"a{k + 1}.{suffix}", frame.depth.astype(np.float32))
        save(folder / "images/left" / f"a{k + 1}.jpg", frame.colour())


WRITERS: dict[str, tuple[str, Write]] = {
    "colmap": ("COLMAP", write_colmap),
    "colmap, text": ("COLMAP", partial(write_colmap, binary=False, kind="photometric")),
    "colmap, larger images": ("COLMAP", partial(write_colmap, size=(256, 192))),
    "colmap, in dense": ("COLMAP", lambda folder, frames: write_colmap(folder / "dense/0", frames)),
    "transforms, mm": ("transforms.json", write_transforms),
    "transforms, npy": ("transforms.json", partial(write_transforms, suffix="npy", shared=False)),
    "transforms, tiff": ("transforms.json", partial(write_transforms, suffix="tiff")),
    "transforms, exr": ("transforms.json", partial(write_transforms, suffix="exr", shared=False)),
    "splats, npy": ("COLMAP model with depth", partial(write_model_beside, suffix="npy", model="sparse/0")),
    "splats, npz": ("COLMAP model with depth", partial(write_model_beside, suffix="npz", model="sparse")),
    "splats, exr": ("COLMAP model with depth", partial(write_model_beside, suffix="exr", model="sparse/0")),
    "cameras.json": ("cameras.json with depth", write_splats),
    "cameras.json, in order": ("cameras.json with depth", partial(write_splats, by_name=False)),
    "cameras.json, npy": ("cameras.json with depth", partial(write_splats, suffix="npy")),
}


@pytest.fixture(scope="module")
def frames() -> list[Frame]:
    return see_room()


def check_room(scans: list[RangeImage], frames: list[Frame], step_m: float = 1e-6) -> None:
    assert len(scans) == len(frames)
    for scan, frame in zip(scans, frames, strict=True):
        np.testing.assert_allclose(scan.world_from_sensor.matrix, frame.matrix, atol=1e-6)
        assert scan.valid.mean() > 0.9
        assert off_walls(scan.points()[scan.valid]) < 2 * step_m


def said(scans: list[RangeImage]) -> str:
    return " ".join(sentence for scan in scans for sentence in scan.warnings)


@pytest.mark.parametrize("name", WRITERS)
def test_the_room_stands_where_it_is(tmp_path: Path, name: str) -> None:
    layout, write = WRITERS[name]
    frames = see_room(CENTRED) if layout.startswith("cameras.json") else see_room()
    write(tmp_path, frames)
    source = open_scans(tmp_path)
    assert (source.kind, source.registered) == (f"rgbd ({layout})", True)
    scans = source.read()
    check_room(scans, frames, 0.0005 if name == "transforms, mm" else 1e-6)
    if not layout.startswith("cameras.json"):
        greys = [round(float(np.mean(scan.colour)), -1) for scan in scans if scan.colour is not None]
        assert greys == [frame.grey for frame in frames]
    assert ("unit of the reconstruction is arbitrary" in said(scans)) == (layout != "transforms.json")


def test_images_that_are_not_registered_are_left_out_with_a_count(
    tmp_path: Path, frames: list[Frame]
) -> None:
    write_colmap(tmp_path, frames)
    write_model(tmp_path / "sparse", frames[:3], "PINHOLE", pixels_of(half=0.5), (64, 48), binary=True)
    scans = read_scans(tmp_path)
    check_room(scans, frames[:3])
    assert "1 of 4 frames has no pose and was left out" in said(scans)


MODELS: dict[str, list[float]] = {
    "SIMPLE_PINHOLE": [50.0, 31.8, 24.3],
    "SIMPLE_RADIAL": [50.0, 31.8, 24.3, -0.12],
    "RADIAL": [50.0, 31.8, 24.3, -0.2, 0.05],
    "OPENCV": [50.0, 49.0, 31.8, 24.3, *LENS.values()],
    "FULL_OPENCV": [50.0, 49.0, 31.8, 24.3, *LENS.values(), 0.01, 0.0, 0.0, 0.0],
}


def lens_rays(camera: PinholeProjection, lens: list[float]) -> np.ndarray[Any, Any]:
    """Rays, with z 1, that a lens with distortion bends to the pixels' centres: by Newton's steps."""
    rows, columns = np.indices(camera.shape).astype(float)
    wanted = np.stack([(columns - camera.cx) / camera.fx, (rows - camera.cy) / camera.fy], axis=-1)
    k1, k2, p1, p2, k3 = [*lens, 0, 0, 0, 0, 0][:5]
    place = wanted.copy()
    for _ in range(200):
        x, y = place[..., 0], place[..., 1]
        r2 = x * x + y * y
        radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
        bent = np.stack([x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
                         y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y], axis=-1)  # fmt: skip
        place += wanted - bent
    assert np.abs(bent - wanted).max() < 1e-9
    return np.concatenate([place, np.ones((*camera.shape, 1))], axis=-1)


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("binary", [True, False])
def test_camera_models_and_their_distortion(tmp_path: Path, model: str, binary: bool) -> None:
    values = MODELS[model]
    focal = values[0], values[1] if model.endswith("OPENCV") else values[0]
    lens = values[4:] if model.endswith("OPENCV") else values[3:]
    frames = see_room(rays=lens_rays(PinholeProjection(64, 48, *focal, 31.3, 23.8), lens), n_frames=2)
    write_colmap(tmp_path, frames)
    write_model(tmp_path / "sparse", frames, model, values, (64, 48), binary=binary)
    (tmp_path / "sparse" / f"images.{'txt' if binary else 'bin'}").unlink(missing_ok=True)
    (tmp_path / "sparse" / f"cameras.{'txt' if binary else 'bin'}").unlink(missing_ok=True)
    scans = read_scans(tmp_path)
    check_room(scans, frames)
    told = [sentence for sentence in scans[0].warnings if "lens distortion was taken out" in sentence]
    assert len(told) == (model != "SIMPLE_PINHOLE")
    if told:
        corner = lens_rays(PinholeProjection(64, 48, *focal, 31.3, 23.8), lens)[
            [0, 0, -1, -1], [0, -1, 0, -1]
        ]
        at = corner[:, :2] * focal + [31.3, 23.8]
        moved = np.linalg.norm(at - [[0, 0], [63, 0], [0, 47], [63, 47]], axis=-1).max()
        assert told == [f"lens distortion was taken out: up to {moved:.1f} pixels at the corners"]


@pytest.mark.parametrize("binary", [True, False])
def test_fisheyes_are_refused_by_name(tmp_path: Path, frames: list[Frame], binary: bool) -> None:
    write_colmap(tmp_path, frames, binary=binary)
    values = [50.0, 49.0, 32.0, 24.0, 0.1, 0.0, 0.0, 0.0]
    write_model(tmp_path / "sparse", frames, "OPENCV_FISHEYE", values, (64, 48), binary=binary)
    with pytest.raises(InputError, match=r"cameras\.\w+: a camera is of model OPENCV_FISHEYE .* undistort"):
        open_scans(tmp_path)


@pytest.mark.parametrize("name", ["cameras.bin", "images.bin"])
@pytest.mark.parametrize("keep", [0, 5, 0.5, 0.95])
def test_damaged_models_are_refused(tmp_path: Path, frames: list[Frame], name: str, keep: float) -> None:
    write_colmap(tmp_path, frames)
    file = tmp_path / "sparse" / name
    data = file.read_bytes()
    file.write_bytes(data[: int(keep if keep > 1 else keep * len(data))])
    with pytest.raises(InputError, match=name):
        open_scans(tmp_path)


def test_transforms_take_lens_scale_and_angle(tmp_path: Path) -> None:
    lens_frames = see_room(rays=lens_rays(PinholeProjection(64, 48, 50, 49, 31.3, 23.8), list(LENS.values())))
    write_transforms(tmp_path / "lens", lens_frames, lens=LENS, suffix="npy")
    scans = read_scans(tmp_path / "lens")
    check_room(scans, lens_frames)
    assert said(scans[:1]).count("lens distortion was taken out") == 1
    with_angle = {
        "camera_angle_x": 2 * np.arctan(64 / 100),
        "fl_x": None,
        "fl_y": None,
        "cx": 63.6,
        "cy": 48.6,
    }
    frames = see_room(PinholeProjection(64, 48, 50.0, 50.0, 31.3, 23.8))
    write_transforms(tmp_path / "angle", frames, lens=with_angle, suffix="npy")
    check_room(read_scans(tmp_path / "angle"), frames)
    half = [Frame(frame.depth / 2, frame.grey, frame.matrix) for frame in frames]
    write_transforms(tmp_path / "scale", half, lens=with_angle | {"depth_unit_scale_factor": 0.002})
    check_room(read_scans(tmp_path / "scale"), frames, 0.001)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"camera_model": "OPENCV_FISHEYE"}, "its camera_model 'OPENCV_FISHEYE' is not known"),
        ({"fl_x": None, "w": None, "h": None}, "states no focal length"),
        ({"frames": [{"file_path": "a.jpg", "transform_matrix": []}]}, "1 frames have no depth_file_path"),
        ({"frames": [{"depth_file_path": "../a.npy", "transform_matrix": []}]}, "lies outside the folder"),
    ],
)
def test_transforms_that_are_no_scans_are_refused(
    tmp_path: Path, frames: list[Frame], change: dict[str, Any], message: str
) -> None:
    write_transforms(tmp_path, frames, lens={})
    held = json.loads((tmp_path / "transforms.json").read_text()) | change
    save(tmp_path / "transforms.json", {key: value for key, value in held.items() if value is not None})
    with pytest.raises(InputError, match=message):
        open_scans(tmp_path)


def test_frames_without_depth_are_left_out_with_a_count(tmp_path: Path, frames: list[Frame]) -> None:
    write_transforms(tmp_path, frames)
    (tmp_path / "depths/d_2.png").unlink()
    scans = read_scans(tmp_path)
    check_room(scans, [*frames[:2], frames[3]], 0.0005)
    assert "1 of 4 frames have no depth map and were left out" in said(scans)


@pytest.mark.parametrize("suffix", ["npy", "npz", "tiff", "exr", "bin"])
def test_floats_are_metres_unless_a_scale_is_stated(tmp_path: Path, suffix: str) -> None:
    depth = np.linspace(1, 3, 48 * 64).reshape(48, 64).astype(np.float32)
    depth[0, :3] = 0, np.nan, np.inf
    save(tmp_path / "camera.json", {"fx": 50, "fy": 50, "cx": 31.5, "cy": 23.5})
    path = tmp_path / "depth" / f"0.{suffix}"
    if suffix == "bin":
        path.parent.mkdir()
        path.write_bytes(b"64&48&1&" + depth.tobytes())
    else:
        save(path, depth)
    np.testing.assert_array_equal(read_depth_image(path), depth)
    scan = read_scan(tmp_path)
    np.testing.assert_allclose(scan.points_in_sensor()[scan.valid][:, 2], depth.ravel()[3:], rtol=1e-6)
    tenth = read_scan(tmp_path, depth_scale=10.0)
    np.testing.assert_allclose(tenth.ranges[scan.valid], scan.ranges[scan.valid] / 10)


@pytest.mark.parametrize(
    ("name", "data", "message"),
    [
        ("a.exr", b"text", "cannot be read as a depth image"),
        ("a.exr", exr_bytes(np.ones((20, 9)))[:-40], "truncated|cannot be read"),
        ("a.exr", exr_bytes(np.ones((20, 9)), 1).replace(b"\x02dataW", b"\x04dataW"), "packed by PIZ"),
        ("a.bin", b"64&48&1&" + bytes(100), "has 100 bytes for 64 x 48 depths of 1 channels"),
        ("a.bin", b"2&2&3&" + bytes(48), "of 3 channels"),
        ("a.npy", b"\x93NUMPY", "cannot be read"),
        ("a.depth", b"bvx2", "LZFSE"),
    ],
)
def test_unusable_depth_maps_are_refused(tmp_path: Path, name: str, data: bytes, message: str) -> None:
    (tmp_path / name).write_bytes(data)
    with pytest.raises(InputError, match=message):
        read_depth_image(tmp_path / name)


def test_arrays_of_other_shapes_are_refused(tmp_path: Path) -> None:
    save(tmp_path / "a.npy", np.ones((4, 5, 3)))
    with pytest.raises(InputError, match=r"shape \(4, 5, 3\); expected one depth a pixel"):
        read_depth_image(tmp_path / "a.npy")
    np.savez(tmp_path / "a.npz", one=np.ones((4, 5)), two=np.ones((4, 5)))
    with pytest.raises(InputError, match="holds the arrays one, two; call the one of depth 'depth'"):
        read_depth_image(tmp_path / "a.npz")
