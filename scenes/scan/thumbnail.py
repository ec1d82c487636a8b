# SPDX-License-Identifier: MIT
"""Thumbnails: a scan's ranges and colours as small pictures, the way up that a person would see them."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scenes.card import CardPicture
from scenes.checks import ColourArray, FloatArray
from scenes.pose import Pose
from scenes.scan.colour import colour_bytes
from scenes.scan.projection import PinholeProjection, Projection, SphericalProjection

_MOST = 220  # pixels, the longer side


def thumbnails(
    ranges: FloatArray, colour: NDArray[np.float32] | ColourArray | None, projection: Projection
) -> tuple[CardPicture, ...]:
    """Return pictures of ranges (rows, columns), metres, and of colours (rows, columns, 3), if given.

    Near is yellow and far violet; nothing is shown where nothing came back. The projection says which way up
    the scan stands.
    """
    ranges = upright(ranges, projection, _MOST)
    known = np.isfinite(ranges)
    low, high = np.quantile(ranges[known], [0.01, 0.99]) if known.any() else (0.0, 0.0)
    pictures = [
        _picture(_range_colours(ranges, float(low), float(high)), f"range, {low:.2f} to {high:.2f} m")
    ]
    if colour is not None:
        pixels = colour_bytes(upright(colour, projection, _MOST))
        opacity = np.where(known, 255, 0).astype(np.uint8)
        pictures.append(_picture(np.dstack([pixels, opacity]), "colour"))
    return tuple(pictures)


def _range_colours(ranges: FloatArray, low: float, high: float) -> NDArray[np.uint8]:
    """Ranges (rows, columns) as sRGB with opacity: see-through where nothing came back."""
    import cv2  # slow to import: only where pictures are made

    known = np.isfinite(ranges)
    place = np.clip((np.where(known, ranges, low) - low) / max(high - low, 1e-9), 0, 1)
    grey = np.rint(255 * (1 - place)).astype(np.uint8)
    colours = np.asarray(cv2.applyColorMap(grey, cv2.COLORMAP_VIRIDIS))[..., ::-1]
    return np.dstack([colours, np.where(known, 255, 0).astype(np.uint8)])


def field_of_view(projection: Projection) -> str:
    """Return kind, width and height of a field of view in words: "pinhole, 65 x 65 deg"."""
    if isinstance(projection, PinholeProjection):
        halves = projection.width / 2 / abs(projection.fx), projection.height / 2 / abs(projection.fy)
        spans = 2 * np.degrees(np.arctan(halves))
    elif isinstance(projection, SphericalProjection):
        spans = np.degrees([np.ptp(projection.azimuths), np.ptp(projection.elevations)])
    else:
        return projection.kind
    return f"{projection.kind}, {spans[0]:.0f} x {spans[1]:.0f} deg"


def upright(pixels: NDArray[Any], projection: Projection, most: int = 640) -> NDArray[Any]:
    """Return an image (rows, columns) or (rows, columns, k) of a scan as a person would see it.

    Neither side is longer than `most` pixels.

    Panoramas are drawn with equal angles along both sides, up upwards and right to the right, however their
    rows and columns run; camera images keep their order and lose every k-th pixel.
    """
    if not isinstance(projection, SphericalProjection):
        step = max(1, -(-max(pixels.shape[:2]) // most))
        return pixels[::step, ::step]
    spans = [abs(float(angles[-1] - angles[0])) for angles in (projection.elevations, projection.azimuths)]
    scale = most / max(*spans, 1e-9)
    rows, columns = (
        np.rint(np.linspace(0, n - 1, int(np.clip(round(span * scale), 1, most)))).astype(np.int64)
        for n, span in zip(projection.shape, spans, strict=True)
    )
    if projection.elevations[0] < projection.elevations[-1]:
        rows = rows[::-1]
    if projection.azimuths[0] > projection.azimuths[-1]:
        columns = columns[::-1]
    return pixels[np.ix_(rows, columns)]


def turn_upright(pixels: NDArray[Any], projection: Projection, pose: Pose, most: int = 640) -> NDArray[Any]:
    """Return an image (rows, columns) or (rows, columns, k) of a scan with the world's z upwards.

    As `upright`, and panoramas of scanners that swept about a level axis get a quarter of a turn.
    """
    image = upright(pixels, projection, most)
    right, down, _ = pose.rotation[2]  # of the world's z
    if not isinstance(projection, SphericalProjection) or abs(down) >= abs(right):
        return image
    return np.rot90(image, 1 if right > 0 else -1)


def _picture(pixels: NDArray[np.uint8], caption: str) -> CardPicture:
    from PIL import Image  # slow to import: only where pictures are made

    data = io.BytesIO()
    Image.fromarray(pixels).save(data, "PNG", optimize=False, compress_level=9)
    return CardPicture(data.getvalue(), caption, 150)
