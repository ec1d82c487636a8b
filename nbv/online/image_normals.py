# SPDX-License-Identifier: MIT
"""Normals of a range image, from neighbouring pixels that lie on one surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scenes.checks import FloatArray
from scenes.scan.range_image import RangeImage

_MOST_BEND = (
    0.3  # the middle of three neighbours may lie off the middle by half of this share of their distance
)
_STEADY = 16.0  # standard deviations of the range to reach over: one side's slope then errs by about 5 deg
_SAME = 7.5  # standard deviations of the range by which the steps to both sides may differ on one plane


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
    for the whole scan; farther where the scan's noise asks for it) are tried with the pixel half way; the
    side on which that is more nearly their middle is used, so that normals do not reach across creases and
    jump edges. Where the two sides differ by no more than the noise makes them, their mean is used.

    Parameters
    ----------
    scan : RangeImage
        The scan; without a known `sigma_m` it counts as exact.
    baseline_m : float
        Metres.
    """
    sigma = scan.sigma_m or 0.0
    points = scan.points()
    reach = scan.ranges[scan.valid]
    if not len(reach):
        nothing = np.full(scan.shape, np.nan)
        return ImageNormals(np.full((*scan.shape, 3), np.nan), nothing, nothing)
    reach_m = max(baseline_m, _STEADY * sigma)
    half = max(round(reach_m / 2 / (float(np.median(reach)) * scan.projection.pixel_angle)), 1)
    across = _slope(points, half, sigma)
    down = np.moveaxis(_slope(np.moveaxis(points, 0, 1), half, sigma), 0, 1)
    normal = np.cross(across, down)
    areas = np.linalg.norm(normal, axis=-1)
    with np.errstate(invalid="ignore", divide="ignore"):
        normal /= areas[..., None]
        cosine = -np.einsum("ijk,ijk->ij", normal, scan.rays())
    return ImageNormals(normal * np.sign(cosine)[..., None], areas, np.abs(cosine))


def _slope(points: FloatArray, half: int, sigma_m: float) -> FloatArray:
    """Step in metres a pixel along the second axis, from the straighter side; NaN where both bend."""
    n = points.shape[1]
    sides, bends = np.full((2, *points.shape), np.nan), np.full((2, *points.shape[:2]), np.inf)
    first, last = slice(0, max(n - 2 * half, 0)), slice(2 * half, n)
    middle = slice(half, max(n - half, half))
    for k, (sign, here, far) in enumerate(((1, first, last), (-1, last, first))):
        chord = points[:, far] - points[:, here]
        bend = np.linalg.norm(points[:, here] + points[:, far] - 2 * points[:, middle], axis=-1)
        with np.errstate(invalid="ignore"):
            straight = bend < _MOST_BEND * np.linalg.norm(chord, axis=-1)
        sides[k][:, here][straight] = sign * chord[straight] / (2 * half)
        bends[k][:, here][straight] = bend[straight]
    best: FloatArray = np.where((bends[1] < bends[0])[..., None], sides[1], sides[0])
    if sigma_m > 0:
        with np.errstate(invalid="ignore"):
            alike = np.linalg.norm(sides[0] - sides[1], axis=-1) * 2 * half < _SAME * sigma_m
        best[alike] = sides.mean(axis=0)[alike]
    return best
