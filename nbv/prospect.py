# SPDX-License-Identifier: MIT
"""Prospect: what a view into unknown space is expected to meet there, and how much of it would be news.

A shadow hides surface that completion infers, the rear of the body that casts it, and perhaps things that
nothing tells of. A ray that enters unknown space is followed to what is known: where it meets inferred
surface, that surface may yet be missing (an opening); where it meets measured surface from its front,
nothing new is there; where it meets measured surface from the rear, or nothing, unknown surface lies before
it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from nbv.accumulator import cell_directions
from nbv.knowledge import Knowledge
from nbv.occupancy import EMPTY, SEEN, BoundaryFaces, VoxelMap
from scenes.checks import BoolArray, FloatArray
from scenes.raycast import RayCaster

_AGAINST = 0.05  # cosine by which a ray must run against a measured normal to meet that surface's front
_INTO_M = 1e-6  # rays that go on start this far behind the face that they entered by
_CELLS = 32  # of the cube map along an edge: rays 2.8 deg apart
_VOXEL, _MEASURED, _INFERRED = range(3)


@dataclass(frozen=True, slots=True, eq=False)
class Prospect:
    """What is known beyond the faces of unknown space.

    Attributes
    ----------
    boundary : RayCaster
        The faces between empty voxels and all others.
    entered : (k,) int64
        The voxel behind each triangle of the boundary.
    worth_entering : (n_voxels,) bool
        Voxels that are unknown, and have not been sought in vain too often.
    caster : RayCaster or None
        Seen voxels as they border on unknown ones, and completed surface; None where there is neither.
    kind : (m,) int8
        Of each triangle: of a seen voxel, of a measured or of an inferred surface.
    voxel : (m,) int64
        The voxel of the first kind, -1 elsewhere.
    normal : (m, 3) float
        Normal of the other kinds.
    doubt : (m,) float
        Probability that inferred surface is not there; 0 elsewhere.
    voxels : VoxelMap
        The map.
    """

    boundary: RayCaster
    entered: NDArray[np.int64]
    worth_entering: BoolArray
    caster: RayCaster | None
    kind: NDArray[np.int8]
    voxel: NDArray[np.int64]
    normal: FloatArray
    doubt: FloatArray
    voxels: VoxelMap

    @classmethod
    def of(
        cls, voxels: VoxelMap, border: BoundaryFaces, worth_entering: BoolArray, knowledge: Knowledge
    ) -> Prospect:
        """Return the prospect of a map, its boundary, and what completion makes of the same scans."""
        faces = voxels.faces_between(voxels.labels == SEEN, ~np.isin(voxels.labels, (SEEN, EMPTY)))
        corners, squares = faces.triangles(voxels.grid.voxel_m)
        measured, measured_faces = knowledge.measured()
        inferred, inferred_faces, confidence = knowledge.hypothesised()
        vertices = np.concatenate([corners, measured, inferred])
        n_squares, n_measured = len(squares), len(measured_faces)
        triangles = np.concatenate(
            [squares, measured_faces + len(corners), inferred_faces + len(corners) + len(measured)]
        )
        kind = np.repeat([_VOXEL, _MEASURED, _INFERRED], [n_squares, n_measured, len(inferred_faces)])
        voxel, doubt = np.full(len(kind), -1, np.int64), np.zeros(len(kind))
        voxel[:n_squares] = np.repeat(faces.voxel, 2)
        doubt[n_squares + n_measured :] = 1.0 - confidence
        a, b, c = (vertices[triangles[:, k]] for k in range(3))
        normal = np.cross(b - a, c - a)
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
        caster = RayCaster(vertices, triangles, n_threads=1) if len(triangles) else None
        boundary = RayCaster(*border.triangles(voxels.grid.voxel_m), n_threads=1)
        entered = np.repeat(border.voxel, 2)
        return cls(
            boundary, entered, worth_entering, caster, kind.astype(np.int8), voxel, normal, doubt, voxels
        )

    def look(
        self, position: FloatArray, max_range_m: float
    ) -> tuple[FloatArray, FloatArray, NDArray[np.int64], BoolArray]:
        """Look from a position (3,) in all directions.

        Returns
        -------
        offsets : (n, 3) float
            From the position to where rays enter unknown space, metres.
        news_m2 : (n,) float
            Area that is likely to be news there: that of the ray's cell of the cube map, at the range where
            the ray meets something known, or else the end of the volume.
        voxel : (n,) int64
            The unknown voxel that is entered.
        is_unknown : (n,) bool
            True.
        """
        rays, solid_angles = _directions()
        hits = self.boundary.first_hit(position[None], rays)
        enters = np.flatnonzero((hits.face >= 0) & (hits.ranges <= max_range_m))
        enters = enters[self.worth_entering[self.entered[hits.face[enters]]]]
        rays, near, voxel = rays[enters], hits.ranges[enters], self.entered[hits.face[enters]]
        entry = position + near[:, None] * rays
        news, reach = np.ones(len(rays)), near + self.voxels.grid.ranges_to_end(entry, rays)
        if self.caster is not None and len(rays):
            beyond = self.caster.first_hit(entry + _INTO_M * rays, rays)
            met = np.flatnonzero(beyond.face >= 0)
            news[met] = self._news_at(beyond.face[met], rays[met])
            reach[met] = near[met] + beyond.ranges[met]
        area = solid_angles[enters] * np.square(np.minimum(reach, max_range_m)) * news
        worth = np.flatnonzero(area > 0)
        all_unknown = np.ones(len(worth), dtype=np.bool_)
        return near[worth, None] * rays[worth], area[worth], voxel[worth], all_unknown

    def _news_at(self, face: NDArray[np.int32], rays: FloatArray) -> FloatArray:
        """Probability (n,) that there is unknown surface where rays meet triangles."""
        kind = self.kind[face]
        front = np.einsum("ij,ij->i", rays, self.normal[face]) < 0
        front = np.where(kind == _VOXEL, self._shows_front(self.voxel[face], rays), front)
        return np.where(front, self.doubt[face], 1.0)

    def _shows_front(self, voxel: NDArray[np.int64], rays: FloatArray) -> BoolArray:
        """Tell which rays (n, 3) run against a measured normal of the voxel they meet."""
        surfels = self.voxels.surfels
        front = np.zeros(len(voxel), dtype=np.bool_)
        if not len(surfels.keys):
            return front
        for side in range(6):
            at = np.searchsorted(surfels.keys, voxel * 6 + side)
            at = np.minimum(at, len(surfels.keys) - 1)
            has = surfels.keys[at] == voxel * 6 + side
            front |= has & (np.einsum("ij,ij->i", rays, surfels.normals[at]) < -_AGAINST)
        return front


@cache
def _directions() -> tuple[FloatArray, FloatArray]:
    """Unit rays (n, 3) through the cells of a cube map, and the solid angle (n,) of each cell, sr."""
    rays = cell_directions(_CELLS)
    largest = np.abs(rays).max(axis=1)
    return rays, (2 / _CELLS) ** 2 * largest**3
