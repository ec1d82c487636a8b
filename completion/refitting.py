# SPDX-License-Identifier: MIT
"""Refitting: surfaces from all their pixels at once, errors along the rays, each weighted by its variance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from completion.beams import Beams
from completion.correlation import residual_correlation
from completion.fitting.chart import axis_frame
from completion.fitting.result import FitError, SurfaceFit
from completion.observation import Observation
from scenes.checks import FloatArray
from scenes.surfaces import Cylinder, Plane, Surface

_LEAST_SLOPE = 0.1  # |cosine| below which a cylinder's grazing ray says nothing
_MAX_CONDITION = 1e12
_THINNING = 3  # of the pixels that covariances are read from
_LARGEST = 1e4  # a cylinder whose radius exceeds its points' extent by this has run away


@dataclass(frozen=True, slots=True, eq=False)
class _Sums:
    """Normal equations of one surface: J'WJ, J'We, e'We, J'J, sum of squared distances, number of pixels."""

    matrix: FloatArray
    vector: FloatArray
    cost: float
    square: float
    n: int

    def step(self) -> FloatArray:
        """The Gauss-Newton step; raises FitError where the pixels determine nothing."""
        k = len(self.vector)
        scale = np.sqrt(np.diag(self.matrix))
        if self.n <= k or not (scale > 0).all():
            raise FitError(f"{self.n} pixels determine no surface with {k} parameters")
        scaled = self.matrix / np.outer(scale, scale)
        condition = float(np.linalg.cond(scaled))
        if not condition < _MAX_CONDITION:
            raise FitError(f"{self.n} pixels determine no surface: condition number {condition:.3g}")
        step: FloatArray = np.linalg.solve(scaled, self.vector / scale) / scale
        return step

    def repeated(self, times: int) -> _Sums:
        """The sums of so many times as many pixels like these."""
        return _Sums(
            self.matrix * times, self.vector * times, self.cost * times, self.square * times, self.n * times
        )

    def covariance(self) -> FloatArray:
        """Of the parameters, by the weighted residuals themselves."""
        k = len(self.vector)
        return np.asarray(self.cost / (self.n - k) * np.linalg.inv(self.matrix), dtype=np.float64)


def refit(
    surfaces: Sequence[Surface],
    observations: Sequence[Observation],
    labels: Sequence[NDArray[np.int32]],
    flatness_m: float,
    n_rounds: int = 1,
) -> list[SurfaceFit | None]:
    """Fit planes and cylinders to their pixels by Gauss-Newton on the errors along the rays.

    Orthogonal distances pull a cylinder's radius in, since the foot of a noisy point moves sideways; along
    the known ray the place that was meant stays put. Pixels are weighted by the inverse variance of the
    range and of the surface's own flatness, seen along the ray.

    Parameters
    ----------
    surfaces : sequence of Plane or Cylinder
        Where to begin, working frame.
    observations, labels
        The scans, and for each the surface of each pixel, from 1; 0 for none.
    flatness_m : float
        How far surfaces stray from their ideal form, metres.
    n_rounds : int
        Steps before the one whose covariance is returned.

    Returns
    -------
    list of SurfaceFit or None
        Covariances inflated by how much the residuals' means over blocks of pixels exceed independent ones;
        None where the pixels determine no such surface.
    """
    beams = [Beams.of(observation, label) for observation, label in zip(observations, labels, strict=True)]
    placed = improve(surfaces, beams, flatness_m, n_rounds)
    some = [beam.thinned(_THINNING) for beam in beams]
    sums = [found.repeated(_THINNING) for found in _accumulate(placed, some, flatness_m)]
    excess = residual_correlation(placed, observations, labels, flatness_m)
    return [
        None if surface is None or found.n <= len(found.vector) else _fit(surface, found, growth)
        for surface, found, growth in zip(placed, sums, excess, strict=True)
    ]


def improve(
    surfaces: Sequence[Surface], beams: Sequence[Beams], flatness_m: float, n_rounds: int = 1
) -> list[Surface | None]:
    """The surfaces after some Gauss-Newton steps, None where a step loses one."""
    placed: list[Surface | None] = list(surfaces)
    for _ in range(n_rounds):
        sums = _accumulate(placed, beams, flatness_m)
        placed = [_moved(surface, found) for surface, found in zip(placed, sums, strict=True)]
    return placed


def _fit(surface: Surface, sums: _Sums, inflation: float) -> SurfaceFit:
    rms = float(np.sqrt(sums.square / (sums.n - len(sums.vector))))
    return SurfaceFit(surface, rms, sums.covariance() * inflation, sums.n, inflation=float(inflation))


def _moved(surface: Surface | None, sums: _Sums) -> Surface | None:
    """The surface after a step, None where it is lost."""
    if surface is None:
        return None
    if not isinstance(surface, Plane | Cylinder):
        raise TypeError(f"cannot refit a {type(surface).__name__}")
    try:
        step = sums.step()
    except FitError:
        return None
    if isinstance(surface, Plane):
        offset, by_u, by_v = step
        normal = surface.normal_direction - by_u * surface.u_direction - by_v * _v_direction(surface)
        return Plane(surface.point + offset * surface.normal_direction, normal, surface.u_direction)
    radius = surface.radius + step[4]
    if not 0 < radius < _LARGEST * surface.radius:
        return None
    x, y, z = axis_frame(surface.direction)
    point = surface.point + step[0] * x + step[1] * y
    return Cylinder(point, z + step[2] * x + step[3] * y, radius, None, surface.concave)


def _accumulate(surfaces: Sequence[Surface | None], beams: Sequence[Beams], flatness_m: float) -> list[_Sums]:
    """Normal equations of every surface, in one pass over each set of beams."""
    n = len(surfaces)
    matrix, vector, sums = np.zeros((n, 5, 5)), np.zeros((n, 5)), np.zeros((n, 3))
    for beam in beams:
        charts = np.array([_chart(surface, beam.origin) for surface in surfaces]).reshape(n, 14)
        _add_rays(
            beam.label,
            charts,
            beam.ranges,
            beam.rays,
            beam.sigma,
            flatness_m,
            _LEAST_SLOPE,
            matrix,
            vector,
            sums,
        )
    matrix += np.tril(matrix, -1).transpose(0, 2, 1)
    size = [3 if isinstance(surface, Plane) else 5 for surface in surfaces]
    return [
        _Sums(matrix[i, :k, :k], vector[i, :k], float(sums[i, 0]), float(sums[i, 1]), int(sums[i, 2]))
        for i, k in enumerate(size)
    ]


def _v_direction(plane: Plane) -> FloatArray:
    """The plane's v direction; spelt out, since numpy's cross product takes ten times as long."""
    (a, b, c), (x, y, z) = plane.normal_direction.tolist(), plane.u_direction.tolist()
    return np.array([b * z - c * y, c * x - a * z, a * y - b * x])


def _chart(surface: Surface | None, origin: FloatArray) -> FloatArray:
    """Kind (0 plane, 1 cylinder, -1 none), origin from the sensor, frame by rows, radius with its sign."""
    if isinstance(surface, Plane):
        frame = np.stack([surface.u_direction, _v_direction(surface), surface.normal_direction])
        return np.concatenate([[0.0], surface.point - origin, frame.ravel(), [0.0]])
    if isinstance(surface, Cylinder):
        frame = axis_frame(surface.direction)
        signed = -surface.radius if surface.concave else surface.radius
        return np.concatenate([[1.0], surface.point - origin, frame.ravel(), [signed]])
    return np.full(14, -1.0)


@njit(cache=True, nogil=True, error_model="numpy")
def _add_rays(
    labels: NDArray[np.int32],
    charts: FloatArray,
    ranges: FloatArray,
    rays: FloatArray,
    sigma: FloatArray,
    flat: float,
    least: float,
    matrix: FloatArray,
    vector: FloatArray,
    sums: FloatArray,
) -> None:
    """Add up, by label, the normal equations of the rays and their squares: weighted, plain, and how many."""
    row = np.zeros(5)
    for i in range(labels.size):
        label = labels[i] - 1
        if label < 0:
            continue
        c = charts[label]
        if c[0] < 0.0:
            continue
        d = rays[i]
        dx = c[4] * d[0] + c[5] * d[1] + c[6] * d[2]
        dy = c[7] * d[0] + c[8] * d[1] + c[9] * d[2]
        dz = c[10] * d[0] + c[11] * d[1] + c[12] * d[2]
        ox = -(c[4] * c[1] + c[5] * c[2] + c[6] * c[3])
        oy = -(c[7] * c[1] + c[8] * c[2] + c[9] * c[3])
        oz = -(c[10] * c[1] + c[11] * c[2] + c[12] * c[3])
        if c[0] == 0.0:
            if abs(dz) < 1e-6:
                continue
            reach = -oz / dz
            slope = dz
            row[0], row[1], row[2] = 1.0, ox + reach * dx, oy + reach * dy
            k = 3
        else:
            radius = abs(c[13])
            across = dx * dx + dy * dy
            middle = -(ox * dx + oy * dy) / max(across, 1e-18)
            fx, fy = ox + middle * dx, oy + middle * dy
            depth = radius * radius - fx * fx - fy * fy
            if depth <= 0.0 or across < 1e-12:
                continue
            half = np.sqrt(depth / across)
            reach = middle - half if c[13] > 0 else middle + half
            x, y, z = ox + reach * dx, oy + reach * dy, oz + reach * dz
            ux, uy = x / radius, y / radius
            slope = ux * dx + uy * dy
            if abs(slope) < least:
                continue
            row[0], row[1], row[2], row[3], row[4] = ux, uy, z * ux, z * uy, 1.0
            k = 5
        error = ranges[i] - reach
        weight = 1.0 / (sigma[i] * sigma[i] * slope * slope + flat * flat + 1e-30)
        gap = error * slope
        sums[label, 0] += weight * gap * gap
        sums[label, 1] += gap * gap
        sums[label, 2] += 1.0
        for a in range(k):
            vector[label, a] += weight * row[a] * gap
            for b in range(a + 1):
                matrix[label, a, b] += weight * row[a] * row[b]
