# SPDX-License-Identifier: MIT
"""Polish: Levenberg-Marquardt on orthogonal distances, the chart made anew after each step."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from completion.fitting.charts.chart import Chart
from completion.fitting.result import FitError
from scenes.checks import FloatArray

_CHUNK = 8192  # points at a time: a chunk's rows stay in the cache
_N_STEPS = 300
_MAX_CONDITION = 1e13


@dataclass(frozen=True, slots=True, eq=False)
class Cloud:
    """Points (n, 3) with the centre and scale that bring them near the unit ball; weights (n,) or None."""

    points: FloatArray
    centre: FloatArray
    scale: float
    weights: FloatArray | None = None

    def thinned(self, n: int) -> Cloud:
        """About `n` of the points, every k-th."""
        stride = max(1, len(self.points) // n)
        weights = None if self.weights is None else self.weights[::stride]
        return Cloud(self.points[::stride], self.centre, self.scale, weights)

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

    def solved(self, damping: float, what: str) -> FloatArray:
        """The step (k,); raises FitError where the points determine nothing."""
        scale = np.sqrt(np.maximum(np.diag(self.matrix), 1e-300))
        scaled = self.matrix / np.outer(scale, scale)
        values, vectors = np.linalg.eigh(scaled)
        if values[-1] > _MAX_CONDITION * values[0] or not np.isfinite(values).all():
            condition = values[-1] / max(values[0], 1e-300)
            raise FitError(f"{what}: condition number {condition:.3g}")
        change = vectors @ ((vectors.T @ (self.gradient / scale)) / (values + damping))
        return np.asarray(self.basis @ (-change / scale), dtype=np.float64)

    def inverse(self) -> FloatArray:
        """The inverse (k, k) of J'J, for the chart's own parameters."""
        scale = np.sqrt(np.diag(self.matrix))
        inverse = np.linalg.inv(self.matrix / np.outer(scale, scale)) / np.outer(scale, scale)
        return np.asarray(self.basis @ inverse @ self.basis.T)


def normal_equations(chart: Chart, cloud: Cloud) -> Normal:
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


def polished(
    chart: Chart, cloud: Cloud, what: str, n_steps: int = _N_STEPS, damped: bool = True
) -> tuple[Chart, Normal, bool]:
    """Step until rounding: the chart, its normal equations, and whether it stands still.

    Gauss-Newton steps while they lower the sum of squares, Levenberg's damping where one does not. Large
    residuals slow Gauss-Newton down to linear convergence; there successive steps are parallel and their sum
    is taken at once (Aitken). Undamped, every step is taken and one that leaves no surface raises FitError.
    """
    here = normal_equations(chart, cloud)
    damping, before, stalled, last = 0.0, np.inf, 0, np.zeros(chart.n_parameters)
    for _ in range(n_steps):
        change = here.solved(damping, what)
        last, change = change, change * (_remaining(change, last) if damped and damping == 0 else 1.0)
        moved = float(np.abs(change / np.where(chart.lengths() > 0, chart.size(), 1.0)).max())
        trial = chart.moved(change)
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


def _remaining(change: FloatArray, last: FloatArray) -> float:
    """Sum of the geometric series that this step and the last one begin; 1 where they are not parallel."""
    length = float(np.linalg.norm(last))
    if length == 0 or np.linalg.norm(change) > 0.999 * length:
        return 1.0
    ratio = float(change @ last) / length**2
    parallel = abs(ratio) * length > 0.99 * float(np.linalg.norm(change))
    return 1 / (1 - ratio) if parallel and ratio > 0.2 else 1.0


def full_step(chart: Chart, cloud: Cloud, what: str) -> tuple[Chart, Normal]:
    """One Gauss-Newton step on all points, and the normal equations before it."""
    here = normal_equations(chart, cloud)
    trial = chart.moved(here.solved(0.0, what))
    if trial is None:
        raise FitError(f"{what}: the last step left no surface")
    return trial, here
