# SPDX-License-Identifier: MIT
"""Targets: unknown faces and badly seen surface, what each is worth, and which voxels matter at all."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nbv.coverage.surface_classes import KnownSurfaces
from nbv.online.occupancy import EMPTY, SEEN, VoxelMap
from nbv.online.possible_solid import PossibleSurface
from nbv.visibility.zones import Zones
from scenes.checks import BoolArray, FloatArray, InputError, Value


@dataclass(frozen=True, slots=True, kw_only=True)
class GainOptions(Value):
    """Weights of the gain.

    Parameters
    ----------
    occplane_weight : float
        w_v, for unknown surface; with completion times the chance of new surface there (`ExpectedGain`).
    quality_weight : float
        w_q, for surface seen worse than required; 0 gives the planner that only looks for the unknown.
    modelled_weight : float
        Factor of w_q where completion models the surface exactly enough without a better view.
    angle_margin_deg : float
        By how many degrees a predicted view must be better than required: voxels know normals roughly.
    max_attempts : int
        A target no longer counts after this many views that should have settled it.
    max_targets : int
        Candidates are compared by at most so many targets; above, every k-th stands for its neighbours.
    views_ahead : int
        So many views are planned together, of which the first is taken; 1 takes the largest gain each time.

    Raises
    ------
    InputError
        Negative weights or margin, both weights 0, counts below 1.
    """

    occplane_weight: float = 1.0
    quality_weight: float = 1.0
    modelled_weight: float = 0.05
    angle_margin_deg: float = 2.0
    max_attempts: int = 2
    max_targets: int = 2000
    views_ahead: int = 3

    def __post_init__(self) -> None:
        least = min(self.occplane_weight, self.quality_weight, self.modelled_weight, self.angle_margin_deg)
        if least < 0:
            raise InputError(f"weights and margin of the gain must not be negative, got {self}")
        if self.occplane_weight == 0 and self.quality_weight == 0:
            raise InputError("with both weights 0 no view has any gain; give one a positive weight")
        if min(self.max_attempts, self.max_targets, self.views_ahead) < 1:
            raise InputError(f"max_attempts, max_targets and views_ahead must be at least 1, got {self}")


@dataclass(frozen=True, slots=True, eq=False)
class Targets:
    """Targets that a view should see.

    A view must look at `points` (n, 3) in free space just before the target; `normals` (n, 3) are the
    target's, `worth_m2` (n,) weighted area, `voxel` (n,) where it is. Unknown faces are foreshortened, badly
    seen surface counts all or nothing (`is_unknown`, (n,)).
    """

    points: FloatArray
    normals: FloatArray
    worth_m2: FloatArray
    voxel: NDArray[np.int64]
    is_unknown: BoolArray

    def __len__(self) -> int:
        return len(self.points)

    def some(self, chosen: BoolArray | NDArray[np.int64] | slice, times_worth: int = 1) -> Targets:
        """Return the targets chosen by a mask (n,) or numbers (m,), each worth so many times as much."""
        worth = self.worth_m2[chosen] * times_worth
        return Targets(
            self.points[chosen], self.normals[chosen], worth, self.voxel[chosen], self.is_unknown[chosen]
        )

    def thin(self, n_most: int) -> Targets:
        """Return at most about `n_most` targets: every k-th, worth k times as much."""
        k = -(-len(self) // n_most)
        return self if k <= 1 else self.some(slice(k // 2, None, k), k)


def find_targets(
    voxels: VoxelMap,
    surface: PossibleSurface,
    *,
    required_cosine: float,
    attempts: NDArray[np.int32],
    options: GainOptions,
    completed: KnownSurfaces | None = None,
) -> Targets:
    """List what nobody has seen of the surface of what is possible, and what was seen worse than required.

    `attempts` (2, n_voxels) count the views that should have settled a voxel's badly seen surface (0) and
    unknown surface (1). Badly seen surface that `completed` models is worth little.
    """
    side, unknown = voxels.grid.voxel_m, surface.is_unknown
    tried = attempts[unknown.astype(np.int64), surface.voxel] < options.max_attempts
    kept = np.flatnonzero((surface.cosine < required_cosine) & (surface.voxel >= 0) & tried)
    unknown, normals = unknown[kept], surface.normals[kept]
    weight = np.where(unknown, options.occplane_weight, options.quality_weight)
    if completed is not None:
        known = completed.on_modelled(surface.centres[kept], normals, side / 2)
        weight[known & ~unknown] *= options.modelled_weight
    targets = Targets(
        points=surface.centres[kept] + normals * (side / 2),
        normals=normals,
        worth_m2=weight * surface.areas[kept],
        voxel=surface.voxel[kept],
        is_unknown=unknown,
    )
    return targets.some(targets.worth_m2 > 0)


def voxels_of_interest(voxels: VoxelMap, zones: Zones) -> BoolArray:
    """Tell which voxels (n_voxels,) are to be known: all until known space has reached the region."""
    everywhere = np.ones(voxels.grid.n_voxels, np.bool_)
    if zones.region is None:
        return everywhere
    known = np.flatnonzero((voxels.labels == EMPTY) | (voxels.labels == SEEN))
    if not zones.region.holds(voxels.grid.centres(known)).any():
        return everywhere
    return zones.of_interest(voxels.grid.centres(), voxels.grid.voxel_m)
