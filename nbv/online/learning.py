# SPDX-License-Identifier: MIT
"""Learning: scans are written into the voxels of what is known."""

from __future__ import annotations

from collections.abc import Sequence

from nbv.online.occupancy import VoxelMap
from nbv.scanning.sensors.sensor import Sensor
from scenes.scan.range_image import RangeImage


def recall(voxels: VoxelMap, given: Sequence[RangeImage], sensor: Sensor, clearance_m: float) -> VoxelMap:
    """Write scans that were taken before into the voxels.

    Pixels without return of a scan by another instrument than `sensor` say nothing: what they would have met,
    and how far away, nobody knows.
    """
    for scan in given:
        voxels = learn(voxels, scan, sensor if scan.sensor == sensor.name else None, clearance_m)
    return voxels


def learn(voxels: VoxelMap, scan: RangeImage, sensor: Sensor | None, clearance_m: float) -> VoxelMap:
    """Write a scan into the voxels; within a room, the place where the sensor stands is free too."""
    voxels = voxels.integrated(scan, sensor)
    if voxels.outside_is_empty:
        return voxels
    return voxels.cleared(scan.origin, clearance_m + voxels.grid.voxel_m)
