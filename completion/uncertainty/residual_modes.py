# SPDX-License-Identifier: MIT
"""Residual modes: how far a scan's surfaces are bent, by the smoothest shapes that their fits leave over.

A fit takes on the smoothest part of an error that is alike over a surface, its offset and tilt, and no
residual shows it. The next smooth shapes, of second order over the surface, show how large such errors are.
Let Q be the fit's columns and then those of second order, whitened and orthonormal. The components z = Q'r of
the residuals beyond the fit have the variance s2 where errors are independent, and s2 + n tau2 where a smooth
field of mean square tau2 lies over the n pixels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from completion.fitting.charts.chart import axis_frame
from completion.fitting.result import SurfaceFit
from completion.observe.observation import Observation
from scenes.checks import FloatArray, IntArray
from scenes.run.mapping import trim
from scenes.surfaces.catalogue import Cylinder, Plane, Surface

N_SHAPES = 3  # of second order over a surface
_CHUNK = 1 << 17  # pixels at a time
_LEAST_COSINE = 0.05  # of incidence, below which a beam tells nothing of a surface
_N_SAMPLE = 4_000  # pixels that tell where a surface was measured
_SINGULAR = 1e-10  # of a column's own mean square


@dataclass(frozen=True, slots=True, eq=False)
class ResidualModes:
    """What the residuals of a surface in one scan say of smooth errors.

    Attributes
    ----------
    beyond : (3,) float
        Components of the whitened residuals along the smooth shapes beyond the fit.
    square : float
        Mean square of the whitened residuals, s2.
    n : int
        How many pixels.
    information : (k, k) float
        Of the fit's parameters, by these pixels as if their errors were independent.
    """

    beyond: FloatArray
    square: float
    n: int
    information: FloatArray

    @property
    def bend(self) -> float:
        """The mean square of its smooth error, whitened, as these components tell it; may be negative."""
        return float(np.mean(np.square(self.beyond)) - self.square) / self.n


def find_modes(
    fit: SurfaceFit, seen: Observation, pixels: IntArray, flatness_m: float
) -> ResidualModes | None:
    """Return the residual modes of a plane or cylinder in one scan, from all its flat pixels (n,) there.

    A sample of them would not do: what is left of the noise in a component falls with their number. None
    where the pixels do not tell the shapes apart.
    """
    surface, size = fit.surface, len(fit.covariance)
    sample = seen.points_at(pixels[:: max(1, len(pixels) // _N_SAMPLE)])
    places = _places(surface, sample)
    centre, width = places.mean(axis=0), np.maximum(places.std(axis=0), 1e-9)
    moments, total = np.zeros((size + N_SHAPES + 1,) * 2), 0
    for first in range(0, len(pixels), _CHUNK):
        own = pixels[first : first + _CHUNK]
        points = seen.points_at(own)
        cosine = np.abs(np.einsum("ij,ij->i", surface.normal(points), seen.rays_at(own)))
        kept = cosine > _LEAST_COSINE
        own, points = own[kept], points[kept]
        sigma = np.sqrt(np.square(seen.sigma_at(own) * cosine[kept]) + flatness_m**2 + 1e-30)
        shapes = _second_order(surface, points, centre, width)
        columns = np.column_stack([fit.gradient(points), shapes, surface.distance(points)]) / sigma[:, None]
        moments += columns.T @ columns
        total += len(own)
        trim()
    return _modes_of(moments, total, size)


def _modes_of(moments: FloatArray, n: int, size: int) -> ResidualModes | None:
    """From the sums of products of the fit's columns, those beyond and the residual, in this order."""
    diagonal = np.diag(moments)
    freedom = n - size - N_SHAPES
    if freedom < 1 or not (diagonal[:-1] > 0).all():
        return None
    scale = np.sqrt(diagonal[:-1])
    unit = moments[:-1, :-1] / np.outer(scale, scale)
    if np.linalg.eigvalsh(unit)[0] < _SINGULAR:
        return None
    along = solve_triangular(cholesky(unit, lower=True), moments[:-1, -1] / scale, lower=True)
    square = max(float(diagonal[-1] - along @ along), 0.0) / freedom
    return ResidualModes(np.asarray(along[size:]), square, n, moments[:size, :size])


def _second_order(surface: Surface, points: FloatArray, centre: FloatArray, width: FloatArray) -> FloatArray:
    """The shapes (n, 3) at points (n, 3): u2, uv, v2 of a plane; cos 2t, sin 2t, h2 of a cylinder."""
    places = (_places(surface, points) - centre) / width
    if isinstance(surface, Plane):
        u, v = places.T
        return np.column_stack([u * u, u * v, v * v])
    assert isinstance(surface, Cylinder)
    x, y = axis_frame(surface.direction)[:2] @ (points - surface.point).T
    twice = 2 * np.arctan2(y, x)
    return np.column_stack([np.cos(twice), np.sin(twice), places[:, 0] ** 2])


def _places(surface: Surface, points: FloatArray) -> FloatArray:
    """Where points are on a plane (n, 2), or along an axis (n, 1), metres."""
    if isinstance(surface, Plane):
        across = np.stack([surface.u_direction, surface.v_direction])
        return np.asarray((points - surface.point) @ across.T)
    if isinstance(surface, Cylinder):
        return np.asarray(((points - surface.point) @ surface.direction)[:, None])
    raise TypeError(f"no smooth shapes are known over a {type(surface).__name__}")


def pooled_bend(modes: Sequence[ResidualModes]) -> float:
    """Return the mean square of a scan's smooth errors, whitened, from those of its surfaces; at least 0.

    A surface that is bent by itself, or is none, says little of the scan: none counts for more than three
    times the mean (Huber's proposal, the mean of such as are chi-square kept).
    """
    if not modes:
        return 0.0
    bends = np.array([one.bend for one in modes])
    mean = max(float(bends.mean()), 0.0)
    for _ in range(_N_ROUNDS):
        mean = max(_KEPT * float(np.minimum(bends, _MOST * mean).mean()), 0.0)
    return mean


_MOST = 3.0  # times the mean
_KEPT = 1.022  # the mean of a chi-square of three freedoms over that of one cut off at three times its mean
_N_ROUNDS = 20
