# SPDX-License-Identifier: MIT
"""Reach: how far a scan measured in each part of its image, and which places it surely did not get to.

Each tile of 16 x 16 pixels keeps a box around its measured points, along the axes of their scatter. No point
of the tile gets farther in any direction than the box, so that one look at it answers for 256 pixels.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from completion.evidence.limits import LEAST_COSINE, WIDEST
from completion.evidence.sight import ScanSight, Window, along_ray
from completion.observe.observation import Observation
from completion.observe.rays import Rays, Triple, deviation_at, ray_at
from scenes.card import shown
from scenes.checks import FloatArray, read_only_view
from scenes.scan.projection import PinholeProjection, SphericalProjection
from texture.engine.compiled import compiled, inlined

TILE = 16
"""Pixels: side of the parts that an image is cut into."""

NOTHING_M = -1e9
"""The farthest range of a tile where none was measured, metres."""

_PART = 4  # pixels: side of the parts of a tile
_SLACK = 1e-6  # of lengths, which are kept in single precision, and radians


@shown
class Reach(NamedTuple):
    """What is known of the (rows, columns) of tiles of an image, in single precision: half a byte a pixel."""

    far: NDArray[np.float32]  # (rows, columns) farthest range, metres
    part: NDArray[np.float32]  # (4 rows, 4 columns) farthest range of each part of 4 x 4 pixels, metres
    spread: NDArray[np.float32]  # (rows, columns) largest angle from a pixel's ray to places it sees, radians
    boxes: NDArray[
        np.float32
    ]  # (rows, columns, 4, 3) middle of the box, from the sensor, and half axes, metres


def reach_of(seen: Observation) -> Reach:
    """Return the reach of a scan."""
    ranges, rays = seen.beam_ends(), seen.rays
    rows, columns = -(-ranges.shape[0] // TILE), -(-ranges.shape[1] // TILE)
    part, stray = np.empty((rows * TILE // _PART, columns * TILE // _PART)), np.empty((rows, columns))
    scatter, boxes = np.empty((rows, columns, 3, 3)), np.empty((rows, columns, 4, 3))
    _gather(ranges, rays, rays._replace(points=read_only_view(np.zeros((0, 0, 3)))), part, stray, scatter)
    _bound(ranges, rays, np.ascontiguousarray(np.linalg.eigh(scatter)[1].swapaxes(2, 3)), boxes)
    far = part.reshape(rows, TILE // _PART, columns, TILE // _PART).max(axis=(1, 3))
    return Reach(
        _single(far), _single(part), _single(stray + _widths(seen, (rows, columns))), boxes.astype(np.float32)
    )


def _single(bounds: FloatArray) -> NDArray[np.float32]:
    """Upper bounds in single precision, none of them smaller."""
    return np.nextafter(bounds.astype(np.float32), np.float32(np.inf))


def _widths(seen: Observation, tiles: tuple[int, int]) -> FloatArray:
    """Largest angle between the middle of a pixel and its corners in each tile, radians."""
    camera = seen.scan.projection
    if isinstance(camera, PinholeProjection):
        return np.full(tiles, np.hypot(0.5 / camera.fx, 0.5 / camera.fy) + _SLACK)
    if not isinstance(camera, SphericalProjection):
        raise TypeError(f"points cannot be projected into a {type(camera).__name__}")

    def widest(angles: FloatArray) -> FloatArray:
        steps = np.abs(np.diff(angles)) if len(angles) > 1 else np.array([camera.pixel_angle])
        beside = np.maximum(np.append(steps[:1], steps), np.append(steps, steps[-1:]))[: len(angles)]
        return np.maximum.reduceat(beside, np.arange(0, len(angles), TILE)) / 2 + 2 * _SLACK

    return np.hypot(widest(camera.elevations)[:, None], widest(camera.azimuths))


@compiled
def _gather(
    ranges: FloatArray, rays: Rays, grid: Rays, part: FloatArray, stray: FloatArray, scatter: FloatArray
) -> None:
    """Write each part's farthest range, each tile's scatter, and how far its rays stray from the `grid`."""
    rows, columns = ranges.shape
    part[:] = NOTHING_M
    for i in range(stray.shape[0]):
        for j in range(stray.shape[1]):
            n, x, y, z, xx, xy, xz, yy, yz, zz = (0.0,) * 10
            chord = 0.0
            for row in range(i * TILE, min((i + 1) * TILE, rows)):
                for column in range(j * TILE, min((j + 1) * TILE, columns)):
                    measured = ranges[row, column]
                    if not np.isfinite(measured):
                        continue
                    ray = ray_at(rays, row, column)
                    a, b, c = measured * ray[0], measured * ray[1], measured * ray[2]
                    n, x, y, z = n + 1.0, x + a, y + b, z + c
                    xx, xy, xz = xx + a * a, xy + a * b, xz + a * c
                    yy, yz, zz = yy + b * b, yz + b * c, zz + c * c
                    k, m = row // _PART, column // _PART
                    part[k, m] = max(part[k, m], measured)
                    if rays.points.shape[0]:
                        ideal = ray_at(grid, row, column)
                        off = (ray[0] - ideal[0]) ** 2 + (ray[1] - ideal[1]) ** 2 + (ray[2] - ideal[2]) ** 2
                        chord = max(chord, off)
            n, spread = max(n, 1.0), scatter[i, j]
            spread[0, 0], spread[1, 1], spread[2, 2] = xx - x * x / n, yy - y * y / n, zz - z * z / n
            spread[0, 1] = spread[1, 0] = xy - x * y / n
            spread[0, 2] = spread[2, 0] = xz - x * z / n
            spread[1, 2] = spread[2, 1] = yz - y * z / n
            stray[i, j] = 2 * np.arcsin(min(np.sqrt(chord) / 2, 1.0))


@compiled
def _bound(ranges: FloatArray, rays: Rays, axes: FloatArray, boxes: FloatArray) -> None:
    """Write the box around each tile's points along its `axes` (rows, columns, 3, 3); zeros for none."""
    rows, columns = ranges.shape
    for i in range(boxes.shape[0]):
        for j in range(boxes.shape[1]):
            e = axes[i, j]
            low, high = np.full(3, np.inf), np.full(3, -np.inf)
            for row in range(i * TILE, min((i + 1) * TILE, rows)):
                for column in range(j * TILE, min((j + 1) * TILE, columns)):
                    measured = ranges[row, column]
                    if np.isfinite(measured):
                        x, y, z = ray_at(rays, row, column)
                        for k in range(3):
                            along = measured * (e[k, 0] * x + e[k, 1] * y + e[k, 2] * z)
                            low[k], high[k] = min(low[k], along), max(high[k], along)
            boxes[i, j] = 0.0
            for k in range(3):
                if low[k] <= high[k]:
                    for m in range(3):
                        boxes[i, j, 0, m] += (low[k] + high[k]) / 2 * e[k, m]
                        boxes[i, j, 1 + k, m] = (high[k] - low[k]) / 2 * e[k, m]


@inlined
def farthest_along(boxes: NDArray[np.float32], row: int, column: int, direction: Triple) -> float:
    """How far the points of a tile get in a direction from the sensor at most, times its length, metres.

    `boxes` (rows, columns, 4, 3) are those of `Reach`.
    """
    a, b, c = direction
    total = boxes[row, column, 0, 0] * a + boxes[row, column, 0, 1] * b + boxes[row, column, 0, 2] * c
    for k in range(1, 4):
        total += abs(
            boxes[row, column, k, 0] * a + boxes[row, column, k, 1] * b + boxes[row, column, k, 2] * c
        )
    return float(total)


@inlined
def progress_of(reach: Reach, toward: Triple) -> FloatArray:
    """How far each tile (rows, columns) gets in a direction at most, metres."""
    rows, columns = reach.far.shape
    progress = np.empty((rows, columns))
    for i in range(rows):
        for j in range(columns):
            progress[i, j] = farthest_along(reach.boxes, i, j, toward)
    return progress


@inlined
def is_beyond(
    sight: ScanSight,
    reach: Reach,
    progress: FloatArray,
    window: Window,
    distance: float,
    radius: float,
    height: float,
    sd: float,
) -> bool:
    """Tell whether a scan surely measured less far than all places of a plane within a sphere.

    The sphere lies `distance` away and is seen in the pixels of a `window`, whose tiles got as far as
    `progress` (rows, columns) towards the plane. `height` is that of the sensor above the plane and `sd` the
    largest predicted deviation of the plane there, metres. The tolerance of `sight.look` is bounded by its
    largest value there, so that a yes holds for each of the places.

    A tile ends before the places where its farthest range does, or that of each of its parts in the window.
    Or it ends before the plane. A place at distance d under incidence i lies h = d cos i from it. A pixel's
    ray that is off the place's by at most an angle a has an incidence of at most i + a. So a range r along it
    with progress p has r cos i <= p + r (a sin i + a^2 / 2), and h - r cos i must exceed the tolerance times
    cos i.
    """
    eye, noise = sight.eye, sight.noise
    nearest, farthest, height = distance - radius, distance + radius, abs(height)
    if not (nearest > radius and height > _SLACK * farthest):
        return False
    slack = _SLACK * (1.0 + farthest)
    cosine, steepest = max(height / farthest, LEAST_COSINE), min(height / nearest, 1.0)
    tangent, sine = np.sqrt(1.0 - min(cosine, 1.0) ** 2) / cosine, np.sqrt(1.0 - (height / farthest) ** 2)
    oblique, across = farthest * eye.pixel_angle / 2, sd * sd + eye.flatness_m * eye.flatness_m
    for row in range(window[0] // TILE, window[1] // TILE + 1):
        for column in range(window[2] // TILE, window[3] // TILE + 1):
            far, spread = float(reach.far[row, column]), float(reach.spread[row, column])
            if far < 0.0:
                continue
            sigma = deviation_at(noise, far)  # the largest: it grows with the range
            end = nearest - along_ray(eye, sigma, sd, cosine) - oblique * tangent - slack
            if far < end:
                continue
            before = height - progress[row, column] - far * spread * (sine + spread / 2)
            allowed = eye.n_sigma * np.sqrt(sigma * sigma * steepest * steepest + across) + eye.registration_m
            if spread < WIDEST and before > allowed + oblique * sine + slack + _SLACK * far:
                continue
            if _farthest_part(reach.part, window, row, column) >= end:
                return False
    return True


@inlined
def _farthest_part(part: NDArray[np.float32], window: Window, row: int, column: int) -> float:
    """Farthest range of the parts of a tile that lie in a window."""
    each, most = TILE // _PART, NOTHING_M
    for i in range(max(window[0] // _PART, row * each), min(window[1] // _PART + 1, (row + 1) * each)):
        for j in range(
            max(window[2] // _PART, column * each), min(window[3] // _PART + 1, (column + 1) * each)
        ):
            most = max(most, float(part[i, j]))
    return most
