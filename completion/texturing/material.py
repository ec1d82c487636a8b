# SPDX-License-Identifier: MIT
"""Material: what a surface is made of, told apart by the median colour of a neighbourhood."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from scenes.checks import BoolArray, FloatArray
from texture.shading import fit_shading

NEIGHBOURHOOD = 31  # texels: side of the square whose median colour is a material's
FEWEST = 400  # texels: fewer are no texture
_BIN = 4.0  # CIELAB units: colours closer than about this pass for one
_RARE = 0.002  # share of the texels below which a colour is no material's
_MOST = 2 / 3  # of what borders the hidden area: the materials that make it are its


def material_colour(image: NDArray[np.uint8], own: BoolArray, wraps: bool) -> FloatArray:
    """Median colour (rows, columns, 3) around each texel, without shading, CIELAB.

    Medians change at once where one material ends and another begins. Texels that are not the surface's own
    count as the nearest one that is.

    Parameters
    ----------
    image : (rows, columns, 3) uint8
        sRGB.
    own : (rows, columns) bool
        Texels to go by; some are.
    wraps : bool
        Whether columns close.
    """
    values = image.astype(np.float32) / np.float32(255)
    values /= fit_shading(values.mean(axis=2), own, (False, wraps)).gain[..., None]
    nearest = ndimage.distance_transform_edt(~own, return_distances=False, return_indices=True)
    levels = np.rint(np.clip(values[tuple(nearest)], 0, 1) * 255).astype(np.uint8)
    around = NEIGHBOURHOOD // 2
    if wraps:
        levels = np.concatenate([levels[:, -around:], levels, levels[:, :around]], axis=1)
    median = cv2.medianBlur(np.ascontiguousarray(levels), NEIGHBOURHOOD)
    return to_lab(median[:, around:-around] if wraps else median)


def same_material(image: NDArray[np.uint8], own: BoolArray, distance: FloatArray, wraps: bool) -> BoolArray:
    """Texels of the materials that make two thirds of what is found beside the hidden area.

    Parameters
    ----------
    image, own, wraps
        As in `material_colour`.
    distance : (rows, columns) float
        To the nearest hidden texel, texels.
    """
    beside = own & (distance <= NEIGHBOURHOOD)
    if np.count_nonzero(own) < FEWEST or not beside.any():
        return np.ones_like(own)
    bins = _bins(material_colour(image, own, wraps))
    count = _histogram(bins, own)
    number, n_materials = ndimage.label(count >= max(1.0, _RARE * count.sum()), np.ones((3, 3, 3)))
    share = np.bincount(number[tuple(bins[beside].T)], minlength=n_materials + 1)
    share[0] = 0  # of colours too rare for a material
    ranked = np.argsort(-share, kind="stable")
    n_kept = 1 + int(np.searchsorted(np.cumsum(share[ranked]), _MOST * share.sum()))
    kept = np.zeros(n_materials + 1, dtype=np.bool_)
    kept[ranked[:n_kept]] = True
    found = kept[number[tuple(np.moveaxis(bins, -1, 0))]]
    # Where materials meet in a corner the median is the other one's: go by the colours found further in.
    inner = ndimage.binary_erosion(found | ~own, np.ones((3, 3)), iterations=NEIGHBOURHOOD // 2) & own
    return np.asarray(found & is_among(image, inner) if inner.any() else found, dtype=np.bool_)


def is_among(image: NDArray[np.uint8], among: BoolArray) -> BoolArray:
    """Texels whose colour is one, or nearly one, that some of `among` have."""
    bins = _bins(to_lab(image))
    near = _dilated(_histogram(bins, among) > 0)
    return np.asarray(near[tuple(np.moveaxis(bins, -1, 0))], dtype=np.bool_)


def to_lab(image: NDArray[np.uint8]) -> FloatArray:
    """CIELAB of sRGB colours."""
    colour = np.asarray(image / np.float32(255), dtype=np.float32)
    return np.asarray(cv2.cvtColor(colour, cv2.COLOR_RGB2LAB), dtype=np.float64)


def _bins(lab: FloatArray) -> NDArray[np.int32]:
    """Bin (rows, columns, 3) of each colour."""
    return np.asarray(np.floor((lab + np.array([0, 128, 128])) / _BIN), dtype=np.int32)


def _histogram(bins: NDArray[np.int32], texels: BoolArray) -> NDArray[np.int64]:
    """How many of the texels have each colour."""
    shape = (int(100 / _BIN) + 2, int(256 / _BIN) + 2, int(256 / _BIN) + 2)
    flat = np.ravel_multi_index(tuple(bins[texels].T), shape)
    return np.bincount(flat, minlength=int(np.prod(shape))).reshape(shape)


def _dilated(bins: BoolArray) -> BoolArray:
    """The bins and their neighbours along the three axes in turn."""
    for axis in range(3):
        bins = bins | np.roll(bins, 1, axis) | np.roll(bins, -1, axis)
    return bins
