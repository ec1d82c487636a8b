# SPDX-License-Identifier: MIT
"""Free space: inferred area that measured beams passed through, computed apart from the completion.

It shares nothing with evidence, audit and ray caster: pairs of beams and triangles come from a tree of
directions, and each pair is solved in closed form (Moeller and Trumbore, "Fast, minimum storage ray/triangle
intersection", 1997).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from completion.observe.tolerance import Tolerance
from completion.options import CompletionOptions
from completion.result.completed_model import CompletedModel
from completion.result.labelled_points import LabelledPoints
from scenes.checks import BoolArray, FloatArray
from scenes.mesh.labelled_mesh import triangle_areas
from scenes.rays.raycast import RayCaster
from scenes.scan.range_image import RangeImage

_WELD_M = 1e-6
_BEAMS = 1 << 20  # that are cast at a time
_WIDE = 0.3  # chord of a face so large, seen from the sensor, that the tree is of no use


@dataclass(frozen=True, slots=True, eq=False)
class Violation:
    """Inferred area in measured free space."""

    area_m2: float  # area of the faces that beams went through
    deepest_m: float  # by how much, beyond its tolerance, the farthest of those beams did; 0 without
    n_faces: int  # those faces


def violation_of(
    completed: CompletedModel,
    scans: Sequence[RangeImage],
    options: CompletionOptions,
    n_completed: int,
    mesh: LabelledPoints | None = None,
) -> Violation:
    """Return how much of what was inferred the beams of `scans` went through.

    A beam goes through a face where it measured more than k sqrt(sigma^2 + (s / cos)^2) + t / cos beyond it,
    with s the face's predicted deviation and the flatness together, t the registration error where several
    scans were completed. Without noise one beam convicts a face; with noise it takes two beams around one of
    its corners, one of them through it. A beam whose tolerance exceeds the largest says nothing.
    `completed`: what was inferred. `scans`: simulated scans, whose noise is known: those that were completed,
    or more. `options`: options of the completion. `n_completed`: how many scans were completed. `mesh`: what
    to hold against the beams, working frame; all that was inferred when not given.
    """
    mesh = completed.hypothesised if mesh is None else mesh
    corners = completed.world_from_reference.apply(mesh.vertices)[mesh.faces]

    def crossings() -> Iterator[Crossings]:
        for scan in scans:
            met = meet(scan.origin, scan.rays()[scan.valid], corners)
            yield Crossings(*met, scan.ranges[scan.valid], scan.sigma_m or 0.0)

    noisy = any(scan.sigma_m != 0 for scan in scans)
    return _violation(mesh, corners, crossings(), options.of_surfaces.tolerance(n_completed), noisy=noisy)


def violation_of_beams(
    completed: CompletedModel,
    origins: FloatArray,
    points: FloatArray,
    sigma_m: float,
    options: CompletionOptions,
) -> Violation:
    """Return the same for beams from `origins` (n, 3) to `points` (n, 3), each with an origin of its own.

    Only the first face that a beam meets counts. `sigma_m`: noise of the ranges, metres.
    """
    mesh = completed.hypothesised
    corners = completed.world_from_reference.apply(mesh.vertices)[mesh.faces]

    def crossings() -> Iterator[Crossings]:
        caster = RayCaster(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))
        for start in range(0, len(points), _BEAMS):
            rays = points[start : start + _BEAMS] - origins[start : start + _BEAMS]
            ranges = np.linalg.norm(rays, axis=1)
            hits = caster.first_hit(origins[start : start + _BEAMS], rays / ranges[:, None])
            beam = np.flatnonzero(hits.face >= 0)
            cosine = np.maximum(hits.incidence_cosine[beam], 1e-3)
            yield Crossings(
                beam, hits.face[beam].astype(np.int64), hits.ranges[beam], cosine, ranges, sigma_m
            )

    return _violation(mesh, corners, crossings(), options.of_surfaces.tolerance(2), noisy=sigma_m > 0)


class Crossings(NamedTuple):
    """Pairs (k,) of a beam and a face that it meets, with distance and cosine of incidence."""

    beam: NDArray[np.int64]
    face: NDArray[np.int64]
    distance: FloatArray
    cosine: FloatArray
    ranges: FloatArray  # (n,) of all beams, metres
    sigma_m: float


def _violation(
    mesh: LabelledPoints,
    corners: FloatArray,
    groups: Iterable[Crossings],
    tolerance: Tolerance,
    *,
    noisy: bool,
) -> Violation:
    """What beams, group by group, say of a mesh with `corners` (m, 3, 3)."""
    if not len(corners):
        return Violation(0.0, 0.0, 0)
    spread = np.hypot(mesh.sd[mesh.faces].max(axis=1), tolerance.flatness_m)
    faces, beams, excess = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)], [np.zeros(0)]
    first = 0
    for met in groups:
        along = np.hypot(met.sigma_m, spread[met.face] / met.cosine)
        allowed = tolerance.n_sigma * along + tolerance.registration_m / met.cosine
        beyond = met.ranges[met.beam] - met.distance - allowed
        through = (beyond > 0) & (allowed <= tolerance.max_m)
        faces.append(met.face[through])
        beams.append(first + met.beam[through])
        excess.append(beyond[through])
        first += len(met.ranges)
    face, beam, depth = np.concatenate(faces), np.concatenate(beams), np.concatenate(excess)
    guilty = _guilty(face, beam, _welded(corners, mesh.surface[mesh.faces[:, 0]]), 2 if noisy else 1)
    area = triangle_areas(corners)
    deepest = float(depth[guilty[face]].max(initial=0.0))
    return Violation(float(area[guilty].sum()), deepest, int(guilty.sum()))


def _guilty(
    face: NDArray[np.int64], beam: NDArray[np.int64], corner: NDArray[np.int64], least: int
) -> BoolArray:
    """Faces (m,) with a beam through them and `least` different beams around one of their corners."""
    met = np.bincount(face, minlength=len(corner)) > 0
    pairs = np.unique(np.stack([np.repeat(beam, 3), corner[face].ravel()], axis=1), axis=0)
    around = np.bincount(pairs[:, 1], minlength=int(corner.max()) + 1)
    return np.asarray(met & (around[corner].max(axis=1) >= least), dtype=np.bool_)


def _welded(corners: FloatArray, surface: NDArray[np.int32]) -> NDArray[np.int64]:
    """Number (m, 3) of each corner; the same for corners of one surface at the same place."""
    places = np.rint(corners.reshape(-1, 3) / _WELD_M).astype(np.int64)
    keyed = np.column_stack([np.repeat(surface, 3), places])
    return np.asarray(np.unique(keyed, axis=0, return_inverse=True)[1].reshape(-1, 3), dtype=np.int64)


def meet(
    origin: FloatArray, rays: FloatArray, corners: FloatArray
) -> tuple[NDArray[np.int64], NDArray[np.int64], FloatArray, FloatArray]:
    """Return all pairs of a ray and a triangle that it meets, with distance and cosine of incidence.

    `origin` (3,) float: where the rays start, metres. `rays` (n, 3) float: unit directions. `corners` (m, 3,
    3) float: triangles. Returns `ray, triangle` (k,) int: the pairs; `distance, cosine` (k,) float: metres
    along the ray; |cosine| between ray and normal, at least 1e-3.
    """
    if not len(rays) or not len(corners):
        return np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0), np.zeros(0)
    ray, triangle = _near_pairs(rays, corners - origin)
    a, b, c = np.moveaxis(corners[triangle], 1, 0)
    along, u, v = rays[ray], b - a, c - a
    across = np.cross(along, v)
    determinant = np.einsum("ij,ij->i", u, across)
    with np.errstate(divide="ignore", invalid="ignore"):
        start = origin - a
        first = np.einsum("ij,ij->i", start, across) / determinant
        turned = np.cross(start, u)
        second = np.einsum("ij,ij->i", along, turned) / determinant
        distance = np.einsum("ij,ij->i", v, turned) / determinant
        inside = (first >= 0) & (second >= 0) & (first + second <= 1) & (distance > 0)
    normal = np.cross(u, v)[inside]
    cosine = np.abs(determinant[inside]) / np.maximum(np.linalg.norm(normal, axis=1), 1e-300)
    return ray[inside], triangle[inside], distance[inside], np.maximum(cosine, 1e-3)


def _near_pairs(rays: FloatArray, corners: FloatArray) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Pairs of a ray and a triangle, relative to the rays' start, that are near enough to meet."""
    ways = corners / np.maximum(np.linalg.norm(corners, axis=2, keepdims=True), 1e-12)
    middle = ways.sum(axis=1)
    middle /= np.maximum(np.linalg.norm(middle, axis=1, keepdims=True), 1e-12)
    chord = np.linalg.norm(ways - middle[:, None], axis=2).max(axis=1)
    chord = np.where(chord > _WIDE, 3.0, 1.05 * chord + 1e-9)
    near = cKDTree(rays).query_ball_point(middle, chord)
    triangle = np.repeat(np.arange(len(corners)), [len(found) for found in near])
    return np.concatenate([np.asarray(found, dtype=np.int64) for found in near]), triangle
