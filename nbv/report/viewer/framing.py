# SPDX-License-Identifier: MIT
"""Framing: from which side surface is seen best, and what of it is to fill the picture."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nbv.report.pictures.camera import Camera, overview_cameras
from nbv.report.viewer.layers import Layer
from scenes.checks import FloatArray

_BETTER = 1.05  # by this factor more must another side show than the first
_REMOTE = 0.005  # share of the faces at each end that need not be in the picture


def best_side(cameras: Sequence[Camera], corners: FloatArray) -> int:
    """Return the camera to which most area turns its front by number; the first if that is much alike.

    Parameters
    ----------
    cameras : sequence of Camera
        All around.
    corners : (m, 3, 3) float
        Of faces that are seen from their front alone.
    """
    a, b, c = np.moveaxis(corners, 1, 0)
    twice = np.cross(b - a, c - a)
    shown = [float(np.maximum(twice @ -camera.axes[2], 0.0).sum()) for camera in cameras]
    best = int(np.argmax(shown))
    return best if shown[best] > _BETTER * shown[0] else 0


def best_camera(bounds: FloatArray, layers: Sequence[Layer]) -> Camera:
    """Return from which side layers are best looked into; they lie within `bounds` (2, 3)."""
    cameras = overview_cameras(bounds)
    return cameras[best_side(cameras, _corners(layers))]


def focus(layers: Sequence[Layer], forward: FloatArray, *, is_room: bool) -> FloatArray:
    """Return the bounds (2, 3) of what is to fill the picture, metres: what is shown, without what is remote.

    Of a room it is what turns its front to an eye that looks `forward` (3,).
    """
    corners = _corners(layers)
    if is_room and len(corners):
        a, b, c = np.moveaxis(corners, 1, 0)
        seen = np.cross(b - a, c - a) @ forward < 0
        corners = corners[seen] if seen.any() else corners
    points = corners.reshape(-1, 3)
    return np.quantile(points, [_REMOTE, 1 - _REMOTE], axis=0) if len(points) else np.zeros((2, 3))


def _corners(layers: Sequence[Layer]) -> FloatArray:
    """Corners (m, 3, 3) of all faces that are shown at first."""
    return np.concatenate(
        [np.zeros((0, 3, 3)), *(layer.vertices[layer.faces] for layer in layers if layer.shown)]
    )
