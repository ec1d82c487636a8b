# SPDX-License-Identifier: MIT
"""Euclidean fits: least squares of orthogonal distances, from a start or from a search of its own."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from completion.fitting.charts.axial_charts import ConeChart, CylinderChart, chart_of
from completion.fitting.charts.chart import Chart
from completion.fitting.charts.held_chart import HeldChart
from completion.fitting.degeneracy import (
    centroid,
    check_enough,
    check_layer,
    check_spread,
    principal,
    undetermined,
)
from completion.fitting.held import Held
from completion.fitting.polish import Cloud, Normal, full_step, polished
from completion.fitting.result import FitError, SurfaceFit
from completion.fitting.starts import cones_along, starts, starts_along
from scenes.checks import BoolArray, FloatArray, InputError, check_points
from scenes.surfaces.catalogue import Cylinder, Plane, Surface

_SUBSAMPLE = 20_000  # points that a fit converges on before its last two full steps
_START_SAMPLE = 2_000  # points on which starts compete
_FEW = 50  # points: so few that every start is polished to its end
_N_LEADING = 6  # starts that go on where points are many


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
    check_enough(len(cloud), "plane")
    centre = cloud.mean(axis=0)
    spread, axes = principal(cloud, centre)
    check_spread(len(cloud), spread, centre, 1)
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

    Steps are not damped: points from which Gauss-Newton runs away in 30 steps are not near this cylinder.
    `fit` needs no start and damps.

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
    held: Held | None = None,
) -> SurfaceFit:
    """Fit one shape by orthogonal distances to checked points.

    Parameters
    ----------
    points : (n, 3) float
        Metres.
    shape : str
        Which one.
    start : Surface, optional
        Where to begin; without it the starts are searched (`starts`).
    weights : (n,) float, optional
        Of the points.
    n_steps : int
        Most steps.
    damped : bool
        Whether steps are damped, and thin layers of points refused.
    held : Held, optional
        Values that are given.

    Raises
    ------
    FitError
        The points do not determine the shape, or the steps do not converge.
    """
    check_enough(len(points), shape)
    if shape == "plane":
        return fit_plane(points) if held is None else _fit_level(points, held)
    cloud = normalised(points, weights)
    what = undetermined(len(points), shape)
    if start is None:
        chart = _searched(shape, cloud, what, held)
    elif held is not None:
        chart = _best_held([chart_of(start, cloud.centre, cloud.scale)], cloud, what, held)
    else:
        chart = chart_of(start, cloud.centre, cloud.scale)
        _check_off_axis(chart, cloud)
    sample = cloud.thinned(_SUBSAMPLE)
    chart, normal, converged = polished(chart, sample, what, n_steps, damped)
    if not converged:
        raise FitError(f"no convergence: {what}; the last radius is {chart.size() * cloud.scale:.3g} m")
    chart, is_turned = _growing(chart)
    if len(sample.points) < len(points):
        for _ in range(2):
            chart, normal = full_step(chart, cloud, what)
    elif is_turned:
        chart, normal = full_step(chart, cloud, what)
    found = _result(chart, normal, cloud, bool(getattr(start, "concave", False)), what)
    if held is not None:
        found = held.marked(found)
    if damped:
        check_layer(found)
    return found


def _fit_level(points: FloatArray, held: Held) -> SurfaceFit:
    """Fit a plane whose normal is given: its offset is the points' mean."""
    plane = held.exact(fit_plane(points).surface)
    residual = plane.distance(points)
    rms = float(np.sqrt(residual @ residual / (len(points) - 1)))
    covariance = np.zeros((3, 3))
    covariance[0, 0] = rms**2 / len(points)
    return held.marked(SurfaceFit(plane, rms, covariance, len(points)))


def normalised(points: FloatArray, weights: FloatArray | None = None) -> Cloud:
    """Return points (n, 3) and weights (n,) with the points' centroid and root mean square radius."""
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
    if isinstance(chart, HeldChart):
        covariance = chart.widened(covariance)
    return SurfaceFit(surface, rms, covariance, n)


def _growing(chart: Chart) -> tuple[Chart, bool]:
    """The chart with a cone's axis the way it grows, and whether that was the other way round."""
    inner = chart.inner if isinstance(chart, HeldChart) else chart
    if not isinstance(inner, ConeChart) or inner.phi <= 0:
        return chart, False
    grown = inner.growing()
    return (HeldChart(grown, chart.free) if isinstance(chart, HeldChart) else grown), True


def _best_held(candidates: list[Chart], cloud: Cloud, what: str, held: Held) -> Chart:
    """The candidate that polishes best when it has the given values."""
    sample = cloud.thinned(_START_SAMPLE)
    best = _best_polished(held.scaled(1 / cloud.scale).starts(candidates), sample)
    if best is None:
        names = " and ".join(held.names)
        raise FitError(f"{what} with the given {names}: none of {len(candidates)} starts is near it")
    return best[1]


def _searched(shape: str, cloud: Cloud, what: str, held: Held | None) -> Chart:
    """The start that polishes best on a sample."""
    spread, _ = principal(cloud.thinned(_SUBSAMPLE).points, cloud.centre)
    check_spread(len(cloud.points), spread, cloud.centre, 2)
    sample = cloud.thinned(_START_SAMPLE)
    n_best = 40 if len(sample.points) <= _FEW else 8 if shape == "cone" else 3
    unit = cloud.thinned(_SUBSAMPLE).unit()
    if held is not None:
        axis = [] if held.direction is None else starts_along(shape, unit, held.direction)
        return _best_held([*axis, *starts(shape, unit, n_best)], cloud, what, held)
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
    """Sum of squares and chart of the candidate that polishes best; None where none does.

    Where there are many points and starts, only those that lead after a few steps go on.
    """
    if len(sample.points) > _FEW and len(candidates) > _N_LEADING:
        heat = sorted(_polished_each(candidates, sample, 8), key=lambda one: one[0])
        candidates = [chart for _, chart in heat[:_N_LEADING]]
    best: tuple[float, Chart] | None = None
    for cost, chart in _polished_each(candidates, sample, 60):
        if best is None or cost < best[0] * (1 - 1e-9):
            best = cost, chart
    return best


def _polished_each(candidates: list[Chart], sample: Cloud, n_steps: int) -> Iterator[tuple[float, Chart]]:
    """Sum of squares and chart of each candidate after some steps, without those that leave no surface."""
    for start in candidates:
        try:
            chart, normal, _ = polished(start, sample, "a start", n_steps)
        except FitError:
            continue
        yield normal.cost, chart


def _check_off_axis(chart: Chart, cloud: Cloud) -> None:
    local = chart.frame @ (cloud.unit() - chart.origin).T
    near: BoolArray = np.hypot(local[0], local[1]) < 1e-9 * chart.size()
    if near.any():
        raise FitError(f"{int(near.sum())} points lie on the cylinder's axis")
