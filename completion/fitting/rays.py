# SPDX-License-Identifier: MIT
"""Fits along rays: errors measured where a scanner makes them, along its beams.

Orthogonal distances are the right errors for noise that is alike in all directions. A scanner's noise lies
along its ray; where rays meet the surface obliquely the orthogonal fit then takes too small a radius, since
the foot of a point moves sideways with its error. Along the known ray the place that was meant stays put.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from completion.fitting.chart import Chart
from completion.fitting.degeneracy import undetermined_by
from completion.fitting.euclidean import Normal, ScaledCloud, normalise
from completion.fitting.held import GivenGeometry, HeldChart
from completion.fitting.kinds import chart_of
from completion.fitting.limits import LEAST_SLOPE, STILL, TUKEY
from completion.fitting.result import FitError, SurfaceFit
from completion.fitting.robust import scale_within, tukey_variance, tukey_weights
from scenes.checks import BoolArray, FloatArray
from scenes.surfaces.catalogue import Surface

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
