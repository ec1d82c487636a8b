# SPDX-License-Identifier: MIT
"""Quadrics from the 35 sums of monomials that stand for any points, and the surfaces read from them."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from math import comb
from typing import Literal

import numpy as np
from scipy.linalg import eigh

from completion.fitting.degeneracy import centroid, check_spread, principal
from completion.fitting.kinds import KINDS
from completion.fitting.result import FitError, SurfaceFit
from scenes.checks import FloatArray, check_point, check_points, check_vectors
from scenes.surfaces.catalogue import Cone, Cylinder, EllipticCylinder, Sphere, Surface
from scenes.surfaces.surface import perpendicular

_SQUARES = ((2, 0, 0), (0, 2, 0), (0, 0, 2), (1, 1, 0), (1, 0, 1), (0, 1, 1))
MONOMIALS = (*_SQUARES, (1, 0, 0), (0, 1, 0), (0, 0, 1), (0, 0, 0))
"""Exponents of x2, y2, z2, xy, xz, yz, x, y, z, 1: the order of a quadric's ten coefficients."""

EXPONENTS = tuple(sorted((e for e in product(range(5), repeat=3) if sum(e) <= 4), key=lambda e: (sum(e), e)))
_PLACE = {exponents: place for place, exponents in enumerate(EXPONENTS)}
_LINEAR = [_PLACE[exponents] for exponents in MONOMIALS[6:9]]
_PAIRS = np.array([[_PLACE[tuple(np.add(a, b))] for b in MONOMIALS] for a in MONOMIALS])
_CHUNK = 8192
_N_SPREAD = 2_000  # points that show whether all lie on a line or in a plane


@dataclass(frozen=True, slots=True, eq=False)
class Moments:
    """Sums over points of x^i y^j z^k, i + j + k <= 4, about `centre`.

    Attributes
    ----------
    centre : (3,) float
        What coordinates are relative to, metres.
    sums : (35,) float
        In the order of `EXPONENTS`, in powers of metres; the first is the number of points.

    Examples
    --------
    >>> left, right = np.eye(3), -np.eye(3)
    >>> both = moments(left).merged(moments(right))
    >>> both.n, both.mean().round(12).tolist()
    (6, [0.0, 0.0, 0.0])
    """

    centre: FloatArray
    sums: FloatArray

    @property
    def n(self) -> int:
        """Number of points."""
        return round(float(self.sums[0]))

    def mean(self) -> FloatArray:
        """The centroid (3,), metres."""
        return np.asarray(self.centre + self.sums[_LINEAR] / self.sums[0], dtype=np.float64)

    def gram(self) -> FloatArray:
        """Sums of m m' (10, 10), m the ten monomials of a quadric."""
        return np.asarray(self.sums[_PAIRS], dtype=np.float64)

    def about(self, centre: object) -> Moments:
        """The same moments about another centre, by the binomial theorem."""
        target = check_point("centre", centre)
        shift = self.centre - target
        powers = shift[:, None] ** np.arange(5)[None, :]
        sums = np.zeros(len(EXPONENTS))
        for place, (i, j, k) in enumerate(EXPONENTS):
            for a, b, c in product(range(i + 1), range(j + 1), range(k + 1)):
                factor = comb(i, a) * comb(j, b) * comb(k, c)
                weight = powers[0, i - a] * powers[1, j - b] * powers[2, k - c]
                sums[place] += factor * weight * self.sums[_PLACE[a, b, c]]
        return Moments(target, sums)

    def scaled(self, scale: float) -> Moments:
        """The moments of the points divided by `scale`; the centre is the origin then."""
        order = np.array([sum(exponents) for exponents in EXPONENTS])
        return Moments(np.zeros(3), self.sums / float(scale) ** order)

    def merged(self, other: Moments) -> Moments:
        """The moments of both sets of points, about the centroid of this one."""
        here = self.about(self.mean())
        return Moments(here.centre, here.sums + other.about(here.centre).sums)

    def radius(self) -> float:
        """Root mean square distance from the centroid, metres."""
        own = self.about(self.mean())
        return float(np.sqrt(sum(own.sums[_PLACE[e]] for e in MONOMIALS[:3]) / own.sums[0]))


def moments(points: object, centre: object | None = None) -> Moments:
    """Sum the monomials of `points` (n, 3) in one pass; about their centroid unless `centre` is given."""
    cloud = check_vectors("points", points)
    mean = centroid(cloud)
    if not np.isfinite(mean).all():
        cloud = check_points("points", cloud)  # says which are not finite
    about = mean if centre is None else check_point("centre", centre)
    gram, buffer = np.zeros((10, 10)), np.ones((10, min(_CHUNK, len(cloud))))
    for first in range(0, len(cloud), _CHUNK):
        chunk = cloud[first : first + _CHUNK]
        rows = buffer[:, : len(chunk)]
        np.subtract(chunk.T, about[:, None], out=rows[6:9])
        x, y, z = rows[6:9]
        np.multiply(rows[6:9], rows[6:9], out=rows[:3])
        np.multiply(x, rows[7:9], out=rows[3:5])
        np.multiply(y, z, out=rows[5])
        gram += rows @ rows.T
    sums = np.zeros(len(EXPONENTS))
    sums[_PAIRS.ravel()] = gram.ravel()
    return Moments(about, sums)


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
    gram = points.about(centre).scaled(scale).gram() / points.n
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
    axis, rest = vectors[:, along], np.delete(np.arange(3), along)
    middle, level = quadric.centre_of_symmetry(2)
    squares = -level / values[rest]
    if not (squares > 0).all():
        raise FitError(f"not an elliptic cylinder: squared radii {(squares * scale**2).tolist()} m2")
    radii = scale * np.sqrt(squares)
    if shape == "cylinder":
        return Cylinder(centre + scale * middle, axis, float(radii.mean()))
    order = np.argsort(-radii)
    zero = vectors[:, rest[order[0]]]
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
