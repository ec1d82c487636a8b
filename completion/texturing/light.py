# SPDX-License-Identifier: MIT
"""Light: shadows that were cast on a surface, which are nothing of its own look."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from completion.texturing.material import FEWEST, median_colour, to_lab
from scenes.checks import BoolArray, FloatArray

_SHADOW = 0.6  # of the usual luminance
_EDGE = 0.75  # luminance just within a shadow over that just outside it, at most: shading has no edge
_EDGE_TEXELS = 3
_SAME_HUE = 8.0  # CIELAB units of chroma between a material in light and in shadow


def cast_shadows(image: NDArray[np.uint8], own: BoolArray, wraps: bool) -> FloatArray:
    """Relative brightness (rows, columns, 3) of texels: 1 in the light, less in a shadow.

    In a shadow is what is much darker than most of the surface, of its hue, and at once so, by the median of
    a neighbourhood.
    The shadow's depth is the ratio of the medians in it and around. Texels that are not measured are lit as
    those around them are, the more evenly the farther off these are.

    Parameters
    ----------
    image : (rows, columns, 3) uint8
        Measured colour.
    own : (rows, columns) bool
        Texels whose colour is the surface's own.
    wraps : bool
        Whether columns close.
    """
    gain = np.ones((*own.shape, 3))
    if np.count_nonzero(own) < FEWEST:
        return gain
    material = to_lab(median_colour(image, own, wraps))
    luminance, usual = _luminance(material), np.median(material[own], axis=0)
    hue = np.hypot(*np.moveaxis(material[..., 1:] - usual[1:], -1, 0))
    dark = own & (luminance < _SHADOW * _luminance(usual)) & (hue <= _SAME_HUE)
    luminance = _luminance(to_lab(image))
    dark = _to_edges(dark, own, luminance)
    if np.count_nonzero(dark) > np.count_nonzero(own) / 2:
        return gain  # the surface itself is dark, in parts
    number, n_shadows = ndimage.label(dark)
    in_light = np.median(image[own & (number == 0)], axis=0)
    for shadow in range(1, n_shadows + 1):
        inside = number == shadow
        if _has_edge(inside, own, luminance):
            gain[inside] = np.clip(np.median(image[inside], axis=0) / np.maximum(in_light, 1), 1 / 255, 1)
    return np.where(own[..., None], gain, np.exp(_carried(np.log(gain), own)))


def _to_edges(dark: BoolArray, own: BoolArray, luminance: FloatArray) -> BoolArray:
    """Grow shadows over what is dark itself, into corners and strips where most of a neighbourhood is lit."""
    if not dark.any():
        return dark
    between = np.sqrt(np.median(luminance[dark]) * np.median(luminance[own & ~dark]))
    square, mask = np.ones((3, 3)), dark | own & (luminance < between)
    grown = ndimage.binary_propagation(dark, square, mask)
    closed = ndimage.binary_closing(grown, square, iterations=_EDGE_TEXELS) & own
    return np.asarray(grown | closed, dtype=np.bool_)


def _has_edge(dark: BoolArray, own: BoolArray, luminance: FloatArray) -> bool:
    """Whether brightness jumps at the border of a dark part that is large enough for a shadow."""
    if np.count_nonzero(dark) < FEWEST:
        return False
    square = np.ones((3, 3))
    inside = dark & ~ndimage.binary_erosion(dark | ~own, square, iterations=_EDGE_TEXELS)
    outside = own & ~dark & ndimage.binary_dilation(dark, square, iterations=_EDGE_TEXELS)
    if not inside.any() or not outside.any():
        return False
    return bool(np.median(luminance[inside]) < _EDGE * np.median(luminance[outside]))


def _carried(values: FloatArray, own: BoolArray) -> FloatArray:
    """Carry values (rows, columns, 3) into what is not own: by a pyramid, each level from the next coarser.

    References
    ----------
    .. [1] Gortler et al. 1996, "The lumigraph", section 3.4 (pull and push).
    """
    if own.all() or min(own.shape) < 2:
        return np.where(own[..., None], values, 0.0)
    rows, columns = (-(-size // 2) for size in own.shape)
    weight = cv2.resize(own.astype(np.float64), (columns, rows), interpolation=cv2.INTER_AREA)
    total = cv2.resize(np.where(own[..., None], values, 0.0), (columns, rows), interpolation=cv2.INTER_AREA)
    coarse = _carried(total / np.maximum(weight, 1e-9)[..., None], weight > 0)
    finer = cv2.resize(coarse, own.shape[::-1], interpolation=cv2.INTER_LINEAR)
    return np.where(own[..., None], values, finer)


def _luminance(lab: FloatArray) -> FloatArray:
    """Luminance, 0..1, of CIELAB colours."""
    return np.asarray(((lab[..., 0] + 16) / 116) ** 3, dtype=np.float64)
