# SPDX-License-Identifier: MIT
"""Feasible viewpoints: the candidates in space that is known to be free, above floor that was seen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nbv.online.occupancy import EMPTY, VoxelMap
from nbv.online.seen_floor import TALLEST_M, SeenFloor
from nbv.online.surfels import UPWARD
from nbv.visibility.viewpoints import Candidates
from nbv.visibility.zones import Zones
from scenes.checks import BoolArray, FloatArray
from scenes.pose import Pose


def feasible_viewpoints(
    candidates: Candidates, voxels: VoxelMap, here: Pose, clearance_m: float, *, on_floor: bool, zones: Zones
) -> Candidates:
    """Return the candidates where the sensor can stand; where it stands, `here`, it may also turn.

    It needs known free space of `clearance_m` metres around it and, where `on_floor`, seen floor below in a
    room.
    """
    allowed = voxels.is_free(candidates.positions, clearance_m)
    if on_floor and not voxels.outside_is_empty:
        allowed &= has_floor_support(voxels, candidates.positions)
    free = candidates.at(allowed & zones.allow(candidates.positions))
    if free.directions.ndim == 3 or (np.linalg.norm(free.positions - here.translation, axis=1) < 1e-6).any():
        return free
    if not zones.allow(here.translation[None]).all():
        return free
    return replace(free, positions=np.vstack([free.positions, here.translation]))


def has_floor_support(voxels: VoxelMap, positions: FloatArray) -> BoolArray:
    """Tell below which positions (p, 3) everything is known to be empty, down to seen floor; world, metres.

    Floor is what one walks to from where scanners stood (`SeenFloor`), on any storey: no table, and nothing
    lower than the tallest tripod. It is level under the feet.
    """
    cell, floor = voxels.grid.index_of(positions), SeenFloor.of(voxels)
    below = _first_below(voxels)[cell]
    known = np.isin(below, floor.voxels[floor.is_even])
    down = positions[:, 2] - voxels.grid.centres(np.maximum(below, 0))[:, 2]
    return np.asarray((cell >= 0) & known & (down <= TALLEST_M))


def floor_level(voxels: VoxelMap) -> float | None:
    """Height at which the largest area of seen surface faces upwards, metres; None where none does."""
    surfels = voxels.surfels
    upward = surfels.sides == UPWARD
    if not upward.any():
        return None
    height = surfels.points[upward, 2]
    layer = np.floor((height - voxels.grid.origin[2]) / voxels.grid.voxel_m).astype(np.int64)
    area = np.bincount(layer, surfels.areas[upward])
    return float(np.median(height[layer == int(np.argmax(area))]))


def _first_below(voxels: VoxelMap) -> NDArray[np.int64]:
    """For each voxel the number of the first that is not empty, itself or straight below; -1 for none."""
    solid = (voxels.labels != EMPTY).reshape(voxels.grid.shape)
    number = np.where(solid, np.arange(voxels.grid.n_voxels).reshape(solid.shape), -1)
    return np.maximum.accumulate(number, axis=2).ravel()
