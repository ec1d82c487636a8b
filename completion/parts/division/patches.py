# SPDX-License-Identifier: MIT
"""Triangles of a model's mesh that lie in one plane, and which of these patches bend on to the next."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components

from completion.parts.division import limits
from scenes.checks import BoolArray, FloatArray, IntArray
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.surfaces.catalogue import Surface

_END = 0.05  # of an edge


class Patches(NamedTuple):
    """Patches (p,) of coplanar triangles.

    `of` (m,) is that of each triangle, of `areas` (m,). `triangle` (m,) and `corner` (k,) are triangles and
    vertices in order of their patches: of patch i from `first_triangle[i]` and `first[i]` to the next.
    `bends` (p, p) links neighbours that turn little; `n_triangles` in each; `is_thin`: its normal says
    nothing; `is_inner`: it has no sharp edge.
    """

    of: IntArray
    triangle: IntArray
    first_triangle: IntArray
    areas: FloatArray
    area: FloatArray
    normal: FloatArray
    centroid: FloatArray
    first: IntArray
    corner: IntArray
    bends: csr_array
    n_triangles: IntArray
    is_seed: BoolArray
    is_thin: BoolArray
    is_inner: BoolArray
    mesh: LabelledMesh
    tolerance_m: float

    def triangles_of(self, some: IntArray) -> IntArray:
        """Triangles (k,) of patches, in their order."""
        return self.triangle[ranges(self.first_triangle, some)[0]]

    def turns(self, triangles: IntArray, surface: Surface) -> FloatArray:
        """Largest angle (k,) that a surface turns by along an edge of triangles, radians."""
        one = self.mesh.vertices[self.mesh.faces[triangles]]
        two = np.roll(one, 1, axis=1)
        inner = [
            (1 - t) * one + t * two for t in (_END, 1 - _END)
        ]  # not at an apex, where there is no normal
        ends = [surface.normal(points.reshape(-1, 3)).reshape(-1, 3, 3) for points in inner]
        turn = np.arccos(np.clip(np.einsum("kij,kij->ki", *ends), -1, 1)).max(axis=1) / (1 - 2 * _END)
        return np.asarray(turn)

    def sags(self, triangles: IntArray, surface: Surface) -> FloatArray:
        """How far triangles (k,) lie off a surface at most, at the middles of their edges."""
        corners = self.mesh.vertices[self.mesh.faces[triangles]]
        middles = (corners + np.roll(corners, 1, axis=1)) / 2
        return np.asarray(np.abs(surface.distance(middles.reshape(-1, 3))).reshape(-1, 3).max(axis=1))


def most_turn(turn: FloatArray, area: FloatArray, surface: Surface, n_triangles: IntArray) -> FloatArray:
    """Return how far a surface may turn across chords (k,) of so many triangles, radians.

    Of the usual turn across its chords (n,), by area: a wider chord of a cylinder is a flat, as is one of
    many triangles on what bends both ways; others there may be diagonals.
    """
    order = np.argsort(turn, kind="stable")
    usual = float(turn[order][np.searchsorted(np.cumsum(area[order]), area.sum() / 2)])
    is_one = (n_triangles <= 2) & (surface.kind in ("sphere", "torus"))
    ratio = np.where(is_one, limits.TURN_RATIO, limits.WIDER)
    return np.minimum(ratio * usual + limits.FLAT_ANGLE, limits.MOST_TURN)


def ranges(first: IntArray, some: IntArray) -> tuple[IntArray, IntArray]:
    """Return places (k,) from `first[i]` to the next for each i of some (n,), and which (k,) it is of."""
    count = first[some + 1] - first[some]
    which = np.repeat(np.arange(len(some)), count)
    start = first[some] - np.concatenate([[0], np.cumsum(count)[:-1]])
    return np.arange(len(which)) + start[which], which


def patches_of(mesh: LabelledMesh, tolerance_m: float) -> Patches:
    """Return triangles joined where they lie in one plane to a tolerance, metres."""
    n, areas, normals = len(mesh.faces), mesh.face_areas(), mesh.face_normals()
    a, b, over = pairs_of(mesh)
    large, small = np.where(areas[a] >= areas[b], a, b), np.where(areas[a] >= areas[b], b, a)
    other = np.where(areas[a] >= areas[b], over[:, 1], over[:, 0])
    height = np.einsum("ij,ij->i", mesh.vertices[other] - mesh.vertices[mesh.faces[large, 0]], normals[large])
    is_flat = np.abs(height) <= tolerance_m
    same = np.einsum("ij,ij->i", normals[a], normals[b])
    is_thin = 2 * areas <= limits.THIN * tolerance_m * _longest(mesh)
    wide = 2 * areas / np.maximum(_longest(mesh), 1e-300)
    unsure = limits.EXACTLY_FLAT + limits.ROUNDED * tolerance_m / np.maximum(wide[small], 1e-300)
    is_flat &= (np.arccos(np.clip(same, -1, 1)) <= unsure) & ~is_thin[small]
    graph = coo_array((np.ones(is_flat.sum()), (a[is_flat], b[is_flat])), shape=(n, n))
    of = connected_components(graph, directed=False)[1].astype(np.int64)
    p = int(of.max()) + 1
    area: FloatArray = np.bincount(of, areas, minlength=p).astype(np.float64)
    normal: FloatArray = np.column_stack([np.bincount(of, areas * way, minlength=p) for way in normals.T])
    normal = normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    middle = mesh.corners.mean(axis=1)
    centroid: FloatArray = np.column_stack([np.bincount(of, areas * one, minlength=p) for one in middle.T])
    centroid = centroid / np.maximum(area[:, None], 1e-300)
    pairs = _outline_corners(mesh, of, tolerance_m)
    first = np.searchsorted(pairs[:, 0], np.arange(p + 1))
    i, j = of[a], of[b]
    apart = i != j
    i, j = i[apart], j[apart]
    turn = np.arccos(np.clip(np.einsum("ij,ij->i", normal[i], normal[j]), -1, 1))
    inner = np.ones(p, np.bool_)
    inner[np.concatenate([i[turn >= limits.FACET_TURN], j[turn >= limits.FACET_TURN]])] = False
    thin = np.ones(p, np.bool_)
    np.logical_and.at(thin, of, is_thin)
    bent = (turn < limits.FACET_TURN) | thin[i] | thin[j]
    both = np.concatenate([i[bent], j[bent]]), np.concatenate([j[bent], i[bent]])
    bends = csr_array((np.ones(len(both[0])), both), shape=(p, p))
    count = np.bincount(of, minlength=p)
    is_seed = (area > 0) & ~thin
    order = np.argsort(of, kind="stable")
    first_triangle = np.concatenate([[0], np.cumsum(count)])
    return Patches(
        of, order, first_triangle, areas, area, normal=normal, centroid=centroid, first=first,
        corner=pairs[:, 1], bends=bends, n_triangles=count, is_seed=is_seed, is_thin=thin, is_inner=inner,
        mesh=mesh, tolerance_m=tolerance_m,
    )  # fmt: skip


def _outline_corners(mesh: LabelledMesh, of: IntArray, tolerance_m: float) -> IntArray:
    """Patch and vertex (k, 2), ascending, where outlines of patches turn: not within a side, nor inside."""
    faces, n = mesh.faces.astype(np.int64), len(mesh.vertices)
    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    patch = np.repeat(of, 3)
    key = (patch * n + np.minimum(start, end)) * n + np.maximum(start, end)
    _, place, count = np.unique(key, return_inverse=True, return_counts=True)
    outer = count[place.reshape(-1)] == 1
    start, end, patch = start[outer], end[outer], patch[outer]
    at = np.concatenate([patch * n + start, patch * n + end])
    other = np.concatenate([end, start])
    order = np.argsort(at, kind="stable")
    at, other = at[order], other[order]
    known, first, count = np.unique(at, return_index=True, return_counts=True)
    vertex = known % n
    last = np.minimum(first + 1, len(other) - 1)
    sides = [mesh.vertices[other[place]] - mesh.vertices[vertex] for place in (first, last)]
    across = np.linalg.norm(np.cross(*sides), axis=1)
    chord = np.linalg.norm(sides[0] - sides[1], axis=1)
    is_straight = (count == 2) & (across <= tolerance_m * chord)
    is_straight &= np.einsum("ij,ij->i", *sides) < 0
    return np.asarray(np.column_stack([known // n, vertex])[~is_straight])


def _longest(mesh: LabelledMesh) -> FloatArray:
    """Longest edge (m,) of each triangle."""
    return np.asarray(np.linalg.norm(mesh.corners - np.roll(mesh.corners, 1, axis=1), axis=2).max(axis=1))


def pairs_of(mesh: LabelledMesh) -> tuple[IntArray, IntArray, IntArray]:
    """Return triangles (e,), (e,) beside edges, and the corner (e, 2) of each that is not on it."""
    edges = np.sort(mesh.faces[:, [[0, 1], [1, 2], [2, 0]]], axis=2).reshape(-1, 2)
    triangle, opposite = np.repeat(np.arange(len(mesh.faces)), 3), mesh.faces[:, [2, 0, 1]].ravel()
    order = np.lexsort((edges[:, 1], edges[:, 0]))
    edges, triangle, opposite = edges[order], triangle[order], opposite[order]
    start = np.flatnonzero(np.concatenate([[True], (edges[1:] != edges[:-1]).any(axis=1)]))
    twice = start[np.diff(np.append(start, len(edges))) == 2]
    return triangle[twice], triangle[twice + 1], np.column_stack([opposite[twice], opposite[twice + 1]])
