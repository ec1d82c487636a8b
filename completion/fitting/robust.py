# SPDX-License-Identifier: MIT
"""Robust fits: consensus of oriented points, then Tukey's weights with an annealed scale."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from completion.fitting.chart import Chart
from completion.fitting.degeneracy import check_layer
from completion.fitting.euclidean import ScaledCloud, normal_equations, polish_chart
from completion.fitting.given_geometry import GivenGeometry, HeldChart
from completion.fitting.kinds import KINDS, chart_of
from completion.fitting.limits import CUTS, LEAST_AGREEING, TUKEY
from completion.fitting.result import FitError, SurfaceFit
from completion.fitting.starts import N_NEIGHBOURS, orient_normals
from scenes.checks import BoolArray, FloatArray, InputError
from scenes.surfaces.catalogue import Plane, Surface

_N_SCORED = 600


def consensus_surface(
    points: FloatArray, normals: FloatArray, shape: str, tolerance: float, held: GivenGeometry | None = None
) -> Surface:
    """Find the surface of one shape with the least truncated squared distance (MSAC), from minimal sets.

    Minimal sets of oriented points: one for a plane, two for a sphere or cylinder, three for a cone (its apex
    is where three tangent planes meet), four for a torus (its axis meets four normals); two for an elliptic
    cylinder's axis, and five points for its section. Points (n, 3) are in metres, some hundreds to thousands
    are enough; normals (n, 3) need no side: they count as lines. Beyond `tolerance`, metres, a point is an
    outlier. The sets are drawn with a fixed seed; what is `held` is imposed on each.

    Raises
    ------
    FitError
        No minimal set spans such a surface, or a fifth of the points agree with none.
    """
    rng = np.random.default_rng(0)
    n_drawn, n_sets = KINDS[shape].minimal
    sample = np.unique(np.linspace(0, len(points) - 1, _N_SCORED).astype(np.int64))
    best: Surface | None = None
    least, n_spanned = np.inf, 0
    for drawn in rng.integers(0, len(points), (n_sets, n_drawn)):
        surface = KINDS[shape].geometry.through(points[drawn], normals[drawn])
        if surface is None:
            continue
        n_spanned += 1
        for near in _with_given(surface, points[drawn].mean(axis=0), held):
            distance = np.minimum(np.abs(near.distance(points[sample])), tolerance)
            cost = float(distance @ distance)
            if cost < least:
                best, least = near, cost
    if best is None:
        raise FitError(f"none of {n_sets} sets of {n_drawn} oriented points spans {KINDS[shape].title}")
    n_agree = int((np.abs(best.distance(points)) <= 3 * tolerance).sum())
    if n_agree < LEAST_AGREEING * len(points):
        raise FitError(f"only {n_agree} of {len(points)} points agree on {KINDS[shape].title}")
    return best


def _with_given(surface: Surface, place: FloatArray, held: GivenGeometry | None) -> list[Surface]:
    """The surface, or those with the given values that are near it about a place (3,)."""
    try:
        return [surface] if held is None else list(held.impose(surface, place))
    except InputError:
        return []


_N_SAMPLE = 1_500  # points that take part in the consensus
_N_ANNEALED = 20_000  # points that the scale is annealed on before two last rounds on all
_N_FINAL = 20


def fit_robust(
    points: FloatArray, shape: str, start: Surface | None = None, held: GivenGeometry | None = None
) -> SurfaceFit:
    """Fit a shape to points of which up to about half are outliers.

    MSAC from minimal sets of oriented points (normals by local principal components), then iteratively
    reweighted least squares with Tukey's weights, its cut annealed from 20 to 4.685 sigma. Tukey's weights
    from a least-squares start would not be robust.

    Parameters
    ----------
    points : (n, 3) float
        Checked, metres.
    shape : str
        As for `fit`, "auto" excepted.
    start : Surface, optional
        Instead of the consensus.
    held : GivenGeometry, optional
        Values that are given.

    Returns
    -------
    SurfaceFit
        `inliers` are the points with a weight; `rms` is theirs; the covariance is the M-estimator's.

    Raises
    ------
    FitError
        Too few points, no consensus, or too few points left with a weight.
    """
    if len(points) < N_NEIGHBOURS:
        raise FitError(f"a robust fit needs {N_NEIGHBOURS} points, got {len(points)}")
    sample = points[np.unique(np.linspace(0, len(points) - 1, _N_SAMPLE).astype(np.int64))]
    normals, sigma = orient_normals(sample, points)
    surface = (
        _held_start(start, held, sample)
        if start is not None
        else consensus_surface(sample, normals, shape, 3 * sigma, held)
    )
    part = points[:: max(1, len(points) // _N_ANNEALED)]
    for cut in CUTS:
        surface, sigma = _reweigh(part, surface, cut, sigma, held)
    surface, sigma, inliers = _settle_weights(part, surface, sigma, _N_FINAL, held)
    if len(part) < len(points):
        surface, sigma, inliers = _settle_weights(points, surface, sigma, 2, held)
    fit = _robust_result(points, surface, sigma, inliers, held)
    return fit if held is None else held.mark(fit)


def _held_start(start: Surface, held: GivenGeometry | None, points: FloatArray) -> Surface:
    """The start with the given values, nearest to most points (n, 3)."""
    if held is None:
        return start
    near = held.impose(start, points.mean(axis=0))
    return min(near, key=lambda surface: float(np.median(np.abs(surface.distance(points)))))


def _chart(surface: Surface, cloud: ScaledCloud, held: GivenGeometry | None) -> Chart:
    """The chart at a surface, with what is given held."""
    if held is None:
        return chart_of(surface, cloud.centre, cloud.scale)
    return held.chart(surface, cloud.centre, cloud.scale)


def _settle_weights(
    points: FloatArray, surface: Surface, sigma: float, n_rounds: int, held: GivenGeometry | None
) -> tuple[Surface, float, BoolArray]:
    """Reweigh at the last cut until the same points have a weight, at most so many times."""
    inliers: BoolArray = np.zeros(len(points), dtype=np.bool_)
    for _ in range(n_rounds):
        surface, sigma = _reweigh(points, surface, TUKEY, sigma, held)
        before, inliers = inliers, np.abs(surface.distance(points)) < TUKEY * sigma
        if (before == inliers).all():
            break
    return surface, sigma, inliers


def tukey_weights(residual: FloatArray, cut: float) -> FloatArray:
    """Tukey's biweights (n,): (1 - (r / cut)^2)^2 within the cut, 0 beyond."""
    return np.asarray(np.maximum(1 - (residual / cut) ** 2, 0.0) ** 2, dtype=np.float64)


def _reweigh(
    points: FloatArray, surface: Surface, cut: float, sigma: float, held: GivenGeometry | None
) -> tuple[Surface, float]:
    """The surface after a weighted fit, and the scale of its residuals within the cut."""
    weights = tukey_weights(surface.distance(points), cut * sigma)
    cloud = _weighted_cloud(points, weights, surface.kind)
    what = f"{len(cloud.points)} of {len(points)} points left with a weight determine no {surface.kind}"
    chart, _, _ = polish_chart(_chart(surface, cloud, held), cloud, what, 12)
    try:
        moved = chart.surface(cloud.centre, cloud.scale, bool(getattr(surface, "concave", False)))
    except InputError as error:
        raise FitError(f"{what}: {error}") from error
    residual = np.abs(moved.distance(points))
    return moved, max(scale_within(residual[residual < cut * sigma], sigma), 1e-12 * cloud.scale)


def scale_within(size: FloatArray, sigma: float) -> float:
    """The scale of residuals of sizes (n,), at most twice `sigma`, the one before; that where none is left.

    Of normal residuals within 4.685 sigma, 1.4826 times the median size is sigma.
    """
    return min(1.4826 * float(np.median(size)), 2 * sigma) if len(size) else sigma


def tukey_variance(residual: FloatArray, sigma: float, n_parameters: int) -> float:
    """Variance factor of the M-estimator from residuals (n,): mean psi^2 / (mean psi')^2, times (J'J)^-1."""
    u2 = (residual / (TUKEY * sigma)) ** 2
    psi, slope = residual * (1 - u2) ** 2, float(np.mean((1 - u2) * (1 - 5 * u2)))
    return float(psi @ psi) / max(len(residual) - n_parameters, 1) / slope**2


def _weighted_cloud(points: FloatArray, weights: FloatArray, kind: str) -> ScaledCloud:
    kept = weights > 0
    if kept.sum() < 8:
        raise FitError(f"only {int(kept.sum())} of {len(points)} points are near any {kind}")
    near = points[kept]
    centre = near.mean(axis=0)
    scale = float(np.sqrt(np.einsum("ij,ij->", near - centre, near - centre) / len(near)))
    return ScaledCloud(near, centre, scale or 1.0, weights[kept])


def _robust_result(
    points: FloatArray, surface: Surface, sigma: float, inliers: BoolArray, held: GivenGeometry | None
) -> SurfaceFit:
    """The fit with the M-estimator's covariance."""
    kept = points[inliers]
    cloud = replace(_weighted_cloud(points, inliers.astype(np.float64), surface.kind), weights=None)
    if isinstance(surface, Plane):  # its chart's origin: the point nearest to the centroid
        height = float(surface.distance(cloud.centre[None])[0])
        surface = Plane(cloud.centre - height * surface.normal_direction, surface.normal_direction)
    chart = _chart(surface, cloud, held)
    normal = normal_equations(chart, cloud)
    n, k = len(kept), chart.n_parameters
    residual = surface.distance(kept)
    variance = tukey_variance(residual, sigma, k)
    units = np.where(chart.lengths() > 0, 1.0, 1 / cloud.scale)
    covariance = variance * normal.inverse() * np.outer(units, units)
    if isinstance(chart, HeldChart):
        covariance = chart.full_covariance(covariance)
    rms = float(np.sqrt(residual @ residual / max(n - k, 1)))
    placed = chart.surface(cloud.centre, cloud.scale, bool(getattr(surface, "concave", False)))
    fit = SurfaceFit(placed, rms, covariance if n > k else covariance * np.nan, n, inliers=inliers)
    check_layer(fit)
    return fit
