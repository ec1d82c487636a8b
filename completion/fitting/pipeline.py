# SPDX-License-Identifier: MIT
"""Fitting: a surface through points by one of three metrics, robustly or along rays, with uncertainty.

Orthogonal distances are the right errors for noise that is alike in all directions; quadrics, from the
moments of any number of points, are closed forms for comparison. A scanner's noise lies along its ray; where
rays meet the surface obliquely the orthogonal fit then takes too small a radius, since the foot of a point
moves sideways with its error. Along the known ray the place that was meant stays put.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.linalg import eigh

from completion.fitting.chart import Chart
from completion.fitting.degeneracy import (
    check_bend,
    check_enough,
    check_sample,
    check_spread,
    principal,
    undetermined_by,
)
from completion.fitting.euclidean import Normal, ScaledCloud, fit_euclidean, normalise
from completion.fitting.given_geometry import GivenGeometry, HeldChart, given_of_shape
from completion.fitting.kinds import KINDS, chart_of
from completion.fitting.limits import LEAST_SLOPE, STILL, TUKEY
from completion.fitting.moments import MONOMIALS, Moments, moments
from completion.fitting.result import FitError, SurfaceFit
from completion.fitting.robust import fit_robust, scale_within, tukey_variance, tukey_weights
from completion.fitting.selection import select
from completion.fitting.shape import Metric, Shape
from scenes.checks import BoolArray, FloatArray, InputError, check_points, check_vectors
from scenes.surfaces.catalogue import Cone, Cylinder, EllipticCylinder, Sphere, Surface
from scenes.surfaces.surface import perpendicular


def fit(
    points: object,
    shape: Shape,
    *,
    metric: Metric = "euclidean",
    robust: bool = False,
    start: Surface | None = None,
    rays: object | None = None,
    radius: float | None = None,
    axis: object | None = None,
) -> SurfaceFit:
    """Fit a surface to points.

    Parameters
    ----------
    points : (n, 3) float
        Metres; anywhere: they are centred first.
    shape : {"auto", "plane", "sphere", "cylinder", "elliptic-cylinder", "cone", "torus"}
        What to fit; "auto" lets the evidence decide, and raises where it does not.
    metric : {"euclidean", "taubin", "algebraic"}
        Orthogonal distances (the least-squares fit), or the closed forms, kept for comparison.
    robust : bool
        Find consensus first and weigh outliers down (Euclidean only).
    start : Surface, optional
        Where to begin; none is needed.
    rays : (n, 3) float, optional
        The beam that each point lies on, of any length, where the noise is a scanner's range noise: errors
        are then measured along the rays, and rays that graze or miss are left out (Euclidean only).
    radius : float, optional
        Given and held exactly, metres: of a sphere, a cylinder, or the circle in a torus' tube.
    axis : (3,) float, optional
        A direction, of any length, given and held exactly: of the axis, or a plane's normal.

    Raises
    ------
    FitError
        The points determine no such surface, or a plane explains them as well; the message says why in
        numbers.
    InputError
        Arrays of wrong shape, unknown names, options that exclude each other.

    Examples
    --------
    >>> around = np.linspace(0, 2, 200)
    >>> post = np.column_stack([0.3 * np.cos(around), 0.3 * np.sin(around), np.sin(9 * around)])
    >>> round(fit(post, "cylinder").surface.radius, 9)
    0.3
    """
    _check_options(shape, metric, robust, rays)
    held = given_of_shape(shape, radius, axis)
    if held is not None and metric != "euclidean":
        raise InputError(f"given values are held by Euclidean fits alone; drop them or metric={metric!r}")
    cloud = _check_points(points)
    check_enough(len(cloud), "plane" if shape == "auto" else shape)
    check_sample(cloud, shape)
    along = None if rays is None else _unit_rays(rays, len(cloud))
    selection = select(cloud, robust=robust) if shape == "auto" else None
    kind = shape if selection is None else selection.decide()
    if metric != "euclidean" and not KINDS[kind].is_quadric:
        raise FitError(
            f"{KINDS[kind].title} is no quadric: {metric!r} cannot fit it; use the euclidean metric"
        )
    if metric != "euclidean" and kind != "plane":  # a plane's three metrics are one
        return fit_by_quadric(cloud, kind, metric)
    if selection is not None:
        result = selection.fits[kind]
    else:
        result = (
            fit_robust(cloud, kind, start, held) if robust else fit_euclidean(cloud, kind, start, held=held)
        )
    check_bend(result, cloud)
    return result if along is None else fit_along_rays(result, cloud, along, held)


def _check_options(shape: str, metric: str, robust: bool, rays: object | None) -> None:
    if shape != "auto" and shape not in KINDS:
        raise InputError(f"shape must be auto or one of {', '.join(KINDS)}, got {shape!r}")
    if metric not in ("euclidean", "taubin", "algebraic"):
        raise InputError(f"metric must be euclidean, taubin or algebraic, got {metric!r}")
    if metric != "euclidean" and (robust or rays is not None):
        raise InputError(
            f"robust fits and errors along rays are Euclidean; drop those options or metric={metric!r}"
        )


def _check_points(points: object) -> FloatArray:
    """The points as finite (n, 3); raises FitError, with how many, where they are not finite."""
    cloud = check_vectors("points", points)
    with np.errstate(all="ignore"):
        total = float(cloud.sum())
    if not np.isfinite(total):
        try:
            return check_points("points", cloud)
        except InputError as error:
            raise FitError(str(error)) from error
    return cloud


def _unit_rays(rays: object, n: int) -> FloatArray:
    """The rays (n, 3) at unit length."""
    along = check_points("rays", rays)
    if len(along) != n:
        raise InputError(f"{len(along)} rays for {n} points; give one a point")
    length = np.linalg.norm(along, axis=1, keepdims=True)
    if not length.all():
        raise InputError(f"{int((length == 0).sum())} of {n} rays have no length; is a point at the scanner?")
    return np.asarray(along / length)


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


_N_STEPS = 50
_N_NEWTON = 25
_N_CHOOSING = 4  # steps after which the choice of rays stands, so that the steps can converge
_N_WEIGHING = 12  # the same for a robust fit, whose weights and scale must settle too


@dataclass(frozen=True, slots=True, eq=False)
class _Crossings:
    """Where rays meet a surface."""

    reach: FloatArray  # (n,) from each point along its ray to the surface, metres
    slope: FloatArray  # (n,) cosine between ray and normal there
    met: BoolArray  # (n,) which rays meet the surface

    def steeper(self, least: float) -> BoolArray:
        """Which rays meet the surface with a cosine of at least this."""
        return self.met & (np.abs(self.slope) > least)


def fit_along_rays(
    fit: SurfaceFit, points: FloatArray, rays: FloatArray, held: GivenGeometry | None = None
) -> SurfaceFit:
    """Refit by Gauss-Newton on the errors along the rays, from an orthogonal fit.

    The residual of a point (n, 3), metres, is its range beyond the place where its unit ray (n, 3) meets the
    surface; with J the chart's gradient there and n the normal, it changes by J / (n . ray). Rays that miss,
    or graze by less than 6 degrees, are left out. From a robust fit the refit is robust, by Tukey's weights
    on the new residuals. What is `held` stays as the fit has it.

    Raises
    ------
    FitError
        Too few rays meet the surface, or no convergence.
    """
    cloud, is_robust = normalise(points), fit.inliers is not None
    what = f"{undetermined_by(len(points), fit.surface.kind)} along rays"
    chart: Chart = chart_of(fit.surface, cloud.centre, cloud.scale)
    if held is not None:
        chart = held.chart(fit.surface, cloud.centre, cloud.scale)
    weights: FloatArray = np.ones(len(points))
    if fit.inliers is not None:
        weights = fit.inliers.astype(np.float64)
    sigma = fit.rms
    reach = np.zeros(len(points))
    for step in range(_N_STEPS):
        crossings = _crossings(chart, cloud, rays, reach)
        reach = np.where(crossings.met, crossings.reach, 0.0)
        if is_robust and step < _N_WEIGHING:
            weights, sigma = _weigh_rays(crossings, weights, sigma)
        elif not is_robust and step < _N_CHOOSING:
            weights = crossings.steeper(LEAST_SLOPE).astype(np.float64)
        used = crossings.steeper(LEAST_SLOPE / 2) & (weights > 0)  # a ray at the brink does not flicker
        if int(used.sum()) <= chart.n_parameters:
            raise FitError(f"{what}: only {int(used.sum())} of {len(rays)} rays meet it")
        rows = _gradient(chart, cloud, rays, crossings)[:, used]
        error, weight = -crossings.reach[used], weights[used]
        weighted, cost = rows * weight, float(weight @ error**2)
        normal = Normal(weighted @ rows.T, weighted @ error / cloud.scale, cost, chart.basis())
        change = normal.solve(0.0, what)
        moved = chart.move(change)
        if moved is None:
            break
        chart = moved
        if float(np.abs(change).max()) < STILL:
            k = chart.n_parameters
            variance = (
                tukey_variance(error, sigma, k) if is_robust else float(error @ error) / (len(error) - k)
            )
            inverse = Normal(rows @ rows.T, normal.gradient, cost, normal.basis).inverse()
            result = _result(fit, chart, cloud=cloud, covariance=variance * inverse, error=error, used=used)
            return result if held is None else held.mark(result)
    raise FitError(f"no convergence along the rays: {what}")


def _weigh_rays(crossings: _Crossings, weights: FloatArray, sigma: float) -> tuple[FloatArray, float]:
    """Tukey's weights of the rays, zero for those that miss, and the scale of the errors along them."""
    error = np.abs(crossings.reach)
    sigma = scale_within(error[crossings.met & (weights > 0)], sigma)
    return tukey_weights(error, TUKEY * sigma) * crossings.steeper(LEAST_SLOPE), sigma


def _gradient(chart: Chart, cloud: ScaledCloud, rays: FloatArray, crossings: _Crossings) -> FloatArray:
    """Derivatives (k, n) of the errors along the rays by the chart's basis, lengths in its scale."""
    feet = cloud.points + crossings.reach[:, None] * rays
    local = chart.frame @ ((feet - cloud.centre) / cloud.scale - chart.origin).T
    slope = np.where(crossings.met, crossings.slope, 1.0)
    return np.asarray(chart.basis().T @ chart.linearise(local)[1] / slope)


def _crossings(chart: Chart, cloud: ScaledCloud, rays: FloatArray, begin: FloatArray) -> _Crossings:
    """Newton steps along the rays to the chart's surface, from so far beyond the points (n,), metres."""
    surface, scale = chart.surface(cloud.centre, cloud.scale, False), cloud.scale
    reach, slope, height = begin.copy(), np.zeros(len(rays)), np.zeros(len(rays))
    left = np.arange(len(rays))
    for _ in range(_N_NEWTON):
        place, ray = cloud.points[left] + reach[left, None] * rays[left], rays[left]
        height[left] = surface.distance(place)
        slope[left] = np.einsum("ij,ij->i", surface.normal(place), ray)
        left = left[np.abs(height[left]) >= 1e-13 * scale]
        if not len(left):
            break
        steep = np.where(np.abs(slope[left]) < 1e-3, np.copysign(1e-3, slope[left]), slope[left])
        reach[left] -= np.clip(height[left] / steep, -scale, scale)
    return _Crossings(reach, slope, np.abs(height) < 1e-9 * scale)


def _result(
    fit: SurfaceFit,
    chart: Chart,
    cloud: ScaledCloud,
    covariance: FloatArray,
    error: FloatArray,
    used: BoolArray,
) -> SurfaceFit:
    """The fit in metres."""
    concave = bool(getattr(fit.surface, "concave", False))
    surface: Surface = chart.surface(cloud.centre, cloud.scale, concave)
    units = np.where(chart.lengths() > 0, 1.0, 1 / cloud.scale)
    rms = float(np.sqrt(error @ error / (len(error) - len(covariance))))
    covariance = covariance * np.outer(units, units)
    if isinstance(chart, HeldChart):
        covariance = chart.full_covariance(covariance)
    return SurfaceFit(surface, rms, covariance, len(error), inliers=used)
