# SPDX-License-Identifier: MIT
"""Scan map: what scans that were really taken say of a place that nobody has a model of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from completion.observe.range_noise import estimate_noise
from nbv.online.feasible_viewpoints import floor_level
from nbv.online.occupancy import VoxelMap
from nbv.online.planner import PlannerOptions
from nbv.scanning.sensors.sensor import Sensor
from nbv.visibility.viewpoints import (
    TRIPOD_HEIGHTS_M,
    Candidates,
    room_lattice,
    sensor_directions,
    viewing_sphere,
)
from nbv.visibility.zones import EVERYWHERE, Zones
from scenes.checks import FloatArray, InputError
from scenes.scan.range_image import RangeImage
from scenes.world.scene import Mode

_CELL_M = 0.05  # of the lattice by which points are thinned, so that near surface has no more say than far
_STRAY = 0.002  # share of its cells that may lie beyond the volume on either side: stray echoes
_MOST_POSITIONS = 600
_CLOSEST_M, _WIDEST_M = 0.2, 0.5  # candidate positions lie so far apart
_BELOW_M = 0.2  # what a scanner stands on lies at least so far below it


@dataclass(frozen=True, slots=True, eq=False)
class ScanMap:
    """Scans of a place, and the voxels that they filled.

    Attributes
    ----------
    scans : tuple of RangeImage
        World coordinates; each with the deviation of its ranges, read off the scan where it was not known.
    voxels, mode : VoxelMap, "room" or "object"
        What they say of the volume, and whether the sensor stands within it or moves around it.
    floor_m : float or None
        Height of the floor that scanners stand on; None where none was seen below them.
    clearance_m : float
        Within which distance of a scanner's place a room is known to be empty, metres; 0 around an object.
    """

    scans: tuple[RangeImage, ...]
    voxels: VoxelMap
    mode: Mode
    floor_m: float | None
    clearance_m: float

    @classmethod
    def of(
        cls,
        scans: Sequence[RangeImage],
        sensor: Sensor,
        *,
        mode: Mode = "room",
        options: PlannerOptions | None = None,
        zones: Zones = EVERYWHERE,
    ) -> ScanMap:
        """Write registered scans, z up, into the voxels of the volume that they measured in.

        Pixels without return of scans that another instrument than `sensor`, which scans next, took say
        nothing. A region enlarges a room's volume where it reaches beyond it, and is that of an object.

        Raises
        ------
        InputError
            Scans without any return.
        """
        options = options or PlannerOptions()
        scans = tuple(with_known_noise(scan) for scan in scans)
        outside = mode == "object"
        volume = _volume(scans, options.clearance_m, zones, from_outside=outside)
        blank = VoxelMap.unknown(volume, voxel_m=options.voxel_m, outside_is_empty=outside)
        voxels = blank.with_given(scans, sensor, options.clearance_m)
        level = floor_level(voxels)
        standing = min(float(scan.origin[2]) for scan in scans) - _BELOW_M
        has_floor = level is not None and level <= standing and not outside
        return cls(scans, voxels, mode, level if has_floor else None, 0.0 if outside else options.clearance_m)

    @property
    def bounds(self) -> FloatArray:
        """The volume (2, 3), metres."""
        grid = self.voxels.grid
        return np.stack([grid.origin, grid.origin + np.array(grid.shape) * grid.voxel_m])

    def candidates(self, sensor: Sensor, clearance_m: float = 0.3) -> Candidates:
        """Return where the sensor might go next; which of it is known to be free is for the planner to say.

        A viewing sphere around an object; within a room a lattice at tripod heights above the floor, or at
        all heights where no floor was seen.
        """
        if self.mode == "object":
            return viewing_sphere(self.bounds, sensor)
        low, high = self.bounds
        if self.floor_m is None:
            spacing = float(np.cbrt(np.prod(high - low) / _MOST_POSITIONS))
            heights = tuple(np.arange(clearance_m, high[2] - low[2], max(spacing, _CLOSEST_M)).tolist())
        else:
            low = np.array([*low[:2], self.floor_m])
            heights = TRIPOD_HEIGHTS_M
            spacing = float(np.sqrt(np.prod((high - low)[:2]) * len(heights) / _MOST_POSITIONS))
        spacing = max(spacing, _CLOSEST_M) if spacing < _WIDEST_M else spacing
        lattice = room_lattice(
            np.stack([low, high]), spacing_m=spacing, heights_m=heights, clearance_m=clearance_m
        )
        return Candidates(lattice, sensor_directions(sensor, 2))


def with_known_noise(scan: RangeImage) -> RangeImage:
    """Return the scan with `sigma_m`; an unknown one is estimated from the roughness at the median range."""
    if scan.sigma_m is not None or not scan.valid.any():
        return scan
    noise = estimate_noise(scan)
    return replace(scan, sigma_m=float(noise.sigma(np.array([np.median(scan.ranges[scan.valid])]))[0]))


def _volume(
    scans: Sequence[RangeImage], clearance_m: float, zones: Zones, *, from_outside: bool
) -> FloatArray:
    """Bounds (2, 3) of what was measured, strays apart, and in a room of where the scanners stood."""
    points = np.vstack([scan.points()[scan.valid] for scan in scans])
    if not len(points):
        raise InputError("the scans have no returns: there is nothing to plan from")
    cells = np.unique(np.floor(points / _CELL_M).astype(np.int64), axis=0)
    measured = (np.quantile(cells, [_STRAY, 1 - _STRAY], axis=0) + [[0.0], [1.0]]) * _CELL_M
    region = [] if zones.region is None else [zones.region.low, zones.region.high]
    if from_outside:
        return np.array(region) if region else measured
    stood = np.array([scan.origin for scan in scans])
    around = [stood.min(axis=0) - clearance_m - _CELL_M, stood.max(axis=0) + clearance_m + _CELL_M]
    corners = np.vstack([measured, around, *region])
    return np.stack([corners.min(axis=0), corners.max(axis=0)])
