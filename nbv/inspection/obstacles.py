# SPDX-License-Identifier: MIT
"""Obstacles: what stands in the way in a building that was checked, its extras as solids of small cells."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from completion.asbuilt import limits
from completion.asbuilt.findings import DesignCheck
from nbv.online.occupancy import BoundaryFaces
from scenes.checks import BoolArray, FloatArray
from scenes.mesh.labelled_mesh import LabelledMesh, join_meshes
from scenes.rays.raycast import RayCaster

_MOST_CELLS = 20_000  # in the box of an extra: beyond, its cells are twice as large


@dataclass(frozen=True, slots=True, eq=False)
class Obstacles:
    """What is in the way.

    Attributes
    ----------
    solid : LabelledMesh
        What nobody can stand in: the design but for what is missing, and the extras.
    caster : RayCaster
        What stops beams: `solid` without glass.
    owner : (m,) int
        Of each face of `caster`, as `completion.asbuilt.findings.Samples.blocker`.
    design : RayCaster
        What stops beams of the design alone.
    """

    solid: LabelledMesh
    caster: RayCaster
    owner: NDArray[np.int32]
    design: RayCaster

    @classmethod
    def of(cls, check: DesignCheck, n_threads: int | None = None) -> Obstacles:
        """Return the obstacles of a checked design.

        Elements that are missing or displaced do not stand where the design has them. Space in the box of an
        extra that no station could see is part of it: backs of things are rarely measured.
        """
        mesh = check.design.mesh
        gone = [e.surface for e in check.elements if e.verdict == "missing" or e.kind == "displaced"]
        stands = ~np.isin(mesh.face_surface, gone)
        look = None if mesh.appearance is None else mesh.appearance.opacity
        opaque = stands if look is None else stands & (look >= limits.SEE_THROUGH)
        design = _caster(mesh.some(opaque), n_threads)
        eyes = np.array([pose.translation for pose in check.alignment.poses]).reshape(-1, 3)
        cells = [_Cells.around(extra.points) for extra in check.extra]
        measured = _caster(join_meshes([mesh.some(opaque), *(held.mesh(0) for held in cells)]), n_threads)
        extras = [held.filled(eyes, measured).mesh(-2 - k) for k, held in enumerate(cells)]
        barrier = join_meshes([mesh.some(opaque), *extras])
        owner, caster = barrier.face_surface, _caster(barrier, n_threads)
        return cls(join_meshes([mesh.some(stands), *extras]), caster, owner, design)


@dataclass(frozen=True, slots=True, eq=False)
class _Cells:
    """Cells of one extra: its lowest corner (3,) and their side, metres, and which (i, j, k) are solid."""

    low: FloatArray
    side_m: float
    solid: BoolArray

    @classmethod
    def around(cls, points: FloatArray) -> _Cells:
        """Return the cells that have points (n, 3), middles of cells of `limits.CELL_M`."""
        low, side = points.min(axis=0) - limits.CELL_M / 2, limits.CELL_M
        extent = np.ptp(points, axis=0) + limits.CELL_M
        while np.prod(np.ceil(extent / side - 1e-6)) > _MOST_CELLS:
            side *= 2
        shape = np.maximum(np.ceil(extent / side - 1e-6), 1).astype(np.int64)
        solid = np.zeros(shape, np.bool_)
        solid[tuple(np.minimum(((points - low) / side).astype(np.int64), shape - 1).T)] = True
        return cls(low, side, solid)

    def filled(self, eyes: FloatArray, caster: RayCaster) -> _Cells:
        """Return the cells with those that no eye (s, 3) sees."""
        open_ = np.argwhere(~self.solid)
        middles, hidden = self.low + (open_ + 0.5) * self.side_m, np.ones(len(open_), np.bool_)
        for eye in eyes:
            left = np.flatnonzero(hidden)
            hidden[left] = caster.are_blocked(middles[left], eye[None])
        solid = self.solid.copy()
        solid[tuple(open_[hidden].T)] = True
        return _Cells(self.low, self.side_m, solid)

    def mesh(self, label: int) -> LabelledMesh:
        """Return the outside of the cells; all its faces have the label."""
        padded = np.pad(self.solid, 1)
        voxels, outwards = [], []
        for axis in range(3):
            for step in (1, -1):
                bare = np.argwhere(padded & ~np.roll(padded, -step, axis))
                voxels.append(bare - 1)
                outwards.append(np.broadcast_to(step * np.eye(3)[axis], bare.shape))
        voxel, outward = np.vstack(voxels), np.vstack(outwards)
        centres = self.low + (voxel + 0.5 + outward / 2) * self.side_m
        faces = BoundaryFaces(np.arange(len(voxel)), centres, outward)
        vertices, triangles = faces.triangles(self.side_m)
        turned = np.where(np.repeat(outward.sum(axis=1) < 0, 2)[:, None], triangles[:, ::-1], triangles)
        return LabelledMesh(vertices, turned, np.full(len(triangles), label, np.int32))


def _caster(mesh: LabelledMesh, n_threads: int | None) -> RayCaster:
    return RayCaster(mesh.vertices, mesh.faces, n_threads)
