# SPDX-License-Identifier: MIT
"""RGB-D folders: their frames, how the counts of a depth image become metres, and a frame a scan."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, cast, get_args

import numpy as np
from numpy.typing import NDArray

from scenes.checks import ColourArray, FloatArray, InputError
from scenes.formats.guard import reading
from scenes.formats.header import range_warnings
from scenes.formats.image import open_image
from scenes.pose import Pose
from scenes.scan.projection import PinholeProjection
from scenes.scan.range_image import RangeImage
from scenes.scan.saturation import saturation_start

DepthEncoding = Literal["linear", "sun3d", "kinect-disparity"]
_MOST_DISPARITY = 2047  # 11 bits; that number itself means that nothing was measured
_EIGHT_BITS = 255
_FULLEST = 65535
_SEVEN_SCENES = " (--intrinsics 585,585,320,240 for 7-Scenes)"
_FULL = tuple(2**bits - 1 for bits in range(11, 16))  # what a narrower sensor writes for no return, if at all
_TURNED = 0.9  # share of multiples of 8; one in eight by chance, all of depths below 8.2 m by turned bits
_KINECT_M, _KINECT_OFFSET = 351.3, 1092.5  # depth = 351.3 m / (1092.5 - disparity), of the NYU toolbox
Intrinsics = tuple[float, float, float, float]


def check_encoding(name: object) -> DepthEncoding:
    """Return `name` when it is a known encoding; raise InputError otherwise."""
    if name in get_args(DepthEncoding):
        return cast(DepthEncoding, name)
    raise InputError(f"unknown depth_encoding {name!r}; known: {', '.join(get_args(DepthEncoding))}")


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
    if len(np.unique(known)) > 8 and eighth > _TURNED and known.max() > 8192:
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


@dataclass(frozen=True, slots=True)
class RgbdFolder:
    """The frames of a folder in natural order.

    Attributes
    ----------
    layout : str
        "plain", "redwood", "align3d", "tum" or "frames".
    frames : tuple of RgbdFrame
        Frame k of `PATH#k` is the k-th, from 1.
    intrinsics : (fx, fy, cx, cy), optional
        Pixels, from a file beside the images.
    depth_scale : float, optional
        Depth values a metre, from such a file, or where the layout fixes it (TUM 5000, Redwood 1000).
    image_size : (width, height), optional
        What that file says of the images.
    folder : Path
        Where the frames are.
    depth_encoding : str
        How counts become metres.
    """

    layout: str
    frames: tuple[RgbdFrame, ...]
    intrinsics: Intrinsics | None = None
    depth_scale: float | None = None
    image_size: tuple[int, int] | None = None
    folder: Path = field(default_factory=Path)
    depth_encoding: DepthEncoding = "linear"

    @property
    def registered(self) -> bool:
        """Whether every frame has a pose."""
        return all(frame.pose is not None for frame in self.frames)


def read_frame(
    folder: RgbdFolder, index: int, intrinsics: Intrinsics | None = None, depth_scale: float | None = None
) -> RangeImage:
    """Return frame `index` (from 0); arguments given here go before what the folder says.

    Depth images hold z-depth; it becomes range along each pixel's ray. A negative fy is used as given.

    Raises InputError: unknown intrinsics or depth scale, images that are missing, damaged, of 8 bits or of
    unequal size.
    """
    frame = folder.frames[index]
    camera = intrinsics or folder.intrinsics
    scale = folder.depth_scale if depth_scale is None else depth_scale
    missing = ["intrinsics (--intrinsics FX,FY,CX,CY)"] * (camera is None)
    if folder.depth_encoding == "kinect-disparity":
        scale = 1.0
    missing += ["depth values a metre (--depth-scale N: Kinect 1000, TUM 5000)"] * (scale is None)
    if camera is None or scale is None:
        hint = _SEVEN_SCENES if folder.layout == "frames" else ""
        raise InputError(
            f"{folder.folder}: no file beside the images tells the {' and the '.join(missing)}; "
            f"give them{hint}, or put a camera.json with fx, fy, cx, cy, depth_scale there"
        )
    if not (np.isfinite(scale) and scale > 0):
        raise InputError(f"--depth-scale must be a positive number of depth values a metre, got {scale}")
    counts = read_depth_image(frame.depth)
    height, width = counts.shape
    if intrinsics is None and folder.image_size not in (None, (width, height)):
        raise InputError(
            f"{frame.depth}: is {width} x {height}, its camera file says {folder.image_size}; "
            "give --intrinsics FX,FY,CX,CY for these images"
        )
    projection = PinholeProjection(width, height, *camera)
    colour = None if frame.colour is None else _read_colour(frame.colour, (height, width))
    pose = frame.pose or Pose.identity()
    with reading(frame.depth, "a depth image"):
        told: tuple[str, ...] = ()
        if folder.depth_encoding == "linear":
            counts, told = without_codes(counts)
        depth_m = depth_in_metres(counts, folder.depth_encoding, scale)
        warnings = (*told, *range_warnings(depth_m), *depth_warnings(counts))
    scan = depth_scan(depth_m, projection, pose, colour, f"{folder.folder.name}#{index + 1}")
    return scan.restated(warnings=warnings)


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
    """Return the RGB image as bytes; it must have the depth image's shape."""
    with open_image(path, "a colour image") as image:
        if (image.height, image.width) != shape:
            raise InputError(
                f"is {image.width} x {image.height}, its depth image {shape[1]} x {shape[0]}; "
                "register the depth to the colour image first (same size, same camera)"
            )
        return np.asarray(image.convert("RGB"))
