# SPDX-License-Identifier: MIT
"""Site: the rooms of a scene that are asked for, and the candidates that stand in them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nbv.run.wording import count
from nbv.scanning.sensor import Sensor
from nbv.scanning.view import View
from nbv.visibility.site_options import SiteOptions
from nbv.visibility.standing.clearance import Clearance
from nbv.visibility.standing.columns import cut_columns
from nbv.visibility.standing.floors import STEP_M, Platform, find_floors
from nbv.visibility.standing.partition import find_rooms
from nbv.visibility.standing.positions import check_fits, lattice_spacing, room_positions
from nbv.visibility.standing.rooms import Rooms
from nbv.visibility.viewpoints import Candidates, sensor_directions
from scenes.checks import BoolArray, FloatArray, InputError
from scenes.world.scene import Scene

_BELOW_CEILING_M = 0.1


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Site:
    """Where one may stand in a scene.

    Attributes
    ----------
    rooms : Rooms
        All rooms, the outside among them.
    chosen : tuple of int
        Numbers of the rooms that are asked for.
    positions : (p, 3) float
        Where the sensor may be, metres.
    position_room : (p,) int32
        The room of each.
    start : (s, 3) float
        Those at which the first station may be, where it was asked for a place; none where not.
    spacing_m : float
        Between places, metres.
    several_heights : bool
        Whether stations of a plan may stand at several heights over one spot.
    warnings : tuple of str
        What was assumed, and which rooms have no place for a station.
    """

    rooms: Rooms
    chosen: tuple[int, ...]
    positions: FloatArray
    position_room: NDArray[np.int32]
    start: FloatArray
    spacing_m: float
    several_heights: bool
    warnings: tuple[str, ...]

    def __repr__(self) -> str:
        n_rooms, n_places = len(self.chosen), len(self.positions)
        return f"Site({n_rooms} of {count(len(self.rooms.rooms), 'room')}, {count(n_places, 'position')})"

    @property
    def cut_m(self) -> float | None:
        """Height just below the ceilings of the storey with most of the floor asked for, metres.

        None where a building has no ceilings to look through: it is of one storey under the sky.
        """
        rooms = [self.rooms.rooms[number - 1] for number in self.chosen]
        floor = {
            storey: sum(r.floor_m2 for r in rooms if r.storey == storey)
            for storey in {r.storey for r in rooms}
        }
        best = max(floor, key=lambda storey: (floor[storey], -storey), default=None)
        ceilings = [room.ceiling_m for room in rooms if room.storey == best and room.ceiling_m is not None]
        return float(np.median(ceilings)) - _BELOW_CEILING_M if ceilings else None

    def entries(self, views: Sequence[View]) -> tuple[dict[str, Any], ...]:
        """Return what `plan.json` says of each room: whether it is asked for, and its stations, from 1."""
        places = np.array([view.world_from_sensor.translation for view in views]).reshape(-1, 3)
        of = self.rooms.room_of(places)
        return tuple(
            {
                **room.to_json(),
                "is_asked_for": room.number in self.chosen,
                "stations": (np.flatnonzero(of == room.number) + 1).tolist(),
            }
            for room in self.rooms.rooms
        )

    def spots(self, positions: FloatArray) -> FloatArray:
        """Return keys (p, 3), x, y and which floor: alike for positions (p, 3) over one spot of it."""
        xy = np.round(positions[:, :2], 6) + 0.0
        return np.column_stack([xy, self.rooms.span_of(positions)])

    def parts(self, positions: FloatArray) -> NDArray[np.int64]:
        """Return the storey of positions (p, 3), and the number of what one walks to; -1 off the floor."""
        span = self.rooms.span_of(positions)
        storeys = np.array([-1, *(room.storey for room in self.rooms.rooms)])
        walk = np.append(self.rooms.floors.walk, -1)[span]
        return np.column_stack([storeys[self.rooms.room_of(positions)], walk]).astype(np.int64)

    def asked_for(self, positions: FloatArray, level_m: float) -> BoolArray:
        """Tell which positions (p, 3) over a level, metres, may belong to the rooms that are asked for.

        Left out are those over the floor of other rooms, over a drop, and under the open sky unless a room
        outside is asked for. What stands in the rooms, and within walls, is not told from free space.
        """
        span, columns = self.rooms.span_of(positions), self.rooms.floors.columns
        of, known = self.rooms.room_of(positions), span >= 0
        bottom, top = np.append(columns.bottom, level_m)[span], np.append(columns.top, level_m)[span]
        outdoors = any(self.rooms.rooms[number - 1].is_outside for number in self.chosen)
        sky = outdoors or not self.is_roofed
        mine = np.isin(of, self.chosen) | ((of == 0) & (np.isfinite(top) | sky))
        return np.asarray(~known | (mine & (bottom >= level_m - STEP_M)))

    @property
    def is_roofed(self) -> bool:
        """Whether all rooms that are asked for have ceilings."""
        return all(self.rooms.rooms[number - 1].ceiling_m is not None for number in self.chosen)

    def platform_entries(self) -> tuple[dict[str, Any], ...]:
        """Return what `plan.json` says of each platform."""
        return tuple(platform.to_json() for platform in self.rooms.floors.platforms)

    def candidates(self, sensor: Sensor, subdivisions: int = 1) -> Candidates:
        """Return the positions with the sensor's directions all round."""
        return Candidates(self.positions, sensor_directions(sensor, subdivisions))


def find_site(scene: Scene, options: SiteOptions = SiteOptions(), *, turns: bool = False) -> Site:
    """Find the rooms of a scene, and where in those that are asked for the sensor may be.

    Places lie on a lattice over the whole scene, on floor that is level under a tripod's feet, at the heights
    of the sensor above it, and clear of every surface. A room that no place of the lattice falls in gets one
    in its middle.

    A sensor that `turns` by itself has one pose at each position: its lattice keeps 0.5 m however large the
    building is. A camera's, with 42 or more, has 1 m where more than 60 m2 of floor are asked for.

    Raises
    ------
    InputError
        No floor, a room that there is not, nowhere to stand.
    """
    caster = scene.ray_caster()
    floors = find_floors(cut_columns(scene.mesh, caster), caster)
    rooms = find_rooms(floors, caster)
    chosen, warnings = _chosen(scene, rooms, options)
    warnings += platforms_in_words(rooms.floors.platforms)
    asked = [rooms.rooms[number - 1] for number in chosen]
    check_fits(scene.name, asked, options)
    spacing, widened = lattice_spacing(asked, options, turns=turns)
    clear = Clearance.of(scene.mesh, options.clearance_m)
    bounds = np.asarray(scene.mesh.bounds())
    found = room_positions(bounds, rooms, chosen, options=options, spacing_m=spacing, clear=clear)
    if not len(found.positions):
        level = sum(room.floor_m2 for room in rooms.rooms)
        n_rooms = count(len(rooms.rooms), "room")
        raise InputError(
            f"nowhere to stand in {scene.name}: {level:.1f} m2 of floor in {n_rooms}, and no place on it "
            f"keeps {options.clearance_m:g} m clear (--clearance) of every surface at a height of "
            f"{options.heights_in_words()} (--heights); is it an object (--mode object), not in metres "
            "(--units), or is another axis up (--up)?"
        )
    warnings += widened
    without = [room for room in asked if room.number not in set(found.room.tolist())]
    if without:
        names = ", ".join(f"{room.name} ({room.floor_m2:.1f} m2)" for room in without)
        warnings = [*warnings, f"no place for a station in {names}: nothing there keeps "
                    f"{options.clearance_m:g} m clear; see --clearance"]  # fmt: skip
    return Site(
        rooms=rooms,
        chosen=chosen,
        positions=found.positions,
        position_room=found.room,
        start=found.start,
        spacing_m=spacing,
        several_heights=options.several_heights,
        warnings=tuple(warnings),
    )


def platforms_in_words(platforms: Sequence[Platform]) -> list[str]:
    """Return a sentence on large level surface that is no place to stand; nothing where there is none."""
    if not platforms:
        return []
    total, largest = sum(platform.floor_m2 for platform in platforms), platforms[0]
    where = f"{largest.floor_m2:.1f} m2 at {largest.level_m:.2f} m height"
    more = f"{total:.1f} m2 in all, the largest {where}" if len(platforms) > 1 else where
    return [
        f"{count(len(platforms), 'platform')} left out as places to stand, {more}: no steps lead up, and "
        "more than a third of the edge drops; --candidates takes positions there"
    ]


def _chosen(scene: Scene, rooms: Rooms, options: SiteOptions) -> tuple[tuple[int, ...], list[str]]:
    """Numbers of the rooms that are asked for, and what is to be said of it."""
    warnings = list(rooms.doubts)
    if isinstance(options.rooms, tuple):
        if unknown := [number for number in options.rooms if number > len(rooms.rooms)]:
            raise InputError(
                f"there is no room {unknown[0]} in {scene.name}: it has {count(len(rooms.rooms), 'room')}"
            )
        return options.rooms, warnings
    open_ = [room for room in rooms.rooms if options.outdoors or not room.is_outside]
    if not open_ and rooms.rooms:
        raise InputError(
            f"all {sum(room.floor_m2 for room in rooms.rooms):.1f} m2 of floor in {scene.name} lie outside; "
            "give --outdoors to stand there, or --mode object to look at it from around"
        )
    if options.rooms == "all" or not open_:
        return tuple(room.number for room in open_), warnings
    largest = max(open_, key=lambda room: room.floor_m2)
    reached = rooms.connected(largest.number)
    kept = tuple(room.number for room in open_ if room.number in reached)
    if len(kept) < len(open_):
        warnings.append(f"{count(len(open_) - len(kept), 'room')} not connected with {largest.name} left out")
    return kept, warnings
