# SPDX-License-Identifier: MIT
"""Voxel walk: the voxels that rays from a position pass until they end in seen surface or leave the volume.

After J. Amanatides and A. Woo, "A fast voxel traversal algorithm for ray tracing", Eurographics 1987. The
rays of a position are a grid of pixels that holds the volume, or the six faces of a cube around a position in
it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from nbv.online.occupancy import EMPTY, SEEN, VoxelMap
from nbv.online.voxels import VoxelGrid
from scenes.checks import BoolArray, FloatArray
from scenes.pose import rotations_towards
from texture.engine.compiled import compiled

PASSED, UNKNOWN, MEASURED, CLOSED = range(4)  # what a voxel is to a ray
_ALONG_EDGE = 64  # pixels of the grid of a position outside
_ALONG_CUBE = 32  # and of each face of the cube around one inside: rays 2.8 deg apart
_WIDEST = 1.0  # tangent of half the angle of a grid: that of a cube's face


@dataclass(frozen=True, slots=True, eq=False)
class KnownSpace:
    """A voxel map as rays meet it.

    Attributes
    ----------
    kinds : (nx, ny, nz) int8
        `PASSED` where empty, `UNKNOWN`, `MEASURED` where seen, and `CLOSED` for unknown voxels that do not
        count: they end a ray as a wall would.
    nearness : (nx, ny, nz) float32
        What each unknown voxel adds to `Walked.nearness`.
    """

    grid: VoxelGrid
    kinds: NDArray[np.int8]
    nearness: NDArray[np.float32]

    @classmethod
    def of(
        cls, voxels: VoxelMap, counts: BoolArray, nearness: NDArray[np.float32] | None = None
    ) -> KnownSpace:
        """Return the space of a map in which of the unknown voxels only those that `counts` (n_voxels,) do.

        `nearness` is (nx, ny, nz), zero when not given.
        """
        kinds = np.where(counts, UNKNOWN, CLOSED).astype(np.int8)
        kinds[voxels.labels == EMPTY] = PASSED
        kinds[voxels.labels == SEEN] = MEASURED
        shape = voxels.grid.shape
        if nearness is None:
            nearness = np.zeros(shape, np.float32)
        return cls(voxels.grid, kinds.reshape(shape), nearness)

    def walk(self, position: FloatArray, rays: Rays, max_range_m: float) -> Walked:
        """Return what rays from a position (3,), metres, pass within the range."""
        side = self.grid.voxel_m
        start = (np.asarray(position, dtype=np.float64) - self.grid.origin) / side
        directions = np.ascontiguousarray(rays.directions)
        walked = _walk(start, directions, self.kinds, self.nearness, max_range_m / side)
        return Walked(rays, *walked)


@dataclass(frozen=True, slots=True, eq=False)
class Rays:
    """Unit directions (n, 3) in world coordinates, and the solid angle (n,) that each stands for, sr."""

    directions: FloatArray
    solid_angle: FloatArray

    @classmethod
    def into(cls, grid: VoxelGrid, position: FloatArray) -> Rays:
        """Return rays from a position (3,), metres, that cover the volume; all around from within it."""
        middle = grid.origin + np.array(grid.shape) * grid.voxel_m / 2
        radius = float(np.linalg.norm(grid.shape)) * grid.voxel_m / 2
        away = float(np.linalg.norm(position - middle))
        if away * away < 2 * radius * radius:  # the volume reaches beyond 45 deg around its middle
            return AROUND
        tangent = radius / np.sqrt(away * away - radius * radius)
        return _square((middle - position)[None], tangent, _ALONG_EDGE)


def _square(axes: FloatArray, tangent: float, n: int) -> Rays:
    """Return n x n rays around each of the axes (m, 3), as far as half an angle with that tangent."""
    across = ((np.arange(n) + 0.5) / n * 2 - 1) * tangent
    u, v = np.meshgrid(across, across, indexing="ij")
    local = np.stack([u.ravel(), v.ravel(), np.ones(n * n)], axis=1)
    length = np.linalg.norm(local, axis=1)
    solid_angle = (2 * tangent / n) ** 2 / length**3
    unit = local / length[:, None]
    directions = np.concatenate([unit @ rotation.T for rotation in rotations_towards(axes)])
    return Rays(directions, np.tile(solid_angle, len(axes)))


AROUND = _square(np.vstack([np.eye(3), -np.eye(3)]), _WIDEST, _ALONG_CUBE)


class Walked(NamedTuple):
    """What rays pass.

    Attributes
    ----------
    rays : Rays
        The n rays.
    first : (n,) int64
        Number of the first voxel that is not empty; -1 where the ray meets none.
    away : (n,) float
        Distance to where the ray enters that voxel, in sides of a voxel; infinite where there is none.
    is_unknown : (n,) bool
        Whether that voxel is unknown, and counts.
    end : (n,) int64
        Number of the seen voxel in which the ray ends; -1 where it ends in none.
    is_rear : (n,) bool
        Whether the ray comes to that voxel out of an unknown one.
    n_passed : (n, 3) int64
        Empty, unknown and seen voxels up to the end, that included.
    nearness : (n,) float
        Sum over the unknown ones.
    """

    rays: Rays
    first: NDArray[np.int64]
    away: FloatArray
    is_unknown: BoolArray
    end: NDArray[np.int64]
    is_rear: BoolArray
    n_passed: NDArray[np.int64]
    nearness: FloatArray


@compiled
def _walk(
    start: FloatArray,
    directions: FloatArray,
    kinds: NDArray[np.int8],
    nearness: NDArray[np.float32],
    reach: float,
) -> tuple[
    NDArray[np.int64],
    FloatArray,
    BoolArray,
    NDArray[np.int64],
    BoolArray,
    NDArray[np.int64],
    FloatArray,
]:
    """Return the fields of `Walked` for rays from one place; lengths are in sides of a voxel."""
    n = len(directions)
    first, away, is_unknown = np.full(n, -1, np.int64), np.full(n, np.inf), np.zeros(n, np.bool_)
    end, is_rear = np.full(n, -1, np.int64), np.zeros(n, np.bool_)
    n_passed, near = np.zeros((n, 3), np.int64), np.zeros(n)
    cell, leaves = np.empty(3, np.int64), np.empty(3)
    for r in range(n):
        # where the ray enters and leaves the volume
        at, until = 0.0, reach
        for axis in range(3):
            along = directions[r, axis]
            if along != 0:
                low, high = -start[axis] / along, (kinds.shape[axis] - start[axis]) / along
                at, until = max(at, min(low, high)), min(until, max(low, high))
            elif start[axis] < 0 or start[axis] >= kinds.shape[axis]:
                until = -1.0
        if at >= until:
            continue
        for axis in range(3):
            place = int(np.floor(start[axis] + at * directions[r, axis]))
            cell[axis] = min(max(place, 0), kinds.shape[axis] - 1)
        before = PASSED
        while True:
            kind = kinds[cell[0], cell[1], cell[2]]
            number = (cell[0] * kinds.shape[1] + cell[1]) * kinds.shape[2] + cell[2]
            if kind != PASSED and first[r] < 0:
                first[r], away[r], is_unknown[r] = number, at, kind == UNKNOWN
            if kind == CLOSED:
                break
            n_passed[r, kind] += 1
            if kind == MEASURED:
                end[r], is_rear[r] = number, before == UNKNOWN
                break
            if kind == UNKNOWN:
                near[r] += nearness[cell[0], cell[1], cell[2]]
            before = kind
            # the next voxel is behind the nearest of the planes ahead
            for axis in range(3):
                along = directions[r, axis]
                ahead = cell[axis] + (1 if along > 0 else 0)
                leaves[axis] = (ahead - start[axis]) / along if along != 0 else np.inf
            axis = 0
            for other in range(1, 3):
                if leaves[other] < leaves[axis]:
                    axis = other
            at = max(at, leaves[axis])
            cell[axis] += 1 if directions[r, axis] > 0 else -1
            if at >= until or cell[axis] < 0 or cell[axis] >= kinds.shape[axis]:
                break
    return first, away, is_unknown, end, is_rear, n_passed, near
