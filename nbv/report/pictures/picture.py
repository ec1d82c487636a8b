# SPDX-License-Identifier: MIT
"""Pictures: pixels as PNG inside the page, and the one colour code for measured, inferred and unknown."""

from __future__ import annotations

import base64
import io
from dataclasses import dataclass
from typing import Any

import matplotlib as mpl
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from scenes.checks import BoolArray, FloatArray
from scenes.scan.colour import surface_rgb

# Blue and orange (Okabe and Ito's palette) stay apart under all common kinds of colour blindness; unknown
# area is hatched as well, and modelled area, a lighter tone of measured, is dotted, so that they survive a
# grey print.
MODELLED = (0.82, 0.84, 0.84)
MEASURED, INFERRED, UNKNOWN = (0.62, 0.64, 0.64), (0.18, 0.48, 0.80), (0.90, 0.62, 0.10)
_PNG_LEVEL = 4  # of zlib: 6 takes two thirds more time for four percent less


@dataclass(frozen=True, slots=True)
class Picture:
    """A picture of the page, PNG, `width` x `height` pixels.

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


def _data_uri(png: bytes) -> str:
    return "data:image/png;base64," + base64.b64encode(png).decode("ascii")
