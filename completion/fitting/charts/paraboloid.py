# SPDX-License-Identifier: MIT
"""Paraboloid: points near a plane as heights over it, and how these curve."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scenes.checks import FloatArray

LEAST_CURVATURE = 1e-6  # in units of the points' inverse RMS radius


@dataclass(frozen=True, slots=True, eq=False)
class Paraboloid:
    """The paraboloid over the plane of points, least squares in their heights.

    Attributes
    ----------
    foot : (3,) float
        Where it stands over the points' middle, which is the origin.
    normal : (3,) float
        Unit vector at the foot.
    curvatures : (2,) float
        Principal ones, the smaller first; positive where it bends towards the normal.
    directions : (3, 2) float
        Unit vectors in the plane, in which it curves so.
    """

    foot: FloatArray
    normal: FloatArray
    curvatures: FloatArray
    directions: FloatArray

    @classmethod
    def of(cls, unit: FloatArray) -> Paraboloid:
        """Fit it to points (n, 3) whose middle is the origin."""
        _, vectors = np.linalg.eigh(unit.T @ unit)
        x, y, z = vectors[:, 2] @ unit.T, vectors[:, 1] @ unit.T, vectors[:, 0] @ unit.T
        basis = np.column_stack([np.ones(len(x)), x, y, x * x / 2, x * y, y * y / 2])
        level, slope_x, slope_y, xx, xy, yy = np.linalg.lstsq(basis, z, rcond=None)[0]
        curvatures, turns = np.linalg.eigh(np.array([[xx, xy], [xy, yy]]))
        normal = vectors @ np.array([1.0, -slope_y, -slope_x])
        across = np.stack([vectors[:, [2, 1]] @ turns[:, k] for k in range(2)], axis=1)
        return cls(level * vectors[:, 0], normal / np.linalg.norm(normal), curvatures, across)
