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
        At most about so many, the nearest to the hidden ones.

    Returns
    -------
    samples, context : (rows, columns) bool
    """
    genuine = ~find_foreign(measured, distance)
    own = _kept(_kept(measured.fine, genuine), lit)
    alike = same_material(measured.image, own, distance, wraps)
    chosen = _kept(own, alike)
    if np.count_nonzero(chosen) > max_samples:
        chosen = chosen & (distance <= np.partition(distance[chosen], max_samples)[max_samples])
    return chosen, measured.known & genuine & alike | chosen


def distance_to(wanted: BoolArray, wraps: bool) -> FloatArray:
    """Distance (rows, columns) of each texel to the nearest wanted one, texels; infinite for none."""
    if not wanted.any():
        return np.full(wanted.shape, np.inf)
    width = wanted.shape[1]
    around = np.concatenate([wanted] * 3, axis=1) if wraps else wanted
    distance = cv2.distanceTransform((~around).astype(np.uint8), cv2.DIST_L2, 3)
    return np.asarray(distance[:, width : 2 * width] if wraps else distance, dtype=np.float64)


def _kept(texels: BoolArray, likely: BoolArray) -> BoolArray:
    """Those of the texels that are likely samples, or all if hardly any are."""
    both = texels & likely
    return both if np.count_nonzero(both) >= FEWEST else texels
