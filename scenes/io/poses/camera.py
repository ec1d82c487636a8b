# SPDX-License-Identifier: MIT
"""Camera files of RGB-D folders: intrinsics, depth scale and lens distortion."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, cast, get_args

import numpy as np

from scenes.checks import FloatArray, InputError
from scenes.io.checks.documents import parse_json, read_text
from scenes.io.checks.guard import guard_reading
from scenes.scan.projection import PinholeProjection
from scenes.scan.range_image import RangeImage

DepthEncoding = Literal["linear", "sun3d", "kinect-disparity"]
Intrinsics = tuple[float, float, float, float]
_FILES = ("camera.json", "intrinsics.json", "intrinsic.json", "camera_primesense.json", "camera.txt",
          "intrinsics.txt", "camera-intrinsics.txt")  # fmt: skip
_COEFFICIENTS = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")  # in OpenCV's order
_LISTS = ("distortion", "dist_coeffs", "distortion_coeffs", "distortion_coefficients")
_LENGTHS = (0, 4, 5, 8)  # of such a list
_MODEL_NAMES = ("distortion_model", "camera_model", "model")
_MODELS = ("none", "pinhole", "simple_pinhole", "perspective", "simple_radial", "radial", "opencv",
           "full_opencv", "brown", "brown_conrady", "plumb_bob", "radtan", "rational_polynomial")  # fmt: skip
_BENT_PX = 0.1  # from a pixel, at which its ray must come out again
_FOLDED_PX = 2.0  # from a pixel: a point farther off lies where the polynomial turned back
_MATRIX, _PIXELS = "intrinsic_matrix", ("fx", "fy", "cx", "cy")
_KNOWN = {_MATRIX, *_PIXELS, "width", "height", "depth_scale", "depth_encoding", *_COEFFICIENTS, *_LISTS,
          *_MODEL_NAMES}  # fmt: skip


def check_encoding(name: object) -> DepthEncoding:
    """Return `name` when it is a known encoding; raise InputError otherwise."""
    if name in get_args(DepthEncoding):
        return cast(DepthEncoding, name)
    raise InputError(f"unknown depth_encoding {name!r}; known: {', '.join(get_args(DepthEncoding))}")


@dataclass(frozen=True, slots=True)
class Camera:
    """Camera of the depth images of a folder, as far as its files state it.

    Attributes
    ----------
    intrinsics : (fx, fy, cx, cy), optional
        Pixels, centres at integers.
    depth_scale : float, optional
        Depth values a metre.
    image_size : (width, height), optional
        Of the images that the intrinsics are of, pixels.
    depth_encoding : str
        How counts become metres.
    distortion : tuple of float
        k1, k2, p1, p2, k3, k4, k5, k6 of OpenCV's model, as many as are known; empty without distortion.
    warnings : tuple of str
        What was left out or converted.
    """

    intrinsics: Intrinsics | None = None
    depth_scale: float | None = None
    image_size: tuple[int, int] | None = None
    depth_encoding: DepthEncoding = "linear"
    distortion: tuple[float, ...] = field(default=())
    warnings: tuple[str, ...] = ()

    def of_size(self, size: tuple[int, int]) -> Camera:
        """Return the camera of images of `size` (width, height), scaled where only the size differs.

        Raises InputError: images of another aspect ratio, or a principal point outside of the image.
        """
        camera, stated = self, self.image_size
        if self.intrinsics is not None and stated is not None and stated != size:
            if not is_scaled(stated, size):
                raise InputError(
                    f"is {size[0]} x {size[1]}, its camera file says {stated}; "
                    "give --intrinsics FX,FY,CX,CY for these images"
                )
            across, down = size[0] / stated[0], size[1] / stated[1]
            fx, fy, cx, cy = self.intrinsics
            scaled = fx * across, fy * down, (cx + 0.5) * across - 0.5, (cy + 0.5) * down - 0.5
            sentence = f"intrinsics of {stated[0]} x {stated[1]} pixels were scaled to {size[0]} x {size[1]}"
            camera = replace(self, intrinsics=scaled, image_size=size, warnings=(*self.warnings, sentence))
        if camera.intrinsics is not None:
            _check_principal_point(camera.intrinsics[2:], size)
        return camera


def is_scaled(first: tuple[int, int], second: tuple[int, int]) -> bool:
    """Tell whether two sizes (width, height) have one aspect ratio, up to half a pixel of the smaller."""
    small, large = sorted((first, second))
    return min(small) > 0 and abs(small[0] * large[1] / large[0] - small[1]) <= 0.5


def _check_principal_point(point: tuple[float, ...], size: tuple[int, int]) -> None:
    if not all(-0.5 <= place <= n - 0.5 for place, n in zip(point, size, strict=True)):
        raise InputError(
            f"its principal point ({point[0]:g}, {point[1]:g}) lies outside of its {size[0]} x {size[1]} "
            "pixels: the intrinsics are of another image size; give those of the depth images, or state "
            "width and height in camera.json, by which they are scaled"
        )


def read_camera(folder: Path) -> Camera:
    """Return the camera that the first camera file of a folder states: .json (ours, Open3D's) or .txt.

    Raises InputError: a damaged file, a distortion that is not known.
    """
    for name in _FILES:
        if (folder / name).is_file():
            with guard_reading(folder / name, "a camera file"):
                text = read_text(folder / name)
                return _of_text(text) if name.endswith(".txt") else _of_values(parse_json(text, dict), name)
    return Camera()


def intrinsics_of(matrix: FloatArray) -> Intrinsics:
    """Return fx, fy, cx, cy of a camera matrix (3, 3) or (4, 4)."""
    return float(matrix[0, 0]), float(matrix[1, 1]), float(matrix[0, 2]), float(matrix[1, 2])


def _of_text(text: str) -> Camera:
    """The camera of 3x3, 4 or 5 numbers."""
    numbers = [float(word) for word in text.replace(",", " ").split()]
    if len(numbers) == 9:
        return Camera(intrinsics_of(np.array(numbers).reshape(3, 3)))
    if len(numbers) not in (4, 5):
        raise InputError(f"expected fx fy cx cy [depth_scale] or 3x3 numbers, got {len(numbers)}")
    fx, fy, cx, cy = numbers[:4]
    return Camera((fx, fy, cx, cy), numbers[4] if len(numbers) == 5 else None)


def _of_values(values: Mapping[str, Any], name: str) -> Camera:
    if _MATRIX in values:  # Open3D's, column by column
        camera = intrinsics_of(np.array(values[_MATRIX], dtype=np.float64).reshape(3, 3).T)
    else:
        fx, fy, cx, cy = (float(values[key]) for key in _PIXELS)
        camera = fx, fy, cx, cy
    unknown = ", ".join(sorted(str(key) for key in set(values) - _KNOWN))
    return Camera(
        camera,
        depth_scale=float(values["depth_scale"]) if values.get("depth_scale") is not None else None,
        image_size=(int(values["width"]), int(values["height"])) if "width" in values else None,
        depth_encoding=check_encoding(values.get("depth_encoding", "linear")),
        distortion=distortion_of(values),
        warnings=(f"{name}: keys that are not known were left out: {unknown[:200]}",) if unknown else (),
    )


def distortion_of(values: Mapping[str, Any]) -> tuple[float, ...]:
    """Return the coefficients in OpenCV's order, nothing where all are 0; by name or as a list.

    Raises InputError: another number of them, or of a camera model that is not known.
    """
    listed: Any = next((values[key] for key in _LISTS if values.get(key)), [])
    coefficients = [float(number) for number in np.ravel(listed)]
    coefficients = coefficients or [float(values.get(key) or 0.0) for key in _COEFFICIENTS]
    if len(coefficients) not in _LENGTHS or not np.isfinite(coefficients).all():
        raise InputError(
            f"its distortion is {coefficients}; expected 4, 5 or 8 numbers, k1, k2, p1, p2, k3 ..."
        )
    if not any(coefficients):
        return ()
    for key in _MODEL_NAMES:
        check_model(values.get(key), key)
    return tuple(coefficients)


def check_model(name: object, key: str = "camera model") -> None:
    """Raise InputError when a camera model, by name, is none of OpenCV's without fisheye."""
    if re.sub(r"\W+", "_", str(name or "none").lower()) not in _MODELS:
        raise InputError(
            f"its {key} {name!r} is not known (known: {', '.join(_MODELS)}); undistort the images first"
        )


def undistorted(
    scan: RangeImage, camera: PinholeProjection, depth_m: FloatArray, distortion: Sequence[float]
) -> RangeImage:
    """Return the scan of a distorted image as of the same camera without distortion; its points stay exact.

    `depth_m` (rows, columns) is along the optical axis, metres; `distortion` is in OpenCV's order and model.
    A warning says by how much pixels move at most, another how many no ray reaches, as where a polynomial
    that was fitted to the middle of an image turns back.

    Raises InputError: no ray reaches any pixel.
    """
    import cv2  # slow to import, and rarely needed

    matrix = np.array([[camera.fx, 0.0, camera.cx], [0.0, camera.fy, camera.cy], [0.0, 0.0, 1.0]])
    lens = np.array(distortion)
    columns, rows = np.meshgrid(np.arange(camera.width, dtype=np.float64), np.arange(float(camera.height)))
    pixels = np.stack([columns, rows], axis=-1).reshape(-1, 1, 2)
    rays = cv2.undistortPoints(pixels, matrix, lens, criteria=(3, 50, 1e-9)).reshape(-1, 2)
    still, ahead = np.zeros(3), np.column_stack([rays, np.ones(len(rays))])
    bent = cv2.projectPoints(ahead, still, still, matrix, lens)[0]
    known = (np.linalg.norm(bent - pixels, axis=-1) < _BENT_PX).reshape(scan.shape)
    if not known.any():
        raise InputError(f"no ray reaches any pixel of a lens with the distortion {list(distortion)}")
    rays = np.where(known[..., None], rays.reshape(*scan.shape, 2), np.nan)
    places = rays * matrix[[0, 1], [0, 1]] + matrix[:2, 2]  # columns and rows without distortion
    points = np.dstack([rays, np.ones(scan.shape)]) * np.where(scan.valid, depth_m, np.nan)[..., None]
    seen = cv2.initUndistortRectifyMap(matrix, lens, None, matrix, scan.shape[::-1], cv2.CV_32FC1)
    column, row = (np.rint(place).astype(np.int64) for place in seen)
    inside = (column >= 0) & (column < camera.width) & (row >= 0) & (row < camera.height)
    at = np.where(inside, row, 0), np.where(inside, column, 0)
    pixel = pixels.reshape(*scan.shape, 2)
    inside &= np.linalg.norm(places[at] - pixel, axis=-1) < _FOLDED_PX
    colour = None if scan.colour is None else scan.colour[at]
    points = np.where(inside[..., None], points[at], np.nan)
    flat = RangeImage.from_points(points, camera, scan.world_from_sensor, colour, scan.name)
    most = np.nanmax(np.linalg.norm(places - pixel, axis=-1))
    sentences = [f"lens distortion was taken out: up to {most:.1f} pixels at the corners"]
    if not known.all():
        n_lost = int((~known).sum())
        sentences.append(f"{n_lost} of {known.size} pixels, which no ray of the lens reaches, were left out")
    return flat.add_warnings(tuple(sentences))
