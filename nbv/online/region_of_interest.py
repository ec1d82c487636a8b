# SPDX-License-Identifier: MIT
"""Concern: which voxels matter to a plan that is to measure a region of the volume alone."""

from __future__ import annotations

import numpy as np

from nbv.online.occupancy import EMPTY, SEEN, VoxelMap
from nbv.visibility.zones import Zones
from scenes.checks import BoolArray


def of_interest(voxels: VoxelMap, zones: Zones) -> BoolArray:
    """Tell which voxels (n_voxels,) are to be known: all until known space has reached the region."""
    everywhere = np.ones(voxels.grid.n_voxels, np.bool_)
    if zones.region is None:
        return everywhere
    known = np.flatnonzero((voxels.labels == EMPTY) | (voxels.labels == SEEN))
    if not zones.region.holds(voxels.grid.centres(known)).any():
        return everywhere
    return zones.of_interest(voxels.grid.centres(), voxels.grid.voxel_m)
