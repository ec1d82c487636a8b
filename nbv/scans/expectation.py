# SPDX-License-Identifier: MIT
"""Expectation: what the scans before a scan said that it would settle from where it stood, and what it did.

The same area that the planner's gain counts: boundary of the unknown, foreshortened, and surface that had
been seen at a worse angle than required.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nbv.online.gain import ViewEvaluation, seen_from
from nbv.online.occupancy import EMPTY, SEEN, VoxelMap
from nbv.online.planner import wanted_cosine
from nbv.online.targets import GainOptions, find_targets, voxels_of_interest
from nbv.scanning.sensor import Sensor
from nbv.visibility.requirement import Requirement
from nbv.visibility.zones import EVERYWHERE, Zones
from scenes.rays.raycast import RayCaster
from scenes.scan.range_image import RangeImage


@dataclass(frozen=True, slots=True)
class Settled:
    """What a scan was expected to settle, and what of it it settled, weighted square metres."""

    expected_m2: float
    settled_m2: float


def settled(
    before: VoxelMap,
    after: VoxelMap,
    scan: RangeImage,
    *,
    sensor: Sensor,
    requirement: Requirement,
    gain: GainOptions,
    zones: Zones = EVERYWHERE,
) -> Settled:
    """Compare what a map said of a scan from where it stood with the map after the scan.

    What lies in the scan's field of view counts, within the range of `sensor`. An unknown voxel is settled
    when it is known to be empty or holds a sample; badly seen surface when none is left in its voxel.
    """
    expected = _expected(before, scan, sensor=sensor, requirement=requirement, gain=gain, zones=zones)
    known = (after.labels == EMPTY) | (after.labels == SEEN)
    poor = np.zeros(after.grid.n_voxels, np.bool_)
    poor[after.surfels.voxels[after.surfels.quality < requirement.min_cosine]] = True
    done = np.where(expected.is_unknown, known[expected.voxel], ~poor[expected.voxel])
    return Settled(float(expected.worth_m2.sum()), float(expected.worth_m2[done].sum()))


def _expected(
    before: VoxelMap,
    scan: RangeImage,
    *,
    sensor: Sensor,
    requirement: Requirement,
    gain: GainOptions,
    zones: Zones,
) -> ViewEvaluation:
    """Return the targets of a map that a scan should see."""
    faces = before.boundary()
    attempts = np.zeros((2, before.grid.n_voxels), np.int32)
    targets = find_targets(
        before, faces, required_cosine=requirement.min_cosine, attempts=attempts, options=gain
    )
    targets = targets.some(voxels_of_interest(before, zones)[targets.voxel])
    caster = RayCaster(*faces.triangles(before.grid.voxel_m), n_threads=1)
    seen = seen_from(
        targets, scan.origin, boundary=caster, required_cosine=wanted_cosine(requirement, gain),
        sensor=sensor, expected=None,
    )  # fmt: skip
    in_view = np.isfinite(scan.pixels(scan.origin + seen.offsets).sum(axis=1))
    return seen.some(in_view)
