# SPDX-License-Identifier: MIT
"""Texel: colours at points of textured faces, looked up by compiled code."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from scenes.checks import FloatArray
from scenes.run.stored_code import can_store


@njit(inline="always")
def _mix_corners(
    corner_colour: NDArray[np.float32], face: int, channel: int, a: float, b: float, c: float
) -> float:
    value = a * corner_colour[face, 0, channel] + b * corner_colour[face, 1, channel]
    return float(value + c * corner_colour[face, 2, channel])


@njit(cache=can_store(), nogil=True)
def plain_colours(
    faces: NDArray[np.int32],
    barycentric: FloatArray,
    corner_colour: NDArray[np.float32],
    face_image: NDArray[np.int32],
    nothing: float,
    colour: NDArray[np.float32],
) -> None:
    """Write the corner colours (m, 3, 3), weighted (n, 3), to `colour` (n, 3) where a face has no image.

    `nothing` is written for face -1; faces with an image are left to `textured_colours`.
    """
    for i in range(faces.size):
        face = faces[i]
        if face < 0:
            for channel in range(3):
                colour[i, channel] = nothing
        elif face_image[face] < 0:
            a, b, c = barycentric[i, 0], barycentric[i, 1], barycentric[i, 2]
            for channel in range(3):
                colour[i, channel] = _mix_corners(corner_colour, face, channel, a, b, c)


@njit(cache=can_store(), nogil=True)
def textured_colours(
    faces: NDArray[np.int32],
    barycentric: FloatArray,
    corner_colour: NDArray[np.float32],
    corner_uv: NDArray[np.float32],
    face_image: NDArray[np.int32],
    number: int,
    image: NDArray[np.uint8],
    colour: NDArray[np.float32],
) -> None:
    """Write corner colours times bilinear samples of image `number` where the face has that image.

    The image repeats; (u, v) = (0, 0) is its lower left corner, and texel centres lie half a texel inside.
    """
    height, width = image.shape[0], image.shape[1]
    texels = image.reshape(-1)
    for i in range(faces.size):
        face = faces[i]
        if face < 0 or face_image[face] != number:
            continue
        a, b, c = barycentric[i, 0], barycentric[i, 1], barycentric[i, 2]
        u = a * corner_uv[face, 0, 0] + b * corner_uv[face, 1, 0] + c * corner_uv[face, 2, 0]
        v = a * corner_uv[face, 0, 1] + b * corner_uv[face, 1, 1] + c * corner_uv[face, 2, 1]
        x = (u - np.floor(u)) * width - 0.5
        y = (np.ceil(v) - v) * height - 0.5
        c0, r0 = int(np.floor(x)), int(np.floor(y))
        right, below = x - c0, y - r0
        c1, r1 = (c0 + 1 if c0 + 1 < width else 0), (r0 + 1 if r0 + 1 < height else 0)
        c0, r0 = (c0 if c0 >= 0 else width - 1), (r0 if r0 >= 0 else height - 1)
        lower = below * (1 / 255.0)
        upper = 1 / 255.0 - lower
        w01, w11 = upper * right, lower * right
        w00, w10 = upper - w01, lower - w11
        i00, i01 = np.uint64(3 * (r0 * width + c0)), np.uint64(3 * (r0 * width + c1))
        i10, i11 = np.uint64(3 * (r1 * width + c0)), np.uint64(3 * (r1 * width + c1))
        for channel in range(np.uint64(3)):
            mixed = w00 * texels[i00 + channel] + w01 * texels[i01 + channel]
            mixed += w10 * texels[i10 + channel] + w11 * texels[i11 + channel]
            colour[i, channel] = mixed * _mix_corners(corner_colour, face, channel, a, b, c)
