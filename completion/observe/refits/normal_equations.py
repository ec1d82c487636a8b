# SPDX-License-Identifier: MIT
"""Normal equations of planes and cylinders: errors along the rays, each weighted by its variance."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from completion.fitting.charts.chart import axis_frame
from completion.observe.observation import Beams
from completion.observe.rays import Noise, Rays, deviation_at, ray_at
from completion.observe.triple import Triple
from scenes.checks import FloatArray
from scenes.run.mapping import trim
from scenes.surfaces.catalogue import Cylinder, Plane, Surface
from texture.engine.compiled import compiled

_LEAST_SLOPE = 0.1  # |cosine| below which a cylinder's grazing ray says nothing
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
        some = beam.pixel, beam.label, charts[origin], beam.ranges, beam.rays, beam.noise
        _add_rays(*some, flatness_m, _LEAST_SLOPE, matrix, vector, sums)
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
    """Add up, by label, the normal equations of the rays and their squares: weighted, plain, and how many."""
    terms = np.zeros(5)
    for i in range(labels.size):
        label = labels[i] - 1
        if label < 0 or charts[label, 0] < 0.0:
            continue
        row, column = pixels[i] // ranges.shape[1], pixels[i] % ranges.shape[1]
        measured = ranges[row, column]
        ex, ey, ez = ray_at(rays, row, column)
        dx = charts[label, 4] * ex + charts[label, 5] * ey + charts[label, 6] * ez
        dy = charts[label, 7] * ex + charts[label, 8] * ey + charts[label, 9] * ez
        dz = charts[label, 10] * ex + charts[label, 11] * ey + charts[label, 12] * ez
        ox, oy, oz = charts[label, 1], charts[label, 2], charts[label, 3]
        if charts[label, 0] == 0.0:
            if abs(dz) < 1e-6:
                continue
            reach = -oz / dz
            slope = dz
            u, v = ox + reach * dx, oy + reach * dy
        else:
            radius = abs(charts[label, 13])
            across = dx * dx + dy * dy
            middle = -(ox * dx + oy * dy) / max(across, 1e-18)
            fx, fy = ox + middle * dx, oy + middle * dy
            depth = radius * radius - fx * fx - fy * fy
            if depth <= 0.0 or across < 1e-12:
                continue
            half = np.sqrt(depth / across)
            reach = middle - half if charts[label, 13] > 0 else middle + half
            u, v, z = (ox + reach * dx) / radius, (oy + reach * dy) / radius, oz + reach * dz
            slope = u * dx + v * dy
            if abs(slope) < least:
                continue
        error, sigma = measured - reach, deviation_at(noise, measured)
        weight = 1.0 / (sigma * sigma * slope * slope + flat * flat + 1e-30)
        gap = error * slope
        sums[label, 0] += weight * gap * gap
        sums[label, 1] += gap * gap
        sums[label, 2] += 1.0
        if charts[label, 0] == 0.0:
            wu, wv = weight * u, weight * v
            vector[label, 0] += weight * gap
            vector[label, 1] += wu * gap
            vector[label, 2] += wv * gap
            matrix[label, 0, 0] += weight
            matrix[label, 1, 0] += wu
            matrix[label, 1, 1] += wu * u
            matrix[label, 2, 0] += wv
            matrix[label, 2, 1] += wv * u
            matrix[label, 2, 2] += wv * v
            continue
        terms[0], terms[1], terms[2], terms[3], terms[4] = u, v, z * u, z * v, 1.0
        for a in range(5):
            weighted = weight * terms[a]
            vector[label, a] += weighted * gap
            for b in range(a + 1):
                matrix[label, a, b] += weighted * terms[b]
