# SPDX-License-Identifier: MIT
"""Feasible viewpoints: the candidates in space that is known to be free, above floor that was seen.

Seen floor: where scans show that one walks to from the places where scanners stood, on every storey.
Told as in a known scene (`nbv.visibility.floors`): level surface with headroom, joined where one
steps from one patch to the next. A table is a step too high, so it is no floor, whatever its area.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from nbv.online.limits import LOWEST_M, STRIDE_M, TALLEST_M
from nbv.online.occupancy import EMPTY, SEEN, VoxelMap
from nbv.online.voxels import UPWARD
from nbv.visibility.limits import FOOT_M, HEADROOM_M, RAMP_DEG, SILL_M, STEP_M, UNEVEN_M, WALKABLE
from nbv.visibility.viewpoints import Candidates
from nbv.visibility.zones import Zones
from scenes.checks import BoolArray, FloatArray
from scenes.pose import Pose


@dataclass(frozen=True, slots=True, eq=False)
class SeenFloor:
    """Voxels that hold floor on which a scanner stood, or to which one walks from there.

    Pieces of a storey's floor between which nobody has looked yet are told by their height alone.
    `voxels` (n,) ascend; `is_even` (n,) tells which are level under all of a tripod's feet, as far as seen.
    """

    voxels: NDArray[np.int64]
    is_even: BoolArray

    @classmethod
    def of(cls, voxels: VoxelMap) -> SeenFloor:
        """Return the floor that the scans of a map show; none where no scanner has floor below it."""
        surfels = voxels.surfels
        level = np.flatnonzero((surfels.sides == UPWARD) & (surfels.normals[:, 2] >= WALKABLE))
        level = level[_has_headroom(voxels, surfels.voxels[level])]
        points, cells = surfels.points[level], surfels.voxels[level]
        side = voxels.grid.voxel_m
        first, second = _pairs(points, max(STRIDE_M, 2 * side))
        steps = np.abs(points[first, 2] - points[second, 2]) <= STEP_M
        links = coo_array(
            (np.ones(int(steps.sum()), np.int8), (first[steps], second[steps])), shape=(len(level),) * 2
        )
        walk = connected_components(links, directed=False)[1]
        footings = [_find_footing(place, points, surfels.areas[level], walk) for place in voxels.stood]
        held = np.isin(walk, [number for number, _ in footings])
        for _, height in footings:
            held |= np.abs(points[:, 2] - height) <= SILL_M
        even = _is_even(points, walk, FOOT_M + side / 2)
        return cls(cells[held], even[held])


def _has_headroom(voxels: VoxelMap, cells: NDArray[np.int64]) -> BoolArray:
    """Tell over which voxels (n,) nothing was seen as high as a person needs."""
    height = voxels.grid.shape[2]
    seen = np.pad((voxels.labels == SEEN).reshape(-1, height).cumsum(axis=1), ((0, 0), (1, 0)))
    column, level = np.divmod(cells, height)
    top = np.minimum(level + 1 + int(HEADROOM_M / voxels.grid.voxel_m), height)
    return np.asarray(seen[column, top] == seen[column, np.minimum(level + 1, height)])


def _pairs(points: FloatArray, reach_m: float) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Pairs of points (n, 3) no farther apart than `reach_m` along the ground."""
    if not len(points):
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    pairs = cKDTree(points[:, :2]).query_pairs(reach_m, output_type="ndarray").astype(np.int64)
    return pairs[:, 0], pairs[:, 1]


def _find_footing(
    place: FloatArray, points: FloatArray, areas: FloatArray, walk: NDArray[np.int64]
) -> tuple[int, float]:
    """Return the walk that fills most of what is level in sight below a scanner, and its height; -1 for none.

    The height, metres, is that of the part in sight, near surface counting more.
    """
    below = place[2] - points[:, 2]
    near = np.flatnonzero((below >= LOWEST_M) & (below <= TALLEST_M))
    if not len(near):
        return -1, np.nan
    weight = areas[near] / ((points[near] - place) ** 2).sum(axis=1)
    number = int(np.argmax(np.bincount(walk[near], weight)))
    of_it = near[walk[near] == number]
    order = of_it[np.argsort(points[of_it, 2], kind="stable")]
    total = np.cumsum(weight[np.searchsorted(near, order)])
    return number, float(points[order[np.searchsorted(total, total[-1] / 2)], 2])


def _is_even(points: FloatArray, walk: NDArray[np.int64], reach_m: float) -> BoolArray:
    """Tell around which points (n, 3) nothing of the same walk is higher or lower than a ramp makes it."""
    first, second = _pairs(points, reach_m)
    slack = reach_m * float(np.tan(np.radians(RAMP_DEG))) + UNEVEN_M
    off = (walk[first] == walk[second]) & (np.abs(points[first, 2] - points[second, 2]) > slack)
    even = np.ones(len(points), np.bool_)
    even[first[off]] = even[second[off]] = False
    return even


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


def _first_below(voxels: VoxelMap) -> NDArray[np.int64]:
    """For each voxel the number of the first that is not empty, itself or straight below; -1 for none."""
    solid = (voxels.labels != EMPTY).reshape(voxels.grid.shape)
    number = np.where(solid, np.arange(voxels.grid.n_voxels).reshape(solid.shape), -1)
    return np.maximum.accumulate(number, axis=2).ravel()
