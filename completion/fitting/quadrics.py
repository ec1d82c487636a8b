# SPDX-License-Identifier: MIT
"""Quadrics from the moments of any number of points, and the surfaces read from them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.linalg import eigh

from completion.fitting.degeneracy import check_spread, principal
from completion.fitting.kinds import KINDS
from completion.fitting.moments import MONOMIALS, Moments, moments
from completion.fitting.result import FitError, SurfaceFit
from scenes.checks import FloatArray
from scenes.surfaces.catalogue import Cone, Cylinder, EllipticCylinder, Sphere, Surface
from scenes.surfaces.surface import perpendicular

_N_SPREAD = 2_000  # points that show whether all lie on a line or in a plane


@dataclass(frozen=True, slots=True, eq=False)
class Quadric:
    """The quadric x'Qx + l'x + c = 0, x relative to `centre` in units of `scale`.

    `coefficients` (10,) multiply x2, y2, z2, xy, xz, yz, x, y, z, 1.
    """

    centre: FloatArray
    scale: float
    coefficients: FloatArray

    def form(self) -> FloatArray:
        """The symmetric matrix Q (3, 3)."""
        xx, yy, zz, xy, xz, yz = self.coefficients[:6]
        return np.array([[xx, xy / 2, xz / 2], [xy / 2, yy, yz / 2], [xz / 2, yz / 2, zz]])

    def centre_of_symmetry(self, rank: int) -> tuple[FloatArray, float]:
        """The point (3,) where the gradient vanishes across the `rank` strongest axes, its value there."""
        values, vectors = np.linalg.eigh(self.form())
        strong = np.argsort(-np.abs(values))[:rank]
        across = vectors[:, strong]
        point = -across @ ((across.T @ self.coefficients[6:9]) / (2 * values[strong]))
        value = point @ self.form() @ point + self.coefficients[6:9] @ point + self.coefficients[9]
        return np.asarray(point, dtype=np.float64), float(value)


def fit_quadric(points: Moments, metric: Literal["algebraic", "taubin"], *, sphere: bool = False) -> Quadric:
    """Fit a quadric to moments.

    Parameters
    ----------
    points : Moments
        Of any number of points, merged from any number of tiles.
    metric : {"algebraic", "taubin"}
        Algebraic: least p'Mp with |p| = 1. Taubin: least p'Mp / p'Np, N the mean over the gradients of the
        monomials (Taubin 1991); the constant, which has no gradient, is eliminated first.
    sphere : bool
        Hold the quadric to x2 + y2 + z2 and the linear terms.

    Raises
    ------
    FitError
        Moments of fewer points than coefficients, or of points in one spot.
    """
    basis = np.zeros((5, 10)) if sphere else np.eye(10)
    if sphere:
        basis[0, :3], basis[1:, 6:] = 1.0, np.eye(4)
    if points.n < len(basis) - 1:
        raise FitError(
            f"a quadric of {len(basis)} coefficients needs {len(basis) - 1} points, got {points.n}"
        )
    centre, scale = points.mean(), points.radius()
    if not scale > 0:
        raise FitError(f"{points.n} points lie in one spot, at {centre.tolist()}")
    gram = points.about(centre).scale(scale).gram() / points.n
    m = basis @ gram @ basis.T
    if metric == "algebraic":
        solution = np.linalg.eigh(m)[1][:, 0]
    else:
        n = (basis @ _gradient_gram(gram) @ basis.T)[:-1, :-1]
        reduced = m[:-1, :-1] - np.outer(m[:-1, -1], m[-1, :-1]) / m[-1, -1]
        floor = 1e-14 * np.trace(n) / len(n)  # points in a plane leave a gradient undetermined
        head = eigh(reduced, n + floor * np.eye(len(n)), subset_by_index=[0, 0])[1][:, 0]
        solution = np.append(head, -m[-1, :-1] @ head / m[-1, -1])
    coefficients = solution @ basis
    return Quadric(centre, scale, coefficients / np.linalg.norm(coefficients))


def _gradient_gram(gram: FloatArray) -> FloatArray:
    """Mean of the products of the monomials' gradients (10, 10), from moments up to order 2."""
    place = {exponents: index for index, exponents in enumerate(MONOMIALS)}
    total = np.zeros((10, 10))
    for axis in range(3):
        derivative = np.zeros((10, 10))
        for row, exponents in enumerate(MONOMIALS):
            if exponents[axis]:
                x, y, z = (e - (a == axis) for a, e in enumerate(exponents))
                derivative[row, place[x, y, z]] = exponents[axis]
        total += derivative @ gram @ derivative.T
    return total


def read_surface(quadric: Quadric, shape: str) -> Surface:
    """Read a surface from a quadric; raises FitError, with the eigenvalues, where a sign is wrong.

    An elliptic cylinder's axis is the eigenvector of the least eigenvalue in size; a circular cylinder takes
    the mean of its radii. A cone's axis is the eigenvector whose eigenvalue has the odd sign.
    """
    centre, scale = quadric.centre, quadric.scale
    values, vectors = np.linalg.eigh(quadric.form())
    if shape == "sphere":
        middle, level = quadric.centre_of_symmetry(3)
        radius2 = -level / values.mean()
        if not radius2 > 0:
            raise FitError(f"not a sphere: squared radius {radius2 * scale**2:.3g} m2")
        return Sphere(centre + scale * middle, scale * float(np.sqrt(radius2)))
    if shape == "cone":
        return _read_cone(quadric, values, vectors)
    along = int(np.argmin(np.abs(values)))
    axis, across = vectors[:, along], np.delete(np.arange(3), along)
    middle, level = quadric.centre_of_symmetry(2)
    squares = -level / values[across]
    if not (squares > 0).all():
        raise FitError(f"not an elliptic cylinder: squared radii {(squares * scale**2).tolist()} m2")
    radii = scale * np.sqrt(squares)
    if shape == "cylinder":
        return Cylinder(centre + scale * middle, axis, float(radii.mean()))
    order = np.argsort(-radii)
    zero = vectors[:, across[order[0]]]
    return EllipticCylinder(
        centre + scale * middle, axis, (float(radii[order[0]]), float(radii[order[1]])), zero
    )


def _read_cone(quadric: Quadric, values: FloatArray, vectors: FloatArray) -> Cone:
    if np.prod(np.sign(values)) == 0 or abs(float(np.sign(values).sum())) != 1:
        raise FitError(f"not a cone: eigenvalues {values.tolist()} have one sign")
    signs = np.sign(values)
    odd = int(np.flatnonzero(signs == -np.sign(signs.sum()))[0])
    axis = vectors[:, odd]
    half_angle = float(np.arctan(np.sqrt(-values[odd] / np.delete(values, odd).mean())))
    apex, _ = quadric.centre_of_symmetry(3)
    height = float(-apex @ axis)
    if height < 0:
        axis, height = -axis, -height
    point = quadric.centre + quadric.scale * (apex + height * axis)
    radius = quadric.scale * height * float(np.tan(half_angle))
    return Cone(point, axis, radius, half_angle, perpendicular(axis))


def fit_by_quadric(points: FloatArray, shape: str, metric: Literal["algebraic", "taubin"]) -> SurfaceFit:
    """Fit a shape to points (n, 3) in closed form, for comparison with the Euclidean fit; no covariance."""
    sample = points[:: max(1, len(points) // _N_SPREAD)]
    centre = sample.mean(axis=0)
    check_spread(len(points), principal(sample, centre)[0], centre, 2)
    surface = read_surface(fit_quadric(moments(points), metric, sphere=shape == "sphere"), shape)
    residual = surface.distance(points)
    k = KINDS[shape].n_parameters
    rms = float(np.sqrt(residual @ residual / max(len(points) - k, 1)))
    return SurfaceFit(surface, rms, np.full((k, k), np.nan), len(points), metric=metric)
