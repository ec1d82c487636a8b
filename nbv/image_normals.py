# SPDX-License-Identifier: MIT
"""Normals of a range image, from neighbouring pixels that lie on one surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scenes.checks import FloatArray
from scenes.range_image import RangeImage

_MOST_BEND = (
    0.3  # the middle of three neighbours may lie off the middle by half of this share of their distance
)


@dataclass(frozen=True, slots=True, eq=False)
class ImageNormals:
    """Local surface of each pixel.

    Attributes
    ----------
    normals : (rows, columns, 3) float
        World-frame unit normals towards the sensor, NaN where unknown.
    areas : (rows, columns) float
        Surface in square metres that each pixel stands for, NaN where unknown.
    cosine : (rows, columns) float
        Cosine of incidence, NaN where unknown.
    """

    normals: FloatArray
    areas: FloatArray
    cosine: FloatArray


def image_normals(scan: RangeImage, baseline_m: float) -> ImageNormals:
    """Estimate the normals of a scan.

    In each image direction the two neighbours about `baseline_m` metres away (an even number of pixels, one
    for the whole scan) are tried with the pixel half way; the side on which that
    is more nearly their middle is used, so that normals do not reach across creases and jump edges.
    """
    points = scan.points()
    reach = scan.ranges[scan.valid]
    if not len(reach):
        nothing = np.full(scan.shape, np.nan)
        return ImageNormals(np.full((*scan.shape, 3), np.nan), nothing, nothing)
    half = max(round(baseline_m / 2 / (float(np.median(reach)) * scan.projection.pixel_angle)), 1)
    across, down = _slope(points, half), np.moveaxis(_slope(np.moveaxis(points, 0, 1), half), 0, 1)
    normal = np.cross(across, down)
    areas = np.linalg.norm(normal, axis=-1)
    with np.errstate(invalid="ignore", divide="ignore"):
        normal /= areas[..., None]
        cosine = -np.einsum("ijk,ijk->ij", normal, scan.rays())
    return ImageNormals(normal * np.sign(cosine)[..., None], areas, np.abs(cosine))


def _slope(points: FloatArray, half: int) -> FloatArray:
    """Step in metres a pixel along the second axis, from the straighter side; NaN where both bend."""
    n = points.shape[1]
    best = np.full(points.shape, np.nan)
    least = np.full(points.shape[:2], np.inf)
    first, last = slice(0, max(n - 2 * half, 0)), slice(2 * half, n)
    middle = slice(half, max(n - half, half))
    for sign, here, far in ((1, first, last), (-1, last, first)):
        chord = points[:, far] - points[:, here]
        bend = np.linalg.norm(points[:, here] + points[:, far] - 2 * points[:, middle], axis=-1)
        with np.errstate(invalid="ignore"):
            better = (bend < least[:, here]) & (bend < _MOST_BEND * np.linalg.norm(chord, axis=-1))
        best[:, here][better] = sign * chord[better] / (2 * half)
        least[:, here][better] = bend[better]
    return best
