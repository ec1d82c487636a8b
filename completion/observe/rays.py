# SPDX-License-Identifier: MIT
"""Rays of a scan and the noise along them, in triples of numbers as compiled loops read them."""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from scenes.card import shown
from scenes.checks import FloatArray, read_only_view
from scenes.scan.range_image import RangeImage
from texture.engine.compiled import compiled, inlined

Triple: TypeAlias = tuple[float, float, float]


def triple(vector: FloatArray) -> Triple:
    """Return a vector (3,) as three numbers."""
    x, y, z = vector.tolist()
    return x, y, z


@inlined
def dot(a: Triple, b: Triple) -> float:
    """Inner product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inlined
def minus(a: Triple, b: Triple) -> Triple:
    """Difference."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@inlined
def plus(a: Triple, length: float, b: Triple) -> Triple:
    """The place at so many lengths of `b` from `a`."""
    return a[0] + length * b[0], a[1] + length * b[1], a[2] + length * b[2]


@shown
class Rays(NamedTuple):
    """The rays (p s, q, p t) of rows p, q and columns s, t, or those through measured points."""

    origin: Triple  # where they start, metres
    turn: tuple[Triple, Triple, Triple]  # rows of the rotation out of the sensor frame
    scale: FloatArray  # (rows,) p
    down: FloatArray  # (rows,) q
    right: FloatArray  # (columns,) s
    forward: FloatArray  # (columns,) t
    points: FloatArray | NDArray[np.float32]  # (rows, columns, 3) sensor frame; (0, 0, 3): none


@shown
class Noise(NamedTuple):
    """Expected error of a range r to a flat wall: hypot(hypot(constant, q r^2) + q r^2, bulge r), metres."""

    constant_m: float
    bulge: float
    quadratic_per_m: float  # q


def rays_of(scan: RangeImage) -> Rays:
    """Return the rays of a scan in the frame of its pose."""
    grid, pose = scan.projection.ray_grid(), scan.world_from_sensor
    x, y, z = map(triple, pose.rotation)
    points = np.zeros((0, 0, 3)) if scan.sensor_points is None else scan.sensor_points
    return Rays(
        origin=triple(pose.translation),
        turn=(x, y, z),
        scale=grid.scale,
        down=grid.down,
        right=grid.right,
        forward=grid.forward,
        points=read_only_view(points),  # of one type to compiled loops, whatever a scan holds
    )


@inlined
def ray_at(rays: Rays, row: int, column: int) -> Triple:
    """The unit ray of a pixel."""
    x, y, z = rays.scale[row] * rays.right[column], rays.down[row], rays.scale[row] * rays.forward[column]
    if rays.points.shape[0] and np.isfinite(rays.points[row, column, 0]):
        x = np.float64(rays.points[row, column, 0])
        y, z = np.float64(rays.points[row, column, 1]), np.float64(rays.points[row, column, 2])
    length = 1.0 / np.sqrt(x * x + y * y + z * z)
    a, b, c = rays.turn
    return (
        (a[0] * x + a[1] * y + a[2] * z) * length,
        (b[0] * x + b[1] * y + b[2] * z) * length,
        (c[0] * x + c[1] * y + c[2] * z) * length,
    )


@inlined
def deviation_at(noise: Noise, measured: float) -> float:
    """Expected error of a range, metres; 0 where nothing came back."""
    if not np.isfinite(measured):
        return 0.0
    quadratic = noise.quadratic_per_m * (measured * measured)
    flat = np.sqrt(noise.constant_m * noise.constant_m + quadratic * quadratic) + quadratic
    bulge = noise.bulge * measured
    return float(flat if bulge == 0.0 else np.sqrt(flat * flat + bulge * bulge))


@compiled
def deviations(noise: Noise, ranges: FloatArray) -> FloatArray:
    """Expected errors (n,) of ranges (n,), metres."""
    result = np.empty(ranges.size)
    for k in range(ranges.size):
        result[k] = deviation_at(noise, ranges[k])
    return result


@compiled
def pick_rays(rays: Rays, pixels: NDArray[np.int64], out: FloatArray) -> None:
    """Write the unit rays of flat pixels (n,) to `out` (n, 3)."""
    columns = rays.right.size
    for k in range(pixels.size):
        out[k, 0], out[k, 1], out[k, 2] = ray_at(rays, pixels[k] // columns, pixels[k] % columns)


@compiled
def pick_points(rays: Rays, ranges: FloatArray, pixels: NDArray[np.int64], out: FloatArray) -> None:
    """Write the places at `ranges` (rows, columns) along the rays of flat pixels (n,) to `out` (n, 3)."""
    columns = rays.right.size
    for k in range(pixels.size):
        row, column = pixels[k] // columns, pixels[k] % columns
        measured = ranges[row, column] if np.isfinite(ranges[row, column]) else np.nan
        out[k, 0], out[k, 1], out[k, 2] = plus(rays.origin, measured, ray_at(rays, row, column))
