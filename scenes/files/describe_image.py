# SPDX-License-Identifier: MIT
"""Description of images for `unseen info`: colour images, masks and depth images."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from scenes.formats.image import open_image
from scenes.formats.rgbd.depth_encoding import depth_warnings, suspected_encoding

IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".webp", ".pgm", ".ppm")
_METRES = {1000: "millimetres (Kinect, RealSense)", 5000: "1/5000 m (TUM, ICL-NUIM)"}


def describe_image(path: Path) -> dict[str, Any]:
    """Return size, channels and values of an image; for depth images which unit is plausible.

    Raises
    ------
    InputError
        No image, or too large.
    """
    with open_image(path) as image:
        mode, size, values = image.mode, image.size, np.asarray(image)
    is_depth = mode.startswith(("I", "F"))
    found: dict[str, Any] = {
        "kind": "depth image" if is_depth else "image",
        "path": str(path),
        "width": size[0],
        "height": size[1],
        "mode": mode,
        "channels": 1 if values.ndim == 2 else values.shape[2],
        "bits": values.dtype.itemsize * 8,
        "warnings": [],
    }
    with np.errstate(invalid="ignore"):  # counts may be of any kind
        return found | _depth(values.astype(np.float64)) if is_depth else found


def _depth(counts: Any) -> dict[str, Any]:
    """What the counts of a depth image say."""
    known = counts[np.isfinite(counts) & (counts > 0)]
    if not len(known):
        return {"valid_share": 0.0, "counts": None, "warnings": ["no pixel holds a depth"]}
    low, middle, high = (float(pick(known)) for pick in (np.min, np.median, np.max))
    plausible = [f"median {middle / scale:.2f} m if {text}" for scale, text in _METRES.items()]
    suspected = suspected_encoding(counts)
    return {
        "valid_share": float(len(known) / counts.size),
        "counts": {"min": low, "median": middle, "max": high},
        "depth": [] if suspected else plausible,
        "warnings": [*depth_warnings(counts), *([suspected] if suspected else [])],
    }
