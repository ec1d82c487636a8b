# SPDX-License-Identifier: MIT
"""Standpoints: the candidates that are known to be free, with something to stand on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from nbv.online.floor_support import has_floor_support
from nbv.online.occupancy import VoxelMap
from nbv.visibility.viewpoints import Candidates
from nbv.visibility.zones import Zones
from scenes.pose import Pose


def feasible_viewpoints(
    candidates: Candidates,
    voxels: VoxelMap,
    here: Pose,
    clearance_m: float,
    *,
    on_floor: bool,
    zones: Zones,
) -> Candidates:
    """Return the candidates where the sensor can stand; where it stands it may also turn.

    Parameters
    ----------
    candidates : Candidates
        Where it might.
    voxels : VoxelMap
        What is known.
    here : Pose
        Where it stands now.
    clearance_m : float
        Known free space that it needs around it, metres.
    on_floor : bool
        Whether it needs seen floor below, in a room.
    zones : Zones
        Where it may not be.
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
