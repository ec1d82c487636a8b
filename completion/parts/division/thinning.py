# SPDX-License-Identifier: MIT
"""Thinning: input at the door, copies, and as many points as surfaces are sought in."""

from __future__ import annotations

import numpy as np

from completion.fitting.degeneracy import centroid, check_spread, principal
from completion.fitting.result import FitError
from scenes.checks import FloatArray, InputError, IntArray, check_points

LEAST = 8  # points of a surface
MOST_POINTS = 30_000  # that surfaces are sought in; all others find their face afterwards
_N_HALVINGS = 40


def checked_cloud(
    points: object, normals: object | None, noise_m: float | None
) -> tuple[FloatArray, FloatArray | None]:
    """Return points (n, 3) and unit normals (n, 3), None where there are none.

    Raises
    ------
    InputError
        Other shapes, numbers that are not finite, normals without length, a noise below zero.
    """
    cloud = check_points("points", points)
    if noise_m is not None and not (np.isfinite(noise_m) and noise_m >= 0):
        raise InputError(f"noise_m must be a number of metres from 0, got {noise_m}")
    if normals is None:
        return cloud, None
    turned = check_points("normals", normals)
    if len(turned) != len(cloud):
        raise InputError(f"{len(turned)} normals for {len(cloud)} points; give one a point")
    length = np.linalg.norm(turned, axis=1, keepdims=True)
    if not length.all():
        raise InputError(f"{int((length == 0).sum())} of {len(turned)} normals have no length")
    return cloud, np.asarray(turned / length)


def too_little(points: FloatArray) -> str:
    """Why places (n, 3) can hold no surface, a sentence; empty where they may."""
    if len(points) < LEAST:
        return f"the points lie in {len(points)} places; a surface needs {LEAST}, so that none was looked for"
    middle = centroid(points)
    try:
        check_spread(len(points), principal(points, middle)[0], middle, 1)
    except FitError as error:
        return f"{error}; no surface was looked for"
    return ""


def thinned(points: FloatArray, most: int) -> IntArray:
    """Return places (m,), in order, of at most so many distinct points (n, 3): one in each cell of a grid."""
    _, first = np.unique(points, axis=0, return_index=True)
    first = np.sort(first)
    if len(first) <= most:
        return first
    distinct = points[first] - points.min(axis=0)
    extent = float(distinct.max())
    low, high = 0.0, extent
    best = first[:: -(-len(first) // most)]
    for _ in range(_N_HALVINGS):
        side = (low + high) / 2
        cells = np.floor(distinct / side).astype(np.int64)
        n = cells.max(axis=0) + 1
        key = (cells[:, 0] * n[1] + cells[:, 1]) * n[2] + cells[:, 2]
        _, one = np.unique(key, return_index=True)
        if len(one) > most:
            low = side
            continue
        best, high = first[np.sort(one)], side
        if len(one) > 0.95 * most:
            break
    return best
