# SPDX-License-Identifier: MIT
"""Obstacles: what stands in the way in a building that was checked, its extras as solids of small cells."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_closing

from completion.asbuilt import limits
from completion.asbuilt.findings import DesignCheck
from nbv.online.occupancy import BoundaryFaces
from scenes.checks import BoolArray, FloatArray
from scenes.mesh.labelled_mesh import LabelledMesh, join_meshes
from scenes.rays.raycast import RayCaster

_MOST_CELLS = 20_000  # in the box of an extra: beyond, its cells are twice as large
_HOLE = 2  # cells of an extra: narrower gaps between measured ones are surface too
_SPACE_M, _MOST_SPACE = 0.15, 600_000  # side of cells of space at least, and how many there are at most
_STEPS = 48  # along a line of sight


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
    space : Space
        Which of it the scans so far could see.
    """

    solid: LabelledMesh
    caster: RayCaster
    owner: NDArray[np.int32]
    design: RayCaster
    space: Space

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
        space = Space.seen_from(eyes, measured, mesh.bounds())
        return cls(join_meshes([mesh.some(stands), *extras]), caster, owner, design, space)


@dataclass(frozen=True, slots=True, eq=False)
class Space:
    """Cells of space from `low` (3,) on, of side `side_m`, metres; no scan saw those `unseen`."""

    low: FloatArray
    side_m: float
    unseen: BoolArray

    @classmethod
    def seen_from(cls, eyes: FloatArray, caster: RayCaster, bounds: FloatArray) -> Space:
        """Return which cells within bounds (2, 3) no eye (s, 3) sees."""
        extent = np.maximum(np.ptp(bounds, axis=0), _SPACE_M)
        side = max(_SPACE_M, float(np.cbrt(extent.prod() / _MOST_SPACE)))
        shape = np.ceil(extent / side).astype(np.int64)
        unseen = _unseen_from(eyes, caster, bounds[0] + (np.argwhere(np.ones(shape)) + 0.5) * side)
        return cls(bounds[0], side, unseen.reshape(shape))

    def unseen_m(self, starts: FloatArray, ends: FloatArray) -> FloatArray:
        """Return how much of the lines between places (n, 3) lies in cells that nobody saw, metres."""
        way, found = ends - starts, np.zeros(len(starts))
        for step in (np.arange(_STEPS) + 0.5) / _STEPS:
            cell = ((starts + step * way - self.low) / self.side_m).astype(np.int64)
            found += self.unseen[tuple(np.clip(cell, 0, np.array(self.unseen.shape) - 1).T)]
        return np.asarray(found / _STEPS * np.linalg.norm(way, axis=1))


def _unseen_from(eyes: FloatArray, caster: RayCaster, places: FloatArray) -> BoolArray:
    """Tell which places (n, 3) no eye (s, 3) sees."""
    unseen = np.ones(len(places), np.bool_)
    for eye in eyes:
        left = np.flatnonzero(unseen)
        unseen[left] = caster.are_blocked(places[left], eye[None])
    return unseen


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
        closed = binary_closing(np.pad(solid, _HOLE), np.ones((3, 3, 3)), _HOLE)
        return cls(low, side, solid | closed[(slice(_HOLE, -_HOLE),) * 3])

    def filled(self, eyes: FloatArray, caster: RayCaster) -> _Cells:
        """Return the cells with those that no eye (s, 3) sees."""
        open_ = np.argwhere(~self.solid)
        hidden = _unseen_from(eyes, caster, self.low + (open_ + 0.5) * self.side_m)
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
