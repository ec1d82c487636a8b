# SPDX-License-Identifier: MIT
"""Depth encodings: how the counts of a depth image become metres."""

from __future__ import annotations

from typing import Literal, cast, get_args

import numpy as np
from numpy.typing import NDArray

from scenes.checks import FloatArray, InputError

DepthEncoding = Literal["linear", "sun3d", "kinect-disparity"]
_MOST_DISPARITY = 2047  # 11 bits; that number itself means that nothing was measured
_EIGHT_BITS = 255
_TURNED = 0.9  # share of multiples of 8; one in eight by chance, all of depths below 8.2 m by turned bits
_KINECT_M, _KINECT_OFFSET = 351.3, 1092.5  # depth = 351.3 m / (1092.5 - disparity), of the NYU toolbox


def check_encoding(name: object) -> DepthEncoding:
    """Return `name` when it is a known encoding; raise InputError otherwise."""
    if name in get_args(DepthEncoding):
        return cast(DepthEncoding, name)
    raise InputError(f"unknown depth_encoding {name!r}; known: {', '.join(get_args(DepthEncoding))}")


def depth_in_metres(counts: FloatArray, encoding: DepthEncoding, scale: float) -> FloatArray:
    """Return z-depth in metres, 0 where nothing was measured.

    Parameters
    ----------
    counts : (rows, columns) float
        Values of the image.
    encoding : "linear", "sun3d" or "kinect-disparity"
        linear: `counts / scale`. sun3d: 16-bit counts turned left by three bits, turned back and divided by
        `scale`. kinect-disparity: raw 11-bit disparities of the first Kinect, as the NYU data hold them;
        where they exceed 11 bits the bytes of the file stand in the wrong order and are swapped.
    scale : float
        Counts a metre; of no meaning for disparities.

    Raises
    ------
    InputError
        Values that the encoding cannot hold.
    """
    if encoding == "linear":
        return counts / scale
    if not ((counts >= 0) & (counts <= 65535) & (counts == np.floor(counts))).all():
        raise InputError(f"{encoding} depth is of 16-bit integers, the image holds others")
    words = counts.astype(np.uint16)
    if encoding == "sun3d":
        return np.asarray(((words >> 3) | (words << 13)).astype(np.float64) / scale)
    return _kinect_depth(words)


def _kinect_depth(words: NDArray[np.uint16]) -> FloatArray:
    if words.max() > _MOST_DISPARITY:
        words = words.byteswap()
    if words.max() > _MOST_DISPARITY:
        raise InputError(f"kinect-disparity has 11 bits, the image holds {int(words.max())}")
    disparity = words.astype(np.float64)
    known = (disparity > 0) & (disparity < _KINECT_OFFSET - 1)
    return np.where(known, _KINECT_M / (_KINECT_OFFSET - np.where(known, disparity, 0.0)), 0.0)


def depth_warnings(counts: FloatArray) -> tuple[str, ...]:
    """Return a warning where an image (rows, columns) of more bits holds only 8: depths are steps then."""
    known = counts[np.isfinite(counts) & (counts != 0)]
    if not len(known) or known.max() > _EIGHT_BITS or (known != np.floor(known)).any():
        return ()
    return (f"its depths are whole numbers up to {known.max():g}: 8-bit depth in a wider image?",)


def suspected_encoding(counts: FloatArray) -> str:
    """Return why the counts (rows, columns) may be no linear depth, "" where nothing speaks against it."""
    known = counts[counts > 0]
    if not len(known) or not (known == np.floor(known)).all() or known.max() > 65535:
        return ""
    eighth = float(np.mean(known % 8 == 0))
    if len(np.unique(known)) > 8 and eighth > _TURNED and known.max() > 8192:
        return (
            f"{eighth:.0%} of its values are multiples of 8, as SUN3D's are, whose bits are turned: if so, "
            'say "depth_encoding": "sun3d" in camera.json'
        )
    swapped = known.astype(np.uint16).byteswap()
    if known.max() > _MOST_DISPARITY >= swapped.max():
        return (
            "its bytes stand in the wrong order, as in NYU's raw Kinect disparities: if so say "
            '"depth_encoding": "kinect-disparity" in camera.json'
        )
    return ""
