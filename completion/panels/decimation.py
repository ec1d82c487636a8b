# SPDX-License-Identifier: MIT
"""Decimation: the fewest triangles whose deviation from a mesh stays within a bound."""

from __future__ import annotations

import fast_simplification
import numpy as np
from numpy.typing import NDArray

from completion.panels.welding import edges_of
from scenes.checks import FloatArray
from scenes.mesh.triangle_distance import TriangleTree, distances

_SHARE = 0.95  # of the places that are measured, whose deviation stays within the bound
_FIRST = 0.2  # share of the triangles that is tried first
_FEWEST = 1 / 256  # share of them that is left at least
_ROUNDS, _CLOSE = 6, 0.05  # of the search, which ends where the number of triangles is known to 5 %
_PLACES = 5_000  # of either mesh at which the deviation is measured
_LEAST = 1e-3  # of the bound, below which deviations are alike

Mesh = tuple[FloatArray, NDArray[np.int64]]
"""Vertices (n, 3), metres, and triangles (m, 3)."""


def decimated(vertices: FloatArray, faces: NDArray[np.int64], bound_m: float) -> Mesh:
    """Thin a mesh (n, 3), metres, (m, 3) by quadrics (Garland & Heckbert 1997) as far as a bound allows.

    A share of the triangles says nothing of the error, so their number is searched for: 95 % of the vertices
    lie within the bound of the thinner mesh, and 95 % of its vertices and of its triangles' middles within
    the bound of what was given. Borders stay where they are as far as the bound allows, and no two of them
    are joined. Returns the vertices (k, 3) and triangles (l, 3).
    """
    best = vertices, faces
    if len(faces) < 2 or bound_m <= 0:
        return best
    tree = TriangleTree.of(vertices[faces])
    few, many, tried = (float(np.log(_FEWEST)), np.inf), (0.0, -np.inf), float(np.log(_FIRST))
    for _ in range(_ROUNDS):
        found = _thinner(vertices, faces, bound_m, max(1, round(len(faces) * float(np.exp(tried)))))
        excess = float(np.log(max(_deviation(vertices, tree, found, bound_m) / bound_m, _LEAST)))
        if excess <= 0:
            best, many = found, (tried, excess)
        else:
            few = tried, excess
        if many[0] - few[0] < _CLOSE:
            break
        tried = _next(few, many, tried + excess)
    return best


def _next(few: tuple[float, float], many: tuple[float, float], guess: float) -> float:
    """Where between two numbers of triangles the deviation may reach the bound; all as logarithms.

    Of each its logarithm and that of the deviation over the bound. They are taken to depend on each other by
    a power, the first where only one is known.
    """
    width = many[0] - few[0]
    if np.isfinite(few[1]) and np.isfinite(many[1]):
        guess = few[0] + width * few[1] / (few[1] - many[1])
    return float(np.clip(guess, few[0] + 0.2 * width, many[0] - 0.2 * width))


def deviation(whole: Mesh, few: Mesh) -> float:
    """How far a mesh and a thinner one, vertices (n, 3) and triangles (m, 3), stand off each other, metres.

    The 95th percentile over the vertices of the first, or over the vertices and the triangles' middles of the
    second, whichever is larger. Of very many, some are measured, evenly spread. Infinite where nothing is
    left.
    """
    return _deviation(whole[0], TriangleTree.of(whole[0][whole[1]]), few, np.inf)


def _deviation(vertices: FloatArray, tree: TriangleTree, few: Mesh, bound_m: float) -> float:
    """The same of used vertices and the tree of their triangles; beyond the bound one way is enough."""
    places, corners = few
    if not len(corners):
        return float("inf")
    off = float(np.quantile(distances(_some(vertices), places[corners]), _SHARE))
    if off > bound_m:
        return off
    back = (_some(points) for points in (places[np.unique(corners)], places[corners].mean(axis=1)))
    return max(off, *(float(np.quantile(tree.distances(points), _SHARE)) for points in back))


def _some(points: FloatArray) -> FloatArray:
    """At most 5000 of points (n, 3), evenly spread."""
    if len(points) <= _PLACES:
        return points
    return points[np.linspace(0, len(points) - 1, _PLACES).astype(np.int64)]


def _thinner(vertices: FloatArray, faces: NDArray[np.int64], bound_m: float, n_faces: int) -> Mesh:
    """The mesh with about so many triangles; lengths in bounds, so that the order of collapses has no unit.

    A flap stands on every open edge, across its triangle: by its plane the border costs what it costs to move
    it. Flaps collapse with their edge; those that are left are taken away.
    """
    tips, flaps = _flaps(vertices, faces)
    points = np.concatenate([vertices, tips]) / bound_m
    corners = np.concatenate([faces, flaps]).astype(np.int32)
    places, found = fast_simplification.simplify(points, corners, target_count=min(n_faces, len(corners)))
    is_tip = np.isin(as_one(places), as_one(points[len(vertices) :]))
    return _compact(places * bound_m, found[~is_tip[found].any(axis=1)].astype(np.int64))


def as_one(points: FloatArray) -> NDArray[np.void]:
    """Return points (n, 3) as n values that are equal only if all their bytes are."""
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


def _compact(vertices: FloatArray, faces: NDArray[np.int64]) -> Mesh:
    """A mesh without the vertices that no triangle uses."""
    used, index = np.unique(faces, return_inverse=True)
    return vertices[used], index.reshape(-1, 3).astype(np.int64)
