# SPDX-License-Identifier: MIT
"""Volume and area of a part's mesh, its vertices moved onto the surfaces that they lie on.

Vertices of a mesh carry noise, and chords of tessellated models lie within round surfaces. Each vertex is
moved, as little as may be, to where it lies on the surfaces of the triangles around it. How volume and area
change with the parameters of these follows from how the vertices move along: N d = -G p, with N the normals
at a vertex and G the derivatives of its distances by the parameters.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from trimesh.remesh import subdivide

from completion.parts.dimensions.dimension import Kind, PartDimension
from completion.parts.dimensions.joint_surfaces import JointSurfaces
from completion.parts.division.divided_part import RelatedPart
from scenes.checks import BoolArray, FloatArray, IntArray
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.mesh.winding import turn_outside_out
from scenes.surfaces.catalogue import Plane

_MOST_TRIANGLES = 300_000  # to which a mesh is cut finer
_ROUNDS = 4
_LEAST_TOLD = 1e-3  # share of the area
_TANGENT = 0.1  # of the largest singular value: normals that are nearer to alike are one
_MOST_MOVED = 0.02  # of the part's size: farther vertices are of no surface
_ROUND_SHARE = 1e-3  # of the part's size, by which a chord's edge may be long for its radius


class _SurfaceVertices(NamedTuple):
    """Vertices (k,) that lie on surfaces (k, m), and the pseudoinverse (k, 3, m) of the normals there."""

    vertex: IntArray
    place: IntArray


def measure_rows(known: JointSurfaces) -> tuple[list[PartDimension], tuple[str, ...]]:
    """Volume and area of a part's mesh, of points none, and what is doubtful of them."""
    part = known.part
    if part.faces is None or part.triangle_surface is None:
        return [], ()
    points, place = np.unique(part.points, axis=0, return_inverse=True)
    mesh = LabelledMesh(points, place.reshape(-1)[part.faces].astype(np.int32))
    turned = turn_outside_out(mesh, np.zeros(len(part.faces), np.int64))
    n_open = int((~turned.is_closed).sum())
    vertices, levels, label = _cut_finely(turned.mesh.vertices, turned.mesh.faces, part, known.size_m)
    groups = list(_on_surfaces(levels[-1], label, part))
    vertices = _moved(vertices, groups, part, known.size_m)
    outward = [_outward(vertices, faces, label[:: len(label) // len(faces)], part) for faces in levels]
    areas = [float(np.einsum("ij,ij->", _across(vertices[faces]), out)) / 2
             for faces, out in zip(levels, outward, strict=True)]  # fmt: skip
    slopes = _area_slopes(vertices, levels[-1], outward[-1])
    area = _row("area", _extrapolated(areas), slopes, vertices=vertices, groups=groups, known=known)
    doubts = []
    without = float(
        turned.mesh.face_areas()[part.triangle_surface == 0].sum() / turned.mesh.face_areas().sum()
    )
    if without > _LEAST_TOLD:
        doubts.append(
            f"volume and area count the {100 * without:.1f} % of the mesh on no surface as they are"
        )
    if n_open:
        what = f"{n_open} of {len(part.faces)} triangles are of no closed component"
        doubts.append(f"the mesh is open ({what}): no volume, and its area is that of what is there")
        return [area], tuple(doubts)
    middle = vertices.mean(axis=0)
    volumes = [float(np.einsum("ij,ij->", vertices[faces[:, 0]] - middle, _across(vertices[faces]))) / 6
               for faces in levels]  # fmt: skip
    slopes = np.zeros_like(vertices)
    for k in range(3):
        np.add.at(slopes, levels[-1][:, k], _across(vertices[levels[-1]]) / 6)
    volume = _row("volume", _extrapolated(volumes), slopes, vertices=vertices, groups=groups, known=known)
    return [volume, area], tuple(doubts)


def _across(corners: FloatArray) -> FloatArray:
    """Normals (m, 3) of triangles, twice as long as their area."""
    return np.asarray(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))


def _extrapolated(values: Sequence[float]) -> float:
    """What values of a mesh come to as it is cut finer: chords miss by the square of their length."""
    return values[-1] if len(values) < 2 else values[-1] + (values[-1] - values[-2]) / 3


def _outward(vertices: FloatArray, faces: IntArray, label: IntArray, part: RelatedPart) -> FloatArray:
    """Unit normals (m, 3) of the surfaces that triangles lie on, out of the part; their own where on none.

    Along a border some triangles are on the wrong one of two surfaces, and are folded over when their corners
    are moved: against the surface's normal they count less than nothing, and so make up for others.
    """
    corners = vertices[faces]
    across = _across(corners)
    out: FloatArray = across / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-300)
    for name, fit in zip(part.labels, part.fits, strict=True):
        own = label == name
        normal = fit.surface.normal(corners[own].mean(axis=1))
        out[own] = normal * np.sign(np.einsum("ij,ij->", normal, across[own]))
    return out


def _cut_finely(
    vertices: FloatArray, faces: IntArray, part: RelatedPart, size_m: float
) -> tuple[FloatArray, list[IntArray], IntArray]:
    """A mesh with every triangle cut in four until chords of round surfaces are short, or it has many.

    Vertices, the last two levels of triangles, which are of the same vertices, and labels of the last.
    """
    levels = [faces]
    label = np.asarray(part.triangle_surface, dtype=np.int64)
    radius = {
        name: float(getattr(fit.surface, "tube_radius", getattr(fit.surface, "radius", np.inf)))
        for name, fit in zip(part.labels, part.fits, strict=True)
        if not isinstance(fit.surface, Plane)
    }
    while 4 * len(faces) <= _MOST_TRIANGLES:
        edges = np.linalg.norm(vertices[faces] - vertices[np.roll(faces, 1, axis=1)], axis=2).max(axis=1)
        sag = max(
            (float((edges[label == name] ** 2).max(initial=0.0)) / (8 * r) for name, r in radius.items()),
            default=0.0,
        )
        if sag <= 1e-3 * _ROUND_SHARE * size_m:
            break
        vertices, faces = subdivide(vertices, faces)
        levels, label = [levels[-1], faces], np.repeat(label, 4)
    return vertices, levels, label


def _on_surfaces(faces: IntArray, label: IntArray, part: RelatedPart) -> Iterator[_SurfaceVertices]:
    """Vertices by how many surfaces they lie on."""
    place = np.searchsorted(part.labels, label)
    pairs = np.unique(np.column_stack([faces.ravel(), np.repeat(place, 3)])[np.repeat(label, 3) > 0], axis=0)
    vertex, first, count = np.unique(pairs[:, 0], return_index=True, return_counts=True)
    for n in np.unique(count):
        here = first[count == n]
        yield _SurfaceVertices(vertex[count == n], pairs[here[:, None] + np.arange(n), 1])


def _normals(
    group: _SurfaceVertices, vertices: FloatArray, part: RelatedPart
) -> tuple[FloatArray, FloatArray]:
    """Pseudoinverses (k, 3, m) of the normals at vertices, and their distances (k, m) from the surfaces."""
    normals, distance = np.zeros((*group.place.shape, 3)), np.zeros(group.place.shape)
    for place in np.unique(group.place):
        which = group.place == place
        points = vertices[np.broadcast_to(group.vertex[:, None], which.shape)[which]]
        surface = part.fits[place].surface
        normals[which], distance[which] = surface.normal(points), surface.distance(points)
    return np.linalg.pinv(normals, rcond=_TANGENT), distance


def _moved(
    vertices: FloatArray, groups: list[_SurfaceVertices], part: RelatedPart, size_m: float
) -> FloatArray:
    """Vertices (n, 3) on their surfaces; those stay that are far from them."""
    moved = vertices.copy()
    for _ in range(_ROUNDS):
        for group in groups:
            inverse, distance = _normals(group, moved, part)
            moved[group.vertex] -= np.einsum("kim,km->ki", inverse, distance)
    is_far: BoolArray = ~(np.linalg.norm(moved - vertices, axis=1) <= _MOST_MOVED * size_m)
    moved[is_far] = vertices[is_far]
    return moved


def _area_slopes(vertices: FloatArray, faces: IntArray, outward: FloatArray) -> FloatArray:
    """Derivative (n, 3) of the area by the vertices."""
    corners, slopes = vertices[faces], np.zeros_like(vertices)
    for k in range(3):
        opposite = corners[:, (k + 2) % 3] - corners[:, (k + 1) % 3]
        np.add.at(slopes, faces[:, k], np.cross(outward, opposite) / 2)
    return slopes


def _row(
    kind: Kind, value: float, slopes: FloatArray,
    *, vertices: FloatArray, groups: list[_SurfaceVertices], known: JointSurfaces,
) -> PartDimension:  # fmt: skip
    """The dimension whose derivative by the vertices is `slopes` (n, 3)."""
    part, ends = known.part, np.repeat(vertices.mean(axis=0)[None], 2, axis=0)
    by = [np.zeros(len(fit.covariance)) for fit in part.fits]
    for group in groups:
        inverse, _ = _normals(group, vertices, part)
        weight = np.einsum("kim,ki->km", inverse, slopes[group.vertex])
        for place in np.unique(group.place):
            row, column = np.nonzero(group.place == place)
            gradient = part.measured[place].gradient(vertices[group.vertex[row]])
            by[place] -= weight[row, column] @ gradient
    gradient = np.concatenate([np.zeros(0), *by])
    sd, before = (
        float(np.sqrt(max(gradient @ each @ gradient, 0.0)))
        for each in (known.covariance, known.measured_covariance)
    )
    return PartDimension(kind=kind, value=value, sd=sd, measured_sd=before, surfaces=part.labels, ends=ends)
