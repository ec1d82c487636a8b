# SPDX-License-Identifier: MIT
"""Folds of a light model against the edges at which true surfaces meet."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from completion.export.panels.welding import edges_of, vertices_within_edges
from completion.result.completed_model import CompletedModel
from scenes import RayCaster
from scenes.checks import BoolArray, FloatArray
from scenes.scan.range_image import RangeImage
from scenes.world.scene import Scene

NEAR_M = 0.015  # between a fold and its truth
_LEAST_DEG = 20.0  # of the angle at a fold
_SPACING_M = 0.008  # of places on the scene's surface
_FOOTPRINTS = 2.5  # between the places of two pixels and the fold between them
_SAME_DEG = 20.0  # between a normal and that of a true surface


@dataclass(frozen=True, slots=True, eq=False)
class TrueFolds:
    """Where true surfaces meet: places (n, 3) on folds in view; the places and normals (m, 3) of all."""

    in_view: FloatArray
    tree: cKDTree
    normals: FloatArray

    @classmethod
    def of(cls, scene: Scene, scans: Sequence[RangeImage], left_out: Sequence[str] = ()) -> TrueFolds:
        """Return those of a scene that its scans, which know their truth, look at.

        Folds in view of surfaces whose names hold one of the words `left_out` are not asked for.
        """
        seen = np.concatenate([scan.true_points().reshape(-1, 3) for scan in scans])
        places, normals = _surface_places(scene, np.nanmin(seen, axis=0) - 0.1, np.nanmax(seen, axis=0) + 0.1)
        asked = np.array([not any(word in name for word in left_out) for name in scene.surface_names])
        found = [
            np.concatenate(parts)
            for parts in zip(*(folds_in_view(scene, s, asked) for s in scans), strict=True)
        ]
        _, first = np.unique(np.floor(found[0] / 0.01).astype(np.int64), axis=0, return_index=True)
        at, one, other = (array[np.sort(first)] for array in found)
        all_of_them = cls(at, cKDTree(places), normals)
        there = np.isfinite(all_of_them.angles_near(at, one, other))  # planes meet in places without surface
        return cls(at[there], all_of_them.tree, normals)

    def angles_near(self, points: FloatArray, first: FloatArray, second: FloatArray) -> FloatArray:
        """Angle (n,), degrees, between the true surfaces at places (n, 3) that have nearly two normals each.

        NaN where there are no such surfaces within 15 mm that meet at 20 degrees at least.
        """
        result = np.full(len(points), np.nan)
        for k, near in enumerate(self.tree.query_ball_point(points, NEAR_M)):
            normals = self.normals[near]
            if not len(normals):
                continue
            along = np.abs(normals @ np.stack([first[k], second[k]], axis=1))
            best = along.argmax(axis=0)
            if (along.max(axis=0) < np.cos(np.radians(_SAME_DEG))).any():
                continue
            one, other = normals[best]
            angle = np.degrees(np.arccos(np.clip(abs(one @ other), 0, 1)))
            if angle >= _LEAST_DEG:
                result[k] = angle
        return result


def folds_in_view(
    scene: Scene, scan: RangeImage, asked: BoolArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Places (n, 3) where neighbouring pixels of a scan lie on planes that meet between them, their normals.

    Both are among those `asked` for, (surfaces,).

    The planes of the triangles that were hit are cut with one another; the cut lies within two and a half
    footprints of both pixels, and they meet at 20 degrees at least.
    """
    assert scan.truth is not None
    points, face = scan.true_points(), scan.truth.face
    corners = scene.mesh.vertices[scene.mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    footprint = scan.truth.ranges * scan.projection.pixel_angle
    slant = np.maximum(np.cos(np.nan_to_num(scan.truth.incidence, nan=1.5)), 0.05)
    found: list[tuple[FloatArray, FloatArray, FloatArray]] = []
    for a, b in ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:])):
        one, other = face[a].ravel(), face[b].ravel()
        surface = scene.mesh.face_surface
        both = (one >= 0) & (other >= 0)
        both[both] = _is_other(scene, surface[one[both]], surface[other[both]])
        both[both] = asked[surface[one[both]]] & asked[surface[other[both]]]
        n, m = normals[one[both]], normals[other[both]]
        cosine = (n * m).sum(axis=1)
        square = 1 - cosine**2
        meets = square > np.sin(np.radians(_LEAST_DEG)) ** 2
        n, m, cosine, square = n[meets], m[meets], cosine[meets], square[meets]
        p, q = (points[side].reshape(-1, 3)[both][meets] for side in (a, b))
        limit = [_FOOTPRINTS * (footprint / slant)[side].ravel()[both][meets] for side in (a, b)]
        middle = (p + q) / 2
        e, f = ((p - middle) * n).sum(axis=1), ((q - middle) * m).sum(axis=1)
        place = middle + ((e - f * cosine) / square)[:, None] * n + ((f - e * cosine) / square)[:, None] * m
        near = (np.linalg.norm(place - p, axis=1) < limit[0]) & (np.linalg.norm(place - q, axis=1) < limit[1])
        found.append((place[near], n[near], m[near]))
    at, first, second = (np.concatenate(parts) for parts in zip(*found, strict=True))
    return at, first, second


def _is_other(scene: Scene, one: NDArray[np.int32], other: NDArray[np.int32]) -> BoolArray:
    """Whether two faces are of different surfaces, or of one that has no form."""
    formless = np.array([surface is None for surface in scene.surfaces], np.bool_)
    return np.asarray((one != other) | formless[one], dtype=np.bool_)


def _surface_places(scene: Scene, low: FloatArray, high: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Places (n, 3) about evenly on the faces of a scene in a box, and the normals (n, 3) there."""
    corners = scene.mesh.vertices[scene.mesh.faces]
    reaches = (corners.max(axis=1) >= low).all(axis=1) & (corners.min(axis=1) <= high).all(axis=1)
    corners = corners[reaches]
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    cross = np.cross(a, b)
    area = np.linalg.norm(cross, axis=1) / 2
    rng = np.random.default_rng(0)
    count = rng.poisson(area / _SPACING_M**2) + 1
    owner = np.repeat(np.arange(len(area)), count)
    s, t = rng.random((2, len(owner)))
    turned = s + t > 1
    s[turned], t[turned] = 1 - s[turned], 1 - t[turned]
    places = corners[owner, 0] + s[:, None] * a[owner] + t[:, None] * b[owner]
    within = ((places >= low) & (places <= high)).all(axis=1)
    return places[within], (cross / np.maximum(2 * area, 1e-18)[:, None])[owner][within]


_STEP_M = 0.01  # along a fold
_CREASE_DEG = 20.0  # at an edge of a mesh that counts as a fold
_CLOSE_M = 0.01  # between a true surface and the model
_MOST = 5000  # places of a model that are held against the truth, drawn at random
_SLACK_M = 1e-4  # of a vertex within an edge


@dataclass(frozen=True, slots=True, eq=False)
class SampledFolds:
    """Places (n, 3) along folds, and the normals (n, 3) of the two surfaces that meet there."""

    points: FloatArray
    first: FloatArray
    second: FloatArray


@dataclass(frozen=True, slots=True)
class FoldScore:
    """Shares of true folds found and of found ones that are true, and errors of their angles, degrees."""

    recall: float
    precision: float
    angle_median: float
    angle_p95: float

    def cells(self) -> str:
        """The cells of a table's row."""
        return f"{self.recall:.3f} | {self.precision:.3f} | {self.angle_median:.3f} / {self.angle_p95:.2f}"


def folds_of_panels(done: CompletedModel) -> SampledFolds:
    """The folds of a completed model, world coordinates."""
    world, surfaces = done.world_from_reference, [patch.grid.surface for patch in done.patches]
    points, normals = [np.zeros((0, 3))], ([np.zeros((0, 3))], [np.zeros((0, 3))])
    for fold in done.panels().folds:
        places = _along(fold.points)
        points.append(world.apply(places))
        for number, own, some in zip(fold.surfaces, fold.normals, normals, strict=True):
            known = surfaces[number - 1].normal(places) if number else np.tile(own, (len(places), 1))
            some.append(world.rotate(known))
    return SampledFolds(np.concatenate(points), *(np.concatenate(some) for some in normals))


def folds_of_mesh(vertices: FloatArray, faces: NDArray[np.int64]) -> SampledFolds:
    """The edges of a mesh at which its triangles meet at more than 20 degrees."""
    ends = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    owner = np.tile(np.arange(len(faces)), 3)
    order = np.lexsort(ends.T)
    ends, owner = ends[order], owner[order]
    same = np.flatnonzero((ends[1:] == ends[:-1]).all(axis=1))
    corner = vertices[faces]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    one, other = normal[owner[same]], normal[owner[same + 1]]
    bent = (one * other).sum(axis=1) < np.cos(np.radians(_CREASE_DEG))
    edge = vertices[ends[same[bent]]]
    count = np.maximum((np.linalg.norm(edge[:, 1] - edge[:, 0], axis=1) / _STEP_M).astype(np.int64), 1)
    which = np.repeat(np.arange(len(edge)), count)
    share = (np.arange(len(which)) - np.repeat(np.cumsum(count) - count, count) + 0.5) / count[which]
    points = edge[which, 0] + share[:, None] * (edge[which, 1] - edge[which, 0])
    return SampledFolds(points, one[bent][which], other[bent][which])


def score_folds(found: SampledFolds, truth: TrueFolds) -> FoldScore:
    """Hold folds against the true ones: those in view are to be found, hidden ones may be."""
    recall = float("nan")
    if len(truth.in_view):
        distance = cKDTree(found.points).query(truth.in_view)[0] if len(found.points) else np.array([np.inf])
        recall = float((distance <= NEAR_M).mean())
    some = np.random.default_rng(0).permutation(len(found.points))[:_MOST]
    points, first, second = (array[some] for array in (found.points, found.first, found.second))
    true = truth.angles_near(points, first, second)
    is_true = np.isfinite(true)
    between = np.degrees(np.arccos(np.clip(np.abs((first * second).sum(axis=1)), 0, 1)))
    off = np.abs(between - true)[is_true]
    median, p95 = np.percentile(off, [50, 95]) if len(off) else (np.nan, np.nan)
    return FoldScore(recall, float(is_true.mean()) if len(is_true) else np.nan, float(median), float(p95))


def share_within(
    vertices: FloatArray, faces: NDArray[np.int64], points: FloatArray, normals: FloatArray
) -> float:
    """Share of true places (n, 3) with a mesh within 1 cm of them, along their normals (n, 3)."""
    start = points + _CLOSE_M * normals
    hits = RayCaster(vertices, faces.astype(np.int32)).first_hit(start, -normals)
    return float((hits.ranges <= 2 * _CLOSE_M).mean())


def true_places(scans: list[RangeImage]) -> tuple[FloatArray, FloatArray]:
    """What scans really met, and the directions (n, 3) back to them."""
    points, back = [], []
    for scan in scans:
        places = scan.true_points().reshape(-1, 3)
        known = np.isfinite(places).all(axis=1) & scan.valid.ravel()
        points.append(places[known])
        back.append(-scan.rays().reshape(-1, 3)[known])
    return np.concatenate(points), np.concatenate(back)


def flaws(done: CompletedModel) -> tuple[int, int, int]:
    """Vertices within edges, edges of more than two facets where a surface goes on, and other such edges."""
    panels = done.panels()
    within = vertices_within_edges(panels.vertices, panels.faces, _SLACK_M)
    edges, count, _ = edges_of(panels.faces)
    many = {tuple(edge) for edge in edges[count > 2].tolist()}
    on: dict[tuple[int, ...], set[int]] = {}
    for face, surface in zip(panels.faces.tolist(), panels.face_surface.tolist(), strict=True):
        for k in range(3):
            edge = tuple(sorted((face[k], face[(k + 1) % 3])))
            if edge in many:
                on.setdefault(edge, set()).add(surface)
    goes_on = {number for fold in panels.folds for number in fold.goes_on}
    through = sum(1 for some in on.values() if some & goes_on or len(some) > 2)
    return len(within), through, len(on) - through


def _along(points: FloatArray) -> FloatArray:
    """Places (n, 3) about a centimetre apart along a polyline (k, 3)."""
    found = []
    for begin, end in pairwise(points):
        count = max(1, int(np.linalg.norm(end - begin) / _STEP_M))
        share = (np.arange(count) + 0.5) / count
        found.append(begin + share[:, None] * (end - begin))
    return np.concatenate([np.zeros((0, 3)), *found])
