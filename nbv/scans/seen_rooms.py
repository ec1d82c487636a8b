# SPDX-License-Identifier: MIT
"""Seen rooms: the floor that scans show, parted into storeys and rooms as that of a known scene is.

What completion infers of floors counts as floor: a panoramic scanner sees none of that which it stands on.
Rooms into which scans only look through doorways are among them, with as much floor as was seen.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from nbv.coverage.surface_classes import KnownSurfaces
from nbv.online.limits import BELOW_M, NEAR_M
from nbv.run.wording import count
from nbv.scanning.sensor import Sensor
from nbv.scans.scan_mesh import joined_faces, scan_faces
from nbv.visibility.clearance import Clearance
from nbv.visibility.floors import cut_columns, find_floors
from nbv.visibility.limits import WALKABLE
from nbv.visibility.rooms import Rooms, SiteRoom, find_rooms
from nbv.visibility.site import lattice_spacing, room_positions
from nbv.visibility.site_options import SiteOptions
from nbv.visibility.viewpoints import Candidates, sensor_directions
from scenes.checks import FloatArray, InputError
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.rays.raycast import RayCaster
from scenes.scan.range_image import RangeImage


@dataclass(frozen=True, slots=True, eq=False)
class SeenRooms:
    """The rooms that scans show.

    Attributes
    ----------
    mesh : LabelledMesh
        What the scans measured, and level surface that completion infers; few triangles, metres.
    rooms : Rooms
        Its floor in rooms; those without a ceiling that was seen lie outside.
    stood : (s,) int32
        The room in which each scan was taken, 0 for none.
    """

    mesh: LabelledMesh
    rooms: Rooms
    stood: NDArray[np.int32]

    @classmethod
    def of(cls, scans: Sequence[RangeImage], completed: KnownSurfaces | None = None) -> SeenRooms | None:
        """Find the rooms that registered `scans`, z up and few pixels each, show; None without any floor."""
        mesh = joined_faces([*(scan_faces(scan)[:2] for scan in scans), *_inferred_levels(completed)])
        if not len(mesh.faces):
            return None
        caster = RayCaster(mesh.vertices, mesh.faces)
        floors = find_floors(cut_columns(mesh, caster).seen_from_one_side(), caster)
        rooms = find_rooms(floors, caster)
        if not rooms.rooms:
            return None
        nowhere = np.zeros(0, np.int32)
        places = np.array([scan.origin for scan in scans])
        return cls(mesh, rooms, cls(mesh, rooms, nowhere).room_near(places))

    def room_near(self, places: FloatArray) -> NDArray[np.int32]:
        """Return the number (n,) of the room in which each place (n, 3) lies, metres; 0 for none.

        It is the room of the nearest floor below, of the highest storey that has any within a metre beside.
        """
        columns, room_numbers = self.rooms.floors.columns, np.zeros(len(places), np.int32)
        storey = np.array([0, *(room.storey for room in self.rooms.rooms)])[self.rooms.room]
        for number in range(int(storey.max(initial=0)), 0, -1):
            spans = np.flatnonzero(storey == number)
            if not len(spans):
                continue
            above = places[:, 2] >= columns.bottom[spans].min() - BELOW_M
            left = np.flatnonzero((room_numbers == 0) & above)
            tree = cKDTree(columns.places(columns.cell[spans]))
            away, nearest = tree.query(places[left, :2], distance_upper_bound=NEAR_M)
            near = np.isfinite(away)
            room_numbers[left[near]] = self.rooms.room[spans[nearest[near]]]
        return room_numbers

    def choose_rooms(self, site: SiteOptions) -> tuple[tuple[int, ...], list[str]]:
        """Return the numbers of the rooms that are asked for, and what is to be said of it.

        A room in which a scan was taken is asked for even where no ceiling shows that it lies inside.

        Raises
        ------
        InputError
            A room that the scans do not show.
        """
        rooms = self.rooms.rooms
        if isinstance(site.rooms, tuple):
            if unknown := [number for number in site.rooms if number > len(rooms)]:
                raise InputError(
                    f"there is no room {unknown[0]}: the scans show {count(len(rooms), 'room')}; rooms are "
                    "numbered anew as scans come in"
                )
            return site.rooms, []
        stood = set(self.stood.tolist())
        asked = [room for room in rooms if site.outdoors or not room.is_outside or room.number in stood]
        if site.rooms == "connected":
            here = int(self.stood[-1]) or max(rooms, key=lambda room: room.floor_m2).number
            reached = self.rooms.reachable_from(here)
            asked = [room for room in asked if room.number in reached]
        if not asked:
            floor_m2 = sum(room.floor_m2 for room in rooms)
            return tuple(room.number for room in rooms), [
                f"no ceiling was seen over any of {floor_m2:.1f} m2 of floor: stations may stand on all of it"
            ]
        return tuple(room.number for room in asked), []

    def some(self, numbers: Sequence[int]) -> list[SiteRoom]:
        """Return the rooms by their numbers."""
        return [self.rooms.rooms[number - 1] for number in numbers]

    def candidates(self, sensor: Sensor, site: SiteOptions) -> Candidates:
        """Return where the sensor might stand in the rooms that are asked for, clear of what was measured.

        Which of it is known to be free is for the planner to say.
        """
        chosen, _ = self.choose_rooms(site)
        turns = sensor.kind == "spherical"
        spacing, _ = lattice_spacing(self.some(chosen), site, turns=turns)
        clear = Clearance.of_points(self.mesh.vertices, site.clearance_m)
        bounds = np.stack([self.mesh.vertices.min(axis=0), self.mesh.vertices.max(axis=0)])
        positions = room_positions(bounds, self.rooms, chosen, options=site, spacing_m=spacing, clear=clear)
        return Candidates(positions.positions, sensor_directions(sensor, 2))


def _inferred_levels(
    completed: KnownSurfaces | None,
) -> list[tuple[FloatArray, NDArray[np.int32]]]:
    """Return what completion infers of level surface, floors and ceilings; nothing without completion."""
    if completed is None:
        return []
    vertices, faces, _ = completed.inferred_mesh()
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    level = np.abs(normals[:, 2]) >= WALKABLE * np.linalg.norm(normals, axis=1)
    return [(vertices, faces[level])]
