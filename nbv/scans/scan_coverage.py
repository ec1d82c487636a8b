# SPDX-License-Identifier: MIT
"""Coverage of scans without a model of the scene: measured, seen worse, inferred, and occluded.

Measured and inferred are areas of surface. Occluded is the area of the boundary behind which nobody knows:
it cannot be added to them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from completion.result.completed_model import CompletedModel
from completion.result.completion import Completion
from completion.result.meshes import display_mesh
from nbv.scans.measured_area import MeasuredArea, MeasuredCells, PixelQuality
from nbv.scans.room_coverage import RoomCoverage, room_coverage
from nbv.scans.scan_map import ScanMap
from nbv.scans.unseen_boundary import UnseenBoundary
from nbv.visibility.requirement import Requirement
from nbv.visibility.zones import EVERYWHERE, Zones
from scenes.checks import FloatArray


@dataclass(frozen=True, slots=True)
class RecognisedSurface:
    """A surface that completion recognised: number from 1, as in `completion.json`, areas in square metres.

    `met` is the share of what the scans' pixels measured of it that meets the requirement.
    """

    id: int
    kind: str
    observed_m2: float
    met: float
    hypothesised_m2: float


@dataclass(frozen=True, slots=True, eq=False)
class ScanCoverage:
    """Coverage of a place without a model by its scans; without `completion` nothing was continued.

    `rooms` are those that the scans show; `growth` (one a scan) is what had been measured after each.
    """

    scan_map: ScanMap
    requirement: Requirement
    zones: Zones
    measured: MeasuredArea
    unseen: UnseenBoundary
    completion: Completion | None
    surfaces: tuple[RecognisedSurface, ...]
    rooms: tuple[RoomCoverage, ...]
    growth: tuple[MeasuredArea, ...]

    def to_json(self) -> dict[str, Any]:
        """Return the contents of `coverage.json`: square metres, of surface and of boundary apart."""
        model = self.completion
        return {
            "requirement": self.requirement.to_json(),
            **self.zones.to_json(),
            "scans": len(self.scan_map.scans),
            "surface": {
                "measured_m2": self.measured.total_m2,
                "met_m2": self.measured.met_m2,
                "seen_worse_m2": self.measured.worse_m2,
                "recognised_m2": None if model is None else model.observed_m2,
                "inferred_m2": None if model is None else model.hypothesised_m2,
            },
            "boundary": self.unseen.to_json(),
            "voxel_m": self.scan_map.voxels.grid.voxel_m,
            "mode": None if model is None else model.mode,
            "surfaces": [asdict(surface) for surface in self.surfaces],
            "rooms": [room.to_json() for room in self.rooms],
        }


def cover_by_scans(
    scan_map: ScanMap,
    requirement: Requirement | None = None,
    *,
    completion: Completion | None = None,
    zones: Zones = EVERYWHERE,
) -> ScanCoverage:
    """Report what scans have measured, what their completion infers, and where the unknown begins.

    Measured surface and boundary count within the region of `zones` alone; what is inferred counts
    everywhere.
    """
    requirement, grid = requirement or Requirement(), scan_map.voxels.grid
    cells, areas = list[MeasuredCells](), list[FloatArray]()
    for number, scan in enumerate(scan_map.scans):
        pixels = PixelQuality.of(scan, requirement, grid.voxel_m / 2)
        cells.append(MeasuredCells.of_scan(scan, pixels, grid, zones))
        if completion is not None:
            areas.append(_measured_of_surfaces(completion, pixels, number, scan.shape))
    surface = None if completion is None else display_mesh(completion)
    stood = np.array([scan.origin for scan in scan_map.scans])
    unseen = UnseenBoundary.of(scan_map.voxels, surface, zones, stood, scan_map.clearance_m)
    growth = [MeasuredCells.of_all(cells[: n + 1], grid, requirement.k) for n in range(len(cells))]
    return ScanCoverage(
        scan_map=scan_map,
        requirement=requirement,
        zones=zones,
        measured=growth[-1].total,
        unseen=unseen,
        completion=completion,
        surfaces=() if completion is None else _surface_shares(completion, areas),
        rooms=room_coverage(scan_map, growth[-1], unseen, completion),
        growth=tuple(cells.total for cells in growth),
    )


def _measured_of_surfaces(
    model: CompletedModel, pixels: PixelQuality, number: int, shape: tuple[int, int]
) -> FloatArray:
    """Area (2, surfaces + 1) of each surface in a scan: all that its pixels measured, and as required.

    The scan may have been thinned (`RangeImage.thinned`) before it was completed.
    """
    owner = model.owners[number]
    row, column = np.divmod(pixels.pixel, shape[1])
    step = -(-max(shape) // max(owner.shape))
    of = owner[row // step, column // step]
    n = len(model.patches) + 1
    return np.stack([np.bincount(of, pixels.areas, n), np.bincount(of, pixels.areas * pixels.met, n)])


def _surface_shares(model: CompletedModel, measured: Sequence[FloatArray]) -> tuple[RecognisedSurface, ...]:
    """Return the surfaces of a completed model, with the share of each that is measured as required."""
    whole, met = np.sum(measured, axis=0)
    shares = np.divide(met, whole, out=np.zeros(len(whole)), where=whole > 0)
    return tuple(
        RecognisedSurface(
            k, patch.source.fit.surface.kind, patch.observed_m2, float(shares[k]), patch.hypothesised_m2
        )
        for k, patch in enumerate(model.patches, start=1)
    )
