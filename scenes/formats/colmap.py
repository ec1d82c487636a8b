# SPDX-License-Identifier: MIT
"""COLMAP poses: `images.txt`, which holds sensor-from-world, an image on every second line, in any order."""

from __future__ import annotations

import re

import numpy as np

from scenes.checks import FloatArray, InputError
from scenes.pose import rotation_of

_LINE = "IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME"
_WORDS = len(_LINE.split())


def natural_key(name: str) -> list[tuple[int, int, str]]:
    """Return the key under which names are in natural order.

    Examples
    --------
    >>> sorted(["10.png", "9.png", "a2.png"], key=natural_key)
    ['9.png', '10.png', 'a2.png']
    """
    parts = re.split(r"(\d+)", name)
    return [(0, int(part), "") if part.isdigit() else (1, 0, part) for part in parts]


def is_colmap(text: str) -> bool:
    """Tell whether the first line that is no comment begins the list of images of a COLMAP model."""
    for line in text.splitlines():
        if line.strip() and not line.startswith("#"):
            words = line.split()
            return len(words) >= _WORDS and not _is_number(words[_WORDS - 1])
    return False


def colmap_matrices(text: str) -> list[FloatArray]:
    """Return world-from-sensor matrices (4, 4), in the natural order of the images' names.

    COLMAP's own poses go from the world to the camera, and its unit is that of the model, which is arbitrary
    unless it was scaled; its camera frame is ours.

    Raises
    ------
    InputError
        A line that is no image, or a quaternion that is no rotation.
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
            raise InputError(f"image {number} has {len(words)} words; expected {_LINE}")
        images[words[-1]] = _matrix([float(word) for word in words[1:8]], words[-1])
    return [images[name] for name in sorted(images, key=natural_key)]


def _matrix(numbers: list[float], name: str) -> FloatArray:
    """World from sensor, of a quaternion w x y z and a translation that go the other way."""
    w, x, y, z = numbers[:4]
    back = rotation_of([x, y, z, w], f"image {name!r}").T
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = back, -back @ np.array(numbers[4:])
    return matrix


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True
