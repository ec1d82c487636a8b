# SPDX-License-Identifier: MIT
"""Pictures: pixels as PNG in the page, the one colour code for measured, inferred and unknown, cameras.

Cameras stand a step aside from the scanner, or look from outside into a room.
"""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import matplotlib as mpl
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from scenes.checks import BoolArray, FloatArray
from scenes.scan.colour import surface_rgb
from scenes.scan.range_image import RangeImage
from scenes.scan.thumbnail import upright

# Blue and orange (Okabe and Ito's palette) stay apart under all common kinds of colour blindness: any two
# colours differ by 15 or more (CIEDE2000). Unknown area is hatched as well, and modelled area, a lighter tone
# of measured, is dotted, so that they survive a grey print.
MODELLED = (0.86, 0.88, 0.88)
MEASURED, INFERRED, UNKNOWN = (0.62, 0.64, 0.64), (0.18, 0.48, 0.80), (0.90, 0.62, 0.10)
_PNG_LEVEL = 4  # of zlib: 6 takes two thirds more time for four percent less


@dataclass(frozen=True, slots=True)
class Picture:
    """A picture of the page, PNG or SVG, `width` x `height` pixels.

    The title stands in for it where it cannot be seen; `dark_png` is empty when one serves both themes.
    """

    title: str
    caption: str
    png: bytes
    width: int
    height: int
    dark_png: bytes = b""

    @property
    def uri(self) -> str:
        """The picture as a data URI."""
        return _data_uri(self.png)

    @property
    def dark_uri(self) -> str:
        """The dark picture as a data URI, "" without one."""
        return _data_uri(self.dark_png) if self.dark_png else ""


def picture_of(pixels: NDArray[Any], title: str, caption: str = "") -> Picture:
    """Return float (0..1) or uint8 pixels (h, w, 3 or 4) as a picture."""
    if pixels.dtype != np.uint8:
        pixels = np.rint(np.clip(pixels, 0, 1) * 255).astype(np.uint8)
    data = io.BytesIO()
    Image.fromarray(pixels).save(data, "PNG", optimize=False, compress_level=_PNG_LEVEL)
    return Picture(title, caption, data.getvalue(), pixels.shape[1], pixels.shape[0])


def hatch(shape: tuple[int, int], period: int = 9) -> FloatArray:
    """Opacity (h, w) of diagonal stripes, with soft edges."""
    wave = np.sin(2 * np.pi * np.arange(sum(shape)) / period)
    opacity: FloatArray = 0.28 + 0.72 / (1 + np.exp(-6 * (wave - 0.1)))
    return np.asarray(opacity[np.add.outer(*(np.arange(side) for side in shape))], dtype=np.float64)


def dots(shape: tuple[int, int], period: int = 8) -> FloatArray:
    """Opacity (h, w) of a square lattice of dots, with soft edges."""
    row, column = (np.cos(2 * np.pi * np.arange(side) / period) for side in shape)
    opacity: FloatArray = 1 / (1 + np.exp(-6 * (row[:, None] + column - 0.9)))
    return opacity


def segment_pixels(owner: NDArray[np.int32], valid: BoolArray) -> FloatArray:
    """Colour (h, w, 4) of the surface that each pixel belongs to; see-through where nothing came back."""
    numbers = range(int(owner.max(initial=0)) + 1)
    palette = np.array([surface_rgb(k) for k in numbers])
    return np.dstack([palette[owner], valid.astype(np.float64)])


def range_colours(ranges: FloatArray) -> tuple[FloatArray, float, float]:
    """Return ranges (rows, columns) as colours (rows, columns, 4), and the ranges at both ends of the scale.

    The scale spans the middle 98 % of the ranges; where nothing came back it is see-through.
    """
    valid = np.isfinite(ranges)
    low, high = np.quantile(ranges[valid], [0.01, 0.99]) if valid.any() else (0.0, 1.0)
    position = (np.where(valid, ranges, low) - low) / max(high - low, 1e-9)
    colours = mpl.colormaps["viridis"](1 - np.clip(position, 0, 1))
    colours[..., 3] = valid
    return colours, float(low), float(high)


def height_colours(heights: FloatArray, most_m: float) -> FloatArray:
    """Colours (..., 4) of heights (...): blue below, white, red above, in full from `most_m` metres on.

    See-through where there is none (NaN).
    """
    known = np.isfinite(heights)
    share = np.clip(0.5 + np.where(known, heights, 0.0) / max(2 * most_m, 1e-300), 0, 1)
    colours: FloatArray = mpl.colormaps["RdBu_r"](share)
    colours[..., 3] = known
    return colours


def _data_uri(data: bytes) -> str:
    kind = "svg+xml" if data.startswith(b"<?xml") else "png"
    return f"data:image/{kind};base64," + base64.b64encode(data).decode("ascii")


ASIDE_DEG = (
    (-38.0, 8.0),
    (38.0, 8.0),
    (-24.0, 10.0),
    (24.0, 10.0),
    (-30.0, 22.0),
    (30.0, 22.0),
)  # in pairs: one side, the other side
_OVERVIEW_FOV_DEG = 38.0
_BETTER = 1.05  # by this factor more must another side show than the first


@dataclass(frozen=True, slots=True, eq=False)
class Camera:
    """A pinhole camera for drawing; it may be left-handed, as scans with a mirrored image axis are.

    It stands at `origin` (3,), world, metres; rows of `axes` (3, 3) are right, down, forward, and `slope`
    (2,) the tangents of half its field of view across and down.
    """

    origin: FloatArray
    axes: FloatArray
    slope: FloatArray

    def rays(self, shape: tuple[int, int]) -> FloatArray:
        """Unit rays (rows, columns, 3) of an image of this shape."""
        rows, columns = shape
        y = ((np.arange(rows) + 0.5) / rows * 2 - 1) * self.slope[1]
        x = ((np.arange(columns) + 0.5) / columns * 2 - 1) * self.slope[0]
        local = np.stack([*np.meshgrid(x, y), np.ones(shape)], axis=-1)
        rays: FloatArray = (local / np.linalg.norm(local, axis=-1, keepdims=True)) @ self.axes
        return rays

    def shape(self, width: int) -> tuple[int, int]:
        """Rows and columns of an image of this width with square pixels."""
        return max(1, round(width * float(self.slope[1] / self.slope[0]))), width


def aim(
    origin: FloatArray, target: FloatArray, up: FloatArray, slope: FloatArray, *, mirrored: bool
) -> Camera:
    """Return the camera at `origin` that looks at `target` with `up` upwards.

    These have shape (3,), world coordinates, metres; `slope` (2,) is half the image's extent at distance 1.
    """
    forward = (target - origin) / np.linalg.norm(target - origin)
    right = np.cross(forward, up)
    right /= np.linalg.norm(right)
    down = np.cross(forward, right)
    return Camera(origin, np.stack([-right if mirrored else right, down, forward]), slope)


def aside_cameras(scan: RangeImage) -> list[Camera]:
    """Return cameras that see what the scan saw from a step aside, turned about the middle of it."""
    rays = scan.world_from_sensor.rotate(upright(scan.projection.directions(), scan.projection))
    rows, columns = rays.shape[:2]
    forward, across, downward = _axes(rays)
    up = np.array([0.0, 0.0, 1.0])
    if -downward @ up < 0.5:  # a scan in its camera's own frame: its image says what is up
        up = -downward
    mirrored = bool(np.linalg.det(np.stack([across, downward, forward])) < 0)
    points = scan.points()[scan.valid]
    pivot = scan.origin + forward * float(np.quantile((points - scan.origin) @ forward, 0.6))
    tangent = np.array([_tangent(rays[rows // 2, -1], forward), _tangent(rays[-1, columns // 2], forward)])
    slope = np.minimum(tangent * 1.12, 1.0)
    cameras = []
    for yaw, pitch in np.radians(ASIDE_DEG):
        arm = _rotate(scan.origin - pivot, up, yaw)
        arm = _rotate(arm, np.cross(arm, up), pitch)
        cameras.append(aim(pivot + 1.05 * arm, pivot, up, slope, mirrored=mirrored))
    return cameras


def overview_cameras(bounds: FloatArray, n: int = 8, height_deg: float = 38.0) -> list[Camera]:
    """Return cameras all around that look down into the box `bounds` (2, 3) and hold all of it."""
    low, high = bounds
    centre, radius = (low + high) / 2, float(np.linalg.norm(high - low)) / 2
    slope = np.tan(np.radians(_OVERVIEW_FOV_DEG) / 2) * np.array([1.0, 0.68])
    up = np.array([0.0, 0.0, 1.0])
    corners = np.array(np.meshgrid(*bounds.T)).reshape(3, -1).T
    cameras = []
    for turn in 2 * np.pi * (np.arange(n) + 0.37) / n:
        level, steep = np.cos(np.radians(height_deg)), np.sin(np.radians(height_deg))
        out = np.array([level * np.cos(turn), level * np.sin(turn), steep])
        camera = aim(centre + 10 * radius * out, centre, up, slope, mirrored=False)
        local = (corners - centre) @ camera.axes.T
        distance = float((np.abs(local[:, :2]) / slope - local[:, 2:]).max())
        cameras.append(aim(centre + 1.01 * distance * out, centre, up, slope, mirrored=False))
    return cameras


def best_side(cameras: Sequence[Camera], corners: FloatArray) -> int:
    """Return the number of the camera to which most area turns its front; the first if that is much alike.

    `corners` (m, 3, 3) are of faces that are seen from their front alone.
    """
    a, b, c = np.moveaxis(corners, 1, 0)
    twice = np.cross(b - a, c - a)
    shown = [float(np.maximum(twice @ -camera.axes[2], 0.0).sum()) for camera in cameras]
    best = int(np.argmax(shown))
    return best if shown[best] > _BETTER * shown[0] else 0


def _axes(rays: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Forward, right and down of an image's rays, from its middle and its edges."""
    rows, columns = rays.shape[:2]
    forward = rays[rows // 2, columns // 2]
    third_r, third_c = max(rows // 3, 1), max(columns // 8, 1)
    across = (
        rays[rows // 2, min(columns // 2 + third_c, columns - 1)] - rays[rows // 2, columns // 2 - third_c]
    )
    down = rays[min(rows // 2 + third_r, rows - 1), columns // 2] - rays[rows // 2 - third_r, columns // 2]
    return _unit(forward), _unit(across), _unit(down)


def _unit(vector: FloatArray) -> FloatArray:
    unit: FloatArray = vector / max(float(np.linalg.norm(vector)), 1e-12)
    return unit


def _tangent(ray: FloatArray, forward: FloatArray) -> float:
    along = float(ray @ forward)
    return float(np.linalg.norm(ray - along * forward)) / max(along, 1e-6)


def _rotate(vector: FloatArray, axis: FloatArray, angle: float) -> FloatArray:
    """Return `vector` turned about `axis` (Rodrigues)."""
    unit = _unit(axis)
    turned: FloatArray = (
        vector * np.cos(angle)
        + np.cross(unit, vector) * np.sin(angle)
        + unit * (unit @ vector) * (1 - np.cos(angle))
    )
    return turned
