# SPDX-License-Identifier: MIT
"""RGB-D layouts: frames, camera and poses of plain, Redwood, align3d and TUM folders."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from scenes.checks import FloatArray, InputError
from scenes.formats.documents import parse_json, read_json, read_text
from scenes.formats.guard import reading
from scenes.formats.rgbd.rgbd import Intrinsics, RgbdFolder, RgbdFrame, check_encoding
from scenes.formats.trajectory import TIME_GAP_S, natural_key, read_poses, read_timed_poses, rounded_pose
from scenes.pose import Pose
from scenes.run.file_limits import check_limit

_DEPTH_FOLDERS = ("depth", "depths")
_COLOUR_FOLDERS = ("color", "colour", "rgb", "image", "images")
_IMAGES = {".png", ".jpg", ".jpeg", ".tif", ".tiff", ".pgm", ".ppm", ".bmp"}
_CAMERAS = ("camera.json", "intrinsics.json", "intrinsic.json", "camera_primesense.json", "camera.txt",
            "intrinsics.txt", "camera-intrinsics.txt")  # fmt: skip
_FRAME = re.compile(r"(frame-\d+)\.depth\.(?:png|pgm|tiff?)", re.IGNORECASE)
_POSES = ("pose.txt", "poses.txt", "trajectory.txt", "trajectory.log", "poses.json")


def open_rgbd(folder: Path) -> RgbdFolder:
    """Return the frames of an RGB-D folder, without reading an image.

    * align3d: `frames.json`; its `rt_cam` is camera to world (checked: reprojected depths agree to 12 mm
      that way and to 118 mm the other, over 2.7 cm of motion). Frames without images are skipped.
    * TUM: `rgb.txt` and `depth.txt` (or `associations.txt`) with `groundtruth.txt`; 5000 values a metre.
    * Redwood: `color/`, `depth/` and `trajectory.log`, camera to world; 1000 values a metre.
    * frames (7-Scenes, tsdf-fusion): `frame-000000.depth.png` in millimetres, `.color.png` or `.jpg`, and
      `.pose.txt`, a 4x4 matrix, camera to world.
    * plain: `color/`, `depth/`, `pose.txt`, and for camera and scale `camera.json`, which may also name the
      `depth_encoding` (see `scenes.formats.rgbd.rgbd`).

    Raises InputError: none of these, or frames, images and poses of unequal number.
    """
    with reading(folder, "an RGB-D folder"):
        if (folder / "frames.json").is_file():
            found = _open_align3d(folder)
        elif (folder / "depth.txt").is_file() or (folder / "associations.txt").is_file():
            found = _open_tum(folder)
        elif any(_FRAME.fullmatch(inside.name) for inside in folder.iterdir()):
            found = _open_frames(folder)
        else:
            found = _open_plain(folder)
        if not found.frames:
            raise InputError("holds no depth image")
    return replace(found, folder=folder)


def _images(folder: Path, names: Sequence[str]) -> list[Path]:
    """Images of the first of the named subfolders that exists, in natural order."""
    for name in names:
        if (folder / name).is_dir():
            found = [p for p in (folder / name).iterdir() if p.suffix.lower() in _IMAGES and p.name[0] != "."]
            check_limit("entries", len(found), f"images in {name}")
            return sorted(
                (_inside(folder, f"{name}/{p.name}") for p in found), key=lambda path: natural_key(path.name)
            )
    return []


def _open_plain(folder: Path) -> RgbdFolder:
    """Plain and Redwood: subfolders of images, pairs by name or else by order."""
    depths, colours = _images(folder, _DEPTH_FOLDERS), _images(folder, _COLOUR_FOLDERS)
    if not depths:
        raise InputError(
            "is not an RGB-D folder: expected depth images in depth/, colour images in color/, "
            "poses in pose.txt or trajectory.log, the camera in camera.json; or TUM or align3d files, or "
            "frame-000000.depth.png, .color.png and .pose.txt; or 3DTK's scan000.3d"
        )
    if colours and len(colours) != len(depths):
        raise InputError(f"holds {len(colours)} colour and {len(depths)} depth images; give as many of both")
    files = [folder / name for name in _POSES if (folder / name).is_file()]
    poses: Sequence[Pose | None] = read_poses(files[0]) if files else [None] * len(depths)
    if len(poses) != len(depths):
        raise InputError(f"holds {len(depths)} depth images, but {files[0].name} has {len(poses)} poses")
    pairs = colours if colours else [None] * len(depths)
    frames = tuple(RgbdFrame(*frame) for frame in zip(depths, pairs, poses, strict=True))
    redwood = bool(files) and files[0].suffix == ".log"
    found = _with_camera(RgbdFolder("redwood" if redwood else "plain", frames), folder)
    return replace(found, depth_scale=1000.0) if redwood and found.depth_scale is None else found


def _open_frames(folder: Path) -> RgbdFolder:
    """7-Scenes and tsdf-fusion: frame-NNNNNN.depth.png, .color.png or .jpg, .pose.txt side by side."""
    names = [found for inside in folder.iterdir() if (found := _FRAME.fullmatch(inside.name))]
    check_limit("entries", len(names), "its frames")
    frames = []
    for found in sorted(names, key=lambda one: natural_key(one.string)):
        stem = found.group(1)
        images = [folder / f"{stem}.color{suffix}" for suffix in (".png", ".jpg", ".jpeg", ".ppm")]
        colour = next((image for image in images if image.is_file()), None)
        pose = folder / f"{stem}.pose.txt"
        poses = read_poses(_inside(folder, pose.name)) if pose.is_file() else [None]
        if len(poses) != 1:
            raise InputError(f"{pose.name} holds {len(poses)} poses; expected one 4x4 matrix")
        depth = _inside(folder, found.string)
        frames.append(RgbdFrame(depth, colour and _inside(folder, colour.name), poses[0]))
    found_camera = _with_camera(RgbdFolder("frames", tuple(frames)), folder)
    return replace(found_camera, depth_scale=found_camera.depth_scale or 1000.0)


def _with_camera(found: RgbdFolder, folder: Path) -> RgbdFolder:
    """Add what the first camera file of the folder tells."""
    for name in _CAMERAS:
        if (folder / name).is_file():
            with reading(folder / name, "a camera file"):
                return _read_camera(folder / name, found)
    return found


def _read_camera(path: Path, found: RgbdFolder) -> RgbdFolder:
    """Add what a .json (ours, Open3D's) or .txt (3x3, 4 or 5 numbers) tells of the camera."""
    text = read_text(path)
    if path.suffix == ".txt":
        numbers = [float(word) for word in text.replace(",", " ").split()]
        if len(numbers) == 9:
            return replace(found, intrinsics=(numbers[0], numbers[4], numbers[2], numbers[5]))
        if len(numbers) not in (4, 5):
            raise InputError(f"expected fx fy cx cy [depth_scale] or 3x3 numbers, got {len(numbers)}")
        fx, fy, cx, cy = numbers[:4]
        scale = numbers[4] if len(numbers) == 5 else None
        return replace(found, intrinsics=(fx, fy, cx, cy), depth_scale=scale)
    values = parse_json(text, dict)
    size = (int(values["width"]), int(values["height"])) if "width" in values else None
    scale = float(values["depth_scale"]) if values.get("depth_scale") is not None else None
    encoding = check_encoding(values.get("depth_encoding", "linear"))
    if "intrinsic_matrix" in values:  # Open3D's, column by column
        matrix = np.array(values["intrinsic_matrix"], dtype=np.float64).reshape(3, 3).T
        camera = _from_matrix(matrix)
    else:
        fx, fy, cx, cy = (float(values[name]) for name in ("fx", "fy", "cx", "cy"))
        camera = fx, fy, cx, cy
    return replace(found, intrinsics=camera, depth_scale=scale, image_size=size, depth_encoding=encoding)


def _from_matrix(matrix: FloatArray) -> Intrinsics:
    return float(matrix[0, 0]), float(matrix[1, 1]), float(matrix[0, 2]), float(matrix[1, 2])


def _inside(folder: Path, name: str) -> Path:
    """A file of the folder, or that its own list names; neither it nor what a link shows may lie outside."""
    if not isinstance(name, str) or "\0" in name:
        raise InputError(f"names {name!r}, which is no file's name")
    if not (folder / name).resolve().is_relative_to(folder.resolve()):
        raise InputError(f"names {name!r}, which lies outside the folder and is not opened; copy it into it")
    return folder / name


def _open_align3d(folder: Path) -> RgbdFolder:
    frames, cameras = [], set()
    size: Any = None
    entries = read_json(folder / "frames.json", dict)["root"]
    check_limit("entries", len(entries), "its frames")
    for entry in entries:
        depth, colour = _inside(folder, entry["depth_image"]), _inside(folder, entry["rgb_image"])
        if not depth.exists() and not colour.exists():
            continue
        info = entry["info"]
        pose = rounded_pose(np.array(info["rt_cam"]["matrix"]))
        frames.append(RgbdFrame(depth, colour, pose))
        matrix = np.array(info["kcam"]["matrix"], dtype=np.float64)
        cameras.add((_from_matrix(matrix), 1.0 / float(info["depth_scale"])))
        size = tuple(info["kcam"]["image_size"])
    if len(cameras) > 1:
        raise InputError(f"has {len(cameras)} different cameras in frames.json; one is supported")
    intrinsics, scale = cameras.pop() if cameras else (None, None)
    return RgbdFolder("align3d", tuple(frames), intrinsics, scale, size)


def _open_tum(folder: Path) -> RgbdFolder:
    """Depth images with the nearest colour image and pose, at most 20 ms away; others are dropped."""
    timed = _tum_pairs(folder)
    frames = [
        RgbdFrame(_inside(folder, depth), _inside(folder, colour), time=time) for time, depth, colour in timed
    ]
    if timed and (folder / "groundtruth.txt").is_file():
        stamps, poses = read_timed_poses(folder / "groundtruth.txt")
        near = [int(np.argmin(np.abs(stamps - time))) for time, _, _ in timed]
        frames = [
            replace(frame, pose=poses[k])
            for frame, k, (time, _, _) in zip(frames, near, timed, strict=True)
            if abs(stamps[k] - time) <= TIME_GAP_S
        ]
    found = _with_camera(RgbdFolder("tum", tuple(frames)), folder)
    return replace(found, depth_scale=found.depth_scale or 5000.0)


def _tum_pairs(folder: Path) -> list[tuple[float, str, str]]:
    """Time, depth image and colour image of each frame, by `associations.txt` or by the nearest time."""
    if (folder / "associations.txt").is_file():
        pairs = []
        for row in _tum_rows(folder / "associations.txt", 4):
            depth = 2 if row[3].startswith("depth") else 0  # both orders are in use
            pairs.append((float(row[depth]), row[depth + 1], row[3 - depth]))
        return pairs
    depths = [(float(row[0]), row[1]) for row in _tum_rows(folder / "depth.txt", 2)]
    colours = [(float(row[0]), row[1]) for row in _tum_rows(folder / "rgb.txt", 2)]
    if not colours:
        return []
    times = np.array([time for time, _ in colours])
    near = [int(np.argmin(np.abs(times - time))) for time, _ in depths]
    return [
        (time, name, colours[k][1])
        for (time, name), k in zip(depths, near, strict=True)
        if abs(times[k] - time) <= TIME_GAP_S
    ]


def _tum_rows(path: Path, n_words: int) -> list[list[str]]:
    rows = [line.split() for line in read_text(path).splitlines()]
    rows = [row for row in rows if row and not row[0].startswith("#")]
    if any(len(row) != n_words for row in rows):
        raise InputError(f"expected {n_words} words a line in {path.name}")
    return rows
