# SPDX-License-Identifier: MIT
"""Samples: the texels of a surface that say what its hidden part looks like.

Not every measured texel does. Colour at an occluder's rim is half the occluder's; a window, a door or a
poster in a wall is no sample of its plaster; and what lies in a shadow is no sample of what is in the light.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from completion.texturing.measured import MeasuredColour
from scenes.checks import BoolArray, FloatArray
from texture.shading import fit_shading

_RIM = 4  # texels from the hidden area within which colour may be the occluder's
_NEIGHBOURHOOD = 31  # texels: side of the square whose mean colour is a material's
_BIN = 4.0  # CIELAB units: colours closer than about this pass for one
_USUAL = 0.005  # share of the texels that makes a colour one of a material's
_FEWEST = 400  # texels: fewer are no texture
_SHADOW = 0.6  # of the usual luminance
_SAME_HUE = 8.0  # CIELAB units of chroma between a material in light and in shadow


def find_foreign(measured: MeasuredColour, wanted: BoolArray, wraps: bool) -> BoolArray:
    """Texels at the rim of hidden area whose colour the surface does not have anywhere further in.

    Cameras blur colour across a jump edge, and depth and colour never agree to the pixel: these texels may
    show the occluder.
    """
    if not wanted.any():
        return np.zeros_like(wanted)
    distance = _distance(wanted, wraps)
    rim = measured.known & (distance <= _RIM)
    inner = measured.pure & (distance > _RIM)
    if not rim.any() or np.count_nonzero(inner) < _FEWEST:
        return rim & ~measured.pure
    lab = _lab(np.asarray(measured.image / np.float32(255), dtype=np.float32))
    return np.asarray(rim & ~_is_among(lab, inner, share=1 / np.count_nonzero(inner)), dtype=np.bool_)


def choose_samples(measured: MeasuredColour, wanted: BoolArray, wraps: bool, max_samples: int) -> BoolArray:
    """Choose the texels that may be copied to the hidden ones.

    They are fine enough (`measure_colour`), not the occluder's (`find_foreign`), of a material that the
    hidden area borders on, and in the light. Materials are told apart by the mean colour of a neighbourhood,
    shading set apart (`texture.shading`).

    Parameters
    ----------
    measured : MeasuredColour
        Of the whole raster.
    wanted : (rows, columns) bool
        Hidden texels.
    wraps : bool
        Whether columns close.
    max_samples : int
        At most so many, the nearest to the hidden ones.
    """
    distance = _distance(wanted, wraps)
    own = measured.fine & ~find_foreign(measured, wanted, wraps)
    if not own.any():
        own = measured.fine
    chosen = own
    if np.count_nonzero(own) >= _FEWEST:
        mean = _neighbourhood_colour(measured.image, own, wraps)
        for likeness in (_borders(mean, own, distance), _is_lit(mean, own)):
            kept = chosen & likeness
            chosen = kept if np.count_nonzero(kept) >= _FEWEST else chosen
    return _nearest(chosen, distance, max_samples)


def _neighbourhood_colour(image: NDArray[np.uint8], own: BoolArray, wraps: bool) -> FloatArray:
    """Mean colour (rows, columns, 3) of the own texels around each, without shading, CIELAB."""
    values = image.astype(np.float32) / 255
    values /= fit_shading(values.mean(axis=2), own, (False, wraps)).gain[..., None]
    values[~own] = 0
    border = _NEIGHBOURHOOD // 2
    weight = own.astype(np.float32)
    if wraps:
        values, weight = (
            np.concatenate([a[:, -border:], a, a[:, :border]], axis=1) for a in (values, weight)
        )
    size = (_NEIGHBOURHOOD, _NEIGHBOURHOOD)
    total = cv2.blur(values, size, borderType=cv2.BORDER_CONSTANT)
    count = cv2.blur(weight, size, borderType=cv2.BORDER_CONSTANT)
    mean = total / np.maximum(count, 1e-6)[..., None]
    mean = mean[:, border:-border] if wraps else mean
    return _lab(np.asarray(np.clip(mean, 0, 1), dtype=np.float32))


def _borders(mean: FloatArray, own: BoolArray, distance: FloatArray) -> BoolArray:
    """Texels of a material that is found beside the hidden area."""
    beside = own & (distance <= _NEIGHBOURHOOD)
    return _is_among(mean, beside, _USUAL) if beside.any() else own


def _is_lit(mean: FloatArray, own: BoolArray) -> BoolArray:
    """Texels that are not much darker than most of the surface while of its hue."""
    usual = np.median(mean[own], axis=0)
    luminance, usual_luminance = (((light + 16) / 116) ** 3 for light in (mean[..., 0], usual[0]))
    hue = np.hypot(*np.moveaxis(mean[..., 1:] - usual[1:], -1, 0))
    return np.asarray((luminance >= _SHADOW * usual_luminance) | (hue > _SAME_HUE), dtype=np.bool_)


def _is_among(lab: FloatArray, among: BoolArray, share: float) -> BoolArray:
    """Texels whose colour is one, or nearly one, that this share of `among` has."""
    bins = np.floor((lab + np.array([0, 128, 128])) / _BIN).astype(np.int32)
    count = np.zeros((28, 66, 66), np.float32)
    np.add.at(count, tuple(bins[among].T), 1.0)
    usual = (count >= max(1.0, share * np.count_nonzero(among))).astype(np.uint8)
    near = _dilate(usual)
    return np.asarray(near[tuple(np.moveaxis(bins, -1, 0))] > 0, dtype=np.bool_)


def _dilate(bins: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Add the neighbours of all bins, along the three axes in turn."""
    for axis in range(3):
        before, after = np.roll(bins, 1, axis), np.roll(bins, -1, axis)
        bins = bins | before | after
    return bins


def _lab(colour: NDArray[np.float32]) -> FloatArray:
    return np.asarray(cv2.cvtColor(colour, cv2.COLOR_RGB2LAB), dtype=np.float64)


def _nearest(texels: BoolArray, distance: FloatArray, most: int) -> BoolArray:
    """The texels nearest to the hidden ones, at most about so many."""
    if np.count_nonzero(texels) <= most:
        return texels.copy()
    reach = np.partition(distance[texels], most)[most]
    return np.asarray(texels & (distance <= reach), dtype=np.bool_)


def _distance(wanted: BoolArray, wraps: bool) -> FloatArray:
    """Distance (rows, columns) of each texel to the nearest wanted one, texels; infinite for none."""
    if not wanted.any():
        return np.full(wanted.shape, np.inf)
    width = wanted.shape[1]
    around = np.concatenate([wanted] * 3, axis=1) if wraps else wanted
    distance = cv2.distanceTransform((~around).astype(np.uint8), cv2.DIST_L2, 3)
    return np.asarray(distance[:, width : 2 * width] if wraps else distance, dtype=np.float64)
