# SPDX-License-Identifier: MIT
"""Unexplained pixels on one page: those of no surface become few triangles that meet the panels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from completion.panels.arrangement import PRECISION_M
from completion.panels.decimation import as_one, decimated
from completion.panels.model import PanelModel, RestFacets
from completion.panels.stitching import Border, along_border, with_nodes
from completion.panels.welding import edges_of, heal
from scenes.checks import BoolArray, FloatArray
from scenes.mesh.triangle_distance import distances
from scenes.rays.raycast import RayCaster
from scenes.surfaces.catalogue import Surface


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
    left = _unexplained(panels, _welded(pixels))

    # 2. Snap: pixels of a surface go to it, and to the border of its panels where that is near.
    snapped = _snapped(panels, left, surfaces, reach_m)

    # 3. Decimate to the bound. Rims on borders are straight by now, and cost nothing.
    places, faces = decimated(snapped.vertices, snapped.faces, pixels.bound_m)
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
    kept = faces[~_doubled(held.panels, vertices, faces, pixels.bound_m)]
    return _joined(held.panels, vertices, kept, pixels)


def _welded(pixels: PixelMesh) -> PixelMesh:
    """The mesh with vertices at the very same place as one: a scan's rows are meshed some at a time."""
    _, first, index = np.unique(as_one(pixels.vertices), return_index=True, return_inverse=True)
    return replace(pixels, faces=first[index][pixels.faces])


def _unexplained(panels: PanelModel, pixels: PixelMesh) -> PixelMesh:
    """The mesh without triangles whose corners are of surfaces, or as near to panels as the scans tell."""
    free = np.flatnonzero(pixels.owner == 0)
    off = distances(pixels.vertices[free], panels.vertices[panels.faces[panels.is_measured]])
    told: BoolArray = pixels.owner > 0
    told[free] = off <= np.minimum(pixels.error_m[free], pixels.bound_m)
    return _part(pixels, ~np.all(told[pixels.faces], axis=1))


def _snapped(
    panels: PanelModel, pixels: PixelMesh, surfaces: Sequence[Surface], reach_m: FloatArray
) -> PixelMesh:
    """The mesh with the vertices of surfaces moved to these and to their borders; others own none.

    Triangles that lose their area or turn over by it are left out.
    """
    moved = pixels.vertices.copy()
    for number in np.unique(pixels.owner[pixels.owner > 0]).tolist():
        own, surface = pixels.owner == number, surfaces[number - 1]
        moved[own] = surface.from_uv(surface.to_uv(moved[own]))
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


def _doubled(panels: PanelModel, vertices: FloatArray, faces: NDArray[np.int64], bound_m: float) -> BoolArray:
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


def _joined(
    panels: PanelModel, vertices: FloatArray, faces: NDArray[np.int64], pixels: PixelMesh
) -> PanelModel:
    """Panels with the triangles of the rest, whose own vertices follow those of the panels."""
    n, n_faces = len(panels.vertices), len(panels.faces)
    own = np.unique(faces[faces >= n])
    index = np.arange(len(vertices))
    index[own] = n + np.arange(len(own))
    places = np.concatenate([panels.vertices, vertices[own]])
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
        rest=RestFacets(every[is_rest], used, nearest.astype(np.int64)),
    )
