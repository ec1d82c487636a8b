# SPDX-License-Identifier: MIT
"""Score: folds of a model against the true ones, and how light and how closed it is."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from benchmarks.completion.panels.truth import NEAR_M, TrueFolds
from completion.panels.healing import edges_of, vertices_within_edges
from completion.result.completed_model import CompletedModel
from scenes import RayCaster
from scenes.checks import FloatArray
from scenes.scan.range_image import RangeImage

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
