# SPDX-License-Identifier: MIT
"""Samples: the texels of a surface that say what its hidden part looks like.

Not every measured texel does. Colour at an occluder's rim is half the occluder's; a window, a door or a
poster in a wall is no sample of its plaster; and what lies in a shadow is no sample of what is in the light.
"""

from __future__ import annotations

import cv2
import numpy as np

from completion.texturing.material import FEWEST, is_among, same_material
from completion.texturing.measured import MeasuredColour
from scenes.checks import BoolArray, FloatArray

_BLOCK = 48  # texels: side of the blocks that samples are taken in
_FULL = 0.75  # share of a block that makes it a good one
RIM = 4  # texels from the hidden area within which colour may be the occluder's


def find_foreign(measured: MeasuredColour, distance: FloatArray) -> BoolArray:
    """Texels at the rim of hidden area whose colour the surface does not have anywhere further in.

    Cameras blur colour across a jump edge, and depth and colour never agree to the pixel: these texels may
    show the occluder.

    Parameters
    ----------
    measured : MeasuredColour
        Of the whole raster.
    distance : (rows, columns) float
        To the nearest hidden texel, texels.
    """
    rim = measured.known & (distance <= RIM)
    inner = measured.pure & (distance > RIM)
    if not rim.any() or np.count_nonzero(inner) < FEWEST:
        return rim & ~measured.pure
    return np.asarray(rim & ~is_among(measured.image, inner), dtype=np.bool_)


def choose_samples(
    measured: MeasuredColour, lit: BoolArray, distance: FloatArray, wraps: bool, max_samples: int
) -> tuple[BoolArray, BoolArray]:
    """Choose the texels that may be copied to the hidden ones, and those that they are to go on from.

    What is gone on from is not the occluder's (`find_foreign`), and of a material that the hidden area mostly
    borders on (`same_material`); samples are also fine enough (`measure_colour`), and in the light.

    Parameters
    ----------
    measured : MeasuredColour
        Of the whole raster.
    lit : (rows, columns) bool
        Texels in no shadow.
    distance : (rows, columns) float
        To the nearest hidden texel, texels.
    wraps : bool
        Whether columns close.
    max_samples : int
        At most about so many, in the blocks nearest to the hidden ones.

    Returns
    -------
    samples, context : (rows, columns) bool
    """
    genuine = ~find_foreign(measured, distance)
    fine = measured.fine if measured.fine.any() else measured.known
    own = _kept(_kept(fine, genuine), lit)
    alike = same_material(measured.image, own, distance, wraps)
    chosen = _kept(own, alike)
    return _near_blocks(chosen, distance, max_samples), measured.known & genuine & alike | chosen


def distance_to(wanted: BoolArray, wraps: bool) -> FloatArray:
    """Distance (rows, columns) of each texel to the nearest wanted one, texels; infinite for none."""
    if not wanted.any():
        return np.full(wanted.shape, np.inf)
    width = wanted.shape[1]
    around = np.concatenate([wanted] * 3, axis=1) if wraps else wanted
    distance = cv2.distanceTransform((~around).astype(np.uint8), cv2.DIST_L2, 3)
    return np.asarray(distance[:, width : 2 * width] if wraps else distance, dtype=np.float64)


def _near_blocks(texels: BoolArray, distance: FloatArray, most: int) -> BoolArray:
    """About so many of the texels: whole blocks of them, near ones first; a window sees little in a strip."""
    if np.count_nonzero(texels) <= most:
        return texels
    rows, columns = (-(-size // _BLOCK) for size in texels.shape)
    row, column = np.nonzero(texels)
    block = row // _BLOCK * columns + column // _BLOCK
    count = np.bincount(block, minlength=rows * columns)
    nearest = np.full(rows * columns, np.inf)
    np.minimum.at(nearest, block, distance[texels])
    order = np.lexsort((nearest, count < _FULL * _BLOCK**2))
    n_blocks = 1 + int(np.searchsorted(np.cumsum(count[order]), most))
    kept = np.zeros(rows * columns, dtype=np.bool_)
    kept[order[:n_blocks]] = True
    chosen = np.zeros_like(texels)
    chosen[row, column] = kept[block]
    return chosen


def _kept(texels: BoolArray, likely: BoolArray) -> BoolArray:
    """Those of the texels that are likely samples, or all if hardly any are."""
    both = texels & likely
    return both if np.count_nonzero(both) >= FEWEST else texels
