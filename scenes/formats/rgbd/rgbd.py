# SPDX-License-Identifier: MIT
"""RGB-D folders: which frames a folder holds, in which of four layouts, and how a frame becomes a scan."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scenes.checks import FloatArray, InputError
from scenes.formats.guard import reading
from scenes.formats.header import colour_from_bytes, range_warnings
from scenes.formats.image import open_image
from scenes.formats.rgbd.depth_encoding import DepthEncoding, depth_in_metres, depth_warnings
from scenes.pose import Pose
from scenes.scan.projection import PinholeProjection
from scenes.scan.range_image import RangeImage

Intrinsics = tuple[float, float, float, float]


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
        "plain", "redwood", "align3d" or "tum".
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

    Raises
    ------
    InputError
        Unknown intrinsics or depth scale, images that are missing, damaged, of 8 bits or of unequal size.
    """
    frame = folder.frames[index]
    camera = intrinsics or folder.intrinsics
    scale = folder.depth_scale if depth_scale is None else depth_scale
    missing = ["intrinsics (--intrinsics FX,FY,CX,CY)"] * (camera is None)
    if folder.depth_encoding == "kinect-disparity":
        scale = 1.0
    missing += ["depth values a metre (--depth-scale N: Kinect 1000, TUM 5000)"] * (scale is None)
    if camera is None or scale is None:
        raise InputError(
            f"{folder.folder}: no file beside the images tells the {' and the '.join(missing)}; "
            "give them, or put a camera.json with fx, fy, cx, cy, depth_scale there"
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
        depth_m = depth_in_metres(counts, folder.depth_encoding, scale)
        warnings = (*range_warnings(depth_m), *depth_warnings(counts))
    scan = depth_scan(depth_m, projection, pose, colour, f"{folder.folder.name}#{index + 1}")
    return replace(scan, warnings=warnings)


def depth_scan(
    depth_m: FloatArray, projection: PinholeProjection, pose: Pose, colour: Any = None, name: str = "scan"
) -> RangeImage:
    """Return the scan of a z-depth image (rows, columns) in metres; 0, inf and NaN mean nothing came back."""
    along = 1.0 / projection.directions()[..., 2]
    with np.errstate(invalid="ignore"):
        return RangeImage(depth_m * along, projection, pose, colour=colour, name=name)


def read_depth_image(path: Path) -> FloatArray:
    """Return the counts (rows, columns) of an image of one channel, as float64 and unscaled.

    Raises
    ------
    InputError
        No image, too large, or of 8 bits a channel.
    """
    with open_image(path, "a depth image") as image:
        if not image.mode.startswith(("I", "F")):
            raise InputError(
                f"has mode {image.mode} (8 bits a channel), which cannot hold depth; "
                "a depth image has one channel of 16 bits"
            )
        return np.asarray(image, dtype=np.float64)


def _read_colour(path: Path, shape: tuple[int, int]) -> NDArray[np.float32]:
    """Return the RGB image as float32 in 0..1; it must have the depth image's shape."""
    with open_image(path, "a colour image") as image:
        if (image.height, image.width) != shape:
            raise InputError(
                f"is {image.width} x {image.height}, its depth image {shape[1]} x {shape[0]}; "
                "register the depth to the colour image first (same size, same camera)"
            )
        colour: NDArray[np.float32] = colour_from_bytes(np.asarray(image.convert("RGB")))
    return colour
