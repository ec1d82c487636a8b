# SPDX-License-Identifier: MIT
"""Scan map: what scans that were really taken say of a place that nobody has a model of.

And what the scans before a scan predicted that it would gain, beside what it gained: the same area that the
planner's gain counts, boundary of the unknown, foreshortened, and surface seen at a worse angle than
required.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from completion.observe.range_noise import estimate_noise
from nbv.coverage.surface_classes import KnownSurfaces
from nbv.online.gain import ViewEvaluation, seen_from
from nbv.online.limits import LOWEST_M, MOST_SCAN_PIXELS, STRAY_SHARE, THINNING_CELL_M
from nbv.online.occupancy import EMPTY, SEEN, VoxelMap
from nbv.online.planner import PlannerOptions, wanted_cosine
from nbv.online.possible_solid import PossibleSurface
from nbv.online.targets import GainOptions, find_targets, voxels_of_interest
from nbv.scanning.sensor import Sensor
from nbv.scans.seen_rooms import SeenRooms
from nbv.visibility.limits import MOST_POSITIONS, SPACING_M
from nbv.visibility.requirement import Requirement
from nbv.visibility.site_options import SiteOptions
from nbv.visibility.viewpoints import Candidates, room_lattice, sensor_directions, viewing_sphere
from nbv.visibility.zones import EVERYWHERE, Zones
from scenes.checks import FloatArray, InputError
from scenes.scan.range_image import RangeImage
from scenes.world.scene import Mode


@dataclass(frozen=True, slots=True)
class AchievedGain:
    """Predicted gain of a scan, and the part of it that was achieved; weighted square metres."""

    expected_m2: float
    settled_m2: float


def compare_gain(
    before: VoxelMap,
    after: VoxelMap,
    scan: RangeImage,
    *,
    sensor: Sensor,
    requirement: Requirement,
    gain: GainOptions,
    zones: Zones = EVERYWHERE,
) -> AchievedGain:
    """Compare the gain that a map predicted for a scan from where it stood with the map after the scan.

    What lies in the scan's field of view counts, within the range of `sensor`. An unknown voxel is settled
    when it is known to be empty or holds a sample; badly seen surface when none is left in its voxel.
    """
    expected = _expected_targets(before, scan, sensor=sensor, requirement=requirement, gain=gain, zones=zones)
    known = (after.labels == EMPTY) | (after.labels == SEEN)
    poor = np.zeros(after.grid.n_voxels, np.bool_)
    poor[after.surfels.voxels[after.surfels.quality < requirement.min_cosine]] = True
    done = np.where(expected.is_unknown, known[expected.voxel], ~poor[expected.voxel])
    return AchievedGain(float(expected.worth_m2.sum()), float(expected.worth_m2[done].sum()))


def _expected_targets(
    before: VoxelMap,
    scan: RangeImage,
    *,
    sensor: Sensor,
    requirement: Requirement,
    gain: GainOptions,
    zones: Zones,
) -> ViewEvaluation:
    """Return the targets of a map that a scan should see."""
    surface = PossibleSurface.of(before)
    attempts = np.zeros((2, before.grid.n_voxels), np.int32)
    targets = find_targets(
        before, surface, required_cosine=requirement.min_cosine, attempts=attempts, options=gain
    )
    targets = targets.some(voxels_of_interest(before, zones)[targets.voxel])
    seen = seen_from(
        targets, scan.origin, boundary=surface.ray_caster(), required_cosine=wanted_cosine(requirement, gain),
        sensor=sensor, expected=None,
    )  # fmt: skip
    in_view = np.isfinite(scan.pixels(scan.origin + seen.offsets).sum(axis=1))
    return seen.some(in_view)


@dataclass(frozen=True, slots=True, eq=False)
class ScanMap:
    """Scans of a place, and the voxels that they filled.

    Attributes
    ----------
    scans : tuple of RangeImage
        World coordinates; each with the deviation of its ranges, read off the scan where it was not known.
    voxels, mode : VoxelMap, "room" or "object"
        What they say of the volume, and whether the sensor stands within it or moves around it.
    rooms : SeenRooms or None
        The rooms that they show, on all storeys; None around an object, and where no floor was seen.
    clearance_m : float
        Within which distance of a scanner's place a room is known to be empty, metres; 0 around an object.
    gains : tuple of AchievedGain or None
        For each scan the gain that the ones before predicted, and what it achieved; None for the first, and
        for those from where nothing was known before.
    """

    scans: tuple[RangeImage, ...]
    voxels: VoxelMap
    mode: Mode
    rooms: SeenRooms | None
    clearance_m: float
    gains: tuple[AchievedGain | None, ...]

    @classmethod
    def of(
        cls,
        scans: Sequence[RangeImage],
        sensor: Sensor,
        *,
        mode: Mode = "room",
        options: PlannerOptions | None = None,
        requirement: Requirement | None = None,
        completed: KnownSurfaces | None = None,
        zones: Zones = EVERYWHERE,
    ) -> ScanMap:
        """Write registered scans, z up, into the voxels of the volume that they measured in.

        Pixels without return of scans that another instrument than `sensor`, which scans next, took say
        nothing. A region enlarges a room's volume where it reaches beyond it, and is that of an object.
        Floors that `completed`, the completion of the scans, infers are floor.

        Raises
        ------
        InputError
            Scans without any return.
        """
        options, requirement = options or PlannerOptions(), requirement or Requirement()
        scans = tuple(with_known_noise(scan) for scan in scans)
        outside = mode == "object"
        few = [scan.thin(MOST_SCAN_PIXELS) for scan in scans]
        volume = _volume(few, options.clearance_m, zones, from_outside=outside)
        voxels = VoxelMap.unknown(volume, voxel_m=options.voxel_m, outside_is_empty=outside)
        compared = partial(
            compare_gain, sensor=sensor, requirement=requirement, gain=options.gain, zones=zones
        )
        gains: list[AchievedGain | None] = []
        for scan in scans:
            before, voxels = voxels, voxels.with_given([scan], sensor, options.clearance_m)
            knew = len(gains) > 0 and before.is_free(scan.origin[None], before.grid.voxel_m)[0]
            gains.append(compared(before, voxels, scan) if knew else None)
        rooms = None if outside else SeenRooms.of(few, completed)
        return cls(
            scans=scans,
            voxels=voxels,
            mode=mode,
            rooms=rooms,
            clearance_m=0.0 if outside else options.clearance_m,
            gains=tuple(gains),
        )

    @property
    def bounds(self) -> FloatArray:
        """The volume (2, 3), metres."""
        grid = self.voxels.grid
        return np.stack([grid.origin, grid.origin + np.array(grid.shape) * grid.voxel_m])

    def candidates(self, sensor: Sensor, site: SiteOptions = SiteOptions()) -> Candidates:
        """Return where the sensor might go next; which of it is known to be free is for the planner to say.

        A viewing sphere around an object; at tripod heights above the floor of the rooms that are asked for;
        or a lattice at all heights where no floor was seen.

        Raises
        ------
        InputError
            A room that the scans do not show.
        """
        if self.mode == "object":
            return viewing_sphere(self.bounds, sensor)
        if self.rooms is not None:
            return self.rooms.candidates(sensor, site)
        low, high = self.bounds
        spacing = float(np.cbrt(np.prod(high - low) / MOST_POSITIONS))
        heights = tuple(np.arange(site.clearance_m, high[2] - low[2], max(spacing, LOWEST_M)).tolist())
        spacing = max(spacing, LOWEST_M) if spacing < SPACING_M else spacing
        lattice = room_lattice(
            self.bounds, spacing_m=spacing, heights_m=heights, clearance_m=site.clearance_m
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
    cells = _cells(scans)
    if not len(cells):
        raise InputError("the scans have no returns: there is nothing to plan from")
    measured = (np.quantile(cells, [STRAY_SHARE, 1 - STRAY_SHARE], axis=0) + [[0.0], [1.0]]) * THINNING_CELL_M
    region = [] if zones.region is None else [zones.region.low, zones.region.high]
    if from_outside:
        return np.array(region) if region else measured
    stood = np.array([scan.origin for scan in scans])
    around = [
        stood.min(axis=0) - clearance_m - THINNING_CELL_M,
        stood.max(axis=0) + clearance_m + THINNING_CELL_M,
    ]
    corners = np.vstack([measured, around, *region])
    return np.stack([corners.min(axis=0), corners.max(axis=0)])


def _cells(scans: Sequence[RangeImage]) -> NDArray[np.int64]:
    """Cells (n, 3) of a lattice of 5 cm, each once, that hold a point of some scan."""
    once = np.zeros((0, 3), np.int64)
    for scan in scans:
        here = np.floor(scan.points()[scan.valid] / THINNING_CELL_M).astype(np.int64)
        once = _each_once(np.vstack([once, _each_once(here)]))
    return once


def _each_once(cells: NDArray[np.int64]) -> NDArray[np.int64]:
    """Rows (n, 3) each once, in order."""
    if not len(cells):
        return cells
    low = cells.min(axis=0)
    shape = (cells.max(axis=0) - low + 1).tolist()
    if np.prod([float(n) for n in shape]) >= 2.0**62:
        return np.unique(cells, axis=0)
    numbers = np.unique(np.ravel_multi_index((cells - low).T, shape))
    places: NDArray[np.int64] = np.stack(np.unravel_index(numbers, shape), axis=1) + low
    return places
