# SPDX-License-Identifier: MIT
"""RGB-D folders: plain, Redwood, align3d, TUM and 7-Scenes; depth counts become metres, a frame a scan."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scenes.checks import ColourArray, FloatArray, InputError
from scenes.io.camera import (
    Camera,
    DepthEncoding,
    Intrinsics,
    intrinsics_of,
    is_scaled,
    read_camera,
    undistorted,
)
from scenes.io.documents import read_json, read_text
from scenes.io.guard import guard_reading
from scenes.io.header import range_warnings
from scenes.io.image import open_image
from scenes.io.limits import check_limit
from scenes.io.trajectory import natural_key, read_poses, read_timed_poses, rounded_pose
from scenes.limits import MULTIPLES_OF_8, TIME_GAP_S
from scenes.pose import Pose
from scenes.scan.projection import PinholeProjection
from scenes.scan.range_image import RangeImage, saturation_start

_MOST_DISPARITY = 2047  # 11 bits; that number itself means that nothing was measured
_EIGHT_BITS = 255
_FULLEST = 65535
_SEVEN_SCENES = " (--intrinsics 585,585,320,240 for 7-Scenes)"
_FULL = tuple(2**bits - 1 for bits in range(11, 16))  # what a narrower sensor writes for no return, if at all
_KINECT_M, _KINECT_OFFSET = 351.3, 1092.5  # depth = 351.3 m / (1092.5 - disparity), of the NYU toolbox


def depth_in_metres(counts: FloatArray, encoding: DepthEncoding, scale: float) -> FloatArray:
    """Return z-depth in metres, 0 where nothing was measured.

    Parameters
    ----------
    counts : (rows, columns) float
        Values of the image.
    encoding : "linear", "sun3d" or "kinect-disparity"
        linear: `counts / scale`. sun3d: 16-bit counts turned left by three bits, turned back and divided by
        `scale`. kinect-disparity: raw 11-bit disparities of the first Kinect, as the NYU data hold them;
        where they exceed 11 bits the bytes of the file stand in the wrong order and are swapped.
    scale : float
        Counts a metre; of no meaning for disparities.

    Raises
    ------
    InputError
        Values that the encoding cannot hold.
    """
    if encoding == "linear":
        return counts / scale
    if not ((counts >= 0) & (counts <= 65535) & (counts == np.floor(counts))).all():
        raise InputError(f"{encoding} depth is of 16-bit integers, the image holds others")
    words = counts.astype(np.uint16)
    if encoding == "sun3d":
        return np.asarray(((words >> 3) | (words << 13)).astype(np.float64) / scale)
    return _kinect_depth(words)


def _kinect_depth(words: NDArray[np.uint16]) -> FloatArray:
    if words.max() > _MOST_DISPARITY:
        words = words.byteswap()
    if words.max() > _MOST_DISPARITY:
        raise InputError(f"kinect-disparity has 11 bits, the image holds {int(words.max())}")
    disparity = words.astype(np.float64)
    known = (disparity > 0) & (disparity < _KINECT_OFFSET - 1)
    return np.where(known, _KINECT_M / (_KINECT_OFFSET - np.where(known, disparity, 0.0)), 0.0)


def depth_warnings(counts: FloatArray) -> tuple[str, ...]:
    """Return a warning where an image (rows, columns) of more bits holds only 8: depths are steps then."""
    known = counts[np.isfinite(counts) & (counts != 0)]
    if not len(known) or known.max() > _EIGHT_BITS or (known != np.floor(known)).any():
        return ()
    return (f"its depths are whole numbers up to {known.max():g}: 8-bit depth in a wider image?",)


def without_codes(counts: FloatArray) -> tuple[FloatArray, tuple[str, ...]]:
    """Return an image (rows, columns) whose numbers for no return are 0, and a warning where there are some.

    65535 is one always: a 16-bit number that is full. So is a narrower one, 2^11 - 1 to 2^15 - 1, that is
    the largest, there over and over, and far beyond all others.
    """
    full = counts == _FULLEST
    known = counts[(counts > 0) & (counts < _FULLEST)]
    start = saturation_start(known) if len(known) else np.inf
    if start in _FULL and known.max() == start:
        full |= counts == start
    if not full.any():
        return counts, ()
    codes = ", ".join(f"{code:g}" for code in np.unique(counts[full]))
    return np.where(full, 0.0, counts), (
        f"{int(full.sum())} of {counts.size} depths are {codes}: a full number, which means no return, and "
        "were left out",
    )


def suspected_encoding(counts: FloatArray) -> str:
    """Return why the counts (rows, columns) may be no linear depth, "" where nothing speaks against it."""
    known = counts[counts > 0]
    if not len(known) or not (known == np.floor(known)).all() or known.max() > 65535:
        return ""
    eighth = float(np.mean(known % 8 == 0))
    if len(np.unique(known)) > 8 and eighth > MULTIPLES_OF_8 and known.max() > 8192:
        return (
            f"{eighth:.0%} of its values are multiples of 8, as SUN3D's are, whose bits are turned: if so, "
            'say "depth_encoding": "sun3d" in camera.json'
        )
    swapped = known.astype(np.uint16).byteswap()
    if known.max() > _MOST_DISPARITY >= swapped.max():
        return (
            "its bytes stand in the wrong order, as in NYU's raw Kinect disparities: if so say "
            '"depth_encoding": "kinect-disparity" in camera.json'
        )
    return ""


@dataclass(frozen=True, slots=True)
class RgbdFrame:
    """One pair of images; where and when, in seconds, it was taken if known."""

    depth: Path
    colour: Path | None = None
    pose: Pose | None = None
    time: float | None = None

    @property
    def images(self) -> tuple[Path, ...]:
        """The colour image, where there is one, and the depth image."""
        return (self.depth,) if self.colour is None else (self.colour, self.depth)


@dataclass(frozen=True, slots=True)
class RgbdFolder:
    """The frames of a folder in natural order.

    Attributes
    ----------
    layout : str
        "plain", "redwood", "align3d", "tum" or "frames".
    frames : tuple of RgbdFrame
        Frame k of `PATH#k` is the k-th, from 1.
    camera : Camera
        Of a file beside the images; its depth scale also where the layout fixes it (TUM 5000, Redwood 1000).
    folder : Path
        Where the frames are.
    """

    layout: str
    frames: tuple[RgbdFrame, ...]
    camera: Camera = field(default_factory=Camera)
    folder: Path = field(default_factory=Path)

    @property
    def registered(self) -> bool:
        """Whether every frame has a pose."""
        return all(frame.pose is not None for frame in self.frames)


def read_frame(
    folder: RgbdFolder, index: int, intrinsics: Intrinsics | None = None, depth_scale: float | None = None
) -> RangeImage:
    """Return frame `index` (from 0); arguments given here go before what the folder says.

    Depth images hold z-depth; it becomes range along each pixel's ray. A negative fy is used as given. Lens
    distortion is taken out: each pixel of the image without it has the nearest measured point.

    Raises InputError: unknown intrinsics or depth scale, intrinsics of another image, images that are
    missing, damaged, of 8 bits or of another aspect ratio.
    """
    frame, camera = folder.frames[index], folder.camera
    if intrinsics is not None:
        camera = replace(camera, intrinsics=intrinsics, image_size=None)
    if camera.depth_encoding == "kinect-disparity":
        camera = replace(camera, depth_scale=1.0)
    elif depth_scale is not None:
        camera = replace(camera, depth_scale=depth_scale)
    scale = _checked_scale(folder, camera)
    counts = read_depth_image(frame.depth)
    height, width = counts.shape
    with guard_reading(frame.depth, "a depth image"):
        camera = camera.of_size((width, height))
        colour = None if frame.colour is None else _read_colour(frame.colour, (height, width))
        projection = PinholeProjection(width, height, *(camera.intrinsics or ()))
        sentences: tuple[str, ...] = ()
        if camera.depth_encoding == "linear":
            counts, sentences = without_codes(counts)
        depth_m = depth_in_metres(counts, camera.depth_encoding, scale)
        sentences += (*range_warnings(depth_m), *depth_warnings(counts))
    scan = depth_scan(
        depth_m, projection, frame.pose or Pose.identity(), colour, f"{folder.folder.name}#{index + 1}"
    )
    if camera.distortion:
        scan = undistorted(scan, projection, depth_m, camera.distortion)
    return scan.add_warnings((*camera.warnings, *sentences))


def _checked_scale(folder: RgbdFolder, camera: Camera) -> float:
    """The depth values a metre; InputError where these or the intrinsics are not known."""
    missing = ["intrinsics (--intrinsics FX,FY,CX,CY)"] * (camera.intrinsics is None)
    missing += ["depth values a metre (--depth-scale N: Kinect 1000, TUM 5000)"] * (
        camera.depth_scale is None
    )
    if missing:
        hint = _SEVEN_SCENES if folder.layout == "frames" else ""
        raise InputError(
            f"{folder.folder}: no file beside the images tells the {' and the '.join(missing)}; "
            f"give them{hint}, or put a camera.json with fx, fy, cx, cy, depth_scale there"
        )
    scale = camera.depth_scale or 0.0
    if not (np.isfinite(scale) and scale > 0):
        raise InputError(f"--depth-scale must be a positive number of depth values a metre, got {scale}")
    return scale


def depth_scan(
    depth_m: FloatArray, projection: PinholeProjection, pose: Pose, colour: Any = None, name: str = "scan"
) -> RangeImage:
    """Return the scan of a z-depth image (rows, columns) in metres; 0, inf and NaN mean nothing came back."""
    along = 1.0 / projection.directions()[..., 2]
    with np.errstate(invalid="ignore"):
        return RangeImage(depth_m * along, projection, pose, colour=colour, name=name)


def read_depth_image(path: Path) -> FloatArray:
    """Return the counts (rows, columns) of an image of one channel, as float64 and unscaled.

    Raises InputError: no image, too large, or of 8 bits a channel.
    """
    with open_image(path, "a depth image") as image:
        if not image.mode.startswith(("I", "F")):
            raise InputError(
                f"has mode {image.mode} (8 bits a channel), which cannot hold depth; "
                "a depth image has one channel of 16 bits"
            )
        return np.asarray(image, dtype=np.float64)


def _read_colour(path: Path, shape: tuple[int, int]) -> ColourArray:
    """Return the RGB image as bytes, resized to the depth image's shape where both have one aspect ratio."""
    size = shape[1], shape[0]
    with open_image(path, "a colour image") as image:
        if not is_scaled(image.size, size):
            raise InputError(
                f"is {image.width} x {image.height}, its depth image {shape[1]} x {shape[0]}; "
                "register the depth to the colour image first (same aspect ratio, same camera)"
            )
        painted = image.convert("RGB")
        return np.asarray(painted if image.size == size else painted.resize(size))


_DEPTH_FOLDERS = ("depth", "depths")
_COLOUR_FOLDERS = ("color", "colour", "rgb", "image", "images")
_IMAGES = {".png", ".jpg", ".jpeg", ".tif", ".tiff", ".pgm", ".ppm", ".bmp"}
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
      `depth_encoding` (see `scenes.io.rgbd`).

    Raises InputError: none of these, or frames, images and poses of unequal number.
    """
    with guard_reading(folder, "an RGB-D folder"):
        if (folder / "frames.json").is_file():
            frames = _open_align3d(folder)
        elif (folder / "depth.txt").is_file() or (folder / "associations.txt").is_file():
            frames = _open_tum(folder)
        elif any(_FRAME.fullmatch(inside.name) for inside in folder.iterdir()):
            frames = _open_frames(folder)
        else:
            frames = _open_plain(folder)
        if not frames.frames:
            raise InputError("holds no depth image")
    return replace(frames, folder=folder)


def _images(folder: Path, names: Sequence[str]) -> list[Path]:
    """Images of the first of the named subfolders that exists, in natural order."""
    for name in names:
        if (folder / name).is_dir():
            images = [
                p for p in (folder / name).iterdir() if p.suffix.lower() in _IMAGES and p.name[0] != "."
            ]
            check_limit("entries", len(images), f"images in {name}")
            return sorted(
                (_inside(folder, f"{name}/{p.name}") for p in images), key=lambda path: natural_key(path.name)
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
    camera = _scaled(read_camera(folder), 1000.0) if redwood else read_camera(folder)
    return RgbdFolder("redwood" if redwood else "plain", frames, camera)


def _scaled(camera: Camera, depth_scale: float) -> Camera:
    """A camera with the depth scale of its layout, where its file states none."""
    return camera if camera.depth_scale is not None else replace(camera, depth_scale=depth_scale)


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
        poses = read_poses(_inside(folder, pose.name)) if pose.is_file() else [None]
        if len(poses) != 1:
            raise InputError(f"{pose.name} holds {len(poses)} poses; expected one 4x4 matrix")
        depth = _inside(folder, name.string)
        frames.append(RgbdFrame(depth, colour and _inside(folder, colour.name), poses[0]))
    return RgbdFolder("frames", tuple(frames), _scaled(read_camera(folder), 1000.0))


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
    return RgbdFolder("tum", tuple(frames), _scaled(read_camera(folder), 5000.0))


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
