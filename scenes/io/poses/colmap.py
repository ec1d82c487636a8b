# SPDX-License-Identifier: MIT
"""COLMAP models: cameras and images, as text or binary.

Formats: colmap.github.io/format.html; numbers of the models as in `src/colmap/sensor/models.h`.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from scenes.checks import FloatArray, InputError
from scenes.io.checks.documents import read_text
from scenes.io.checks.guard import check_file, guard_reading
from scenes.io.checks.limits import check_limit
from scenes.io.poses.camera import Camera
from scenes.pose import rotation_of

_IMAGE = "IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME"
_WORDS = len(_IMAGE.split())
_COEFFICIENTS = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
_PARAMETERS: Mapping[str, tuple[str, ...]] = {
    "SIMPLE_PINHOLE": ("f", "cx", "cy"),
    "PINHOLE": ("fx", "fy", "cx", "cy"),
    "SIMPLE_RADIAL": ("f", "cx", "cy", "k1"),
    "RADIAL": ("f", "cx", "cy", "k1", "k2"),
    "OPENCV": ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2"),
    "FULL_OPENCV": ("fx", "fy", "cx", "cy", *_COEFFICIENTS),
}
_MODELS = ("SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "OPENCV_FISHEYE", "FULL_OPENCV",
           "FOV", "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE", "THIN_PRISM_FISHEYE")  # fmt: skip
_N_PARAMETERS = (3, 4, 4, 5, 8, 8, 12, 5, 4, 5, 12)
_Camera = tuple[str, tuple[int, int], list[float]]  # model, width and height, parameters


@dataclass(frozen=True, slots=True)
class ModelImage:
    """An image of a model: `world_from_sensor` (4, 4) in the model's unit, and the number of its camera."""

    matrix: FloatArray
    camera: int


def read_model(folder: Path) -> tuple[dict[str, ModelImage], dict[int, Camera]]:
    """Return the images of a model by name, and its cameras by number.

    Pixel centres lie at integers, COLMAP's at halves: half a pixel was subtracted.

    Raises InputError: files missing or damaged, or a camera that an image uses has no known model.
    """
    images, cameras = (_first(folder, name) for name in ("images", "cameras"))
    with guard_reading(images, "the images of a COLMAP model"):
        is_text = images.suffix == ".txt"
        named = read_images(read_text(images)) if is_text else dict(_binary_images(check_file(images)))
    with guard_reading(cameras, "the cameras of a COLMAP model"):
        known = _text_cameras if cameras.suffix == ".txt" else _binary_cameras
        used = {image.camera for image in named.values()}
        listed = known(check_file(cameras))
        return named, {number: _camera(*values) for number, values in listed if number in used}


def _first(folder: Path, name: str) -> Path:
    """The file of a model, the binary one where there is none as text."""
    text = folder / f"{name}.txt"
    return text if text.is_file() else folder / f"{name}.bin"


def is_images(text: str) -> bool:
    """Tell whether the first line that is no comment begins the list of images of a COLMAP model."""
    for line in text.splitlines():
        if line.strip() and not line.startswith("#"):
            words = line.split()
            return len(words) >= _WORDS and not _is_number(words[_WORDS - 1])
    return False


def read_images(text: str) -> dict[str, ModelImage]:
    """Return the images of `images.txt` by name.

    COLMAP's own poses go from the world to the camera, and its unit is that of the model, which is arbitrary
    unless it was scaled; its camera frame is ours.

    Raises InputError: a line that is no image, or a quaternion that is no rotation.
    """
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    while lines and not lines[0].strip():
        lines.pop(0)
    images = {}
    for number, line in enumerate(lines[::2], start=1):
        words = line.split(maxsplit=_WORDS - 1)
        if not words:
            continue
        if len(words) < _WORDS:
            raise InputError(f"image {number} has {len(words)} words; expected {_IMAGE}")
        numbers = np.array([float(word) for word in words[1:8]])
        images[words[-1]] = ModelImage(_inverse(numbers, words[-1]), int(words[8]))
    return images


def _binary_images(path: Path) -> Iterator[tuple[str, ModelImage]]:
    data = path.read_bytes()
    (n_images,) = struct.unpack_from("<Q", data)
    check_limit("entries", n_images, "its images")
    at = 8
    for _ in range(n_images):
        numbers, camera = np.frombuffer(data, "<f8", 7, at + 4), struct.unpack_from("<i", data, at + 60)[0]
        end = data.index(b"\0", at + 64)
        name = data[at + 64 : end].decode("utf-8", "surrogateescape")
        (n_points,) = struct.unpack_from("<Q", data, end + 1)
        at = end + 9 + 24 * n_points
        if at > len(data):
            raise InputError(f"truncated: image {name!r} ends behind the {len(data)} bytes that are present")
        yield name, ModelImage(_inverse(numbers, name), camera)


def _inverse(numbers: FloatArray, name: str) -> FloatArray:
    """World from sensor, of a quaternion w x y z and a translation that go the other way."""
    back = rotation_of(numbers[[1, 2, 3, 0]], f"image {name!r}").T
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = back, -back @ numbers[4:]
    return matrix


def _text_cameras(path: Path) -> Iterator[tuple[int, _Camera]]:
    for line in read_text(path).splitlines():
        words = line.split()
        if words and not line.startswith("#"):
            size, values = (int(words[2]), int(words[3])), [float(word) for word in words[4:]]
            yield int(words[0]), (words[1], size, values)


def _binary_cameras(path: Path) -> Iterator[tuple[int, _Camera]]:
    data = path.read_bytes()
    (n_cameras,) = struct.unpack_from("<Q", data)
    check_limit("entries", n_cameras, "its cameras")
    at = 8
    for _ in range(n_cameras):
        number, model, width, height = struct.unpack_from("<iiQQ", data, at)
        if not 0 <= model < len(_MODELS):
            raise InputError(f"its camera {number} is of model {model}, which is not known")
        values = np.frombuffer(data, "<f8", _N_PARAMETERS[model], at + 24)
        at += 24 + values.nbytes
        yield number, (_MODELS[model], (width, height), values.tolist())


def _camera(model: str, size: tuple[int, int], values: list[float]) -> Camera:
    if model not in _PARAMETERS or len(values) != len(_PARAMETERS[model]):
        raise InputError(
            f"a camera is of model {model} with {len(values)} parameters; known: {', '.join(_PARAMETERS)}; "
            "undistort the images first (colmap image_undistorter)"
        )
    named = dict(zip(_PARAMETERS[model], values, strict=True))
    fx, fy = named.get("fx", named.get("f", 0.0)), named.get("fy", named.get("f", 0.0))
    lens = [named.get(name, 0.0) for name in _COEFFICIENTS]
    return Camera(
        (fx, fy, named["cx"] - 0.5, named["cy"] - 0.5),
        image_size=size,
        distortion=tuple(lens) if any(lens) else (),
    )


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True
