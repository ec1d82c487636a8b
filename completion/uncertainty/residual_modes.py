# SPDX-License-Identifier: MIT
"""Residual modes: what a surface's residuals in one scan say of errors as long as the surface.

A fit takes on the smoothest part of an error that is alike over a surface, its offset and tilt, and no
residual shows it. The next smooth shapes, of second and third order over the surface, show how large such
errors are. Let Q be the fit's columns and then those shapes, whitened and orthonormal over the n pixels. The
components z = Q'r of the residuals beyond the fit have the variance s2 where errors are independent.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from completion.fitting.chart import axis_frame
from completion.fitting.result import SurfaceFit
from completion.observe.observation import Observation
from scenes.checks import FloatArray, IntArray
from scenes.run.mapping import trim
from scenes.surfaces.catalogue import Cylinder, Plane, Surface

N_SHAPES = 7  # of second and third order over a surface
_CHUNK = 1 << 17  # pixels at a time
_LEAST_COSINE = 0.05  # of incidence, below which a beam tells nothing of a surface
_N_FRAME = 4_000  # pixels that tell where a surface was measured
_N_SAMPLE = 400  # pixels over which smooth fields are integrated
_SINGULAR = 1e-10  # of a column's own mean square


@dataclass(frozen=True, slots=True, eq=False)
class ResidualModes:
    """What the residuals of a surface in one scan say, and a sample of its pixels.

    Attributes
    ----------
    beyond : (7,) float
        Components of the whitened residuals along the smooth shapes beyond the fit.
    square : float
        Mean square of the whitened residuals, s2.
    n : int
        How many pixels.
    factor : (k, k) float
        R with R R' the information of the fit's parameters, errors taken as independent.
    shapes : (m, k + 7) float
        Q at a sample of m pixels.
    places : (m, 2) float
        Those pixels in the image, x to the right and y down from its middle, in half longer sides.
    gain : (m,) float
        What an error along the ray of the range's own deviation makes of the whitened residual there.
    """

    beyond: FloatArray
    square: float
    n: int
    factor: FloatArray
    shapes: FloatArray
    places: FloatArray
    gain: FloatArray

    @property
    def information(self) -> FloatArray:
        """Of the fit's parameters (k, k), by these pixels as if their errors were independent."""
        return np.asarray(self.factor @ self.factor.T)

    def taken_on(self, fields: FloatArray) -> FloatArray:
        """Components (k + 7, f) along Q of errors along the rays, (m, f), in deviations of the range."""
        return np.asarray(self.shapes.T @ (fields * self.gain[:, None]) * (self.n / len(self.gain)))


def find_modes(
    fit: SurfaceFit, seen: Observation, pixels: IntArray, flatness_m: float
) -> ResidualModes | None:
    """Return the residual modes of a plane or cylinder in one scan, from all its flat pixels (n,) there.

    A sample of them would not do: what is left of the noise in a component falls with their number. None
    where the pixels do not tell the shapes apart.
    """
    size = len(fit.covariance)
    sample = seen.points_at(pixels[:: max(1, len(pixels) // _N_FRAME)])
    frame = _Whitened(fit, seen, flatness_m, *_frame_of(_places(fit.surface, sample)))
    moments, n = np.zeros((size + N_SHAPES + 1,) * 2), 0
    for first in range(0, len(pixels), _CHUNK):
        columns, _, _ = frame.columns(pixels[first : first + _CHUNK])
        moments += columns.T @ columns
        n += len(columns)
        trim()
    diagonal = np.diag(moments)
    freedom = n - size - N_SHAPES
    if freedom < 1 or not (diagonal[:-1] > 0).all():
        return None
    scale = np.sqrt(diagonal[:-1])
    unit = moments[:-1, :-1] / np.outer(scale, scale)
    if np.linalg.eigvalsh(unit)[0] < _SINGULAR:
        return None
    lower = cholesky(unit, lower=True)
    along = solve_triangular(lower, moments[:-1, -1] / scale, lower=True)
    some, kept, gain = frame.columns(pixels[:: max(1, len(pixels) // _N_SAMPLE)])
    return ResidualModes(
        beyond=np.asarray(along[size:]),
        square=max(float(diagonal[-1] - along @ along), 0.0) / freedom,
        n=n,
        factor=(lower * scale[:, None])[:size, :size],
        shapes=np.asarray(solve_triangular(lower, (some[:, :-1] / scale).T, lower=True).T),
        places=_in_image(kept, seen.scan.shape),
        gain=gain,
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Whitened:
    """The columns of a surface's fit, of the shapes beyond, and its residuals, in deviations."""

    fit: SurfaceFit
    seen: Observation
    flatness_m: float
    centre: FloatArray
    width: FloatArray

    def columns(self, pixels: IntArray) -> tuple[FloatArray, IntArray, FloatArray]:
        """The columns (n, k + 8) at flat pixels, without those that graze; which are left, and their gain."""
        surface, points = self.fit.surface, self.seen.points_at(pixels)
        cosine = np.abs(np.einsum("ij,ij->i", surface.normal(points), self.seen.rays_at(pixels)))
        kept = cosine > _LEAST_COSINE
        pixels, points = pixels[kept], points[kept]
        along = self.seen.sigma_at(pixels) * cosine[kept]
        sigma = np.sqrt(np.square(along) + self.flatness_m**2 + 1e-30)
        shapes = _shapes(surface, points, self.centre, self.width)
        columns = np.column_stack([self.fit.gradient(points), shapes, surface.distance(points)])
        return columns / sigma[:, None], pixels, along / sigma


def _frame_of(places: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The middle (d,) of places (n, d), and how wide they are spread."""
    return places.mean(axis=0), np.maximum(places.std(axis=0), 1e-9)


def _shapes(surface: Surface, points: FloatArray, centre: FloatArray, width: FloatArray) -> FloatArray:
    """Shapes of second and third order (n, 7): of a plane's u, v, or of a cylinder's angle and height."""
    places = (_places(surface, points) - centre) / width
    if isinstance(surface, Plane):
        u, v = np.ascontiguousarray(places.T)
        uu, uv, vv = u * u, u * v, v * v  # a power takes five times as long
        return np.column_stack([uu, uv, vv, uu * u, uu * v, u * vv, vv * v])
    if not isinstance(surface, Cylinder):
        raise _without_shapes(surface)
    x, y = axis_frame(surface.direction)[:2] @ (points - surface.point).T
    turn, h = np.arctan2(y, x), places[:, 0]
    two, three = (np.stack([np.cos(n * turn), np.sin(n * turn)]) for n in (2, 3))
    return np.column_stack([*two, h * h, *three, *(h * two)])


def _places(surface: Surface, points: FloatArray) -> FloatArray:
    """Where points are on a plane (n, 2), or along an axis (n, 1), metres."""
    if isinstance(surface, Plane):
        across = np.stack([surface.u_direction, surface.v_direction])
        return np.asarray((points - surface.point) @ across.T)
    if isinstance(surface, Cylinder):
        return np.asarray(((points - surface.point) @ surface.direction)[:, None])
    raise _without_shapes(surface)


def _without_shapes(surface: Surface) -> TypeError:
    return TypeError(f"no smooth shapes are known over a {type(surface).__name__}")


def _in_image(pixels: IntArray, shape: tuple[int, int]) -> FloatArray:
    """Places (n, 2) of flat pixels, from the middle of the image, in half longer sides."""
    row, column = np.divmod(pixels, shape[1])
    return np.column_stack([column - shape[1] / 2, row - shape[0] / 2]) / (max(shape) / 2)
