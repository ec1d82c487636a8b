# SPDX-License-Identifier: MIT
"""Values on a surface, by its samples: of any point, of finely cut faces, and as pictures from two sides."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from nbv.coverage.coverage import Coverage
from nbv.report.figures.drawing import MeshDrawing, mark_hatched, mark_modelled, paint_states
from nbv.report.figures.picture import Picture, best_side, overview_cameras, picture_of
from nbv.visibility.samples import SurfaceSamples
from nbv.visibility.zones import EVERYWHERE, Zones
from scenes.checks import FloatArray
from scenes.mesh.labelled_mesh import LabelledMesh, triangle_areas
from scenes.world.scene import Scene


def below(mesh: LabelledMesh, height_m: float) -> tuple[LabelledMesh, NDArray[np.int64]]:
    """Return the part of a mesh below a level plane, and of which face of the mesh each of its faces (m,) is.

    Faces that the plane cuts are cut along it and keep the side to which they turn.
    """
    corners = mesh.corners
    low = corners[..., 2] <= height_m
    n_low = low.sum(axis=1)
    whole = np.flatnonzero(n_low == 3)
    parts, of = [corners[whole]], [whole]
    for n in (1, 2):
        faces = np.flatnonzero(n_low == n)
        alone = np.argmax(low[faces] == (n == 1), axis=1)  # the corner that is alone on its side
        turned = corners[faces[:, None], (alone[:, None] + np.arange(3)) % 3]
        a, b, c = np.moveaxis(turned, 1, 0)
        ab, ac = _where_cut(a, b, height_m), _where_cut(a, c, height_m)
        triangles = [(a, ab, ac)] if n == 1 else [(ab, b, c), (ab, c, ac)]
        parts += [np.stack(triangle, axis=1) for triangle in triangles]
        of += [faces] * len(triangles)
    vertices, source = np.concatenate(parts), np.concatenate(of)
    numbers = np.arange(3 * len(vertices), dtype=np.int32).reshape(-1, 3)
    return LabelledMesh(vertices.reshape(-1, 3), numbers, mesh.face_surface[source]), source


def _where_cut(first: FloatArray, second: FloatArray, height_m: float) -> FloatArray:
    """Points (n, 3) at a height on the lines from points (n, 3) on one side of it to those on the other."""
    share = (height_m - first[:, 2]) / (second[:, 2] - first[:, 2])
    return first + share[:, None] * (second - first)


_MOST_LEVELS = 10
_SAMPLES_A_FACE = 6.0  # faces that stand for more samples are cut into four


def nearest_samples(
    samples: SurfaceSamples, points: FloatArray, face: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Return for points (n, 3) on faces (n,) the nearest sample (n,), of the same face if it has any."""
    if not len(points):
        return np.zeros(0, np.int64)
    apart = 4 * max(samples.extent_m, 1e-9)  # faces stand so far apart in the fourth dimension
    tree = cKDTree(np.column_stack([samples.points, samples.face * apart]))
    index: NDArray[np.int64] = tree.query(np.column_stack([points, face * apart]))[1]
    return index


@dataclass(frozen=True, slots=True, eq=False)
class FineCoverage:
    """Coverage on m faces that are small enough to show it; three vertices of its own for each face.

    Attributes
    ----------
    corners, weights : (m, 3, 3) float
        Metres; and the weights of the scene's face's corners at each corner.
    sample, face, surface : (m,) int64, (m,) int32, (m,) int32
        The sample whose values each has; face of the scene's mesh and surface that it lies on.
    best_cosine, n_views, state, reason : (m,) float, int32, int8, int8
        As of `Coverage`.
    """

    corners: FloatArray
    weights: FloatArray
    sample: NDArray[np.int64]
    face: NDArray[np.int32]
    surface: NDArray[np.int32]
    best_cosine: FloatArray
    n_views: NDArray[np.int32]
    state: NDArray[np.int8]
    reason: NDArray[np.int8]


def fine_coverage(
    mesh: LabelledMesh, coverage: Coverage, samples_a_face: float = _SAMPLES_A_FACE
) -> FineCoverage:
    """Cut a mesh's faces as finely as its samples lie, and give each piece its nearest sample's values.

    Faces that stand for more than `samples_a_face` samples are cut into four.
    """
    samples = coverage.samples
    limit = samples_a_face * samples.total_m2 / max(len(samples), 1)
    kept = np.flatnonzero(mesh.face_areas() > 0)
    corners, weights = mesh.corners[kept], np.broadcast_to(np.eye(3), (len(kept), 3, 3))
    pieces, part = cut_finely(np.concatenate([corners, weights], axis=2), limit)
    corners, face = pieces[..., :3], kept[part]
    nearest = nearest_samples(samples, corners.mean(axis=1), face)
    return FineCoverage(
        corners=corners,
        weights=pieces[..., 3:],
        sample=nearest,
        face=face.astype(np.int32),
        surface=mesh.face_surface[face],
        best_cosine=coverage.best_cosine[nearest],
        n_views=coverage.n_views[nearest],
        state=coverage.state[nearest],
        reason=coverage.reason[nearest],
    )


def cut_finely(corners: FloatArray, limit_m2: float) -> tuple[FloatArray, NDArray[np.int64]]:
    """Cut triangles (m, 3, 3 + k) into four until none is larger than a limit, or often enough.

    Corners are in metres; the k other values vary linearly across each triangle. Returns the pieces
    (n, 3, 3 + k), and the triangle (n,) that each is part of, ascending.
    """
    part = np.arange(len(corners))
    for _ in range(_MOST_LEVELS):
        large = triangle_areas(corners[..., :3]) > limit_m2
        if not large.any():
            break
        corners = np.concatenate([corners[~large], _quarter(corners[large])])
        part = np.concatenate([part[~large], np.repeat(part[large], 4)])
    order = np.argsort(part, kind="stable")
    return corners[order], part[order]


def _quarter(corners: FloatArray) -> FloatArray:
    """Each triangle as four, face by face: by the middles of its sides."""
    a, b, c = np.moveaxis(corners, 1, 0)
    ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
    parts = [np.stack(part, axis=1) for part in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))]
    return np.stack(parts, axis=1).reshape(-1, *corners.shape[1:])


_WIDTH = 760
_OUTSIDE, _PALE, _AT_FACES_M = -2, (0.86, 0.86, 0.84), 1e-3  # of the region


@dataclass(frozen=True, slots=True, kw_only=True)
class StateMarks:
    """How the states of surface look in pictures: the colour (0..1) of each.

    `hatched` is in the colour of the unknown, `dotted` in that of what is measured.
    """

    colours: Mapping[int, tuple[float, ...]]
    hatched: int
    dotted: int | None = None


def state_pictures(
    scene: Scene,
    samples: SurfaceSamples,
    state: NDArray[np.int8],
    *,
    marks: StateMarks,
    title: str,
    n_threads: int | None = None,
    zones: Zones = EVERYWHERE,
    cut_m: float | None = None,
) -> tuple[Picture, ...]:
    """The scene from two opposite sides, each point in the colour of its nearest sample's state (n,).

    Faces that look away from the eye are left out, and all above `cut_m` (metres) where it is given; what
    lies outside the region is in one pale grey.
    """
    mesh, source = scene.mesh, None
    if cut_m is not None and cut_m > mesh.bounds()[0][2]:
        mesh, source = below(mesh, cut_m)
    canvas = MeshDrawing(mesh, caster=scene.ray_caster(n_threads) if source is None else None)
    cameras = overview_cameras(mesh.bounds())
    best = best_side(cameras, mesh.corners)
    pictures = []
    for side, number in (("one side", best), ("the other side", best + len(cameras) // 2)):
        camera = cameras[number % len(cameras)]
        layer = canvas.look(camera, camera.shape(_WIDTH))
        hit, shade = layer.hit, canvas.shade(layer)
        vertex_of = np.full(hit.shape, -1, np.int64)
        face = layer.face[hit] if source is None else source[layer.face[hit]]
        vertex_of[hit] = state[nearest_samples(samples, layer.points[hit], face)]
        vertex_of[hit] = np.where(zones.of_interest(layer.points[hit], _AT_FACES_M), vertex_of[hit], _OUTSIDE)
        image = paint_states(vertex_of, shade, {**marks.colours, _OUTSIDE: _PALE})
        if marks.dotted is not None:
            image = mark_modelled(image, vertex_of == marks.dotted, shade)
        pictures.append(picture_of(mark_hatched(image, vertex_of == marks.hatched), f"{title}: from {side}."))
    return tuple(pictures)
