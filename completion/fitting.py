# SPDX-License-Identifier: MIT
"""Fits: orthogonal-distance least squares of plane, sphere, cylinder, cone, with covariance and no guess."""

from __future__ import annotations

from typing import Literal, cast

import numpy as np

from completion.fitting_charts import Chart, ConeChart, CylinderChart, chart_of
from completion.fitting_polish import Cloud, Normal, full_step, polished
from completion.fitting_rays import along_rays
from completion.fitting_result import FitError, SurfaceFit, inflated, surface_parameters
from completion.fitting_starts import cones_along, starts
from completion.moments import centroid
from completion.quadrics import fit_by_quadric
from completion.robust import fit_robust
from completion.selection import Selection, weigh
from scenes.checks import BoolArray, FloatArray, InputError, check_points, check_vectors
from scenes.surfaces import Cone, Cylinder, EllipticCylinder, Plane, Sphere, Surface

__all__ = [
    "FitError",
    "SurfaceFit",
    "fit",
    "fit_cylinder",
    "fit_plane",
    "inflated",
    "select",
    "surface_parameters",
]

Shape = Literal["auto", "plane", "sphere", "cylinder", "elliptic-cylinder", "cone"]
Metric = Literal["euclidean", "taubin", "algebraic"]

LEAST_POINTS = {"plane": 3, "sphere": 4, "cylinder": 6, "cone": 6, "elliptic-cylinder": 7}
_ARTICLE = {"elliptic-cylinder": "an elliptic cylinder"}
_SUBSAMPLE = 20_000  # points that a fit converges on before its last two full steps
_START_SAMPLE = 2_000  # points on which starts compete
_LEAST_RADIUS = 4.0  # times the residuals' rms
_FLAT = 1e-9  # singular values below this part of the greatest count as zero


def fit_plane(points: object, towards: FloatArray | None = None) -> SurfaceFit:
    """Fit a plane by principal components, the closed-form orthogonal-distance fit.

    Parameters
    ----------
    points : (n, 3) float
        At least three, not on one line; metres.
    towards : (3,) float, optional
        A point, such as the sensor's position, on the side that the normal shall point to.

    Raises
    ------
    FitError
        Fewer than three points, or points on one line or in one spot.
    """
    cloud = check_points("points", points)
    if len(cloud) < 3:
        raise FitError(f"a plane needs 3 points, got {len(cloud)}")
    centre = cloud.mean(axis=0)
    spread, axes = _principal(cloud, centre)
    _check_spread(len(cloud), spread, centre, 1)
    normal = axes[2]
    if towards is not None and (towards - centre) @ normal < 0:
        normal = -normal
    plane = Plane(centre, normal, axes[0])
    uv = plane.to_uv(cloud)
    residual = plane.distance(cloud)
    rms = float(np.sqrt(residual @ residual / max(len(cloud) - 3, 1)))
    gradient = np.column_stack([np.ones(len(uv)), uv])
    covariance = rms**2 * np.linalg.inv(gradient.T @ gradient)
    if len(cloud) == 3:
        covariance = np.full((3, 3), np.nan)
    return SurfaceFit(plane, rms, covariance, len(cloud))


def fit_cylinder(points: object, start: Cylinder) -> SurfaceFit:
    """Fit a circular cylinder by Gauss-Newton on orthogonal distances from a start near by.

    Steps are not damped: points from which Gauss-Newton runs away in 30 steps are not near this cylinder,
    and region growing wants to know. `fit` needs no start and damps.

    Parameters
    ----------
    points : (n, 3) float
        At least six; metres.
    start : Cylinder
        Where to begin; `concave` is kept.

    Raises
    ------
    FitError
        Too few points, a singular system (a line or a plane), or no convergence.
    """
    return fit_euclidean(check_points("points", points), "cylinder", start, n_steps=30, damped=False)


def fit_euclidean(
    points: FloatArray,
    shape: str,
    start: Surface | None = None,
    weights: FloatArray | None = None,
    *,
    n_steps: int = 300,
    damped: bool = True,
) -> SurfaceFit:
    """Fit one shape by orthogonal distances to checked points, from `start` or from a search of its own."""
    name = _ARTICLE.get(shape, f"a {shape}")
    if len(points) < LEAST_POINTS[shape]:
        more = " with covariance" if shape == "cylinder" else ""
        raise FitError(f"{name}{more} needs {LEAST_POINTS[shape]} points, got {len(points)}")
    if shape == "plane":
        return fit_plane(points)
    cloud = normalised(points, weights)
    what = f"{len(points)} points determine no {shape.replace('-', ' ')}"
    if start is None:
        chart = _searched(shape, cloud, what)
    else:
        chart = chart_of(start, cloud.centre, cloud.scale)
        _check_off_axis(chart, cloud)
    sample = cloud.thinned(_SUBSAMPLE)
    chart, normal, converged = polished(chart, sample, what, n_steps, damped)
    if not converged:
        raise FitError(f"no convergence: {what}; the last radius is {chart.size() * cloud.scale:.3g} m")
    if len(sample.points) < len(points):
        for _ in range(2):
            chart, normal = full_step(chart, cloud, what)
    elif isinstance(chart, ConeChart) and chart.phi > 0:
        chart = chart.growing()
        chart, normal = full_step(chart, cloud, what)
    found = _result(chart, normal, cloud, bool(getattr(start, "concave", False)), what)
    if damped:
        _check_not_a_layer(found, what)
    return found


def _check_not_a_layer(found: SurfaceFit, what: str) -> None:
    """Refuse radii within the noise: a flat layer of noise has two sides, and an ellipse fits them both."""
    surface = found.surface
    if isinstance(surface, Sphere | Cylinder | Cone | EllipticCylinder):
        least = surface.radii[1] if isinstance(surface, EllipticCylinder) else surface.radius
        if least < _LEAST_RADIUS * found.rms:
            raise FitError(
                f"{what}: the radius {least:.3g} m is within the noise, {found.rms:.3g} m (a layer or a line)"
            )


def normalised(points: FloatArray, weights: FloatArray | None = None) -> Cloud:
    """The points with their centroid and RMS radius."""
    centre = centroid(points)
    offset = points[:: max(1, len(points) // _SUBSAMPLE)] - centre
    scale = float(np.sqrt(np.einsum("ij,ij->", offset, offset) / len(offset)))
    return Cloud(points, centre, scale or 1.0, weights)


def _result(chart: Chart, normal: Normal, cloud: Cloud, concave: bool, what: str) -> SurfaceFit:
    """The fit in metres, with the covariance of its chart's parameters."""
    n, k = len(cloud.points), chart.n_parameters
    rms = cloud.scale * float(np.sqrt(max(normal.cost, 0.0) / max(n - k, 1)))
    try:
        surface = chart.surface(cloud.centre, cloud.scale, concave)
    except InputError as error:
        raise FitError(f"{what}: {error}") from error
    covariance = np.full((k, k), np.nan)
    if n > k:
        units = np.where(chart.lengths() > 0, 1.0, 1 / cloud.scale)
        covariance = rms**2 * normal.inverse() * np.outer(units, units)
    return SurfaceFit(surface, rms, covariance, n)


def _searched(shape: str, cloud: Cloud, what: str) -> Chart:
    """The start that polishes best on a sample."""
    spread, _ = _principal(cloud.thinned(_SUBSAMPLE).points, cloud.centre)
    _check_spread(len(cloud.points), spread, cloud.centre, 2)
    sample = cloud.thinned(_START_SAMPLE)
    n_best = 40 if len(sample.points) <= 50 else 8 if shape == "cone" else 3
    unit = cloud.thinned(_SUBSAMPLE).unit()
    best = _best_polished(starts(shape, unit, n_best), sample)
    if shape == "cone":
        along = _best_polished(starts("cylinder", unit, min(n_best, 8)), sample)
        if along is not None and isinstance(along[1], CylinderChart):
            touching = _best_polished(cones_along(along[1]), sample)
            best = min((b for b in (best, touching) if b is not None), key=lambda b: b[0], default=None)
    if best is None:
        raise FitError(f"{what}: no axis direction gives a start; singular values {spread.tolist()}")
    return best[1]


def _best_polished(candidates: list[Chart], sample: Cloud) -> tuple[float, Chart] | None:
    """Sum of squares and chart of the candidate that polishes best; None where none does."""
    best: tuple[float, Chart] | None = None
    for start in candidates:
        try:
            chart, normal, _ = polished(start, sample, "a start", 60)
        except FitError:
            continue
        if best is None or normal.cost < best[0] * (1 - 1e-9):
            best = normal.cost, chart
    return best


def _principal(cloud: FloatArray, centre: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Singular values (3,) and principal axes (3, 3) of the points about their centroid."""
    offset = cloud - centre
    _, spread, axes = np.linalg.svd(np.linalg.qr(offset, mode="r") if len(cloud) > 3 else offset)
    return spread, axes


def _check_spread(n: int, spread: FloatArray, centre: FloatArray, rank: int) -> None:
    """Refuse points in one spot, on one line or, for curved surfaces, in one plane."""
    rounding = 8 * np.finfo(np.float64).eps * float(np.abs(centre).max()) * np.sqrt(n)
    floor = max(_FLAT * float(spread[0]), rounding)
    if spread[0] <= rounding:
        raise FitError(f"{n} points lie in one spot, at {centre.tolist()}: singular values {spread.tolist()}")
    if spread[1] <= floor:
        raise FitError(f"{n} points lie on one line: singular values {spread.tolist()}")
    if rank > 1 and spread[2] <= floor:
        raise FitError(f"{n} points lie in one plane: singular values {spread.tolist()}")


def _check_off_axis(chart: Chart, cloud: Cloud) -> None:
    local = chart.frame @ (cloud.unit() - chart.origin).T
    near: BoolArray = np.hypot(local[0], local[1]) < 1e-9 * chart.size()
    if near.any():
        raise FitError(f"{int(near.sum())} points lie on the cylinder's axis")


def fit(
    points: object,
    shape: Shape,
    *,
    metric: Metric = "euclidean",
    robust: bool = False,
    start: Surface | None = None,
    rays: object | None = None,
) -> SurfaceFit:
    """Fit a surface to points.

    Parameters
    ----------
    points : (n, 3) float
        Metres; anywhere: they are centred first.
    shape : {"auto", "plane", "sphere", "cylinder", "elliptic-cylinder", "cone"}
        What to fit; "auto" lets the evidence decide, and raises where it does not.
    metric : {"euclidean", "taubin", "algebraic"}
        Orthogonal distances (the least-squares fit), or the closed forms, kept for comparison.
    robust : bool
        Find consensus first and weigh outliers down (Euclidean only).
    start : Surface, optional
        Where to begin; none is needed.
    rays : (n, 3) float, optional
        The beam that each point lies on, where the noise is a scanner's range noise: errors are then
        measured along the rays, and rays that graze or miss are left out (Euclidean, not robust).

    Raises
    ------
    FitError
        The points determine no such surface; the message says why in numbers.

    Examples
    --------
    >>> around = np.linspace(0, 2, 200)
    >>> post = np.column_stack([0.3 * np.cos(around), 0.3 * np.sin(around), np.sin(9 * around)])
    >>> round(fit(post, "cylinder").surface.radius, 9)
    0.3
    """
    if shape != "auto" and shape not in LEAST_POINTS:
        raise InputError(f"shape must be auto or one of {', '.join(LEAST_POINTS)}, got {shape!r}")
    cloud = check_vectors("points", points)
    if not np.isfinite(centroid(cloud)).all():
        cloud = check_points("points", cloud)  # says which are not finite
    if shape == "auto":
        selection = select(cloud, robust=robust)
        if selection.shape is None:
            raise FitError(f"{selection.summary()}; name the shape")
        shape, start = cast("Shape", selection.shape), None
        if metric == "euclidean" and rays is None:
            return selection.fits[shape]
    if rays is not None and (robust or metric != "euclidean"):
        raise InputError(
            "errors along rays need the Euclidean metric, not robust; drop rays or those options"
        )
    if robust:
        if metric != "euclidean":
            raise InputError(f"a robust fit is Euclidean; drop robust or metric={metric!r}")
        return fit_robust(cloud, shape, start)
    if metric not in ("euclidean", "taubin", "algebraic"):
        raise InputError(f"metric must be euclidean, taubin or algebraic, got {metric!r}")
    if metric != "euclidean" and shape != "plane":  # a plane's three metrics are one
        return fit_by_quadric(cloud, shape, metric)
    found = fit_euclidean(cloud, shape, start)
    if rays is None:
        return found
    along = check_points("rays", rays)
    if len(along) != len(cloud):
        raise InputError(f"{len(along)} rays for {len(cloud)} points; give one a point")
    unit = along / np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-300)
    return along_rays(found, normalised(cloud), unit, f"{len(cloud)} points determine no {shape} along rays")


def select(points: object, *, robust: bool = False) -> Selection:
    """Fit every shape to points (n, 3) and weigh the evidence; see `Selection`.

    Residuals count as independent; where they are not (a wall that bends a little), the ratios overstate.
    """
    cloud = check_points("points", points)
    fits: dict[str, SurfaceFit] = {}
    failures: dict[str, str] = {}
    for shape in LEAST_POINTS:
        try:
            fits[shape] = fit_robust(cloud, shape) if robust else fit_euclidean(cloud, shape)
        except FitError as error:
            failures[shape] = str(error)
    residuals = {shape: found.surface.distance(cloud) for shape, found in fits.items()}
    size = np.abs(cloud).max(initial=0.0)
    spread = np.abs(cloud - cloud[:1]).max(initial=0.0)
    extent = float(spread + 1e-3 * size)  # rounding grows with the distance from the origin
    return weigh(fits, residuals, failures, extent)
