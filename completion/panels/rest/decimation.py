# SPDX-License-Identifier: MIT
"""Decimation: the fewest triangles whose deviation from a mesh stays within a bound."""

from __future__ import annotations

import fast_simplification
import numpy as np
from numpy.typing import NDArray

from completion.panels.healing import edges_of
from scenes.checks import FloatArray
from scenes.mesh.triangle_distance import distances

_SHARE = 0.95  # of the places that are measured, whose deviation stays within the bound
_ROUNDS = 7  # of bisection: the number of triangles is found to 4 %
_FEWEST = 256  # times fewer triangles than there were, at most
_PLACES = 5_000  # of either mesh at which the deviation is measured


def decimated(
    vertices: FloatArray, faces: NDArray[np.int64], bound_m: float
) -> tuple[FloatArray, NDArray[np.int64]]:
    """Thin a mesh (n, 3), metres, (m, 3) by quadrics (Garland & Heckbert 1997) as far as a bound allows.

    A share of the triangles says nothing of the error, so their number is found by bisection: 95 % of the
    vertices lie within the bound of the thinner mesh, and 95 % of its vertices and of its triangles' middles
    within the bound of what was given. Borders stay where they are as far as the bound allows, and no two of
    them are joined. Returns the vertices (k, 3) and triangles (l, 3).
    """
    whole = vertices, faces
    if len(faces) < 2 or bound_m <= 0:
        return whole
    best, few, many = whole, -float(np.log(_FEWEST)), 0.0
    for _ in range(_ROUNDS):
        middle = (few + many) / 2
        found = _thinner(vertices, faces, bound_m, max(1, round(len(faces) * float(np.exp(middle)))))
        if deviation(whole, found) <= bound_m:
            best, many = found, middle
        else:
            few = middle
    return best


def deviation(
    whole: tuple[FloatArray, NDArray[np.int64]], few: tuple[FloatArray, NDArray[np.int64]]
) -> float:
    """How far a mesh and a thinner one, vertices (n, 3) and triangles (m, 3), stand off each other, metres.

    The 95th percentile over the vertices of the first, or over the vertices and the triangles' middles of the
    second, whichever is larger. Of very many, some are measured, evenly spread. Infinite where nothing is
    left.
    """
    (vertices, faces), (places, corners) = whole, few
    if not len(corners):
        return float("inf")
    off = distances(_some(vertices[np.unique(faces)]), places[corners])
    back = [
        distances(_some(points), vertices[faces])
        for points in (places[np.unique(corners)], places[corners].mean(axis=1))
    ]
    return max(float(np.quantile(one, _SHARE)) for one in (off, *back))


def _some(points: FloatArray) -> FloatArray:
    """At most 5000 of points (n, 3), evenly spread."""
    if len(points) <= _PLACES:
        return points
    return points[np.linspace(0, len(points) - 1, _PLACES).astype(np.int64)]


def _thinner(
    vertices: FloatArray, faces: NDArray[np.int64], bound_m: float, n_faces: int
) -> tuple[FloatArray, NDArray[np.int64]]:
    """The mesh with about so many triangles; lengths in bounds, so that the order of collapses has no unit.

    A flap stands on every open edge, across its triangle: by its plane the border costs what it costs to move
    it. Flaps collapse with their edge; those that are left are taken away.
    """
    tips, flaps = _flaps(vertices, faces)
    points = np.concatenate([vertices, tips]) / bound_m
    corners = np.concatenate([faces, flaps]).astype(np.int32)
    places, found = fast_simplification.simplify(points, corners, target_count=min(n_faces, len(corners)))
    is_tip = np.isin(_as_one(places), _as_one(points[len(vertices) :]))
    return compact(places * bound_m, found[~is_tip[found].any(axis=1)].astype(np.int64))


def _as_one(points: FloatArray) -> NDArray[np.void]:
    """Points (n, 3) as n values that are equal only if all their bytes are."""
    return np.ascontiguousarray(points).view(np.dtype((np.void, 3 * points.dtype.itemsize))).ravel()


def _flaps(vertices: FloatArray, faces: NDArray[np.int64]) -> tuple[FloatArray, NDArray[np.int64]]:
    """A triangle on each open edge, at a right angle to its own: their tips (k, 3) and corners (k, 3)."""
    half = np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2)
    edges, count, _ = edges_of(faces)
    n = len(vertices)
    known, key = (rows[:, 0] * n + rows[:, 1] for rows in (edges, np.sort(half, axis=1)))
    is_open = np.flatnonzero(count[np.searchsorted(known, key)] == 1)
    begin, end = half[is_open].T
    first, second, third = (vertices[faces[is_open // 3, k]] for k in range(3))
    normal = np.cross(second - first, third - first)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    length = np.linalg.norm(vertices[end] - vertices[begin], axis=1, keepdims=True)
    tips = (vertices[begin] + vertices[end]) / 2 + normal * length
    return tips, np.stack([end, begin, n + np.arange(len(tips))], axis=1)


def compact(vertices: FloatArray, faces: NDArray[np.int64]) -> tuple[FloatArray, NDArray[np.int64]]:
    """Return a mesh (n, 3), (m, 3) without the vertices that no triangle uses."""
    used, index = np.unique(faces, return_inverse=True)
    return vertices[used], index.reshape(-1, 3).astype(np.int64)
