# SPDX-License-Identifier: MIT
"""Unexplained pixels on one page: those of no surface become few triangles that meet the panels.

They are the fewest whose deviation from the pixels' mesh stays within a bound.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import fast_simplification
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from completion.export.panels.limits import PRECISION_M, WITHIN_BOUND
from completion.export.panels.model import PanelModel, RemainderFacets
from completion.export.panels.stitching import Border, along_border, with_nodes
from completion.export.panels.welding import edges_of, heal
from scenes.checks import BoolArray, FloatArray
from scenes.mesh.triangle_distance import TriangleTree, distances
from scenes.rays.raycast import RayCaster
from scenes.surfaces.catalogue import Surface

_FIRST = 0.2  # share of the triangles that is tried first
_FEWEST = 1 / 256  # share of them that is left at least
_ROUNDS, _CLOSE = 6, 0.05  # of the search, which ends where the number of triangles is known to 5 %
_PLACES = 5_000  # of either mesh at which the deviation is measured
_LEAST = 1e-3  # of the bound, below which deviations are alike

Mesh = tuple[FloatArray, NDArray[np.int64]]
"""Vertices (n, 3), metres, and triangles (m, 3)."""


def decimate(vertices: FloatArray, faces: NDArray[np.int64], bound_m: float) -> Mesh:
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
        thinner = _thinner(vertices, faces, bound_m, max(1, round(len(faces) * float(np.exp(tried)))))
        excess = float(np.log(max(_deviation(vertices, tree, thinner, bound_m) / bound_m, _LEAST)))
        if excess <= 0:
            best, many = thinner, (tried, excess)
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
    off = float(np.quantile(distances(_some(vertices), places[corners]), WITHIN_BOUND))
    if off > bound_m:
        return off
    back = (_some(points) for points in (places[np.unique(corners)], places[corners].mean(axis=1)))
    return max(off, *(float(np.quantile(tree.distances(points), WITHIN_BOUND)) for points in back))


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
    places, corners_left = fast_simplification.simplify(
        points, corners, target_count=min(n_faces, len(corners))
    )
    is_tip = np.isin(as_one(places), as_one(points[len(vertices) :]))
    return _compact(places * bound_m, corners_left[~is_tip[corners_left].any(axis=1)].astype(np.int64))


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


@dataclass(frozen=True, slots=True, eq=False)
class PixelMesh:
    """The pixels that belong to no surface, with one ring of others around them, as a mesh.

    Attributes
    ----------
    vertices : (n, 3) float
        Metres, working frame.
    faces : (m, 3) int
        Triangles.
    owner : (n,) int
        Number of the surface of each vertex, from 1; 0 for none.
    error_m : (n,) float
        What the scan cannot tell apart at each, metres.
    """

    vertices: FloatArray
    faces: NDArray[np.int64]
    owner: NDArray[np.int64]
    error_m: FloatArray

    @property
    def bound_m(self) -> float:
        """What the scans cannot tell apart where no surface explains them, as the median, metres."""
        free = self.error_m[self.owner == 0]
        return float(np.median(free)) if len(free) else 0.0


def light_rest(
    panels: PanelModel, pixels: PixelMesh, surfaces: Sequence[Surface], reach_m: FloatArray
) -> PanelModel:
    """Add what no surface explains to the light model, as few triangles that share vertices with the panels.

    95 % of the places of the pixels lie within the bound of the model, and 95 % of its places within that of
    the pixels, or on panels.

    Parameters
    ----------
    panels : PanelModel
        The surfaces.
    pixels : PixelMesh
        What no surface explains.
    surfaces : sequence of Surface
        All of them, in the order of their numbers.
    reach_m : (surfaces,) float
        How far from a panel's border its outermost pixels may lie, metres.
    """
    # 1. Clip: what lies on panels, as far as the scans can tell, is in the model already.
    left = _drop_explained(panels, _weld_pixels(pixels))

    # 2. Snap: pixels of a surface go to it, and to the border of its panels where that is near.
    snapped = _snap_to_panels(panels, left, surfaces, reach_m)

    # 3. Decimate to the bound. Rims on borders are straight by now, and cost nothing.
    places, faces = decimate(snapped.vertices, snapped.faces, pixels.bound_m)
    if not len(faces):
        return panels

    # 4. Stitch: put the rim's vertices on the borders as nodes of both, and the borders' nodes into the rim.
    edges, count, _ = edges_of(faces)
    rim, owner = np.unique(edges[count == 1]), np.zeros(len(places), np.int64)
    owner[rim] = snapped.owner[cKDTree(snapped.vertices).query(places[rim])[1]]
    held = with_nodes(panels, places, owner, reach_m)
    index = np.where(held.vertex >= 0, held.vertex, len(held.panels.vertices) + np.arange(len(places)))
    vertices = np.concatenate([held.panels.vertices, places])
    faces = along_border(held.panels, _proper(index[faces]), vertices, float(reach_m.max(initial=0)))
    faces = _proper(faces)
    kept = faces[~_covered_triangles(held.panels, vertices, faces, pixels.bound_m)]
    return _join_rest(held.panels, vertices, kept, pixels)


def _weld_pixels(pixels: PixelMesh) -> PixelMesh:
    """The mesh with vertices at the very same place as one: a scan's rows are meshed some at a time."""
    _, first, index = np.unique(as_one(pixels.vertices), return_index=True, return_inverse=True)
    return replace(pixels, faces=first[index][pixels.faces])


def _drop_explained(panels: PanelModel, pixels: PixelMesh) -> PixelMesh:
    """The mesh without triangles whose corners are of surfaces, or as near to panels as the scans tell."""
    free = np.flatnonzero(pixels.owner == 0)
    off = distances(pixels.vertices[free], panels.vertices[panels.faces[panels.is_measured]])
    is_member: BoolArray = pixels.owner > 0
    is_member[free] = off <= np.minimum(pixels.error_m[free], pixels.bound_m)
    return _part(pixels, ~np.all(is_member[pixels.faces], axis=1))


def _snap_to_panels(
    panels: PanelModel, pixels: PixelMesh, surfaces: Sequence[Surface], reach_m: FloatArray
) -> PixelMesh:
    """The mesh with the vertices of surfaces moved to these and to their borders; others own none.

    Triangles that lose their area or turn over by it are left out.
    """
    moved = pixels.vertices.copy()
    for number in np.unique(pixels.owner[pixels.owner > 0]).tolist():
        is_member, surface = pixels.owner == number, surfaces[number - 1]
        moved[is_member] = surface.from_uv(surface.to_uv(moved[is_member]))
    border = Border.of(panels)
    place = border.nearest(moved, pixels.owner, reach_m)
    on = place.edge >= 0
    moved[on] = border.at(place)
    before, after = (_normals(places, pixels.faces) for places in (pixels.vertices, moved))
    result = replace(pixels, vertices=moved, owner=np.where(on, pixels.owner, 0))
    return _part(result, (before * after).sum(axis=1) > 0)


def _part(pixels: PixelMesh, kept: BoolArray) -> PixelMesh:
    """Some of the triangles (m,) with the vertices that they use."""
    used, index = np.unique(pixels.faces[kept], return_inverse=True)
    corners = index.reshape(-1, 3).astype(np.int64)
    return PixelMesh(pixels.vertices[used], corners, pixels.owner[used], pixels.error_m[used])


def _proper(faces: NDArray[np.int64]) -> NDArray[np.int64]:
    """Triangles (m, 3) that have three corners, each once."""
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
    return faces[np.sort(np.unique(np.sort(faces, axis=1), axis=0, return_index=True)[1])]


def _normals(vertices: FloatArray, faces: NDArray[np.int64]) -> FloatArray:
    """Normals (m, 3) of triangles, as long as twice their areas."""
    first, second, third = (vertices[faces[:, k]] for k in range(3))
    return np.asarray(np.cross(second - first, third - first), dtype=np.float64)


def _covered_triangles(
    panels: PanelModel, vertices: FloatArray, faces: NDArray[np.int64], bound_m: float
) -> BoolArray:
    """Which triangles (m, 3) have corners on panels alone, and a panel within a bound of their middle."""
    within = np.zeros(len(faces), np.bool_)
    asked = np.flatnonzero((faces < len(panels.vertices)).all(axis=1))
    if not len(asked):
        return within
    caster, middle = RayCaster(panels.vertices, panels.faces), vertices[faces[asked]].mean(axis=1)
    normal = _normals(vertices, faces[asked])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    off = [caster.first_hit(middle - side * bound_m * normal, side * normal).ranges for side in (1.0, -1.0)]
    within[asked] = np.minimum(*off) <= 2 * bound_m
    return within


def _join_rest(
    panels: PanelModel, vertices: FloatArray, faces: NDArray[np.int64], pixels: PixelMesh
) -> PanelModel:
    """Panels with the triangles of the rest, whose own vertices follow those of the panels."""
    n, n_faces = len(panels.vertices), len(panels.faces)
    members = np.unique(faces[faces >= n])
    index = np.arange(len(vertices))
    index[members] = n + np.arange(len(members))
    places = np.concatenate([panels.vertices, vertices[members]])
    uv = np.concatenate([panels.corner_uv, np.zeros((len(faces), 3, 2))])
    every, uv, source = heal(places, np.concatenate([panels.faces, index[faces]]), uv, PRECISION_M)
    is_rest = source >= n_faces
    of = source[~is_rest]
    used = np.unique(every[is_rest])
    known = np.unique(pixels.faces)
    nearest = known[cKDTree(pixels.vertices[known]).query(places[used])[1]] if len(used) else used
    return replace(
        panels,
        vertices=places,
        faces=every[~is_rest],
        face_surface=panels.face_surface[of],
        face_provenance=panels.face_provenance[of],
        corner_uv=uv[~is_rest],
        remainder=RemainderFacets(every[is_rest], used, nearest.astype(np.int64)),
    )
