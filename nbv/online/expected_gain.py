# SPDX-License-Identifier: MIT
"""Expected gain: how much new surface a view into unknown space is expected to find.

A ray that enters unknown space is followed until it meets what is known. Inferred surface may be missing (an
opening): it is new with the probability that it is not there. Measured surface met from its front tells
nothing new. Where a ray meets measured surface from the rear, or meets nothing, unknown surface lies before.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from nbv.coverage.surface_classes import KnownSurfaces
from nbv.online.gain import ViewEvaluation, cell_directions
from nbv.online.limits import FLATTEST, FLATTEST_EXPECTED, INTO_M, TRUSTED_RAYS
from nbv.online.occupancy import EMPTY, SEEN, VoxelMap
from nbv.online.voxels import VoxelGrid
from scenes.checks import BoolArray, FloatArray
from scenes.rays.raycast import RayCaster
from scenes.scan.range_image import RangeImage

_CELLS = 32  # of the cube map along an edge: rays 2.8 deg apart


@dataclass(frozen=True, slots=True, eq=False)
class SurfacePrior:
    """How likely a ray that meets nothing known is to meet surface before it leaves the volume.

    `trust` (6,) is that for each side (+x, +y, +z, -x, -y, -z) by which the ray would leave.
    """

    trust: FloatArray

    @classmethod
    def none(cls) -> SurfacePrior:
        """Return the prior before any look: the volume is closed on every side."""
        return cls(np.ones(6))

    def after(self, scan: RangeImage, predicted: ViewEvaluation, grid: VoxelGrid) -> SurfacePrior:
        """Return the prior updated by a scan whose rays into the unknown were `predicted`."""
        pixels = scan.pixels(scan.origin + predicted.offsets)
        seen = np.flatnonzero((predicted.side >= 0) & np.isfinite(pixels).all(axis=1))
        row, column = np.rint(pixels[seen]).astype(np.int64).T
        met = grid.index_of(scan.points()[row, column]) >= 0
        n_looked = np.bincount(predicted.side[seen], minlength=6)
        n_met = np.bincount(predicted.side[seen], met, minlength=6)
        return SurfacePrior((TRUSTED_RAYS * self.trust + n_met) / (TRUSTED_RAYS + n_looked))


@dataclass(frozen=True, slots=True, eq=False)
class ExpectedGain:
    """Unknown space and what is known behind it, prepared for rays.

    Attributes
    ----------
    boundary, entered : RayCaster, (k,) int64
        The faces between empty voxels and all others, and the voxel behind each of their triangles.
    worth_entering : (n_voxels,) bool
        Voxels that are unknown, and have not been sought in vain too often.
    caster : RayCaster or None
        Seen voxels as they border on unknown ones, and completed surface; None where there is neither.
    voxel, normal, doubt : (m,) int64, (m, 3) float, (m,) float
        Of each of its triangles the voxel, -1 for completed surface; the normal, of completed surface towards
        where it was seen from; and the probability that inferred surface is not there, 0 elsewhere.
    trust : (6,) float
        As of `SurfacePrior`.
    """

    boundary: RayCaster
    entered: NDArray[np.int64]
    worth_entering: BoolArray
    caster: RayCaster | None
    voxel: NDArray[np.int64]
    normal: FloatArray
    doubt: FloatArray
    voxels: VoxelMap
    trust: FloatArray

    @classmethod
    def of(
        cls,
        voxels: VoxelMap,
        boundary: RayCaster,
        entered: NDArray[np.int64],
        *,
        worth_entering: BoolArray,
        completed: KnownSurfaces,
        trust: FloatArray,
    ) -> ExpectedGain:
        """Return what views into the unknown space of a map may bring, after completion of its scans.

        `entered` (k,), `worth_entering` (n_voxels,) and `trust` (6,) are as in the attributes.
        """
        faces = voxels.faces_between(_loose(voxels, completed), ~np.isin(voxels.labels, (SEEN, EMPTY)))
        corners, squares = faces.triangles(voxels.grid.voxel_m)
        measured, measured_faces = completed.measured_mesh()
        inferred, inferred_faces, confidence = completed.inferred_mesh()
        vertices = np.concatenate([corners, measured, inferred])
        n_squares, n_measured = len(squares), len(measured_faces)
        triangles = np.concatenate(
            [squares, measured_faces + len(corners), inferred_faces + len(corners) + len(measured)]
        )
        voxel, doubt = np.full(len(triangles), -1, np.int64), np.zeros(len(triangles))
        voxel[:n_squares] = np.repeat(faces.voxel, 2)
        doubt[n_squares + n_measured :] = 1.0 - confidence
        a, b, c = (vertices[triangles[:, k]] for k in range(3))
        normal = np.cross(b - a, c - a)
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
        caster = RayCaster(vertices, triangles, n_threads=1) if len(triangles) else None
        return cls(
            boundary=boundary,
            entered=entered,
            worth_entering=worth_entering,
            caster=caster,
            voxel=voxel,
            normal=normal,
            doubt=doubt,
            voxels=voxels,
            trust=trust,
        )

    def look(self, position: FloatArray, max_range_m: float) -> ViewEvaluation:
        """Evaluate a position (3,), world coordinates in metres, in all directions within the range.

        The worth of a ray is the area that its cell of the cube map cuts out of the surface that it meets,
        or of the side by which it leaves the volume, times the probability that surface there is new.
        """
        rays, solid_angles = _directions()
        hits = self.boundary.first_hit(position[None], rays)
        enters = np.flatnonzero((hits.face >= 0) & (hits.ranges <= max_range_m))
        enters = enters[self.worth_entering[self.entered[hits.face[enters]]]]
        rays, near, voxel = rays[enters], hits.ranges[enters], self.entered[hits.face[enters]]
        entry = position + near[:, None] * rays
        reach, side = self.voxels.grid.way_out(entry, rays)
        news, cosine = self.trust[side], np.abs(rays[np.arange(len(rays)), side % 3])
        if self.caster is not None and len(rays):
            beyond = self.caster.first_hit(entry + INTO_M * rays, rays)
            met = np.flatnonzero(beyond.face >= 0)
            news[met] = self._news_at(beyond.face[met], rays[met])
            reach[met], side[met] = beyond.ranges[met], -1
            cosine[met] = np.where(self.voxel[beyond.face[met]] >= 0, 1.0, beyond.incidence_cosine[met])
        area = solid_angles[enters] * np.square(np.minimum(near + reach, max_range_m))
        worth = np.where(
            cosine >= FLATTEST_EXPECTED, area * news / np.maximum(cosine, FLATTEST_EXPECTED), 0.0
        )
        kept = np.flatnonzero(worth > 0)
        is_unknown = np.ones(len(kept), dtype=np.bool_)
        return ViewEvaluation(
            offsets=near[kept, None] * rays[kept],
            worth_m2=worth[kept],
            voxel=voxel[kept],
            is_unknown=is_unknown,
            side=side[kept],
            share=np.ones(len(kept)),
        )

    def _news_at(self, face: NDArray[np.int32], rays: FloatArray) -> FloatArray:
        """Probability (n,) that there is unknown surface where rays meet triangles."""
        voxel = self.voxel[face]
        front = np.einsum("ij,ij->i", rays, self.normal[face]) < 0
        front = np.where(voxel >= 0, self._shows_front(voxel, rays), front)
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
            front |= has & (np.einsum("ij,ij->i", rays, surfels.normals[at]) < -FLATTEST)
        return front


def _loose(voxels: VoxelMap, completed: KnownSurfaces) -> BoolArray:
    """Seen voxels (n_voxels,) with surface off the completed surfaces; those tell the place of the rest."""
    surfels = voxels.surfels
    known = completed.on_modelled(surfels.points, surfels.normals, voxels.grid.voxel_m / 2)
    loose: BoolArray = np.asarray(voxels.labels == SEEN)
    loose[surfels.voxels[known]] = False
    loose[surfels.voxels[~known]] = True
    return loose


@cache
def _directions() -> tuple[FloatArray, FloatArray]:
    """Unit rays (n, 3) through the cells of a cube map, and the solid angle (n,) of each cell, sr."""
    rays = cell_directions(_CELLS)
    largest = np.abs(rays).max(axis=1)
    return rays, (2 / _CELLS) ** 2 * largest**3
