# SPDX-License-Identifier: MIT
"""Fits along rays: errors measured where a scanner makes them, along its beams.

Orthogonal distances are the right errors for noise that is alike in all directions. A scanner's noise lies
along its ray; where rays meet the surface obliquely the orthogonal fit then takes too small a radius, since
the foot of a point moves sideways with its error. Along the known ray the place that was meant stays put.
"""

from __future__ import annotations

import numpy as np

from completion.fitting_charts import chart_of
from completion.fitting_polish import Cloud, Normal
from completion.fitting_result import FitError, SurfaceFit
from scenes.checks import BoolArray, FloatArray
from scenes.surfaces import Surface

_N_STEPS = 50
_N_NEWTON = 25
_N_CHOOSING = 4  # steps after which the choice of rays stands, so that the steps can converge
_LEAST_SLOPE = 0.1  # |cosine| between ray and normal below which a grazing ray says nothing


def along_rays(found: SurfaceFit, cloud: Cloud, rays: FloatArray, what: str) -> SurfaceFit:
    """Refit by Gauss-Newton on the errors along the rays, from an orthogonal fit.

    The residual of a point is its range beyond the place where its ray meets the surface; with J the chart's
    gradient there and n the normal, it changes by J / (n . ray). Rays that miss, or graze by less than 6
    degrees, are left out.

    Parameters
    ----------
    found : SurfaceFit
        The orthogonal fit to start from.
    cloud : Cloud
        The points.
    rays : (n, 3) float
        Unit directions along which the points' errors lie.
    what : str
        How a failure begins.

    Raises
    ------
    FitError
        Too few rays meet the surface, or no convergence.
    """
    chart = chart_of(found.surface, cloud.centre, cloud.scale)
    kept: BoolArray = np.ones(len(rays), dtype=np.bool_)
    for step in range(_N_STEPS):
        surface = chart.surface(cloud.centre, cloud.scale, False)
        reach, slope, met = _meet(surface, cloud.points, rays, cloud.scale)
        if step < _N_CHOOSING:
            kept = met & (np.abs(slope) > _LEAST_SLOPE)
        met &= kept
        if int(met.sum()) <= chart.n_parameters:
            raise FitError(f"{what}: only {int(met.sum())} of {len(rays)} rays meet it")
        feet = (cloud.points + reach[:, None] * rays)[met]
        local = chart.frame @ ((feet - cloud.centre) / cloud.scale - chart.origin).T
        _, gradient = chart.linearise(local)
        rows, residual = gradient / slope[met], -reach[met] / cloud.scale
        normal = Normal(rows @ rows.T, rows @ residual, float(residual @ residual))
        change = normal.solved(0.0, what)
        moved = chart.moved(change)
        chart = moved or chart
        if moved is None or float(np.abs(change).max()) < 1e-10:
            break
    if moved is None or float(np.abs(change).max()) >= 1e-10:
        raise FitError(f"no convergence along the rays: {what}")
    n, k = int(met.sum()), chart.n_parameters
    rms = cloud.scale * float(np.sqrt(normal.cost / max(n - k, 1)))
    units = np.where(chart.lengths() > 0, 1.0, 1 / cloud.scale)
    covariance = rms**2 * normal.inverse() * np.outer(units, units)
    concave = bool(getattr(found.surface, "concave", False))
    return SurfaceFit(chart.surface(cloud.centre, cloud.scale, concave), rms, covariance, n)


def _meet(
    surface: Surface, points: FloatArray, rays: FloatArray, scale: float
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """How far along its ray each point is from the surface, the cosine there, and which rays do meet it."""
    reach = np.zeros(len(points))
    for _ in range(_N_NEWTON):
        place = points + reach[:, None] * rays
        height = surface.distance(place)
        slope = np.einsum("ij,ij->i", surface.normal(place), rays)
        if np.abs(height).max() < 1e-13 * scale:
            break
        steep = np.where(np.abs(slope) < 1e-3, np.copysign(1e-3, slope), slope)
        reach -= np.clip(height / steep, -scale, scale)
    met = (np.abs(height) < 1e-9 * scale) & (np.abs(slope) > _LEAST_SLOPE / 2)
    return reach, slope, np.asarray(met, dtype=np.bool_)
