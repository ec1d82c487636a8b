# SPDX-License-Identifier: MIT
"""Layouts of RGB-D folders: the table by which they are known; TUM, Redwood, align3d, 7-Scenes and plain."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from scenes.checks import InputError
from scenes.io.checks.documents import read_json, read_text
from scenes.io.checks.guard import guard_reading
from scenes.io.checks.limits import check_limit
from scenes.io.formats.columns import in_seconds
from scenes.io.formats.facts import FormatFacts
from scenes.io.formats.format import Format
from scenes.io.poses.camera import Camera, intrinsics_of, read_camera
from scenes.io.poses.trajectory import natural_key, read_poses, read_timed_poses, rounded_pose
from scenes.io.rgbd import phone, reconstruction
from scenes.io.rgbd.depth import DEPTH_SUFFIXES, LZFSE
from scenes.io.rgbd.frames import RgbdFolder, RgbdFrame
from scenes.io.rgbd.listing import inside, is_marked, keep_complete, list_frames
from scenes.limits import TIME_GAP_S
from scenes.pose import Pose

_SEVEN_SCENES = " (--intrinsics 585,585,320,240 for 7-Scenes)"
_DEPTH_FOLDERS = ("depth", "depths")
_COLOUR_FOLDERS = ("color", "colour", "rgb", "image", "images")
_IMAGES = (*DEPTH_SUFFIXES, ".webp")
_FRAME = re.compile(r"(frame-\d+)\.depth\.(?:png|pgm|tiff?)", re.IGNORECASE)
_POSES = ("pose.txt", "poses.txt", "trajectory.txt", "trajectory.log", "poses.json")
_SENS = (
    "is a .sens recording, which is not read; unpack it by ScanNet's SensReader (reader.py --filename FILE "
    "--output_path FOLDER --export_depth_images --export_color_images --export_poses --export_intrinsics) "
    "and give that folder"
)
FORMAT = (
    Format(suffixes=(".r3d",), name="Record3D", refusal=LZFSE),
    Format(suffixes=(".sens",), name="ScanNet", refusal=_SENS),
)
LISTED_FACTS = (
    FormatFacts(
        title="plain",
        read="`depth/`, `color/`, `camera.json`; `depth_encoding` names other encodings",
        lost="codes for no return (65535 and full narrower numbers), with a count",
        written="16 bits: half a step, .1 mm up to 6.5 m, 1 mm to 65 m",
        poses="`pose.txt` or `--poses`",
        units="`depth_scale` in `camera.json`, or `--depth-scale`",
        colours="8-bit images, resized where the sides have one ratio",
        noise="estimated; a step of depth that hides it is shared by all points",
    ),
    FormatFacts(
        title="TUM",
        read="`depth.txt` and `rgb.txt`, or `associations.txt`",
        lost="as plain",
        written="half a step of .2 mm up to 13.1 m",
        poses="`groundtruth.txt`, nearest in time (20 ms)",
        units="5000 values a metre",
        colours="8-bit images, resized where the sides have one ratio",
        noise="estimated; a step of depth that hides it is shared by all points",
    ),
    FormatFacts(
        title="Redwood, Open3D",
        read="`depth/`, `color/`",
        lost="as plain",
        written="half a step of 1 mm up to 65.5 m",
        poses="`trajectory.log`",
        units="1000 values a metre",
        colours="8-bit images, resized where the sides have one ratio",
        noise="estimated; a step of depth that hides it is shared by all points",
    ),
    FormatFacts(
        title="align3d",
        read="`frames.json` and its images",
        lost="as plain",
        poses="`rt_cam`",
        units="its scale",
        colours="8-bit images, resized where the sides have one ratio",
        noise="estimated; a step of depth that hides it is shared by all points",
    ),
    FormatFacts(
        title="7-Scenes, tsdf-fusion",
        read="`frame-000000.depth.png`",
        lost="frames without a pose, with a count",
        poses="`.pose.txt`",
        units="millimetres",
        colours="`.color.png` or `.jpg`",
        noise="estimated; a step of depth that hides it is shared by all points",
    ),
    FormatFacts(
        title="nerfstudio",
        read="`transforms.json` with `depth_file_path`, cameras of each frame",
        lost="frames without depth, with a count",
        poses="`transform_matrix`",
        units="whole numbers are millimetres, floats metres, or `depth_unit_scale_factor`",
        colours="`file_path`",
        noise="estimated; a step of depth that hides it is shared by all points",
    ),
)


def open_rgbd(folder: Path) -> RgbdFolder:
    """Return the frames of an RGB-D folder, without reading an image.

    * align3d: `frames.json`; its `rt_cam` is camera to world (checked: reprojected depths agree to 12 mm
      that way and to 118 mm the other, over 2.7 cm of motion). Frames without images are skipped.
    * phones and data sets: `scenes.io.rgbd.phone`; reconstructions: `scenes.io.rgbd.reconstruction`.
    * TUM: `rgb.txt` and `depth.txt` (or `associations.txt`) with `groundtruth.txt`; 5000 values a metre.
    * Redwood: `color/`, `depth/` and `trajectory.log`, camera to world; 1000 values a metre.
    * frames (7-Scenes, tsdf-fusion): `frame-000000.depth.png` in millimetres, `.color.png` or `.jpg`, and
      `.pose.txt`, a 4x4 matrix, camera to world; ScanNet's `_info.txt` may give the camera.
    * plain: `color/`, `depth/`, `pose.txt`, and for camera and scale `camera.json`, which may also name the
      `depth_encoding` (see `scenes.io.rgbd.depth`).

    Frames without a pose, or without intrinsics, are left out with a count where others have them.

    Raises InputError: none of these, or frames, images and poses of unequal number.
    """
    with guard_reading(folder, "an RGB-D folder"):
        frames = _open_known(folder)
        if not frames.frames:
            raise InputError("holds no depth image")
    return replace(keep_complete(frames), folder=folder)


def _open_known(folder: Path) -> RgbdFolder:
    for layout in (*phone.LAYOUTS, *reconstruction.LAYOUTS):
        root = layout.root(folder)
        if root is not None:
            return list_frames(layout, root)
    return next(opener(folder) for marks, opener in _LISTED if is_marked(folder, marks))


def _images(folder: Path, names: Sequence[str]) -> list[Path]:
    """Images of the first of the named subfolders that exists, in natural order."""
    for name in names:
        if (folder / name).is_dir():
            images = [
                p for p in (folder / name).iterdir() if p.suffix.lower() in _IMAGES and p.name[0] != "."
            ]
            check_limit("entries", len(images), f"images in {name}")
            return sorted(
                (inside(folder, f"{name}/{p.name}") for p in images), key=lambda path: natural_key(path.name)
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
    if files and files[0].suffix == ".log":
        return RgbdFolder("redwood", frames, read_camera(folder), 1000.0)
    return RgbdFolder("plain", frames, read_camera(folder))


def _open_frames(folder: Path) -> RgbdFolder:
    """7-Scenes and tsdf-fusion: frame-NNNNNN.depth.png, .color.png or .jpg, .pose.txt side by side."""
    names = [name for inside in folder.iterdir() if (name := _FRAME.fullmatch(inside.name))]
    check_limit("entries", len(names), "its frames")
    frames = []
    for name in sorted(names, key=lambda match: natural_key(match.string)):
        stem = name.group(1)
        images = [folder / f"{stem}.color{suffix}" for suffix in (".png", ".jpg", ".jpeg", ".ppm")]
        colour = next((image for image in images if image.is_file()), None)
        pose = folder / f"{stem}.pose.txt"
        found = _tracked(inside(folder, pose.name)) if pose.is_file() else None
        frames.append(RgbdFrame(inside(folder, name.string), colour and inside(folder, colour.name), found))
    camera = _sens_camera(folder / "_info.txt") if (folder / "_info.txt").is_file() else read_camera(folder)
    return RgbdFolder("frames", tuple(frames), camera, 1000.0, hint=_SEVEN_SCENES)


def _tracked(path: Path) -> Pose | None:
    """The one pose of a file, None where all its numbers say that tracking was lost: -inf or NaN."""
    words = read_text(path).split()
    if words and not np.isfinite([float(word) for word in words]).any():
        return None
    poses = read_poses(path)
    if len(poses) != 1:
        raise InputError(f"{path.name} holds {len(poses)} poses; expected one 4x4 matrix")
    return poses[0]


def _sens_camera(path: Path) -> Camera:
    """The camera that ScanNet's SensReader writes beside its frames."""
    with guard_reading(path, "the _info.txt of a .sens recording"):
        lines = (line.partition("=") for line in read_text(path).splitlines())
        held = {name.strip(): [float(word) for word in words.split()] for name, _, words in lines
                if name.strip() in ("m_calibrationDepthIntrinsic", "m_depthShift")}  # fmt: skip
        matrix = np.reshape(held["m_calibrationDepthIntrinsic"], (4, 4))
        return Camera(intrinsics_of(matrix), held.get("m_depthShift", [1000.0])[0])


def _open_align3d(folder: Path) -> RgbdFolder:
    frames, cameras = [], set()
    size: Any = None
    entries = read_json(folder / "frames.json", dict)["root"]
    check_limit("entries", len(entries), "its frames")
    for entry in entries:
        depth, colour = inside(folder, entry["depth_image"]), inside(folder, entry["rgb_image"])
        if not depth.exists() and not colour.exists():
            continue
        info = entry["info"]
        pose = rounded_pose(np.array(info["rt_cam"]["matrix"]))
        frames.append(RgbdFrame(depth, colour, pose))
        matrix = np.array(info["kcam"]["matrix"], dtype=np.float64)
        cameras.add((intrinsics_of(matrix), 1.0 / float(info["depth_scale"])))
        size = tuple(info["kcam"]["image_size"])
    if len(cameras) > 1:
        raise InputError(f"has {len(cameras)} different cameras in frames.json; one is supported")
    intrinsics, scale = cameras.pop() if cameras else (None, None)
    return RgbdFolder("align3d", tuple(frames), Camera(intrinsics, scale, size))


def _open_tum(folder: Path) -> RgbdFolder:
    """Depth images with the nearest colour image and pose, at most 20 ms away; others are dropped."""
    timed = _tum_pairs(folder)
    frames = [
        RgbdFrame(inside(folder, depth), inside(folder, colour), time=time) for time, depth, colour in timed
    ]
    if timed and (folder / "groundtruth.txt").is_file():
        stamps, poses = read_timed_poses(folder / "groundtruth.txt")
        near = [int(np.argmin(np.abs(stamps - time))) for time, _, _ in timed]
        frames = [
            replace(frame, pose=poses[k])
            for frame, k, (time, _, _) in zip(frames, near, timed, strict=True)
            if abs(stamps[k] - time) <= TIME_GAP_S
        ]
        if not frames:
            raise InputError(
                f"none of its {len(timed)} frames, from {timed[0][0]:.3f} s on, has a pose within "
                f"{TIME_GAP_S:g} s in groundtruth.txt, which is from {stamps.min():.3f} to "
                f"{stamps.max():.3f} s; give both in seconds of one clock"
            )
    return RgbdFolder("tum", tuple(frames), read_camera(folder), 5000.0)


def _tum_pairs(folder: Path) -> list[tuple[float, str, str]]:
    """Time, depth image and colour image of each frame, by `associations.txt` or by the nearest time."""
    if (folder / "associations.txt").is_file():
        pairs = []
        for row in _tum_rows(folder / "associations.txt", 4):
            depth = 2 if row[3].startswith("depth") else 0  # both orders are in use
            pairs.append((float(row[depth]), row[depth + 1], row[3 - depth]))
        times = in_seconds(np.array([time for time, _, _ in pairs])).tolist()
        return [(time, *names) for time, (_, *names) in zip(times, pairs, strict=True)]
    depths, colours = _timed_images(folder / "depth.txt"), _timed_images(folder / "rgb.txt")
    if not colours:
        return []
    times = np.array([time for time, _ in colours])
    near = [int(np.argmin(np.abs(times - time))) for time, _ in depths]
    return [
        (time, name, colours[k][1])
        for (time, name), k in zip(depths, near, strict=True)
        if abs(times[k] - time) <= TIME_GAP_S
    ]


def _timed_images(path: Path) -> list[tuple[float, str]]:
    """Time, seconds, and name of each image of a list."""
    rows = _tum_rows(path, 2)
    times = in_seconds(np.array([row[0] for row in rows], np.float64)).tolist()
    return [(time, name) for time, (_, name) in zip(times, rows, strict=True)]


def _tum_rows(path: Path, n_words: int) -> list[list[str]]:
    rows = [line.split() for line in read_text(path).splitlines()]
    rows = [row for row in rows if row and not row[0].startswith("#")]
    if any(len(row) != n_words for row in rows):
        raise InputError(f"expected {n_words} words a line in {path.name}")
    return rows


def _refuse(_: Path, why: str) -> NoReturn:
    raise InputError(f"holds only what {why}")


_Marks = tuple[tuple[str, ...], ...]
_LISTED: tuple[tuple[_Marks, Callable[[Path], RgbdFolder]], ...] = (
    ((("frames.json",),), _open_align3d),
    ((("transforms.json",),), reconstruction.open_transforms),
    ((("depth.txt",), ("associations.txt",)), _open_tum),
    ((("frame-*.depth.*",),), _open_frames),
    ((("*.sens",),), partial(_refuse, why=_SENS)),
    ((("*.r3d",),), partial(_refuse, why=LZFSE)),
    (((),), _open_plain),
)
