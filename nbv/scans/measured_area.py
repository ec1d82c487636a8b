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

from nbv.online.surfels import image_normals, sides_of
from nbv.visibility.requirement import GRAZING_COSINE, Requirement
from nbv.visibility.voxel_grid import VoxelGrid
from nbv.visibility.zones import EVERYWHERE, Zones
from scenes.checks import BoolArray, FloatArray
from scenes.scan.range_image import RangeImage

_SIDES = 6
_RIM_M = 0.01  # surface on a face of the region is in it, however noisy
_MOST = 1.5  # cell faces that the surface in a cell may fill: a slanted one is larger than the face


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
    def of(cls, scan: RangeImage, requirement: Requirement, baseline_m: float) -> PixelQuality:
        """Return the quality of a scan's pixels; normals are estimated over `baseline_m` metres."""
        local = image_normals(scan, baseline_m)
        with np.errstate(invalid="ignore"):
            pixel = np.flatnonzero((local.cosine.ravel() >= GRAZING_COSINE) & scan.valid.ravel())
        cosine = local.cosine.ravel()[pixel]
        met = requirement.limits_of_scan(scan).hold(scan.ranges.ravel()[pixel], cosine)
        points, normals = (array.reshape(-1, 3)[pixel] for array in (scan.points(), local.normals))
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


def measure_area(
    scans: Sequence[RangeImage], requirement: Requirement, grid: VoxelGrid, zones: Zones = EVERYWHERE
) -> MeasuredArea:
    """Measure the surface that registered scans have measured; those without a `sigma_m` count as exact.

    With k above 1 so many scans must have measured a cell as required. Several scans measure the same surface
    in a cell of `grid`; beyond it nothing counts, nor outside the region of `zones`, 1 cm around it apart.
    """
    found = [_by_cell(scan, requirement, grid, zones) for scan in scans]
    keys, areas, good = (np.concatenate(part) for part in zip(*found, strict=True))
    every, which = np.unique(keys, return_inverse=True)
    most = _MOST * grid.voxel_m**2
    whole = np.zeros(len(every))
    np.maximum.at(whole, which, np.minimum(areas, most))
    met = _kth_largest(which, np.minimum(good, most), len(every), requirement.k)
    return MeasuredArea(float(met.sum()), float((whole - np.minimum(met, whole)).sum()))


def _by_cell(
    scan: RangeImage, requirement: Requirement, grid: VoxelGrid, zones: Zones
) -> tuple[NDArray[np.int64], FloatArray, FloatArray]:
    """Return what one scan measures: cells by the side that normals lean to, area there, good area there.

    Returns whose neighbours give no normal (noise, drop-outs, the image's rim) count like the others of their
    cell; where there are no others they are strays.
    """
    pixels = PixelQuality.of(scan, requirement, grid.voxel_m / 2)
    cell = grid.index_of(pixels.points)
    inside = (cell >= 0) & zones.of_interest(pixels.points, _RIM_M)
    returns = grid.index_of(scan.points()[scan.valid])
    n_returns = np.bincount(returns[returns >= 0], minlength=grid.n_voxels)
    n_used = np.bincount(cell[cell >= 0], minlength=grid.n_voxels)
    cell, area, met = cell[inside], pixels.areas[inside], pixels.met[inside]
    area = area * (n_returns / np.maximum(n_used, 1))[cell]
    keys, which = np.unique(cell * _SIDES + sides_of(pixels.normals[inside]), return_inverse=True)
    whole, good = (np.bincount(which, part, len(keys)).astype(np.float64) for part in (area, area * met))
    return keys, whole, good


def _kth_largest(which: NDArray[np.int64], values: FloatArray, n: int, k: int) -> FloatArray:
    """Return for each of n groups the k-th largest of its values, 0 for groups of fewer."""
    order = np.lexsort((-values, which))
    start = np.searchsorted(which[order], np.arange(n))
    count = np.bincount(which, minlength=n)
    kth: FloatArray = np.zeros(n)
    enough = count >= k
    kth[enough] = values[order][start[enough] + k - 1]
    return kth
