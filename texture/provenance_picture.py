# SPDX-License-Identifier: MIT
"""Picture of a filled image for notebooks: the image, and beside it where its pixels came from."""

from __future__ import annotations

import base64
import io
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

_MOST = 240  # pixels, the longer side


def show_fill(
    image: NDArray[Any],
    *,
    source_rows: NDArray[np.int32],
    source_cols: NDArray[np.int32],
    confidence: NDArray[np.float32],
    window: int,
    is_complete: bool,
) -> str:
    """Return HTML without style sheet or script: image, sources, and what the fill says of itself.

    Parameters
    ----------
    image : array, shape (h, w) or (h, w, c)
        uint8, or float in 0..1: what to show.
    source_rows, source_cols : array, shape (h, w)
        Where each pixel came from. Known pixels, which point at themselves, are see-through in the second
        picture; the others are redder the lower, and greener the further right, their source lies.
    confidence : array, shape (h, w)
        Of each filled pixel, in 0..1.
    window : int
        Side of the comparison window, pixels.
    is_complete : bool
        Whether all was filled.
    """
    height, width = source_rows.shape
    itself = (source_rows == np.arange(height)[:, None]) & (source_cols == np.arange(width))
    filled = (source_rows >= 0) & ~itself
    agreement = f"{100 * float(confidence[filled].mean()):.0f} %" if filled.any() else "n/a"
    said = f"{np.count_nonzero(filled)} pixels copied, window {window} px, mean confidence {agreement}"
    if not is_complete:
        said += "; not complete: the time was up"
    sources = np.zeros((height, width, 4), np.uint8)
    for channel, place in enumerate((source_rows, source_cols)):
        sources[..., channel] = np.rint(255 * place.clip(0) / max(int(place.max(initial=0)), 1))
    sources[..., 2], sources[..., 3] = 128, np.where(filled, 255, 0)
    pictures = _figure(image, "image") + _figure(sources, "where its pixels came from")
    return (
        '<div class="unseen-card" style="font:13px/1.45 system-ui,sans-serif;color:inherit;'
        "display:inline-block;max-width:760px;padding:10px 14px;margin:4px 0;border-radius:8px;"
        'border:1px solid color-mix(in srgb,currentColor 25%,transparent)">'
        f'<div style="font-weight:600;margin-bottom:6px">Texture, {height} x {width} pixels</div>'
        f'<div style="display:flex;flex-wrap:wrap;gap:10px 22px">{pictures}</div>'
        f'<div style="opacity:.7;margin-top:6px">{said}</div></div>'
    )


def _figure(pixels: NDArray[Any], caption: str) -> str:
    """Return every k-th pixel as a figure."""
    step = max(1, -(-max(pixels.shape[:2]) // _MOST))
    small = pixels[::step, ::step]
    if small.dtype != np.uint8:
        small = np.rint(255 * np.clip(np.nan_to_num(small.astype(np.float64)), 0, 1)).astype(np.uint8)
    data = io.BytesIO()
    Image.fromarray(small[..., 0] if small.ndim == 3 and small.shape[2] == 1 else small).save(data, "PNG")
    uri = "data:image/png;base64," + base64.b64encode(data.getvalue()).decode("ascii")
    return (
        f'<figure style="margin:0"><img src="{uri}" alt="{caption}" width="{max(small.shape[1], 160)}" '
        'style="max-width:100%"/><figcaption style="opacity:.7;font-size:85%">'
        f"{caption}</figcaption></figure>"
    )
