# SPDX-License-Identifier: MIT
"""Colour of inferred area that other scans confirm, against the colour that they saw there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from skimage.color import rgb2lab

from scenes.checks import BoolArray, FloatArray
from scenes.scan.colour import unit_colour
from scenes.scan.range_image import RangeImage

PATCH_M = 0.05  # colours are compared as means over so much: a texture is continued, not reproduced


@dataclass(frozen=True, slots=True, eq=False)
class ColourScore:
    """Colour differences in patches of 5 cm.

    Attributes
    ----------
    difference : (n,) float
        CIELAB distance (CIE 1976) between the means of claimed and seen colour in each patch.
    n_points : int
        Places that another scan saw at all.
    """

    difference: FloatArray
    n_points: int

    @property
    def median(self) -> float:
        """Median difference; NaN without patches."""
        return float(np.median(self.difference)) if len(self.difference) else float("nan")


def score_colour(
    points: FloatArray,
    colours: NDArray[np.uint8],
    others: Sequence[RangeImage],
    *,
    tolerance_m: float = 0.03,
) -> ColourScore:
    """Compare the colour claimed at places with that of other scans that measured them.

    A scan measured a place if the range in its pixel is the place's distance, within the tolerance. Patches
    are cubes of 5 cm. A difference of about 2 can just be seen; scans of one place differ by exposure.

    Parameters
    ----------
    points : (n, 3) float
        World coordinates.
    colours : (n, 3) uint8
        sRGB.
    others : sequence of RangeImage
        Registered scans, those without colour are left out.
    tolerance_m : float
        Metres.
    """
    seen, count = np.zeros((len(points), 3)), np.zeros(len(points))
    for other in others:
        if other.colour is None:
            continue
        here, pixel = _measured(other, points, tolerance_m)
        seen[here] += unit_colour(other.colour[pixel[:, 0], pixel[:, 1]])
        count[here] += 1
    known = count > 0
    if not known.any():
        return ColourScore(np.zeros(0), 0)
    reference = seen[known] / count[known, None]
    cubes = np.floor(points[known] / PATCH_M).astype(np.int64)
    _, patch = np.unique(cubes, axis=0, return_inverse=True)
    claimed = _means(colours[known] / 255.0, patch)
    difference = np.linalg.norm(_lab(claimed) - _lab(_means(reference, patch)), axis=1)
    return ColourScore(difference, int(np.count_nonzero(known)))


def _measured(
    scan: RangeImage, points: FloatArray, tolerance_m: float
) -> tuple[BoolArray, NDArray[np.int64]]:
    """Which points a scan measured, and the pixels (row, column) of these."""
    position = scan.pixels(points)
    here = np.asarray(np.isfinite(position).all(axis=1), dtype=np.bool_)
    pixel = np.rint(position[here]).astype(np.int64)
    distance = np.linalg.norm(points[here] - scan.origin, axis=1)
    near = np.abs(scan.ranges[pixel[:, 0], pixel[:, 1]] - distance) <= tolerance_m
    here[here] = near
    return here, pixel[near]


def _means(values: FloatArray, group: NDArray[np.int64]) -> FloatArray:
    """Mean values (k, 3) of each group."""
    count = np.bincount(group)
    sums = np.column_stack([np.bincount(group, values[:, channel]) for channel in range(3)])
    return np.asarray(sums / count[:, None], dtype=np.float64)


def _lab(colour: FloatArray) -> FloatArray:
    """CIELAB (n, 3) of sRGB colours 0..1."""
    return np.asarray(rgb2lab(colour), dtype=np.float64)
