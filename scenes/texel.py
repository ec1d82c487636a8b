# SPDX-License-Identifier: MIT
"""Texel: colours at points of textured faces, looked up by compiled code."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from scenes.checks import FloatArray


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def face_colours(
    faces: NDArray[np.int32],
    barycentric: FloatArray,
    corner_colour: NDArray[np.float32],
    nothing: float,
    colour: NDArray[np.float32],
) -> None:
    """Write the corner colours (m, 3, 3), weighted (n, 3), to `colour` (n, 3); `nothing` for face -1."""
    for i in range(faces.size):
        face = faces[i]
        for channel in range(3):
            if face < 0:
                colour[i, channel] = nothing
                continue
            value = 0.0
            for corner in range(3):
                value += barycentric[i, corner] * corner_colour[face, corner, channel]
            colour[i, channel] = value


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def multiply_texture(
    faces: NDArray[np.int32],
    barycentric: FloatArray,
    corner_uv: NDArray[np.float32],
    face_image: NDArray[np.int32],
    number: int,
    image: NDArray[np.uint8],
    colour: NDArray[np.float32],
) -> None:
    """Multiply `colour` (n, 3) by bilinear samples of image `number` where the face has that image.

    The image repeats; (u, v) = (0, 0) is its lower left corner, and texel centres lie half a texel inside.
    """
    height, width = image.shape[0], image.shape[1]
    for i in range(faces.size):
        face = faces[i]
        if face < 0 or face_image[face] != number:
            continue
        u = v = 0.0
        for corner in range(3):
            u += barycentric[i, corner] * corner_uv[face, corner, 0]
            v += barycentric[i, corner] * corner_uv[face, corner, 1]
        x, y = u * width - 0.5, (1.0 - v) * height - 0.5
        left, top = np.floor(x), np.floor(y)
        right, below = x - left, y - top
        c0, r0 = int(left) % width, int(top) % height
        c1, r1 = (c0 + 1) % width, (r0 + 1) % height
        for channel in range(3):
            upper = image[r0, c0, channel] * (1 - right) + image[r0, c1, channel] * right
            lower = image[r1, c0, channel] * (1 - right) + image[r1, c1, channel] * right
            colour[i, channel] *= (upper * (1 - below) + lower * below) / 255.0
