# SPDX-License-Identifier: MIT
"""Tiles: a range image in small squares, each with its own plane and the moments that merge into larger ones.

Along a unit ray d a plane w . x = 1 has the inverse range w . d: linear in w. Least squares of inverse
ranges, weighted by (range^2 / sigma)^2, is the fit with errors along the rays, in closed form, from sums that
add up over tiles.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from completion.observe.limits import NORMAL_SD
from completion.observe.rays import Noise, Rays, deviation_at, deviations, dot, minus, ray_at
from scenes.checks import FloatArray, read_only_view
from texture.engine.compiled import compiled

LEAST_TILE, MOST_TILE = 3, 16  # pixels
_EVERY = 3  # pixels: medians need no more


@dataclass(frozen=True, slots=True, eq=False)
class ImageTiles:
    """Squares of a range image, with planes in coordinates relative to the sensor."""

    side: int  # pixels along a tile's side
    count: FloatArray  # (rows, columns) measured pixels in each tile
    matrix: FloatArray  # (rows, columns, 6) weighted sums of d d', d the unit ray: xx, xy, xz, yy, yz, zz
    vector: FloatArray  # (rows, columns, 3) weighted sums of d / range
    plane: FloatArray  # (rows, columns, 3) each tile's w, w . x = 1, x from the sensor; NaN for none
    misfit: FloatArray  # (rows, columns) weighted square residual by freedom: 1 for noise, inf for none
    centre: FloatArray  # (rows, columns, 3) mean of the tile's points, from the sensor, metres
    normal_sd: FloatArray  # (rows, columns) expected error of the normal, radians
    flatness_m: float  # how far a surface may stray from its ideal form, metres: part of the weights
    ranges: FloatArray  # (rows, columns) of the pixels that were cut into tiles; inf elsewhere

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of tiles."""
        return int(self.count.shape[0]), int(self.count.shape[1])


def cut_tiles(ranges: FloatArray, rays: Rays, noise: Noise, flatness_m: float, side: int) -> ImageTiles:
    """Cut an image into tiles of `side` pixels and fit a plane to each.

    Ranges (rows, columns), metres, are inf where nothing came back; a surface may stray from its ideal form
    by `flatness_m` along its normal.
    """
    ranges = read_only_view(ranges)
    count, matrix, vector, plane, misfit, centre, scale = _fit_tiles(ranges, rays, noise, flatness_m, side)
    normal_sd = scale / _narrowest(rays, ranges.shape, side)  # as if the noise were one step across the tile
    return ImageTiles(
        side=side,
        count=count,
        matrix=matrix,
        vector=vector,
        plane=plane,
        misfit=misfit,
        centre=centre,
        normal_sd=normal_sd,
        flatness_m=flatness_m,
        ranges=ranges,
    )


@compiled
def _narrowest(rays: Rays, shape: tuple[int, int], side: int) -> FloatArray:
    """Angle (rows, columns) across each tile where it is narrowest, as near a panorama's pole."""
    rows, columns = shape
    step = max(side - 1, 1)
    result = np.empty(((rows + side - 1) // side, (columns + side - 1) // side))
    for i in range(result.shape[0]):
        for j in range(result.shape[1]):
            top, left = i * side, j * side
            bottom, right = min(top + step, rows - 1), min(left + step, columns - 1)
            corner = ray_at(rays, top, left)
            down, across = minus(ray_at(rays, bottom, left), corner), minus(ray_at(rays, top, right), corner)
            result[i, j] = max(np.sqrt(min(dot(down, down), dot(across, across))) * side / step, 1e-12)
    return result


def tile_side(ranges: FloatArray, noise: Noise, spacing: float) -> int:
    """Return the side in pixels of tiles whose normals are good to about 3 degrees at the median range.

    Ranges are (rows, columns), metres, inf where nothing came back; `spacing` is the angle between pixels,
    radians.
    """
    sample = ranges[::_EVERY, ::_EVERY]
    sample = sample[np.isfinite(sample)]
    if not len(sample):
        return LEAST_TILE
    footprint = float(np.median(sample)) * spacing
    spread = float(np.median(deviations(noise, sample)))
    side = np.ceil(np.sqrt(spread * np.sqrt(12.0) / (footprint * NORMAL_SD)))
    return int(np.clip(side, LEAST_TILE, MOST_TILE))


def spread_over_pixels(
    tiles: ImageTiles, values: NDArray[np.int32], shape: tuple[int, int]
) -> NDArray[np.int32]:
    """Give each pixel of an image of this shape the value of its tile, from (rows, columns) of tiles.

    Pixels beyond the last tile get 0.
    """
    image = np.zeros(shape, np.int32)
    rows, columns = tiles.shape[0] * tiles.side, tiles.shape[1] * tiles.side
    image[:rows, :columns] = np.repeat(np.repeat(values, tiles.side, axis=0), tiles.side, axis=1)[
        : shape[0], : shape[1]
    ]
    return image


@compiled
def solve_plane(a: FloatArray, b: FloatArray, w: FloatArray) -> bool:
    """Solve the packed symmetric system a (6,), b (3,) for w (3,) by Cholesky; False where it is singular."""
    if a[0] <= 0.0:
        return False
    l00 = np.sqrt(a[0])
    l10, l20 = a[1] / l00, a[2] / l00
    d1 = a[3] - l10 * l10
    if d1 <= 1e-14 * a[3]:
        return False
    l11 = np.sqrt(d1)
    l21 = (a[4] - l20 * l10) / l11
    d2 = a[5] - l20 * l20 - l21 * l21
    if d2 <= 1e-14 * a[5]:
        return False
    l22 = np.sqrt(d2)
    y0 = b[0] / l00
    y1 = (b[1] - l10 * y0) / l11
    y2 = (b[2] - l20 * y0 - l21 * y1) / l22
    w[2] = y2 / l22
    w[1] = (y1 - l21 * w[2]) / l11
    w[0] = (y0 - l10 * w[1] - l20 * w[2]) / l00
    return True


@compiled
def _fit_tiles(
    ranges: FloatArray, rays: Rays, noise: Noise, flatness: float, side: int
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Pixels, sums, plane, misfit, centre and noise by range of every tile."""
    rows, columns = (ranges.shape[0] + side - 1) // side, (ranges.shape[1] + side - 1) // side
    count = np.zeros((rows, columns))
    matrix, vector = np.zeros((rows, columns, 6)), np.zeros((rows, columns, 3))
    plane, misfit = np.full((rows, columns, 3), np.nan), np.full((rows, columns), np.inf)
    centre, scale = np.zeros((rows, columns, 3)), np.full((rows, columns), np.inf)
    w = np.zeros(3)
    for row in range(rows):
        for column in range(columns):
            axx, axy, axz, ayy, ayz, azz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            bx, by, bz, cx, cy, cz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            n, variance = 0, 0.0
            top, left = row * side, column * side
            bottom, right = min(top + side, ranges.shape[0]), min(left + side, ranges.shape[1])
            for i in range(top, bottom):
                for j in range(left, right):
                    r = ranges[i, j]
                    if not np.isfinite(r):
                        continue
                    x, y, z = ray_at(rays, i, j)
                    sigma = deviation_at(noise, r)
                    s2 = sigma * sigma + flatness * flatness
                    weight = r * r * r * r / s2
                    axx += weight * x * x
                    axy += weight * x * y
                    axz += weight * x * z
                    ayy += weight * y * y
                    ayz += weight * y * z
                    azz += weight * z * z
                    q = weight / r
                    bx += q * x
                    by += q * y
                    bz += q * z
                    cx += r * x
                    cy += r * y
                    cz += r * z
                    n += 1
                    variance += s2
            count[row, column] = n
            if n == 0:
                continue
            a, b, c = matrix[row, column], vector[row, column], centre[row, column]
            a[0], a[1], a[2], a[3], a[4], a[5] = axx, axy, axz, ayy, ayz, azz
            b[0], b[1], b[2] = bx, by, bz
            c[0], c[1], c[2] = cx / n, cy / n, cz / n
            if 2 * n < (bottom - top) * (right - left) or n < 6 or not solve_plane(a, b, w):
                continue
            cost = 0.0
            for i in range(top, bottom):
                for j in range(left, right):
                    r = ranges[i, j]
                    if not np.isfinite(r):
                        continue
                    x, y, z = ray_at(rays, i, j)
                    sigma = deviation_at(noise, r)
                    s2 = sigma * sigma + flatness * flatness
                    inverse = w[0] * x + w[1] * y + w[2] * z
                    gap = r * r * (1.0 / r - inverse)
                    cost += gap * gap / s2
            size = np.sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2])
            reach = np.sqrt(c[0] * c[0] + c[1] * c[1] + c[2] * c[2])
            cosine = min(1.0, max(0.02, 1.0 / (size * reach)))
            # A stray of the surface by its flatness moves the range by flatness / cosine.
            whole = variance / n
            share = whole / (whole + flatness * flatness * (1.0 / (cosine * cosine) - 1.0))
            for k in range(6):
                a[k] *= share
            for k in range(3):
                b[k] *= share
                plane[row, column, k] = w[k]
            misfit[row, column] = cost * share / (n - 3)
            scale[row, column] = np.sqrt(whole) / reach
    return count, matrix, vector, plane, misfit, centre, scale
