# SPDX-License-Identifier: MIT
"""Measured area: how much surface scans have measured, and how much of it as required, without a model.

Every pixel stands for a patch of surface. Patches of one scan add up; what several scans have measured of one
cell of space counts once, as much as the scan has that measured most of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nbv.online.limits import MOST_CELL_FACES, RIM_M
from nbv.online.voxels import VoxelGrid, image_normals, sides_of
from nbv.visibility.limits import GRAZING_COSINE
from nbv.visibility.requirement import Requirement, SightLimits
from nbv.visibility.zones import EVERYWHERE, Zones
from scenes.checks import BoolArray, FloatArray
from scenes.scan.range_image import RangeImage

_SIDES = 6


@dataclass(frozen=True, slots=True, eq=False)
class PixelQuality:
    """The n pixels of a scan with a normal, and whether each is measured as required, (n,).

    `pixel` (n,) is row * columns + column, `points` and `normals` (n, 3) are world coordinates in metres and
    towards the sensor, `cosine` and `areas` (n,) the cosine of incidence and square metres.
    """

    pixel: NDArray[np.int64]
    points: FloatArray
    normals: FloatArray
    cosine: FloatArray
    areas: FloatArray
    met: BoolArray

    @classmethod
    def of(
        cls,
        scan: RangeImage,
        requirement: Requirement,
        baseline_m: float,
        limits: SightLimits | None = None,
    ) -> PixelQuality:
        """Return the quality of a scan's pixels; normals are estimated over `baseline_m` metres.

        The requirement's `limits` are those of the scan unless it stands for one of more pixels.
        """
        local = image_normals(scan, baseline_m)
        with np.errstate(invalid="ignore"):
            pixel = np.flatnonzero((local.cosine.ravel() >= GRAZING_COSINE) & scan.valid.ravel())
        cosine = local.cosine.ravel()[pixel]
        met = (limits or requirement.limits_of_scan(scan)).hold(scan.ranges.ravel()[pixel], cosine)
        points, normals = (array.reshape(-1, 3)[pixel] for array in (local.points, local.normals))
        return cls(
            pixel=pixel,
            points=points,
            normals=normals,
            cosine=cosine,
            areas=local.areas.ravel()[pixel],
            met=met,
        )


@dataclass(frozen=True, slots=True)
class MeasuredArea:
    """Area in square metres that scans have measured as required, and worse than required."""

    met_m2: float
    worse_m2: float

    @property
    def total_m2(self) -> float:
        """All measured area."""
        return self.met_m2 + self.worse_m2


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredCells:
    """What scans have measured, by cells of a voxel grid and the side that normals lean to.

    `keys` (n,) are voxel number * 6 + side (+x, +y, +z, -x, -y, -z), ascending; `met_m2` and `whole_m2` (n,)
    the area there that is measured as required, and all that is measured.
    """

    keys: NDArray[np.int64]
    met_m2: FloatArray
    whole_m2: FloatArray

    @classmethod
    def of_scan(
        cls, scan: RangeImage, pixels: PixelQuality, grid: VoxelGrid, zones: Zones = EVERYWHERE
    ) -> MeasuredCells:
        """Return what one scan measures.

        Returns whose neighbours give no normal (noise, drop-outs, the image's rim) count like the others of
        their cell; where there are no others they are strays.
        """
        cell = grid.index_of(pixels.points)
        inside = (cell >= 0) & zones.of_interest(pixels.points, RIM_M)
        returns = grid.index_of(scan.points()[scan.valid])
        n_returns = np.bincount(returns[returns >= 0], minlength=grid.n_voxels)
        n_used = np.bincount(cell[cell >= 0], minlength=grid.n_voxels)
        cell, area, met = cell[inside], pixels.areas[inside], pixels.met[inside]
        area = area * (n_returns / np.maximum(n_used, 1))[cell]
        key = cell * _SIDES + sides_of(pixels.normals[inside])
        n_keys = grid.n_voxels * _SIDES
        keys = np.flatnonzero(np.bincount(key, minlength=n_keys))
        good, whole = (np.bincount(key, part, n_keys)[keys] for part in (area * met, area))
        return cls(keys, good.astype(np.float64), whole.astype(np.float64))

    @classmethod
    def of_all(cls, cells: Sequence[MeasuredCells], grid: VoxelGrid, k: int = 1) -> MeasuredCells:
        """Return what several scans have measured: of each cell as much as the best of them.

        As required it is measured where `k` of them did so.
        """
        every, which = np.unique(np.concatenate([cells.keys for cells in cells]), return_inverse=True)
        most = MOST_CELL_FACES * grid.voxel_m**2
        whole = np.zeros(len(every))
        np.maximum.at(whole, which, np.minimum(np.concatenate([cells.whole_m2 for cells in cells]), most))
        good = np.minimum(np.concatenate([cells.met_m2 for cells in cells]), most)
        return cls(every, np.minimum(_kth_largest(which, good, len(every), k), whole), whole)

    @property
    def total(self) -> MeasuredArea:
        """All of it."""
        return MeasuredArea(float(self.met_m2.sum()), float((self.whole_m2 - self.met_m2).sum()))

    def before(self, grid: VoxelGrid) -> FloatArray:
        """Places (n, 3) a voxel before the surface in each cell, world coordinates in metres."""
        cell, side = np.divmod(self.keys, _SIDES)
        outward = np.vstack([np.eye(3), -np.eye(3)])[side]
        return grid.centres(cell) + grid.voxel_m * outward


def measure_area(
    scans: Sequence[RangeImage], requirement: Requirement, grid: VoxelGrid, zones: Zones = EVERYWHERE
) -> MeasuredArea:
    """Measure the surface that registered scans have measured; those without a `sigma_m` count as exact.

    With k above 1 so many scans must have measured a cell as required. Several scans measure the same surface
    in a cell of `grid`; beyond it nothing counts, nor outside the region of `zones`, 1 cm around it apart.
    """
    cells = [
        MeasuredCells.of_scan(scan, PixelQuality.of(scan, requirement, grid.voxel_m / 2), grid, zones)
        for scan in scans
    ]
    return MeasuredCells.of_all(cells, grid, requirement.k).total


def _kth_largest(which: NDArray[np.int64], values: FloatArray, n: int, k: int) -> FloatArray:
    """Return for each of n groups the k-th largest of its values, 0 for groups of fewer."""
    order = np.lexsort((-values, which))
    start = np.searchsorted(which[order], np.arange(n))
    count = np.bincount(which, minlength=n)
    kth: FloatArray = np.zeros(n)
    enough = count >= k
    kth[enough] = values[order][start[enough] + k - 1]
    return kth
