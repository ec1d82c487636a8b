# SPDX-License-Identifier: MIT
"""3-D view of a part: its points or triangles, coloured by the surface that they are on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from completion.parts.division.result import thin_points
from completion.parts.part import Part
from nbv.report.figures.picture import Camera, Picture
from nbv.report.viewer.layers import Category, Classes, Layer, Numbers, Viewer
from scenes.checks import FloatArray, IntArray
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.mesh.mesh_parts import thin_mesh as thinned_mesh
from scenes.scan.colour import surface_rgb

_MOST_POINTS, _MOST_FACES = 30_000, 300_000  # that are shown
_OVERLAP = 0.75  # of the distance to a neighbour: half the side of a point's square
_N_APART = 3  # which neighbour, so that there are no gaps between points at random places
_N_NEAR = 12
_MOST_OFF = 0.99  # quantile of the distances at which the colour bar ends


@dataclass(frozen=True, slots=True, eq=False)
class ShownPart:
    """A part as triangles for display.

    Attributes
    ----------
    mesh : LabelledMesh
        n vertices, m triangles.
    place : (m,) int
        Places of surface labels from 1; 0 for none.
    off_m : (m,) float
        Distances from these surfaces.
    vertex : (n,) int
        The point of the part that each vertex is, or stands about.
    """

    mesh: LabelledMesh
    place: IntArray
    off_m: FloatArray
    vertex: IntArray


def shown_part(part: Part) -> ShownPart:
    """Return the triangles of a part, or a square for each of some of its points, as they were measured."""
    if part.faces is not None and part.triangle_surface is not None:
        vertices, faces, subset = thinned_mesh(part.points, part.faces, _MOST_FACES)
        is_whole = len(faces) == len(part.faces)
        corners = part.surface[subset][faces]
        most: IntArray = np.where(corners[:, 1] == corners[:, 2], corners[:, 1], corners[:, 0])
        number = _places(part, np.asarray(part.triangle_surface if is_whole else most))
        mesh = LabelledMesh(vertices, faces.astype(np.int32))
        return ShownPart(
            mesh, number, _distances(part, mesh.corners.mean(axis=1), number), np.asarray(subset)
        )
    kept = thin_points(part.points, _MOST_POINTS)
    points = part.points[kept]
    number = _places(part, part.surface[kept])
    mesh = point_squares(points, _normals(part, points, number))
    off_m = np.repeat(_distances(part, points, number), 2)
    return ShownPart(mesh, np.repeat(number, 2), off_m, np.repeat(kept, 4))


def part_view(part: Part, shown: ShownPart, pictures: tuple[Picture, ...], camera: Camera) -> Viewer:
    """Return the view of a part, seen from a camera at first."""
    names = [
        Category(f"{label} {fit.surface.kind}", surface_rgb(place))
        for place, (label, fit) in enumerate(zip(part.labels, part.fits, strict=True), start=1)
    ]
    none = Category("none", surface_rgb(0))
    off_mm = 1000 * shown.off_m
    most = float(np.quantile(off_mm[np.isfinite(off_mm)], _MOST_OFF)) if np.isfinite(off_mm).any() else 0.0
    channels = (
        Classes("surface", "Surface", (none, *names), shown.place.astype(np.uint16)),
        Numbers("off", "Distance from it", "mm", off_mm, 0, high=max(most, 1e-3), digits=3),
    )
    layer = Layer("part", "", shown.mesh.vertices, shown.mesh.faces, none, channels=channels)
    return Viewer(
        "The part, coloured by surface.",
        (layer,),
        mode="surface",
        is_room=False,
        pictures=pictures,
        camera=camera,
    )


def _places(part: Part, surface: IntArray) -> IntArray:
    return np.where(surface > 0, np.searchsorted(part.labels, surface) + 1, 0)


def _distances(part: Part, points: FloatArray, place: IntArray) -> FloatArray:
    """Distances (n,) of points from their surfaces as measured, metres; NaN on none."""
    off = np.full(len(points), np.nan)
    for number, fit in enumerate(part.measured, start=1):
        is_member = place == number
        off[is_member] = np.abs(fit.surface.distance(points[is_member]))
    return off


def _normals(part: Part, points: FloatArray, place: IntArray) -> FloatArray:
    """Unit normals (n, 3): of the surface, or across the neighbours where there is none."""
    normals = np.zeros_like(points)
    for number, fit in enumerate(part.measured, start=1):
        is_member = place == number
        normals[is_member] = fit.surface.normal(points[is_member])
    unassigned = np.flatnonzero(place == 0)
    if not len(unassigned):
        return normals
    normals[unassigned] = neighbour_normals(points, points[unassigned])
    return normals


def neighbour_normals(points: FloatArray, places: FloatArray) -> FloatArray:
    """Return unit normals (k, 3) across the points (n, 3) around each place (k, 3), either way round."""
    near = cKDTree(points).query(places, k=min(_N_NEAR, len(points)))[1]
    near = near.reshape(len(places), min(_N_NEAR, len(points)))
    offset = points[near] - points[near].mean(axis=1, keepdims=True)
    return np.asarray(np.linalg.eigh(np.einsum("nki,nkj->nij", offset, offset))[1][:, :, 0])


def point_squares(points: FloatArray, normals: FloatArray) -> LabelledMesh:
    """Return two triangles a point (n, 3), across its normal (n, 3)."""
    near = min(_N_APART, len(points) - 1)
    apart = cKDTree(points).query(points, k=near + 1)[0][:, near] if near else np.ones(len(points))
    half = _OVERLAP * float(np.median(apart)) if len(points) else 0.0
    least = np.eye(3)[np.argmin(np.abs(normals), axis=1)]
    cross = np.cross(normals, least)
    cross /= np.maximum(np.linalg.norm(cross, axis=1, keepdims=True), 1e-300)
    two = np.cross(normals, cross)
    corners = [points + half * (a * cross + b * two) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    first = 4 * np.arange(len(points), dtype=np.int64)[:, None]
    faces = (first[:, :, None] + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3)
    return LabelledMesh(np.stack(corners, axis=1).reshape(-1, 3), faces.astype(np.int32))
