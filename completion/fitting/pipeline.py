# SPDX-License-Identifier: MIT
"""Fitting: a surface through points by one of three metrics, robustly or along rays, with uncertainty."""

from __future__ import annotations

import numpy as np

from completion.fitting.degeneracy import check_bend, check_enough, check_sample
from completion.fitting.euclidean import fit_euclidean
from completion.fitting.given_geometry import given_of_shape
from completion.fitting.kinds import KINDS
from completion.fitting.metrics import fit_along_rays, fit_by_quadric
from completion.fitting.result import FitError, SurfaceFit
from completion.fitting.robust import fit_robust
from completion.fitting.selection import select
from completion.fitting.shape import Metric, Shape
from scenes.checks import FloatArray, InputError, check_points, check_vectors
from scenes.surfaces.catalogue import Surface


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
