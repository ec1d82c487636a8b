# SPDX-License-Identifier: MIT
"""Euclidean fits: Levenberg-Marquardt on orthogonal distances, from a start or from a search of its own."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from completion.fitting.chart import Chart, ConeChart, CylinderChart
from completion.fitting.degeneracy import (
    check_enough,
    check_layer,
    check_spread,
    principal,
    undetermined_by,
)
from completion.fitting.given_geometry import GivenGeometry, HeldChart
from completion.fitting.kinds import KINDS, chart_of
from completion.fitting.limits import MOST_CONDITION
from completion.fitting.moments import centroid
from completion.fitting.result import FitError, SurfaceFit
from completion.fitting.starts import cones_along, starts_along
from scenes.checks import BoolArray, FloatArray, InputError, check_points
from scenes.surfaces.catalogue import Cylinder, Plane, Surface

_CHUNK = 8192  # points at a time: a chunk's rows stay in the cache
_MOST_STEPS = 300


@dataclass(frozen=True, slots=True, eq=False)
class ScaledCloud:
    """Points (n, 3) with the centre and scale that bring them near the unit ball; weights (n,) or None."""

    points: FloatArray
    centre: FloatArray
    scale: float
    weights: FloatArray | None = None

    def thin(self, n: int) -> ScaledCloud:
        """About `n` of the points, every k-th."""
        stride = max(1, len(self.points) // n)
        weights = None if self.weights is None else self.weights[::stride]
        return ScaledCloud(self.points[::stride], self.centre, self.scale, weights)

    def unit(self) -> FloatArray:
        """The points (n, 3) relative to the centre, in units of the scale."""
        return np.asarray((self.points - self.centre) / self.scale)


@dataclass(frozen=True, slots=True, eq=False)
class Normal:
    """Normal equations at a chart: J'J, J'f and f'f, J by the changes that are the columns of `basis`."""

    matrix: FloatArray
    gradient: FloatArray
    cost: float
    basis: FloatArray

    def solve(self, damping: float, what: str) -> FloatArray:
        """The step (k,); raises FitError where the points determine nothing."""
        scale = np.sqrt(np.maximum(np.diag(self.matrix), 1e-300))
        scaled = self.matrix / np.outer(scale, scale)
        values, vectors = np.linalg.eigh(scaled)
        if values[-1] > MOST_CONDITION * values[0] or not np.isfinite(values).all():
            condition = values[-1] / max(values[0], 1e-300)
            raise FitError(f"{what}: condition number {condition:.3g}")
        change = vectors @ ((vectors.T @ (self.gradient / scale)) / (values + damping))
        return np.asarray(self.basis @ (-change / scale), dtype=np.float64)

    def inverse(self) -> FloatArray:
        """The inverse (k, k) of J'J, for the chart's own parameters."""
        scale = np.sqrt(np.diag(self.matrix))
        if not scale.all():
            raise np.linalg.LinAlgError("a parameter that nothing depends on")
        inverse = np.linalg.inv(self.matrix / np.outer(scale, scale)) / np.outer(scale, scale)
        return np.asarray(self.basis @ inverse @ self.basis.T)


def normal_equations(chart: Chart, cloud: ScaledCloud) -> Normal:
    """Accumulate the normal equations over the points, chunk by chunk."""
    k, basis = chart.n_parameters, chart.basis()
    matrix, gradient, cost = np.zeros((k, k)), np.zeros(k), 0.0
    turn, shift = chart.frame / cloud.scale, (chart.frame @ chart.origin)[:, None]
    for first in range(0, len(cloud.points), _CHUNK):
        local = turn @ (cloud.points[first : first + _CHUNK] - cloud.centre).T
        local -= shift
        residual, gradient_rows = chart.linearise(local)
        jacobian = basis.T @ gradient_rows
        weighted = jacobian
        if cloud.weights is not None:
            weighted = jacobian * cloud.weights[first : first + _CHUNK]
            cost += float((residual * cloud.weights[first : first + _CHUNK]) @ residual)
        else:
            cost += float(residual @ residual)
        matrix += weighted @ jacobian.T
        gradient += weighted @ residual
    return Normal(matrix, gradient, cost, basis)


def polish_chart(
    chart: Chart,
    cloud: ScaledCloud,
    what: str,
    n_steps: int = _MOST_STEPS,
    damped: bool = True,
) -> tuple[Chart, Normal, bool]:
    """Step until rounding: the chart, its normal equations, and whether it stands still.

    Gauss-Newton steps while they lower the sum of squares, Levenberg's damping where one does not. Large
    residuals slow Gauss-Newton down to linear convergence; there successive steps are parallel and their sum
    is taken at once (Aitken). Undamped, every step is taken and one that leaves no surface raises FitError.
    """
    here = normal_equations(chart, cloud)
    damping, before, stalled, last = 0.0, np.inf, 0, np.zeros(chart.n_parameters)
    for _ in range(n_steps):
        change = here.solve(damping, what)
        last, change = change, change * (_remaining_sum(change, last) if damped and damping == 0 else 1.0)
        moved = float(np.abs(change / np.where(chart.lengths() > 0, chart.size(), 1.0)).max())
        trial = chart.move(change)
        if trial is None and not damped:
            raise FitError(f"{what}: a step left no surface; these points curve the other way or not at all")
        there = None if trial is None else normal_equations(trial, cloud)
        rounding = 1e-15 * chart.size() * np.sqrt(len(cloud.points))
        slack = 1e-13 * here.cost + 2 * rounding * np.sqrt(here.cost) + rounding**2
        if trial is None or there is None or (damped and not there.cost <= here.cost + slack):
            if moved < 1e-9:
                return chart, here, True
            damping = max(10 * damping, 1e-3)
            if damping > 1e12:
                return chart, here, False
            continue
        chart, here, damping = trial, there, 0.0 if damping < 1e-2 else damping / 10
        if moved < 1e-15:
            return chart, here, True
        stalled = stalled + 1 if moved < 1e-11 and moved >= 0.9 * before else 0
        if stalled >= 3:
            return chart, here, True
        before = moved
    return chart, here, before < (1e-9 if damped else 1e-10)


def _remaining_sum(change: FloatArray, last: FloatArray) -> float:
    """Sum of the geometric series that this step and the last one begin; 1 where they are not parallel."""
    length = float(np.linalg.norm(last))
    if length == 0 or np.linalg.norm(change) > 0.999 * length:
        return 1.0
    ratio = float(change @ last) / length**2
    parallel = abs(ratio) * length > 0.99 * float(np.linalg.norm(change))
    return 1 / (1 - ratio) if parallel and ratio > 0.2 else 1.0


def full_step(chart: Chart, cloud: ScaledCloud, what: str) -> tuple[Chart, Normal]:
    """One Gauss-Newton step on all points, and the normal equations before it."""
    here = normal_equations(chart, cloud)
    trial = chart.move(here.solve(0.0, what))
    if trial is None:
        raise FitError(f"{what}: the last step left no surface")
    return trial, here


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
    held: GivenGeometry | None = None,
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
    held : GivenGeometry, optional
        Values that are given.

    Raises
    ------
    FitError
        The points do not determine the shape, or the steps do not converge.
    """
    check_enough(len(points), shape)
    if shape == "plane":
        return fit_plane(points) if held is None else _fit_level(points, held)
    cloud = normalise(points, weights)
    what = undetermined_by(len(points), shape)
    if start is None:
        chart = _search_start(shape, cloud, what, held)
    elif held is not None:
        chart = _best_held([chart_of(start, cloud.centre, cloud.scale)], cloud, what, held)
    else:
        chart = chart_of(start, cloud.centre, cloud.scale)
        _check_off_axis(chart, cloud)
    sample = cloud.thin(_SUBSAMPLE)
    chart, normal, converged = polish_chart(chart, sample, what, n_steps, damped)
    if not converged:
        raise FitError(f"no convergence: {what}; the last radius is {chart.size() * cloud.scale:.3g} m")
    chart, is_turned = _turn_to_growth(chart)
    if len(sample.points) < len(points):
        for _ in range(2):
            chart, normal = full_step(chart, cloud, what)
    elif is_turned:
        chart, normal = full_step(chart, cloud, what)
    fit = _result(chart, normal, cloud, bool(getattr(start, "concave", False)), what)
    if held is not None:
        fit = held.mark(fit)
    if damped:
        check_layer(fit)
    return fit


def _fit_level(points: FloatArray, held: GivenGeometry) -> SurfaceFit:
    """Fit a plane whose normal is given: its offset is the points' mean."""
    plane = held.exact(fit_plane(points).surface)
    residual = plane.distance(points)
    rms = float(np.sqrt(residual @ residual / (len(points) - 1)))
    covariance = np.zeros((3, 3))
    covariance[0, 0] = rms**2 / len(points)
    return held.mark(SurfaceFit(plane, rms, covariance, len(points)))


def normalise(points: FloatArray, weights: FloatArray | None = None) -> ScaledCloud:
    """Return points (n, 3) and weights (n,) with the points' centroid and root mean square radius."""
    centre = centroid(points)
    offset = points[:: max(1, len(points) // _SUBSAMPLE)] - centre
    scale = float(np.sqrt(np.einsum("ij,ij->", offset, offset) / len(offset)))
    return ScaledCloud(points, centre, scale or 1.0, weights)


def _result(chart: Chart, normal: Normal, cloud: ScaledCloud, concave: bool, what: str) -> SurfaceFit:
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
        covariance = chart.full_covariance(covariance)
    return SurfaceFit(surface, rms, covariance, n)


def _turn_to_growth(chart: Chart) -> tuple[Chart, bool]:
    """The chart with a cone's axis the way it grows, and whether that was the other way round."""
    inner = chart.inner if isinstance(chart, HeldChart) else chart
    if not isinstance(inner, ConeChart) or inner.phi <= 0:
        return chart, False
    grown = inner.turn_to_growth()
    return (HeldChart(grown, chart.free) if isinstance(chart, HeldChart) else grown), True


def _best_held(candidates: list[Chart], cloud: ScaledCloud, what: str, held: GivenGeometry) -> Chart:
    """The candidate that polishes best when it has the given values."""
    sample = cloud.thin(_START_SAMPLE)
    best = _best_polished(held.scale(1 / cloud.scale).starts(candidates), sample)
    if best is None:
        names = " and ".join(held.names)
        raise FitError(f"{what} with the given {names}: none of {len(candidates)} starts is near it")
    return best[1]


def _search_start(shape: str, cloud: ScaledCloud, what: str, held: GivenGeometry | None) -> Chart:
    """The start that polishes best on a sample."""
    spread, _ = principal(cloud.thin(_SUBSAMPLE).points, cloud.centre)
    check_spread(len(cloud.points), spread, cloud.centre, 2)
    sample = cloud.thin(_START_SAMPLE)
    n_best = 40 if len(sample.points) <= _FEW else 8 if shape == "cone" else 3
    unit = cloud.thin(_SUBSAMPLE).unit()
    if held is not None:
        axis = [] if held.direction is None else starts_along(shape, unit, held.direction)
        return _best_held([*axis, *KINDS[shape].geometry.starts(unit, n_best)], cloud, what, held)
    best = _best_polished(KINDS[shape].geometry.starts(unit, n_best), sample)
    if shape == "cone":
        along = _best_polished(KINDS["cylinder"].geometry.starts(unit, min(n_best, 8)), sample)
        if along is not None and isinstance(along[1], CylinderChart):
            touching = _best_polished(cones_along(along[1]), sample)
            best = min((b for b in (best, touching) if b is not None), key=lambda b: b[0], default=None)
    if best is None:
        raise FitError(f"{what}: no axis direction gives a start; singular values {spread.tolist()}")
    return best[1]


def _best_polished(candidates: list[Chart], sample: ScaledCloud) -> tuple[float, Chart] | None:
    """Sum of squares and chart of the candidate that polishes best; None where none does.

    Where there are many points and starts, only those that lead after a few steps go on.
    """
    if len(sample.points) > _FEW and len(candidates) > _N_LEADING:
        heat = sorted(_polished_each(candidates, sample, 8), key=lambda candidate: candidate[0])
        candidates = [chart for _, chart in heat[:_N_LEADING]]
    best: tuple[float, Chart] | None = None
    for cost, chart in _polished_each(candidates, sample, 60):
        if best is None or cost < best[0] * (1 - 1e-9):
            best = cost, chart
    return best


def _polished_each(
    candidates: list[Chart], sample: ScaledCloud, n_steps: int
) -> Iterator[tuple[float, Chart]]:
    """Sum of squares and chart of each candidate after some steps, without those that leave no surface."""
    for start in candidates:
        try:
            chart, normal, _ = polish_chart(start, sample, "a start", n_steps)
        except FitError:
            continue
        yield normal.cost, chart


def _check_off_axis(chart: Chart, cloud: ScaledCloud) -> None:
    local = chart.frame @ (cloud.unit() - chart.origin).T
    near: BoolArray = np.hypot(local[0], local[1]) < 1e-9 * chart.size()
    if near.any():
        raise FitError(f"{int(near.sum())} points lie on the cylinder's axis")
