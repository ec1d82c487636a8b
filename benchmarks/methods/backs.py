# SPDX-License-Identifier: MIT
"""Peers of back sides: an upright superquadric by least squares, and a mirror that is always taken."""

from __future__ import annotations

import numpy as np
from scipy.optimize import least_squares

from benchmarks.cases.houses.solids import cushion
from completion.backs.symmetry import Symmetry
from scenes.checks import FloatArray

SMALL = 2.0  # weight of the size beside the distances: the best for the tuning kinds of 0.02 to 30


def superquadric(points: FloatArray, support_m: float) -> FloatArray:
    """Return triangles (m, 3, 3) of the upright superquadric nearest to points (n, 3), from the support up.

    Least squares of the radial distance (Solina & Bajcsy 1990) over place, yaw, sizes and one exponent,
    from two yaws; the top and the foot are those of the points.
    """
    points = points[:: max(len(points) // 800, 1)]
    low, high = points.min(axis=0), points.max(axis=0)
    half_z = (high[2] - support_m) / 2
    z = (points[:, 2] - support_m - half_z) / half_z
    middle, size = (low + high)[:2] / 2, float(np.linalg.norm(high - low))

    def residual(p: FloatArray) -> FloatArray:
        c, s = np.cos(p[2]), np.sin(p[2])
        at = points[:, :2] - p[:2]
        x = np.abs(at @ [c, s]) / np.exp(p[3]) + 1e-9
        y = np.abs(at @ [-s, c]) / np.exp(p[4]) + 1e-9
        e = 0.1 + 0.9 / (1 + np.exp(-p[5]))
        most = np.maximum(np.maximum(x, y), np.abs(z))  # taken out, so that no power overflows
        value = most * sum((one / most) ** (2 / e) for one in (x, y, np.abs(z))) ** (e / 2)
        away = np.sqrt((at**2).sum(axis=1) + (half_z * z) ** 2)
        volume = np.exp(p[3] + p[4]) ** 0.5  # the smallest of those that fit
        return np.asarray(np.append(away * (1 - 1 / value), SMALL * volume * len(points) ** 0.5))

    best = None
    for yaw in (0.0, np.pi / 4):
        start = np.array([*middle, yaw, *np.log((high - low)[:2] / 2 + 1e-3), -1.0])
        found = least_squares(residual, start, loss="soft_l1", f_scale=0.02 * size, max_nfev=60)
        best = found if best is None or found.cost < best.cost else best
    assert best is not None
    p = best.x
    half = np.minimum(np.exp(p[3:5]), 2 * size)
    power = float(0.1 + 0.9 / (1 + np.exp(-p[5])))
    solid = cushion((-half[0], -half[1], support_m), (half[0], half[1], support_m + 2 * half_z), power=power)
    c, s = np.cos(p[2]), np.sin(p[2])
    return np.asarray(solid @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) + [p[0], p[1], 0])


def least_contradicted(hypotheses: tuple[Symmetry, ...]) -> list[Symmetry]:
    """Return the mirror with the least contradiction, the better matched of equal ones; always taken."""
    mirrors = [one for one in hypotheses if one.kind == "mirror"]
    return sorted(
        mirrors, key=lambda one: (round(one.evidence["contradicted"], 2), -one.evidence["matched"])
    )[:1]
