# SPDX-License-Identifier: MIT
"""Image normals: the local surface of each pixel of a range image, from its neighbours in the image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scenes.checks import FloatArray
from scenes.scan.range_image import RangeImage
from texture.engine.compiled import compiled, inlined

_MOST_BEND = (
    0.3  # the middle of three neighbours may lie off the middle by half of this share of their distance
)
_STEADY = 16.0  # standard deviations of the range to reach over: one side's slope then errs by about 5 deg
_SAME = 7.5  # standard deviations of the range by which the steps to both sides may differ on one plane


@dataclass(frozen=True, slots=True, eq=False)
class ImageNormals:
    """Local surface of each pixel (rows, columns), NaN where unknown.

    `normals` (rows, columns, 3) are world-frame units towards the sensor, `areas` the surface in square
    metres that each pixel stands for, `cosine` that of incidence; `points` (rows, columns, 3) are the
    measured points in world coordinates, metres.
    """

    points: FloatArray
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
    points, reach = scan.points(), scan.ranges[scan.valid]
    half = 1
    if len(reach):
        reach_m = max(baseline_m, _STEADY * sigma)
        half = max(round(reach_m / 2 / (float(np.median(reach)) * scan.projection.pixel_angle)), 1)
    normals, areas, cosine = np.empty(points.shape), np.empty(scan.shape), np.empty(scan.shape)
    origin = np.ascontiguousarray(scan.origin)
    _fill(np.ascontiguousarray(points), origin, half, sigma, normals=normals, areas=areas, cosine=cosine)
    return ImageNormals(points, normals, areas, cosine)


@compiled
def _fill(
    points: FloatArray,
    origin: FloatArray,
    half: int,
    sigma_m: float,
    normals: FloatArray,
    areas: FloatArray,
    cosine: FloatArray,
) -> None:
    """Write the normals of all pixels, pixel by pixel."""
    rows, columns = points.shape[:2]
    steps = np.empty((2, 3))  # across and down
    for r in range(rows):
        for c in range(columns):
            for axis in range(2):
                _slope(points, r, c, axis, half, sigma_m, steps[axis])
            across, down = steps[0], steps[1]
            x = across[1] * down[2] - across[2] * down[1]
            y = across[2] * down[0] - across[0] * down[2]
            z = across[0] * down[1] - across[1] * down[0]
            area = np.sqrt(x * x + y * y + z * z)
            areas[r, c] = area
            if not area > 0:
                normals[r, c] = np.nan
                cosine[r, c] = np.nan
                continue
            a = points[r, c, 0] - origin[0]
            b = points[r, c, 1] - origin[1]
            d = points[r, c, 2] - origin[2]
            slope = -(x * a + y * b + z * d) / (area * np.sqrt(a * a + b * b + d * d))
            sign = 1.0 if slope > 0 else (-1.0 if slope < 0 else 0.0)
            normals[r, c, 0] = sign * x / area
            normals[r, c, 1] = sign * y / area
            normals[r, c, 2] = sign * z / area
            cosine[r, c] = abs(slope)


@inlined
def _slope(
    points: FloatArray, row: int, column: int, axis: int, half: int, sigma_m: float, step: FloatArray
) -> None:
    """Write the step (3,) from pixel to pixel along an image direction, from the straighter side; or NaN."""
    n = points.shape[1] if axis == 0 else points.shape[0]
    here = column if axis == 0 else row
    bends = (np.inf, np.inf)
    for side in range(2):
        sign = 1 - 2 * side
        far = here + 2 * sign * half
        if far < 0 or far >= n:
            continue
        bend, chord = _bend(points, row, column, axis, sign * half)
        if bend < _MOST_BEND * chord:
            bends = (bend, bends[1]) if side == 0 else (bends[0], bend)
    both = bends[0] < np.inf and bends[1] < np.inf
    if both and sigma_m > 0:
        apart = 0.0
        for k in range(3):
            one = _point(points, row, column, axis, 2 * half, k) - points[row, column, k]
            other = points[row, column, k] - _point(points, row, column, axis, -2 * half, k)
            apart += (one - other) ** 2
        both = np.sqrt(apart) < _SAME * sigma_m
    else:
        both = False
    sign = -1 if bends[1] < bends[0] else 1
    for k in range(3):
        if both:
            first = _point(points, row, column, axis, 2 * half, k)
            last = _point(points, row, column, axis, -2 * half, k)
            step[k] = (first - last) / (4 * half)
        elif min(bends[0], bends[1]) < np.inf:
            end = _point(points, row, column, axis, 2 * sign * half, k)
            step[k] = sign * (end - points[row, column, k]) / (2 * half)
        else:
            step[k] = np.nan


@inlined
def _bend(points: FloatArray, row: int, column: int, axis: int, half: int) -> tuple[float, float]:
    """Return how far the middle of three pixels lies off, doubled, and how far apart the ends are, metres."""
    bend = chord = 0.0
    for k in range(3):
        here, end = points[row, column, k], _point(points, row, column, axis, 2 * half, k)
        bend += (here + end - 2 * _point(points, row, column, axis, half, k)) ** 2
        chord += (end - here) ** 2
    return np.sqrt(bend), np.sqrt(chord)


@inlined
def _point(points: FloatArray, row: int, column: int, axis: int, step: int, k: int) -> float:
    """Coordinate `k` of the pixel so many steps along an image direction."""
    if axis == 0:
        return float(points[row, column + step, k])
    return float(points[row + step, column, k])
