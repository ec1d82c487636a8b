# SPDX-License-Identifier: MIT
"""Reach: how far a scan measured in each part of its image, and which places it surely did not get to."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from completion.evidence.sight import Eye, along_ray
from completion.observe.observation import Observation
from completion.observe.rays import deviations
from completion.observe.triple import Triple, dot
from scenes.checks import FloatArray
from texture.engine.compiled import compiled, inlined

_TILE = 16  # pixels: side of the parts
_NOTHING_M = -1e9  # the farthest range where none was measured, metres
_SLACK = 1e-9  # of rounding, metres and radians


class Reach(NamedTuple):
    """What is known of the tiles of an image; (rows, columns) of tiles of 16 x 16 pixels."""

    far: FloatArray  # farthest range of each, metres
    sigma: FloatArray  # largest standard deviation of a range, metres


def reach_of(seen: Observation) -> Reach:
    """Return the reach of a scan."""
    rows, columns = seen.valid.shape
    odd = (0, -rows % _TILE), (0, -columns % _TILE)

    def largest(values: FloatArray, least: float) -> FloatArray:
        whole = np.pad(values, odd, constant_values=least)
        parts = whole.reshape(whole.shape[0] // _TILE, _TILE, whole.shape[1] // _TILE, _TILE)
        return np.asarray(parts.max(axis=(1, 3)), dtype=np.float64)

    far = np.where(np.isfinite(seen.scan.ranges), seen.scan.ranges, _NOTHING_M)
    farthest = largest(far, _NOTHING_M)
    sigma = deviations(seen.noise.numbers(), np.maximum(farthest, 0.0).ravel())  # grows with the range
    return Reach(farthest, sigma.reshape(farthest.shape))


@compiled
def is_beyond(
    eye: Eye, angles: FloatArray, reach: Reach, middle: Triple, radius: float, height: float, sd: float
) -> bool:
    """Tell whether a scan surely measured less far than all places of a plane within a sphere.

    The sphere's image is bounded by tiles, and the tolerance by its largest value there (`sight.look`), so
    that a yes holds for each of the places. `angles` are those of `Sight`; `height` is that of the sensor
    above the plane and `sd` the largest predicted deviation of the plane there, metres.
    """
    x = dot(eye.turn[0], middle) + eye.shift[0]
    y = dot(eye.turn[1], middle) + eye.shift[1]
    z = dot(eye.turn[2], middle) + eye.shift[2]
    distance = np.sqrt(x * x + y * y + z * z)
    if not distance > 2 * radius:
        return False
    if eye.is_spherical:
        top, bottom, left, right = _window_of_turning(eye, angles, x, y, z, radius)
    else:
        top, bottom, left, right = _window_of_pinhole(eye, x, y, z, radius)
    far, sigma = _NOTHING_M, 0.0
    for row in range(top // _TILE, bottom // _TILE + 1):
        for column in range(left // _TILE, right // _TILE + 1):
            far, sigma = max(far, reach.far[row, column]), max(sigma, reach.sigma[row, column])
    nearest, farthest = distance - radius, distance + radius
    if nearest <= far:
        return False
    cosine = max(abs(height) / farthest, 1e-3)
    tangent = np.sqrt(max(1.0 - cosine * cosine, 0.0)) / cosine
    allowed = along_ray(eye, sigma, sd, cosine) + farthest * eye.pixel_angle * tangent / 2
    return bool(nearest - far > allowed + _SLACK)


@inlined
def _window_of_pinhole(eye: Eye, x: float, y: float, z: float, radius: float) -> tuple[int, int, int, int]:
    """First and last row and column that a sphere about (x, y, z), sensor frame, may be seen in."""
    rows, columns = eye.shape
    fx, fy, cx, cy = eye.lens
    near, farther = z - radius, z + radius
    if near <= 0.0:
        return 0, rows - 1, 0, columns - 1
    low, high = (y - radius), (y + radius)
    ups = fy * low / near, fy * low / farther, fy * high / near, fy * high / farther
    low, high = (x - radius), (x + radius)
    sides = fx * low / near, fx * low / farther, fx * high / near, fx * high / farther
    top, bottom = _clipped(cy + min(ups), cy + max(ups), rows)
    left, right = _clipped(cx + min(sides), cx + max(sides), columns)
    return top, bottom, left, right


@inlined
def _clipped(low: float, high: float, n: int) -> tuple[int, int]:
    """First and last of n pixels between two places, and one more on either side; none as (0, -1)."""
    if high < -1.0 or low > n:
        return 0, -_TILE
    return int(max(np.floor(low) - 1.0, 0.0)), int(min(np.ceil(high) + 1.0, n - 1.0))


@inlined
def _window_of_turning(
    eye: Eye, angles: FloatArray, x: float, y: float, z: float, radius: float
) -> tuple[int, int, int, int]:
    """`_window_of_pinhole` for a turning scanner."""
    rows, columns = eye.shape
    half = np.arcsin(radius / np.sqrt(x * x + y * y + z * z)) + _SLACK
    elevation = np.arctan2(-y, np.sqrt(x * x + z * z))
    top, bottom = _between(angles, 0, rows, elevation - half, elevation + half)
    if abs(elevation) + half >= np.pi / 2 - 1e-3:
        return top, bottom, 0, columns - 1
    side = np.arcsin(min(np.sin(half) / np.cos(elevation), 1.0)) + _SLACK
    middle = (angles[rows] + angles[rows + columns - 1]) / 2
    turned = (np.arctan2(x, z) - middle + np.pi) % (2 * np.pi) - np.pi
    if abs(turned) + side >= np.pi:
        return top, bottom, 0, columns - 1
    left, right = _between(angles, rows, columns, middle + turned - side, middle + turned + side)
    return top, bottom, left, right


@inlined
def _between(angles: FloatArray, first: int, n: int, low: float, high: float) -> tuple[int, int]:
    """First and last of n monotonic angles from `first` on within two, and one more on either side."""
    rises = angles[first + n - 1] >= angles[first]
    start, end = _count_below(angles, first, n, rises, low), _count_below(angles, first, n, rises, high)
    if not rises:
        start, end = n - end, n - start
    return max(start - 2, 0), min(end + 1, n - 1)


@inlined
def _count_below(angles: FloatArray, first: int, n: int, rises: bool, limit: float) -> int:
    """How many of n monotonic angles from `first` on are smaller than a limit."""
    low, high = 0, n
    while low < high:
        k = (low + high) // 2
        if angles[first + k if rises else first + n - 1 - k] < limit:
            low = k + 1
        else:
            high = k
    return low
