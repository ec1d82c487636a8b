# SPDX-License-Identifier: MIT
"""RGB-D recordings of phones and of data sets made with them: how each lays out its files, axes and units.

Sources of the layouts, by project and file:

* Stray Scanner: `docs/format.md` and `OdometryEncoder.swift` of strayrobots/scanner. Poses are ARKit's with
  the camera turned to x right, y down, z forward; intrinsics are of the video.
* Polycam: `README.md` and `core/capture_folder.py` of PolyCam/polyform. ARKit's axes, intrinsics of images.
* Record3D: `record3d_utils.py` of nerfstudio, issues 27, 33 and 36 of marek-simonik/record3d. Camera to
  world with ARKit's camera axes, quaternion before translation, in the world of the first camera.
* RTAB-Map: `tools/Export/main.cpp` of introlab/rtabmap. Poses of the robot need `local_transform`.
* ScanNet: `SensReader` of ScanNet/ScanNet. Lost tracking is -inf; `axisAlignment` turns about z.
* ARKitScenes: `DATA.md` and `tenFpsDataLoader.py` of apple/ARKitScenes. Poses go from world to camera.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import scipy  # its parts load when they are first used

from scenes.checks import FloatArray, InputError
from scenes.io.checks.documents import read_json, read_text
from scenes.io.checks.guard import guard_reading
from scenes.io.formats.facts import FormatFacts
from scenes.io.poses.camera import Camera, distortion_of, intrinsics_of, read_camera
from scenes.io.poses.trajectory import rounded_pose
from scenes.io.rgbd.frames import VIDEOS, video_image
from scenes.io.rgbd.listing import (
    ImageLayout,
    View,
    Views,
    camera_pose,
    key_of,
    known_pose,
)
from scenes.pose import Pose, rotation_of

_STRAY_SIZE = 1920, 1440  # of the video
_STRAY_POSE = ("x", "y", "z", "qx", "qy", "qz", "qw")
_PIXELS = ("fx", "fy", "cx", "cy")
_ARKIT_GAP_S = 0.005  # between names of images and times of poses or intrinsics, as Apple's loader allows
_STAMP_GAP_S = 0.001
_Y_UP = "the world of ARKit has y up: give --up y where the up axis is not estimated"
_FIRST_CAMERA = (
    "its world is that of the first camera: y is up only as far as the phone was held level; complete "
    "estimates the up axis"
)


def _numbers(path: Path, columns: Sequence[int], rows: int | None = None) -> FloatArray:
    """The rows of a text, numbers separated by blanks or commas: as many columns, and rows if these count."""
    with guard_reading(path, "rows of numbers"):
        lines = (line.split("#", 1)[0].replace(",", " ").split() for line in read_text(path).splitlines())
        table = np.array([[float(word) for word in words] for words in lines if words])
        if table.ndim != 2 or table.shape[1] not in columns or rows not in (None, len(table)):
            wanted = " or ".join(map(str, columns))
            raise InputError(f"expected {rows or 'any'} rows of {wanted} numbers, got {table.shape}")
        return table


def _pose(place: Sequence[float], quaternion: Sequence[float], what: str) -> FloatArray:
    """A matrix (4, 4) of x y z and qx qy qz qw; NaN where these are no numbers."""
    matrix = np.full((4, 4), np.nan)
    if np.isfinite([*place, *quaternion]).all():
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = rotation_of(quaternion, what), place
    return matrix


def _stray(folder: Path, _: Sequence[str]) -> Views:
    """`odometry.csv`, its columns by name; those of intrinsics go before `camera_matrix.csv`."""
    video = next((folder / f"rgb{suffix}" for suffix in VIDEOS if (folder / f"rgb{suffix}").is_file()), None)
    image = None if video is None else video_image(video, 0)
    size = _STRAY_SIZE if image is None else (image.shape[1], image.shape[0])
    matrix = folder / "camera_matrix.csv"
    shared = (
        Camera(intrinsics_of(_numbers(matrix, [3], 3)), image_size=size) if matrix.is_file() else Camera()
    )
    views, path = {}, folder / "odometry.csv"
    with guard_reading(path, "the odometry of Stray Scanner"):
        for row in csv.DictReader(read_text(path).splitlines(), skipinitialspace=True):
            held = {str(name).strip(): _number(word) for name, word in row.items()}
            missing = [name for name in ("frame", *_STRAY_POSE) if name not in held]
            if missing:
                raise InputError(f"has no column {', '.join(missing)}")
            numbers = [held[name] for name in _STRAY_POSE]
            found = known_pose(_pose(numbers[:3], numbers[3:], f"frame {row['frame']}"))
            pixels = [held.get(name, np.nan) for name in _PIXELS]
            own = None
            if np.isfinite(pixels).all():
                own = Camera((pixels[0], pixels[1], pixels[2], pixels[3]), image_size=size)
            views[str(int(held["frame"]))] = View(found, own, held.get("timestamp"))
    return Views(views, shared, (_Y_UP,))


def _number(word: object) -> float:
    """The number that a field of a table holds, NaN where there is none."""
    try:
        return float(str(word))
    except ValueError:
        return float("nan")


def _polycam(folder: Path, _: Sequence[str]) -> Views:
    """A JSON a frame, `t_00` to `t_23` row by row; poses that were optimised go before ARKit's."""
    cameras = folder / "keyframes"
    corrected = cameras / "corrected_cameras"
    cameras = corrected if corrected.is_dir() and any(corrected.iterdir()) else cameras / "cameras"
    views = {}
    for path in cameras.glob("*.json"):
        with guard_reading(path, "a camera of Polycam"):
            held = read_json(path, dict)
            rows = [[held[f"t_{row}{column}"] for column in range(4)] for row in range(3)]
            fx, fy, cx, cy = (float(held[name]) for name in _PIXELS)
            size = int(held["width"]), int(held["height"])
            camera = Camera((fx, fy, cx, cy), image_size=size)
            views[key_of(path.name)] = View(camera_pose(rows), camera)
    return Views(views, warnings=(_Y_UP,))


def _record3d(folder: Path, _: Sequence[str]) -> Views:
    """`metadata.json`, or `metadata` of an unpacked .r3d: poses and intrinsics in the order of the frames."""
    path = next(path for path in (folder / "metadata.json", folder / "metadata") if path.is_file())
    with guard_reading(path, "the metadata of Record3D"):
        held = read_json(path, dict)
        size = int(held["w"]), int(held["h"])
        matrix = np.array(held["K"], dtype=np.float64).reshape(3, 3)
        shared = intrinsics_of(matrix.T if matrix[2, 0] else matrix)  # column by column
        per_frame = held.get("perFrameIntrinsicCoeffs") or []
        views = {}
        for k, numbers in enumerate(held["poses"]):
            fx, fy, cx, cy = per_frame[k][:4] if k < len(per_frame) else shared
            pose = camera_pose(_pose(numbers[4:7], numbers[:4], f"pose {k + 1}"))
            views[str(k)] = View(pose, Camera((fx, fy, cx, cy), image_size=size))
    return Views(views, warnings=(_FIRST_CAMERA,))


def _rtabmap(folder: Path, keys: Sequence[str]) -> Views:
    """Calibrations in YAML, one a frame or one for all, and poses of the camera or else of the robot."""
    calibrations = sorted([*folder.glob("*calib/*.yaml"), *folder.glob("*.yaml")])
    cameras = {key_of(path.name): _calibration(path) for path in calibrations}
    files = sorted(folder.glob("*camera_poses*.txt")) or sorted(folder.glob("*poses.txt"))
    files = [path for path in files if "scan_poses" not in path.name]
    if len(files) > 1:
        raise InputError(f"holds poses of several cameras, {files[0].name} and {files[1].name}; keep one's")
    of_robot = bool(files) and "camera_poses" not in files[0].name
    alone = next(iter(cameras.values())) if len(cameras) == 1 else (Camera(), None)
    views = {}
    for key, pose in _rtabmap_poses(files[0], keys) if files else ():
        camera, local = cameras.get(key, alone)
        if of_robot and local is None:
            raise InputError(f"{files[0].name}: poses of the robot need local_transform in the calibration")
        views[key] = View(pose @ rounded_pose(local) if of_robot and local is not None else pose,
                          camera if key in cameras else None)  # fmt: skip
    for key in set(cameras) & set(keys) - set(views):
        views[key] = View(camera=cameras[key][0])
    return Views(views, alone[0])


def _calibration(path: Path) -> tuple[Camera, FloatArray | None]:
    """Camera of a calibration, and where it stands on the robot (4, 4) if that is known."""
    import cv2  # slow to import, and rarely needed

    with guard_reading(path, "a calibration of RTAB-Map"):
        file = cv2.FileStorage(read_text(path), cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)

        def numbers(name: str) -> list[float]:
            node = file.getNode(name).getNode("data")
            return [] if node.empty() else [node.at(k).real() for k in range(node.size())]

        size = int(file.getNode("image_width").real()), int(file.getNode("image_height").real())
        values = {"distortion": numbers("distortion_coefficients")[:8],
                  "distortion_model": file.getNode("distortion_model").string()}  # fmt: skip
        local, whole = numbers("local_transform"), np.eye(4)
        if local:
            whole[:3] = np.reshape(local, (3, 4))
        intrinsics = intrinsics_of(np.reshape(numbers("camera_matrix"), (3, 3)))
        camera = Camera(intrinsics, image_size=size if min(size) else None, distortion=distortion_of(values))
        return camera, whole if local else None


def _rtabmap_poses(path: Path, keys: Sequence[str]) -> Iterator[tuple[str, Pose]]:
    """Poses by number (last of nine columns) or time of the frames, or else in their order."""
    rows = _numbers(path, [8, 9, 12])  # stamp x y z qx qy qz qw [id], or a matrix
    stamps = rows[:, 0] if rows.shape[1] < 12 else np.full(len(rows), np.nan)
    times = np.array([_number(key) for key in keys])
    for k, row in enumerate(rows):
        near = np.flatnonzero(np.abs(times - stamps[k]) <= _STAMP_GAP_S)
        number = str(int(row[8])) if rows.shape[1] == 9 else ""
        if number in keys or len(near):
            key = number if number in keys else keys[int(near[0])]
        elif len(rows) == len(keys) and rows.shape[1] != 9:
            key = keys[k]
        else:
            continue
        matrix = np.vstack([row.reshape(3, 4), [0, 0, 0, 1]]) if len(row) == 12 else _pose(
            row[1:4], row[4:8], f"pose {k + 1}")  # fmt: skip
        pose = known_pose(matrix)
        if pose is not None:
            yield key, pose


def _scannet(folder: Path, _: Sequence[str]) -> Views:
    """A matrix a frame, and `axisAlignment` of the scene's own text, which is applied."""
    matrices = {name: folder / "intrinsic" / f"intrinsic_{name}.txt" for name in ("depth", "color")}
    held = {name: intrinsics_of(_numbers(path, [4], 4)) for name, path in matrices.items() if path.is_file()}
    aligned, sentences = np.eye(4), list[str]()
    for path in sorted(folder.glob("*.txt")):
        with guard_reading(path, "the text of a scene of ScanNet"):
            for line in read_text(path).splitlines():
                name, _, words = line.partition("=")
                if name.strip() == "axisAlignment":
                    aligned = np.array([float(word) for word in words.split()]).reshape(4, 4)
                    sentences = [f"the axisAlignment of {path.name} was applied to its poses"]
    views = {}
    for path in folder.glob("pose/*.txt"):
        views[key_of(path.name)] = View(known_pose(aligned @ _numbers(path, [4], 4)))
    camera = Camera(held["depth"]) if "depth" in held else read_camera(folder)
    return Views(views, camera, tuple(sentences), held.get("color"))


def _arkitscenes(folder: Path, keys: Sequence[str]) -> Views:
    """Rotation vector and translation from world to camera a line; intrinsics a file; both by their times."""
    cameras = {}
    for path in folder.glob("lowres_wide_intrinsics/*.pincam"):
        width, height, fx, fy, cx, cy = _numbers(path, [6], 1)[0]
        time = _number(key_of(path.name).rpartition("_")[2])
        cameras[time] = Camera((fx, fy, cx, cy), image_size=(int(width), int(height)))
    rows = _numbers(folder / "lowres_wide.traj", [7])
    views = {}
    for key in keys:
        time = _number(key.rpartition("_")[2])
        row = rows[int(np.argmin(np.abs(rows[:, 0] - time)))]
        pose = None
        if abs(row[0] - time) <= _ARKIT_GAP_S and np.isfinite(row).all():
            back = scipy.spatial.transform.Rotation.from_rotvec(row[1:4]).as_matrix().T
            pose = Pose.from_parts(back, -back @ row[4:7])
        near = min(cameras, key=lambda held: abs(held - time), default=np.inf)
        views[key] = View(pose, cameras[near] if abs(near - time) <= _ARKIT_GAP_S else None, time)
    return Views(views)


LAYOUTS = (
    ImageLayout(
        name="Stray Scanner",
        facts=FormatFacts(
            title="Stray Scanner",
            read="`depth/`, `confidence/`; intrinsics are those of the video",
            lost="depths of the lowest confidence, with a count",
            poses="`odometry.csv`, columns by name; y is up",
            units="millimetres",
            colours="`rgb.mp4` where it can be decoded",
            noise="estimated; a step of depth that hides it is shared by all points",
        ),
        marks=(("odometry.csv", "depth"),),
        views=_stray,
        depth=("depth/*",),
        colour=("rgb.mp4", "rgb.mov", "rgb/*"),
        confidence=("confidence/*",),
    ),
    ImageLayout(
        name="Polycam",
        facts=FormatFacts(
            title="Polycam raw data",
            read="`keyframes/depth`, `confidence`",
            lost="depths of the lowest confidence, with a count",
            poses="`corrected_cameras`, else `cameras`; y is up",
            units="millimetres",
            colours="`corrected_images`, else `images`",
            noise="estimated; a step of depth that hides it is shared by all points",
        ),
        marks=(("keyframes/depth", "keyframes/*cameras"),),
        views=_polycam,
        depth=("keyframes/depth/*",),
        colour=("keyframes/corrected_images/*", "keyframes/images/*"),
        confidence=("keyframes/confidence/*",),
    ),
    ImageLayout(
        name="Record3D",
        facts=FormatFacts(
            title="Record3D, EXR + JPG",
            read="`EXR_RGBD/depth`, `rgb`",
            lost="`.r3d` is refused: its depth is packed by LZFSE",
            poses="`metadata.json`, in the world of the first camera",
            units="metres",
            colours="8-bit images, resized where the sides have one ratio",
            noise="estimated; a step of depth that hides it is shared by all points",
        ),
        marks=(("metadata.json", "depth/*.exr"), ("metadata", "rgbd/*")),
        roots=("", "EXR_RGBD"),
        views=_record3d,
        depth=("depth/*", "rgbd/*.exr", "rgbd/*.depth"),
        colour=("rgb/*", "rgbd/*.jpg", "rgbd/*.png"),
    ),
    ImageLayout(
        name="RTAB-Map",
        facts=FormatFacts(
            title="RTAB-Map (`rtabmap-export --images_id --poses_camera`)",
            read="`*_depth`, `*_rgb`, `*_calib`",
            lost="several cameras are refused",
            poses="`*_camera_poses.txt`, else `*_poses.txt` of the robot and `local_transform`",
            units="millimetres, floats metres",
            colours="8-bit images, resized where the sides have one ratio",
            noise="estimated; a step of depth that hides it is shared by all points",
        ),
        marks=(("*_depth", "*_calib"), ("depth", "calib/*.yaml"), ("depth", "*calibration*.yaml")),
        views=_rtabmap,
        depth=("*_depth/*", "depth/*"),
        colour=("*_rgb/*", "rgb/*"),
    ),
    ImageLayout(
        name="ARKitScenes",
        facts=FormatFacts(
            title="ARKitScenes",
            read="`lowres_depth`, `lowres_wide`, `confidence`, `.pincam` of each frame",
            lost="depths of the lowest confidence, with a count",
            poses="`lowres_wide.traj`, within 5 ms",
            units="millimetres",
            colours="8-bit images, resized where the sides have one ratio",
            noise="estimated; a step of depth that hides it is shared by all points",
        ),
        marks=(("lowres_depth", "lowres_wide.traj"),),
        views=_arkitscenes,
        depth=("lowres_depth/*",),
        colour=("lowres_wide/*",),
        confidence=("confidence/*",),
    ),
    ImageLayout(
        name="ScanNet",
        facts=FormatFacts(
            title="ScanNet, unpacked",
            read="`depth/`, `color/`, `intrinsic/`",
            lost="frames whose pose is -inf, with a count; `.sens` is refused",
            poses="`pose/`; `axisAlignment` is applied, with a warning",
            units="millimetres",
            colours="8-bit images, resized where the sides have one ratio",
            noise="estimated; a step of depth that hides it is shared by all points",
        ),
        marks=(("intrinsic/intrinsic_depth.txt", "depth"), ("pose/*.txt", "depth")),
        views=_scannet,
        depth=("depth/*",),
        colour=("color/*",),
    ),
)
