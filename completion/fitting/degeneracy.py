# SPDX-License-Identifier: MIT
"""Degeneracy: points that do not determine the surface asked for, and errors that say why in numbers."""

from __future__ import annotations

import numpy as np
from scipy.special import chdtri

from completion.fitting.kinds import KINDS, kind_of
from completion.fitting.limits import CHANCE_OF_BEND, FLAT, LEAST_RADIUS, MOST_EXTENT_M
from completion.fitting.moments import centroid
from completion.fitting.result import FitError, SurfaceFit
from scenes.checks import FloatArray
from scenes.surfaces.catalogue import Plane

_CHUNK = 8192
_N_SAMPLE = 1000


def undetermined_by(n: int, shape: str) -> str:
    """How an error begins: so many points determine no such shape."""
    return f"{n} points determine no {'surface' if shape == 'auto' else shape.replace('-', ' ')}"


def check_enough(n: int, shape: str) -> None:
    """Refuse fewer points than a shape has parameters."""
    kind = KINDS[shape]
    if n < kind.least_points:
        more = " with covariance" if kind.least_points > kind.n_parameters else ""
        raise FitError(f"{kind.title}{more} needs {kind.least_points} points, got {n}")


def check_sample(points: FloatArray, shape: str) -> None:
    """Refuse points (n, 3) with too large coordinates or in too few places, judged by about 1,000 of them.

    Raises
    ------
    FitError
        They extend over too much or too little, or lie in fewer places than the shape has parameters.
    """
    sample = points[:: max(1, len(points) // _N_SAMPLE)]
    extent = float(np.abs(sample - sample[:1]).max(initial=0.0))
    if not extent < MOST_EXTENT_M or 0 < extent < 1 / MOST_EXTENT_M:
        raise FitError(f"{len(points)} points extend over {extent:.3g} m; give coordinates in metres")
    least = KINDS.get(shape, KINDS["plane"]).least_points
    n_places = len(np.unique(sample, axis=0))
    if extent > 0 and n_places < least:
        raise FitError(
            f"{undetermined_by(len(points), shape)}: they lie in {n_places} places, {least} are needed"
        )


def principal(points: FloatArray, centre: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Singular values (3,) and principal axes (3, 3) of points (n, 3) about their centroid."""
    offset = points - centre
    _, spread, axes = np.linalg.svd(np.linalg.qr(offset, mode="r") if len(points) > 3 else offset)
    return spread, axes


def check_spread(n: int, spread: FloatArray, centre: FloatArray, rank: int) -> None:
    """Refuse points in one spot, on one line (rank 1) or, for curved surfaces, in one plane (rank 2).

    Of `n` points `spread` (3,) are the singular values, metres, about `centre` (3,), their centroid. What is
    below the rounding of coordinates so far out counts as zero.

    Raises
    ------
    FitError
        The points extend in too few directions.
    """
    rounding = 8 * np.finfo(np.float64).eps * float(np.abs(centre).max()) * np.sqrt(n)
    floor = max(FLAT * float(spread[0]), rounding)
    if spread[0] <= rounding:
        raise FitError(f"{n} points lie in one spot, at {centre.tolist()}: singular values {spread.tolist()}")
    if spread[1] <= floor:
        raise FitError(f"{n} points lie on one line: singular values {spread.tolist()}")
    if rank > 1 and spread[2] <= floor:
        raise FitError(f"{n} points lie in one plane: singular values {spread.tolist()}")


def check_layer(fit: SurfaceFit) -> None:
    """Refuse radii within the noise: a flat layer of noise has two sides, and an ellipse fits them both."""
    surface = fit.surface
    radii = kind_of(surface).geometry.radii(surface)
    if radii and min(radii) < LEAST_RADIUS * fit.rms:
        raise FitError(
            f"{undetermined_by(fit.n, surface.kind)}: the radius {min(radii):.3g} m is within the noise, "
            f"{fit.rms:.3g} m (a layer or a line)"
        )


def check_bend(fit: SurfaceFit, points: FloatArray) -> None:
    """Refuse a curved surface where a plane explains the points (n, 3) as well.

    The likelihood ratio against the plane, the fall of the sum of squares over the residuals' variance, is
    distributed as chi squared where the truth is a plane (Wilks 1938); a bend counts when noise on a plane
    would show as much once in a thousand times. Where the radius was given, that bends it.

    Raises
    ------
    FitError
        A plane explains them as well.
    """
    used = points if fit.inliers is None else points[fit.inliers]
    n_more = max(fit.n - fit.degrees_of_freedom - 3, 1)
    is_known = isinstance(fit.surface, Plane) or "radius" in fit.held
    if is_known or fit.degrees_of_freedom < 1 or not fit.rms > 0:
        return
    sample = used[:: max(1, len(used) // _N_SAMPLE)]
    if len(sample) > 100 and _plane_residual(sample) > 2 * fit.rms**2 * len(sample):
        return  # by far, so that the rest need not be asked
    residual = float(fit.rms**2) * fit.degrees_of_freedom
    gain = (_plane_residual(used) - residual) / fit.rms**2
    needed = float(chdtri(n_more, CHANCE_OF_BEND))
    if gain < needed:
        raise FitError(
            f"{undetermined_by(len(used), fit.surface.kind)}: a plane explains them as well (chi squared "
            f"{max(gain, 0.0):.3g} for {n_more} more parameters, {needed:.3g} needed)"
        )


def _plane_residual(points: FloatArray) -> float:
    """The sum of squared distances from the best plane."""
    centre, scatter = centroid(points), np.zeros((3, 3))
    for first in range(0, len(points), _CHUNK):
        offset = points[first : first + _CHUNK] - centre
        scatter += offset.T @ offset
    return float(max(np.linalg.eigvalsh(scatter)[0], 0.0))
