# SPDX-License-Identifier: MIT
"""Robust least squares of distances with numeric derivatives, and how well it knows its place."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from completion.fitting.limits import CUTS, TUKEY
from completion.fitting.robust import scale_within, tukey_variance, tukey_weights
from scenes.checks import BoolArray, FloatArray, IntArray

Distance = Callable[[FloatArray], FloatArray]
"""From a place (m,) in the unit box to the distances of all points (n,)."""

_N_FINAL = 12  # rounds at most at the last cut
_N_STEPS = 10  # evaluations of residuals a round
_STEP = 1e-5  # of derivatives, in the unit box
_FULL_BLOCK, _LEAST_BLOCKS = 5, 8
PRIOR_VARIANCE = 1 / 12  # of a parameter between its bounds, in the unit box


@dataclass(frozen=True, slots=True, eq=False)
class Refinement:
    """Where least squares ended.

    Attributes
    ----------
    place : (m,) float
        In the unit box.
    sigma : float
        Scale of the residuals.
    distances : (n,) float
        Of all points.
    jacobian : (n, m) float
        Derivatives of the distances.
    evaluations : int
        Of all distances, those for derivatives too.
    is_settled : bool
        Whether the last rounds kept the same points.
    """

    place: FloatArray
    sigma: float
    distances: FloatArray
    jacobian: FloatArray
    evaluations: int
    is_settled: bool

    @property
    def inliers(self) -> BoolArray:
        """Which points (n,) have a weight."""
        return np.abs(self.distances) < TUKEY * self.sigma


def refine(
    distance: Distance, place: FloatArray, sigma: float, *, least_sigma: float, most: int
) -> Refinement:
    """Move a place to where Tukey's weighted squares are least, the cut annealed from 20 to 4.685 sigma.

    Parameters
    ----------
    distance : callable
        From a place (m,) to the distances of points (n,), in their unit.
    place : (m,) float
        Where to begin, in the unit box.
    sigma : float
        Scale of the residuals there.
    least_sigma : float
        What rounding leaves of a scale.
    most : int
        Evaluations at most; at least those that the derivatives at the end need are spent.
    """
    n_each = len(place) + 1
    spent, is_settled, kept = 0, False, np.zeros(0, dtype=np.bool_)
    for cut in (*CUTS, *[TUKEY] * _N_FINAL):
        allowed = min(_N_STEPS, (most - spent) // n_each - 1)
        if allowed < 1 or len(place) == 0:
            is_settled = len(place) == 0
            break
        place, n_steps = _take_steps(distance, place, cut * sigma, allowed)
        size = np.abs(distance(place))
        spent += n_steps * n_each + 1
        sigma = max(scale_within(size[size < cut * sigma], sigma), least_sigma)
        before, kept = kept, size < cut * sigma
        is_settled = cut == TUKEY and np.array_equal(before, kept)
        if is_settled:
            break
    at_end = distance(place)
    size = np.abs(at_end)
    if len(place) == 0:
        sigma = _settled_scale(size, sigma, least_sigma)
    spent += 2 * len(place) + 1
    slopes = _jacobian(distance, place)
    return Refinement(place, sigma, at_end, slopes, evaluations=spent, is_settled=is_settled)


def _settled_scale(size: FloatArray, sigma: float, least: float) -> float:
    """The scale of residuals of sizes (n,) where nothing moves."""
    for cut in (*CUTS, *[TUKEY] * _N_FINAL):
        sigma = max(scale_within(size[size < cut * sigma], sigma), least)
    return sigma


def _take_steps(distance: Distance, place: FloatArray, cut: float, n_steps: int) -> tuple[FloatArray, int]:
    """The place (m,) after a fit with the weights of where it began, and how many steps it took."""
    root = np.sqrt(tukey_weights(distance(place), cut))
    squares = least_squares(
        lambda z: root * distance(z) / cut,
        np.clip(place, 1e-9, 1 - 1e-9),
        bounds=(0.0, 1.0),
        max_nfev=n_steps,
        diff_step=_STEP,
    )
    return np.asarray(squares.x), int(squares.nfev)


def _jacobian(distance: Distance, place: FloatArray) -> FloatArray:
    """Central differences (n, m)."""
    columns = []
    for k in range(len(place)):
        step = np.zeros(len(place))
        step[k] = _STEP
        columns.append((distance(place + step) - distance(place - step)) / (2 * _STEP))
    return np.column_stack(columns) if columns else np.zeros((len(distance(place)), 0))


def inflation(distances: FloatArray, normals: FloatArray, cells: IntArray) -> float:
    """By how much residuals that are alike between neighbours raise a variance, at least 1.

    Residuals are averaged over cells; independent ones would average to rms / sqrt(count). Distances may be
    without a side: within a cell they count along the first normal (as `fitting.result.inflated`, else).

    Parameters
    ----------
    distances : (n,) float
        With or without a sign.
    normals : (n, 3) float
        Their gradients by the place of the point, of any length.
    cells : (n, c) int
        Numbers that neighbours on a face share; cells of few points do not count.
    """
    if len(distances) == 0 or not (distances**2).any():
        return 1.0
    _, first, which = np.unique(cells, axis=0, return_index=True, return_inverse=True)
    which = which.ravel()
    along = distances * np.sign(np.einsum("ij,ij->i", normals, normals[first][which]))
    count = np.bincount(which).astype(np.float64)
    full: BoolArray = count >= _FULL_BLOCK
    if full.sum() < _LEAST_BLOCKS:
        return 1.0
    mean = np.bincount(which, along)[full] / count[full]
    return max(float(np.mean(mean**2 * count[full]) / np.mean(distances**2)), 1.0)


def neighbour_cells(
    points: FloatArray, distances: FloatArray, normals: FloatArray, faces: IntArray, spacing: float
) -> IntArray:
    """Return face and cube (n, 4) of points: about sqrt(n) of them share one.

    Points are first moved onto the surface: cubes of points as measured would part those above it from those
    below.

    Parameters
    ----------
    points : (n, 3) float
        As measured.
    distances, normals : (n,) and (n, 3) float
        From the surface, and their gradients, of any length.
    faces : (n,) int
        On which each is.
    spacing : float
        Typical distance between neighbours.
    """
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    points = points - distances[:, None] * normals / np.maximum(length, 1e-300)
    side = max(spacing, 1e-300) * max(len(points), 1) ** 0.25
    return np.column_stack([faces, np.floor(points / side).astype(np.int64)])


def box_covariance(refined: Refinement, excess: float) -> FloatArray:
    """Return the covariance (m, m) of the place: of points, and of that it lies in the unit box.

    (J'J / s^2 + 12)^-1, s^2 of the M-estimator times the inflation; 1 / 12 is the variance between bounds.
    """
    kept = refined.inliers
    jacobian = refined.jacobian[kept]
    n_sought = jacobian.shape[1]
    if kept.sum() <= n_sought:
        return np.eye(n_sought) * PRIOR_VARIANCE
    variance = max(tukey_variance(refined.distances[kept], refined.sigma, n_sought), 1e-300) * excess
    information = jacobian.T @ jacobian / variance + np.eye(n_sought) / PRIOR_VARIANCE
    return np.asarray(np.linalg.inv(information), dtype=np.float64)
