# SPDX-License-Identifier: MIT
"""Normal equations of planes and cylinders: errors along the rays, each weighted by its variance."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from completion.fitting.chart import axis_frame
from completion.observe.observation import Beams
from completion.observe.rays import Noise, Rays, deviation_at, ray_at
from completion.observe.triple import Triple
from scenes.checks import FloatArray
from scenes.run.mapping import trim
from scenes.surfaces.catalogue import Cylinder, Plane, Surface
from texture.engine.compiled import compiled, inlined

_LEAST_SLOPE = 0.1  # |cosine| below which a cylinder's grazing ray says nothing
_LEVEL = 1e-6  # |cosine| below which a ray does not meet a plane
_MAX_CONDITION = 1e12


@dataclass(frozen=True, slots=True, eq=False)
class NormalEquations:
    """Normal equations of one surface: J'WJ, J'We, e'We, J'J, sum of squared distances, number of pixels."""

    matrix: FloatArray
    vector: FloatArray
    cost: float
    square: float
    n: int

    def step(self) -> FloatArray | None:
        """The Gauss-Newton step (k,); None where the pixels determine no surface."""
        scale = np.sqrt(np.diag(self.matrix))
        if self.n <= len(self.vector) or not (scale > 0).all():
            return None
        values, vectors = np.linalg.eigh(self.matrix / np.outer(scale, scale))
        if not values[-1] < _MAX_CONDITION * values[0]:
            return None
        return np.asarray(vectors @ ((self.vector / scale) @ vectors / values) / scale)

    def repeated(self, times: int) -> NormalEquations:
        """The sums of so many times as many pixels like these."""
        return NormalEquations(
            self.matrix * times, self.vector * times, self.cost * times, self.square * times, self.n * times
        )


def add_up(
    surfaces: Sequence[Surface | None], beams: Iterable[Beams], flatness_m: float
) -> list[NormalEquations]:
    """Return the normal equations of every surface, in one pass over each set of beams."""
    n = len(surfaces)
    matrix, vector, sums = np.zeros((n, 5, 5)), np.zeros((n, 5)), np.zeros((n, 3))
    charts: dict[Triple, FloatArray] = {}  # by where beams start
    for beam in beams:
        trim()
        origin = beam.rays.origin
        if origin not in charts:
            start = np.array(origin)
            charts[origin] = np.array([_chart(surface, start) for surface in surfaces]).reshape(n, 14)
        pixels, labels = np.ascontiguousarray(beam.pixel), np.ascontiguousarray(beam.label)
        beams_read = pixels, labels, charts[origin], beam.ranges, beam.rays, beam.noise
        _add_rays(*beams_read, flatness_m, _LEAST_SLOPE, matrix, vector, sums)
    matrix += np.tril(matrix, -1).transpose(0, 2, 1)
    size = [3 if isinstance(surface, Plane) else 5 for surface in surfaces]
    return [
        NormalEquations(
            matrix[i, :k, :k], vector[i, :k], float(sums[i, 0]), float(sums[i, 1]), int(sums[i, 2])
        )
        for i, k in enumerate(size)
    ]


def _chart(surface: Surface | None, origin: FloatArray) -> FloatArray:
    """Kind (0 plane, 1 cylinder, -1 none), sensor in the frame, frame by rows, radius with its sign."""
    if isinstance(surface, Plane):
        frame = np.stack([surface.u_direction, surface.v_direction, surface.normal_direction])
        return np.concatenate([[0.0], frame @ (origin - surface.point), frame.ravel(), [0.0]])
    if isinstance(surface, Cylinder):
        frame = axis_frame(surface.direction)
        signed = -surface.radius if surface.concave else surface.radius
        return np.concatenate([[1.0], frame @ (origin - surface.point), frame.ravel(), [signed]])
    return np.full(14, -1.0)


@compiled
def _add_rays(
    pixels: NDArray[np.int32],
    labels: NDArray[np.int32],
    charts: FloatArray,
    ranges: FloatArray,
    rays: Rays,
    noise: Noise,
    flat: float,
    least: float,
    matrix: FloatArray,
    vector: FloatArray,
    sums: FloatArray,
) -> None:
    """Add up, by label, the normal equations of the rays and their squares: weighted, plain, and how many.

    Neighbours mostly have one label: its sums are at hand along such a run.
    """
    last = 0
    while last < labels.size:
        first, label = last, labels[last] - 1
        while last < labels.size and labels[last] - 1 == label:
            last += 1
        if label < 0 or charts[label, 0] < 0.0:
            continue
        some, chart, own = pixels[first:last], charts[label], (matrix[label], vector[label], sums[label])
        if chart[0] == 0.0:
            _add_to_plane(some, chart, ranges, rays, noise, flat, own)
        else:
            _add_to_cylinder(some, chart, ranges, rays, noise, flat, least, own)


@inlined
def _add_to_plane(
    pixels: NDArray[np.int32],
    chart: FloatArray,
    ranges: FloatArray,
    rays: Rays,
    noise: Noise,
    flat: float,
    own: tuple[FloatArray, FloatArray, FloatArray],
) -> None:
    """Add the rays of some pixels to a plane's sums: offset, and the slopes along its two axes."""
    matrix, vector, sums = own
    cost, square, count = sums[0], sums[1], sums[2]
    v0, v1, v2 = vector[0], vector[1], vector[2]
    m00, m10, m11 = matrix[0, 0], matrix[1, 0], matrix[1, 1]
    m20, m21, m22 = matrix[2, 0], matrix[2, 1], matrix[2, 2]
    row, columns = -1, ranges.shape[1]
    for pixel in pixels:
        column = pixel - row * columns
        if not 0 <= column < columns:
            row, column = pixel // columns, pixel % columns
        dx, dy, dz = _turned(chart, ray_at(rays, row, column))
        if abs(dz) < _LEVEL:
            continue
        reach, measured = -chart[3] / dz, ranges[row, column]
        u, v = chart[1] + reach * dx, chart[2] + reach * dy
        error, sigma = measured - reach, deviation_at(noise, measured)
        weight = 1.0 / (sigma * sigma * dz * dz + flat * flat + 1e-30)
        gap = error * dz
        cost += weight * gap * gap
        square += gap * gap
        count += 1.0
        wu, wv = weight * u, weight * v
        v0 += weight * gap
        v1 += wu * gap
        v2 += wv * gap
        m00 += weight
        m10 += wu
        m11 += wu * u
        m20 += wv
        m21 += wv * u
        m22 += wv * v
    sums[0], sums[1], sums[2] = cost, square, count
    vector[0], vector[1], vector[2] = v0, v1, v2
    matrix[0, 0], matrix[1, 0], matrix[1, 1] = m00, m10, m11
    matrix[2, 0], matrix[2, 1], matrix[2, 2] = m20, m21, m22


@inlined
def _add_to_cylinder(
    pixels: NDArray[np.int32],
    chart: FloatArray,
    ranges: FloatArray,
    rays: Rays,
    noise: Noise,
    flat: float,
    least: float,
    own: tuple[FloatArray, FloatArray, FloatArray],
) -> None:
    """Add the rays of some pixels to a cylinder's sums: axis across, its slopes, and the radius."""
    (matrix, vector, sums), terms, columns = own, np.zeros(5), ranges.shape[1]
    ox, oy, oz, radius = chart[1], chart[2], chart[3], abs(chart[13])
    for pixel in pixels:
        row, column = pixel // columns, pixel % columns
        dx, dy, dz = _turned(chart, ray_at(rays, row, column))
        measured, across = ranges[row, column], dx * dx + dy * dy
        middle = -(ox * dx + oy * dy) / max(across, 1e-18)
        fx, fy = ox + middle * dx, oy + middle * dy
        depth = radius * radius - fx * fx - fy * fy
        if depth <= 0.0 or across < 1e-12:
            continue
        half = np.sqrt(depth / across)
        reach = middle - half if chart[13] > 0 else middle + half
        u, v, z = (ox + reach * dx) / radius, (oy + reach * dy) / radius, oz + reach * dz
        slope = u * dx + v * dy
        if abs(slope) < least:
            continue
        error, sigma = measured - reach, deviation_at(noise, measured)
        weight = 1.0 / (sigma * sigma * slope * slope + flat * flat + 1e-30)
        gap = error * slope
        sums[0] += weight * gap * gap
        sums[1] += gap * gap
        sums[2] += 1.0
        terms[0], terms[1], terms[2], terms[3], terms[4] = u, v, z * u, z * v, 1.0
        for a in range(5):
            weighted = weight * terms[a]
            vector[a] += weighted * gap
            for b in range(a + 1):
                matrix[a, b] += weighted * terms[b]


@inlined
def _turned(chart: FloatArray, ray: Triple) -> Triple:
    """A ray in the frame of a surface."""
    x, y, z = ray
    return (
        chart[4] * x + chart[5] * y + chart[6] * z,
        chart[7] * x + chart[8] * y + chart[9] * z,
        chart[10] * x + chart[11] * y + chart[12] * z,
    )
