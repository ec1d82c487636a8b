# SPDX-License-Identifier: MIT
"""Material: what a surface is made of, by the median colour of a neighbourhood, and shadows cast on it."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from scenes.checks import BoolArray, FloatArray
from texture.surface.shading import fit_shading

NEIGHBOURHOOD = 31  # texels: side of the square whose median colour is a material's
FEWEST = 400  # texels: fewer are no texture
_BIN = 4.0  # CIELAB units: colours closer than about this pass for one
_RARE = 0.002  # share of the texels below which a colour is no material's
_SPECK = 5  # texels: side of the smallest spot that is another material's
_MOST = 2 / 3  # of what borders the hidden area: the materials that make it are its
_SHAPE = (int(100 / _BIN) + 4, int(256 / _BIN) + 4, int(256 / _BIN) + 4)  # bins of colours, one around them
_COMMON = 0.25  # share of a material's neighbourhoods in which a colour of its own is found
_SHADOW = 0.6  # of the usual luminance
_EDGE = 0.75  # luminance just within a shadow over that just outside it, at most: shading has no edge
_EDGE_TEXELS = 3
_SAME_HUE = 8.0  # CIELAB units of chroma between a material in light and in shadow


def median_colour(image: NDArray[np.uint8], own: BoolArray, wraps: bool) -> NDArray[np.uint8]:
    """Median colour (rows, columns, 3) around each texel of an sRGB image (rows, columns, 3).

    Medians change at once where one material ends and another begins. Texels that are not the surface's
    `own`, (rows, columns), count as the nearest one that is; some are. `wraps`: columns close.
    """
    nearest = ndimage.distance_transform_edt(~own, return_distances=False, return_indices=True)
    levels, around = image[tuple(nearest)], NEIGHBOURHOOD // 2
    if wraps:
        levels = np.concatenate([levels[:, -around:], levels, levels[:, :around]], axis=1)
    median = cv2.medianBlur(np.ascontiguousarray(levels), NEIGHBOURHOOD)
    return np.asarray(median[:, around:-around] if wraps else median, dtype=np.uint8)


def same_material(image: NDArray[np.uint8], own: BoolArray, distance: FloatArray, wraps: bool) -> BoolArray:
    """Texels of the materials that make two thirds of what is found beside the hidden area.

    `image`, `own` and `wraps` as in `median_colour`; `distance` (rows, columns) to the nearest hidden texel,
    texels.
    """
    beside = own & (distance <= NEIGHBOURHOOD)
    if np.count_nonzero(own) < FEWEST or not beside.any():
        return np.ones_like(own)
    even = _without_shading(image, own, wraps)
    bins = _bins(to_lab(median_colour(even, own, wraps)))
    count = _histogram(bins, own)
    number, n_materials = ndimage.label(count >= max(1.0, _RARE * count.sum()), np.ones((3, 3, 3)))
    share = np.bincount(number[tuple(bins[beside].T)], minlength=n_materials + 1)
    share[0] = 0  # of colours too rare for a material
    ranked = np.argsort(-share, kind="stable")
    n_kept = 1 + int(np.searchsorted(np.cumsum(share[ranked]), _MOST * share.sum()))
    kept = np.zeros(n_materials + 1, dtype=np.bool_)
    kept[ranked[:n_kept]] = True
    its_colours = _dilated(kept[number]) & (kept[number] | (number == 0))
    found = np.asarray(its_colours[tuple(np.moveaxis(bins, -1, 0))], dtype=np.bool_)
    strange = found & ~_is_common(_bins(to_lab(even)), found & own)
    return found & ~np.asarray(ndimage.binary_opening(strange, np.ones((_SPECK, _SPECK))), dtype=np.bool_)


def _without_shading(image: NDArray[np.uint8], own: BoolArray, wraps: bool) -> NDArray[np.uint8]:
    values = image / np.float32(255)
    values /= fit_shading(values.mean(axis=2), own, (False, wraps)).gain[..., None]
    return np.asarray(np.rint(np.clip(values, 0, 1) * 255), dtype=np.uint8)


def _is_common(bins: NDArray[np.int32], among: BoolArray) -> BoolArray:
    """Texels whose colour is found in many neighbourhoods of a material.

    Mortar is found wherever there are bricks; glass, in a strip or a corner too narrow for a median, is not.
    """
    row, column = np.nonzero(among)
    block = row // NEIGHBOURHOOD * among.shape[1] + column // NEIGHBOURHOOD
    n_bins = int(np.prod(_SHAPE))
    flat = np.ravel_multi_index(tuple(bins[among].T), _SHAPE)
    pairs = np.unique(block * n_bins + flat)
    n_blocks = len(np.unique(block))
    steps = np.ravel_multi_index((1, 1, 1), _SHAPE) - np.ravel_multi_index(
        tuple(np.indices((3, 3, 3)).reshape(3, -1)), _SHAPE
    )
    near = np.unique((pairs[:, None] + steps).ravel())
    share = np.bincount(near % n_bins, minlength=n_bins) / n_blocks
    return np.asarray(share.reshape(_SHAPE)[tuple(np.moveaxis(bins, -1, 0))] >= _COMMON, dtype=np.bool_)


def is_among(image: NDArray[np.uint8], among: BoolArray) -> BoolArray:
    """Tell which texels of an image (rows, columns, 3) nearly have a colour of the texels `among`."""
    bins = _bins(to_lab(image))
    near = _dilated(_histogram(bins, among) > 0)
    return np.asarray(near[tuple(np.moveaxis(bins, -1, 0))], dtype=np.bool_)


def to_lab(image: NDArray[np.uint8]) -> FloatArray:
    """Return CIELAB colours (..., 3) of sRGB colours (..., 3): lightness 0 to 100, then a and b."""
    colour = np.asarray(image / np.float32(255), dtype=np.float32)
    return np.asarray(cv2.cvtColor(colour, cv2.COLOR_RGB2LAB), dtype=np.float64)


def _bins(lab: FloatArray) -> NDArray[np.int32]:
    """Bin (rows, columns, 3) of each colour."""
    return np.asarray(np.floor((lab + np.array([0, 128, 128])) / _BIN) + 1, dtype=np.int32)


def _histogram(bins: NDArray[np.int32], texels: BoolArray) -> NDArray[np.int64]:
    """How many of the texels have each colour."""
    flat = np.ravel_multi_index(tuple(bins[texels].T), _SHAPE)
    return np.bincount(flat, minlength=int(np.prod(_SHAPE))).reshape(_SHAPE)


def _dilated(bins: BoolArray) -> BoolArray:
    """The bins and their neighbours along the three axes in turn."""
    for axis in range(3):
        bins = bins | np.roll(bins, 1, axis) | np.roll(bins, -1, axis)
    return bins


def cast_shadows(image: NDArray[np.uint8], own: BoolArray, wraps: bool) -> FloatArray:
    """Relative brightness (rows, columns, 3) of texels of an image like it: 1 in the light, less in a shadow.

    In a shadow is what is much darker than most of the surface, of its hue, and at once so, by the median of
    a neighbourhood. The shadow's depth is the ratio of the medians in it and around. Texels that are not
    `own`, (rows, columns), are lit as those around them are, the more evenly the farther off these are.
    `wraps`: columns close.
    """
    gain = np.ones((*own.shape, 3))
    if np.count_nonzero(own) < FEWEST:
        return gain
    material = to_lab(median_colour(image, own, wraps))
    luminance, usual = _luminance(material), np.median(material[own], axis=0)
    hue = np.hypot(*np.moveaxis(material[..., 1:] - usual[1:], -1, 0))
    dark = own & (luminance < _SHADOW * _luminance(usual)) & (hue <= _SAME_HUE)
    if not dark.any():
        return gain
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
