# SPDX-License-Identifier: MIT
"""Room coverage: what scans have measured of each room that they show, and what of it is still missing."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from completion.result.completion import Completion
from nbv.run.wording import letters, square_metres
from nbv.scans.measured_area import MeasuredCells
from nbv.scans.scan_map import ScanMap
from nbv.scans.unseen_boundary import UnseenBoundary
from nbv.visibility.rooms import SiteRoom
from scenes.checks import FloatArray

ELSEWHERE = "outside all rooms"


@dataclass(frozen=True, slots=True)
class RoomCoverage:
    """Areas of one room, or of the space outside all rooms.

    Attributes
    ----------
    room : Room or None
        None for space that is not above a seen floor.
    scans : tuple of int
        The scans that were taken in it, counted from 1.
    met_m2, worse_m2, inferred_m2 : float
        Surface measured as required, measured worse, and inferred by completion, square metres.
    shadow_m2, explained_m2, frontier_m2 : float
        Boundary of the unknown: edges of shadows that no surface explains, those along which a measured or
        inferred surface passes, and ends of all fields of view; square metres, not of surface.
    """

    room: SiteRoom | None
    scans: tuple[int, ...]
    met_m2: float
    worse_m2: float
    inferred_m2: float
    shadow_m2: float
    explained_m2: float
    frontier_m2: float

    @property
    def name(self) -> str:
        """What to call it."""
        return ELSEWHERE if self.room is None else self.room.name

    def to_json(self) -> dict[str, Any]:
        """Return the entry of `coverage.json`."""
        areas = {name: value for name, value in asdict(self).items() if name.endswith("_m2")}
        room = {"room": None, "name": self.name} if self.room is None else self.room.to_json()
        return {**room, "scans": list(self.scans), **areas}

    def describe(self) -> str:
        """Return in words what is measured, what is missing, and what completion covers without a station."""
        if self.room is None:
            where = ELSEWHERE
        else:
            floor = f"storey {self.room.storey}, {square_metres(self.room.floor_m2)} m2 of floor"
            where = f"{self.name} ({floor}, {_scans_in_words(self.scans)})"
        missing = [
            f"{square_metres(self.worse_m2)} m2 measured, but not as required",
            f"{square_metres(self.shadow_m2)} m2 of boundary at shadows",
        ]
        if self.frontier_m2 > 0:
            missing.append(
                f"{square_metres(self.frontier_m2)} m2 of boundary at limits of the fields of view"
            )
        covers = f"; completion covers {square_metres(self.inferred_m2)} m2" if self.inferred_m2 > 0 else ""
        return f"{where}: {square_metres(self.met_m2)} m2 measured as required; {', '.join(missing)}{covers}"


def _scans_in_words(scans: tuple[int, ...]) -> str:
    """Name the scans that were taken in a room."""
    if not scans:
        return "no scan"
    names = ", ".join(letters(number - 1) for number in scans)
    return f"{'scan' if len(scans) == 1 else 'scans'} {names}"


def room_coverage(
    scan_map: ScanMap, measured: MeasuredCells, unseen: UnseenBoundary, completion: Completion | None
) -> tuple[RoomCoverage, ...]:
    """Part areas among the rooms that scans show, and what lies over none of them last; () without rooms."""
    seen, grid = scan_map.rooms, scan_map.voxels.grid
    if seen is None:
        return ()
    n = len(seen.rooms.rooms) + 1
    of_cell = seen.room_near(measured.before(grid))
    met, whole = (np.bincount(of_cell, part, n) for part in (measured.met_m2, measured.whole_m2))
    inferred: FloatArray = np.zeros(n)
    if completion is not None:
        middles, areas = _inferred_places(completion, grid.voxel_m)
        inferred = np.bincount(seen.room_near(middles), areas, n).astype(np.float64)
    of_face = seen.room_near(unseen.faces.centres + grid.voxel_m * unseen.faces.outward)
    parts = (
        unseen.occluded & ~unseen.explained,
        unseen.occluded & unseen.explained,
        ~unseen.occluded & ~unseen.explained,
    )
    shadow, explained, frontier = (np.bincount(of_face[part], unseen.areas[part], n) for part in parts)
    return tuple(
        RoomCoverage(
            room=seen.rooms.rooms[k - 1] if k else None,
            scans=tuple((np.flatnonzero(seen.stood == k) + 1).tolist()),
            met_m2=float(met[k]),
            worse_m2=float(whole[k] - met[k]),
            inferred_m2=float(inferred[k]),
            shadow_m2=float(shadow[k]),
            explained_m2=float(explained[k]),
            frontier_m2=float(frontier[k]),
        )
        for k in [*range(1, n), 0]
    )


def _inferred_places(completion: Completion, before_m: float) -> tuple[FloatArray, FloatArray]:
    """Return places (m, 3) so far before what is inferred, world coordinates, and the areas (m,) there."""
    mesh = completion.hypothesised
    a, b, c = np.moveaxis(completion.world_from_reference.apply(mesh.vertices)[mesh.faces], 1, 0)
    normals = np.cross(b - a, c - a)
    doubled = np.linalg.norm(normals, axis=1)
    unit = normals / np.maximum(doubled, 1e-30)[:, None]
    return (a + b + c) / 3 + before_m * unit, doubled / 2
