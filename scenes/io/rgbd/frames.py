# SPDX-License-Identifier: MIT
"""RGB-D frames: depth map, colours, confidence, camera and pose of each; a frame becomes a scan."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from scenes.checks import ColourArray, FloatArray, InputError
from scenes.io.checks.guard import guard_reading
from scenes.io.checks.image import open_image
from scenes.io.formats.header import range_warnings
from scenes.io.poses.camera import Camera, Intrinsics, is_scaled, undistorted
from scenes.io.rgbd.depth import depth_in_metres, depth_warnings, read_depth_image, without_codes
from scenes.pose import Pose
from scenes.scan.projection import PinholeProjection
from scenes.scan.range_image import RangeImage

VIDEOS = (".mp4", ".mov")


@dataclass(frozen=True, slots=True)
class RgbdFrame:
    """A depth map and what belongs to it, as far as that is known.

    Attributes
    ----------
    depth : Path
        The depth map.
    colour : Path, optional
        The colour image, or the video that holds it.
    pose : Pose, optional
        World from sensor.
    time : float, optional
        When it was taken, seconds.
    camera : Camera, optional
        Its own; that of the folder unless given.
    confidence : Path, optional
        An image in which 0 marks depths that are not to be relied on.
    number : int
        Of the image in the video, from 0.
    """

    depth: Path
    colour: Path | None = None
    pose: Pose | None = None
    time: float | None = None
    camera: Camera | None = None
    confidence: Path | None = None
    number: int = 0

    @property
    def images(self) -> tuple[Path, ...]:
        """The colour image, where there is one, and the depth image."""
        if self.colour is None or self.colour.suffix.lower() in VIDEOS:
            return (self.depth,)
        return self.colour, self.depth


@dataclass(frozen=True, slots=True)
class RgbdFolder:
    """The frames of a folder in natural order.

    Attributes
    ----------
    layout : str
        Name of the layout: "plain", "tum" and so on.
    frames : tuple of RgbdFrame
        Frame k of `PATH#k` is the k-th, from 1.
    camera : Camera
        Of a file beside the images, for frames without one of their own.
    depth_scale : float, optional
        Counts a metre that the layout fixes (TUM 5000, most others 1000).
    folder : Path
        Where the frames are.
    warnings : tuple of str
        Frames that were left out, and what holds for all.
    colour_intrinsics : (fx, fy, cx, cy), optional
        Of colour images that do not show the same pixels as the depth maps, from the same place.
    hint : str
        Intrinsics that are usual for the layout.
    """

    layout: str
    frames: tuple[RgbdFrame, ...]
    camera: Camera = field(default_factory=Camera)
    depth_scale: float | None = None
    folder: Path = field(default_factory=Path)
    warnings: tuple[str, ...] = ()
    colour_intrinsics: Intrinsics | None = None
    hint: str = ""

    @property
    def registered(self) -> bool:
        """Whether every frame has a pose."""
        return all(frame.pose is not None for frame in self.frames)


def read_frame(
    folder: RgbdFolder, index: int, intrinsics: Intrinsics | None = None, depth_scale: float | None = None
) -> RangeImage:
    """Return frame `index` (from 0); arguments given here go before what the folder says.

    Depth maps hold z-depth; it becomes range along each pixel's ray. Maps of floats are in metres unless a
    scale is stated. A negative fy is used as given. Lens distortion is taken out: each pixel of the image
    without it has the nearest measured point.

    Raises InputError: unknown intrinsics or depth scale, intrinsics of another image, images that are
    missing, damaged, of 8 bits or of another aspect ratio.
    """
    frame = folder.frames[index]
    camera = frame.camera or folder.camera
    if intrinsics is not None:
        camera = replace(camera, intrinsics=intrinsics, image_size=None)
    numbers = read_depth_image(frame.depth)
    scale = _checked_scale(folder, camera, depth_scale, is_metric=numbers.dtype.kind == "f")
    counts = numbers.astype(np.float64)
    height, width = counts.shape
    with guard_reading(frame.depth, "a depth image"):
        camera = camera.of_size((width, height))
        projection = PinholeProjection(width, height, *(camera.intrinsics or ()))
        colour, sentences = _read_colour(frame, projection, folder.colour_intrinsics)
        if camera.depth_encoding == "linear":
            counts, codes = without_codes(counts)
            sentences += codes
        depth_m = depth_in_metres(counts, camera.depth_encoding, scale)
        sentences += (*range_warnings(depth_m), *depth_warnings(counts))
        if frame.confidence is not None:
            depth_m, unsure = _without_unsure(depth_m, frame.confidence)
            sentences += unsure
    scan = depth_scan(
        depth_m, projection, frame.pose or Pose.identity(), colour, f"{folder.folder.name}#{index + 1}"
    )
    if camera.distortion:
        scan = undistorted(scan, projection, depth_m, camera.distortion)
    return scan.add_warnings((*camera.warnings, *sentences))


def _checked_scale(folder: RgbdFolder, camera: Camera, given: float | None, *, is_metric: bool) -> float:
    """The depth values a metre; InputError where these or the intrinsics are not known."""
    scale = camera.depth_scale if given is None else given
    if camera.depth_encoding == "kinect-disparity" or (scale is None and is_metric):
        scale = 1.0
    scale = folder.depth_scale if scale is None else scale
    missing = ["intrinsics (--intrinsics FX,FY,CX,CY)"] * (camera.intrinsics is None)
    missing += ["depth values a metre (--depth-scale N: Kinect 1000, TUM 5000)"] * (scale is None)
    if missing:
        raise InputError(
            f"{folder.folder}: no file beside the images tells the {' and the '.join(missing)}; "
            f"give them{folder.hint}, or put a camera.json with fx, fy, cx, cy, depth_scale there"
        )
    if scale is None or not (np.isfinite(scale) and scale > 0):
        raise InputError(f"--depth-scale must be a positive number of depth values a metre, got {scale}")
    return scale


def depth_scan(
    depth_m: FloatArray, projection: PinholeProjection, pose: Pose, colour: Any = None, name: str = "scan"
) -> RangeImage:
    """Return the scan of a z-depth image (rows, columns) in metres; 0, inf and NaN mean nothing came back."""
    along = 1.0 / projection.directions()[..., 2]
    with np.errstate(invalid="ignore"):
        return RangeImage(depth_m * along, projection, pose, colour=colour, name=name)


def _without_unsure(depth_m: FloatArray, path: Path) -> tuple[FloatArray, tuple[str, ...]]:
    """Depths without those of the lowest confidence, which ARKit writes as 0, and how many these were."""
    with open_image(path, "a confidence map") as image:
        if not is_scaled(image.size, depth_m.shape[::-1]):
            raise InputError(
                f"is {image.width} x {image.height}, its depth map {depth_m.shape[1]} x {depth_m.shape[0]}"
            )
        levels = np.asarray(image.resize(depth_m.shape[::-1], Image.Resampling.NEAREST))
    unsure = (levels == 0) & np.isfinite(depth_m) & (depth_m > 0)
    if not unsure.any():
        return depth_m, ()
    sentence = f"{int(unsure.sum())} of {depth_m.size} depths have the lowest confidence and were left out"
    return np.where(unsure, 0.0, depth_m), (sentence,)


def _read_colour(
    frame: RgbdFrame, camera: PinholeProjection, of_colours: Intrinsics | None
) -> tuple[ColourArray | None, tuple[str, ...]]:
    """The RGB image as bytes, for each pixel of the depth map, and a warning where it cannot be read.

    It is resized where both have one aspect ratio; other images are looked up by their own intrinsics.
    """
    if frame.colour is None:
        return None, ()
    if frame.colour.suffix.lower() in VIDEOS:
        picture = video_image(frame.colour, frame.number)
        if picture is None:
            return None, (f"{frame.colour.name} could not be read: the frames have no colour",)
        return _fitted(Image.fromarray(picture), camera, of_colours), ()
    with open_image(frame.colour, "a colour image") as image:
        return _fitted(image.convert("RGB"), camera, of_colours), ()


def _fitted(image: Image.Image, camera: PinholeProjection, own: Intrinsics | None) -> ColourArray:
    size = camera.width, camera.height
    if own is not None:
        rows, columns = np.indices(camera.shape)
        across = (columns - camera.cx) / camera.fx * own[0] + own[2]
        down = (rows - camera.cy) / camera.fy * own[1] + own[3]
        at = [np.clip(np.rint(place), 0, n - 1).astype(np.int64) for place, n in
              ((down, image.height), (across, image.width))]  # fmt: skip
        painted: ColourArray = np.asarray(image)[at[0], at[1]]
        return painted
    if not is_scaled(image.size, size):
        raise InputError(
            f"is {image.width} x {image.height}, its depth image {size[0]} x {size[1]}; "
            "register the depth to the colour image first (same aspect ratio, same camera)"
        )
    return np.asarray(image if image.size == size else image.resize(size))


def video_image(path: Path, number: int) -> NDArray[np.uint8] | None:
    """Return image `number` (from 0) of a video as RGB (rows, columns, 3), None where it cannot be read.

    It is not turned upright: the depth maps of phones lie as the sensor does.
    """
    import cv2  # slow to import, and rarely needed

    if not path.is_file() or not path.stat().st_size:
        return None
    video = cv2.VideoCapture(str(path))
    try:
        video.set(cv2.CAP_PROP_ORIENTATION_AUTO, 0)
        video.set(cv2.CAP_PROP_POS_FRAMES, number)
        was_read, image = video.read()
    finally:
        video.release()
    return np.ascontiguousarray(image[..., ::-1]) if was_read else None
