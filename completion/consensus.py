# SPDX-License-Identifier: MIT
"""Consensus: the cylinder that most oriented points agree with, from minimal sets of two."""

from __future__ import annotations

import numpy as np

from completion.fitting import FitError
from scenes.checks import BoolArray, FloatArray
from scenes.surfaces import Cylinder

_N_PAIRS = 200
_N_SCORED = 600
_MAX_ANGLE = np.radians(20.0)


def consensus_cylinder(
    points: FloatArray, normals: FloatArray, tolerance: float
) -> tuple[Cylinder, BoolArray]:
    """Find the cylinder with the least truncated squared distance (MSAC, Torr & Zisserman 2000).

    Two oriented points fix a cylinder: its axis is across both normals, its centre where the normals meet.
    The pairs are drawn with a fixed seed, so the answer depends on the points alone.

    Parameters
    ----------
    points, normals : (n, 3) float
        Metres and unit vectors.
    tolerance : float
        Distance in metres beyond which a point counts as an outlier.

    Returns
    -------
    cylinder : Cylinder
        The best one; concave where its normals point to the axis.
    inliers : (n,) bool
        Points within tolerance whose normals agree within 20 degrees.

    Raises
    ------
    FitError
        No pair of normals spans a cylinder that a fifth of the points agree with.
    """
    rng = np.random.default_rng(0)
    first, second = rng.integers(0, len(points), (2, _N_PAIRS))
    axes = np.cross(normals[first], normals[second])
    sine = np.linalg.norm(axes, axis=1)
    usable = sine > np.sin(np.radians(8.0))
    if not usable.any():
        raise FitError(
            f"normals hardly spread: the largest angle is {np.degrees(np.arcsin(sine.max())):.1f} deg"
        )
    axes = axes[usable] / sine[usable, None]
    p, q = points[first[usable]], points[second[usable]]
    n, m = normals[first[usable]], normals[second[usable]]
    # In the plane across the axis: p + s n meets q + t m; s by Cramer's rule with the sine of the angle.
    gap = q - p
    gap = gap - np.einsum("ij,ij->i", gap, axes)[:, None] * axes
    s = np.einsum("ij,ij->i", np.cross(gap, m), axes) / np.einsum("ij,ij->i", np.cross(n, m), axes)
    t = np.einsum("ij,ij->i", np.cross(gap, n), axes) / np.einsum("ij,ij->i", np.cross(n, m), axes)
    radius = (np.abs(s) + np.abs(t)) / 2
    centre = p + s[:, None] * n
    even = (np.sign(s) == np.sign(t)) & (np.abs(np.abs(s) - np.abs(t)) <= 0.3 * radius) & (radius > 0)
    if not even.any():
        raise FitError("no two normals meet at equal distance: these points lie on no circular cylinder")
    sample = np.unique(np.linspace(0, len(points) - 1, _N_SCORED).astype(np.int64))
    cost = _costs(
        points[sample], normals[sample], centre[even], axes[even], radius[even], -np.sign(s[even]), tolerance
    )
    chosen = np.flatnonzero(even)[int(np.argmin(cost))]
    best = Cylinder(centre[chosen], axes[chosen], float(radius[chosen]), None, bool(s[chosen] > 0))
    distance, agrees = _residuals(best, points, normals)
    inliers = (distance <= tolerance) & agrees
    if inliers.sum() < 0.2 * len(points):
        raise FitError(f"only {int(inliers.sum())} of {len(points)} points agree on a cylinder")
    return best, np.asarray(inliers, dtype=np.bool_)


def _residuals(cylinder: Cylinder, points: FloatArray, normals: FloatArray) -> tuple[FloatArray, BoolArray]:
    cosine = np.einsum("ij,ij->i", cylinder.normal(points), normals)
    return np.abs(cylinder.distance(points)), np.asarray(cosine >= np.cos(_MAX_ANGLE), dtype=np.bool_)


def _costs(
    points: FloatArray,
    normals: FloatArray,
    centres: FloatArray,
    axes: FloatArray,
    radii: FloatArray,
    outward: FloatArray,
    tolerance: float,
) -> FloatArray:
    """Truncated squared distances, summed over the points, for k cylinders at once; `outward` is +1 or -1."""
    along = points @ axes.T - np.einsum("ij,ij->i", centres, axes)
    radial = points[:, None, :] - centres - along[..., None] * axes
    length = np.linalg.norm(radial, axis=2)
    cosine = np.einsum("pki,pi->pk", radial, normals) * outward / np.maximum(length, 1e-12)
    agrees = cosine >= np.cos(_MAX_ANGLE)
    distance = np.where(agrees, np.minimum(np.abs(length - radii), tolerance), tolerance)
    return np.asarray(np.square(distance).sum(axis=0), dtype=np.float64)
