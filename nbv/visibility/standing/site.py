# SPDX-License-Identifier: MIT
"""Site: the rooms of a scene that are asked for, and the candidates that stand in them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from nbv.run.wording import count
from nbv.scanning.sensors.sensor import Sensor
from nbv.scanning.view import View
from nbv.visibility.standing.clearance import CLEARANCE_M, Clearance
from nbv.visibility.standing.columns import cut_columns
from nbv.visibility.standing.floors import find_floors
from nbv.visibility.standing.partition import find_rooms
from nbv.visibility.standing.rooms import Room, Rooms
from nbv.visibility.viewpoints import TRIPOD_HEIGHTS_M, Candidates, line_positions, sensor_directions
from scenes.checks import BoolArray, FloatArray, InputError
from scenes.world.scene import Scene

_SPACING_M, _WIDE_M = 0.5, 1.0
_BELOW_CEILING_M = 0.1
_LARGE_M2 = 60.0  # of floor: from here on positions are a metre apart


@dataclass(frozen=True, slots=True, kw_only=True)
class SiteOptions:
    """Which rooms to stand in, and where in them.

    Attributes
    ----------
    rooms : "all", "connected" or tuple of int
        All of the scene; those to which one walks from the largest; or these numbers.
    outdoors : bool
        Whether a station may stand outside.
    all_round : bool
        Whether an object may be looked at from below the plane that it stands on.
    heights_m : tuple of float, optional
        Of the sensor above the floor, metres; 0.4, 1.0, 1.6 and 2.2 when not given.
    spacing_m : float, optional
        Between places, metres; 0.5 when not given, 1 from 60 m2 of floor on.
    clearance_m : float
        From the sensor to every surface, metres.

    Raises
    ------
    InputError
        A height, spacing or clearance that is not positive; rooms that are no numbers from 1.
    """

    rooms: Literal["all", "connected"] | tuple[int, ...] = "all"
    outdoors: bool = False
    all_round: bool = False
    heights_m: tuple[float, ...] | None = None
    spacing_m: float | None = None
    clearance_m: float = CLEARANCE_M

    def __post_init__(self) -> None:
        lengths = {"clearance_m": (self.clearance_m,), "heights_m": self.heights_m or (), "spacing_m": ()}
        if self.heights_m is not None and not self.heights_m:
            raise InputError("heights_m holds no height; give at least one, or leave it out")
        if self.spacing_m is not None:
            lengths["spacing_m"] = (self.spacing_m,)
        for name, values in lengths.items():
            if wrong := [value for value in values if not (np.isfinite(value) and value > 0)]:
                raise InputError(f"{name} must be positive, metres, got {wrong[0]}")
        named = self.rooms if isinstance(self.rooms, tuple) else ()
        if wrong_rooms := [room for room in named if room < 1]:
            raise InputError(f"rooms are numbered from 1, got {wrong_rooms[0]}")
        if isinstance(self.rooms, str) and self.rooms not in ("all", "connected"):
            raise InputError(f"rooms must be all, connected, or their numbers, got {self.rooms!r}")


@dataclass(frozen=True, slots=True, eq=False)
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
    spacing_m : float
        Between places, metres.
    warnings : tuple of str
        What was assumed, and which rooms have no place for a station.
    """

    rooms: Rooms
    chosen: tuple[int, ...]
    positions: FloatArray
    position_room: NDArray[np.int32]
    spacing_m: float
    warnings: tuple[str, ...]

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

    def candidates(self, sensor: Sensor, subdivisions: int = 1) -> Candidates:
        """Return the positions with the sensor's directions all round."""
        return Candidates(self.positions, sensor_directions(sensor, subdivisions))


def find_site(scene: Scene, options: SiteOptions = SiteOptions()) -> Site:
    """Find the rooms of a scene, and where in those that are asked for the sensor may be.

    Places lie on a lattice over the whole scene, on floor that is level under a tripod's feet, at the heights
    of the sensor above it, and clear of every surface. A room that no place of the lattice falls in gets one
    in its middle.

    Raises
    ------
    InputError
        No floor, a room that there is not, nowhere to stand.
    """
    caster = scene.ray_caster()
    floors = find_floors(cut_columns(scene.mesh, caster), caster)
    rooms = find_rooms(floors, caster)
    chosen, warnings = _chosen(scene, rooms, options)
    spacing = options.spacing_m or _default_spacing([rooms.rooms[number - 1] for number in chosen])
    positions, of = _positions(scene, rooms, chosen, options, spacing)
    if not len(positions):
        level = sum(room.floor_m2 for room in rooms.rooms)
        n_rooms = count(len(rooms.rooms), "room")
        raise InputError(
            f"nowhere to stand in {scene.name}: {level:.1f} m2 of floor in {n_rooms}, and no place on it "
            f"keeps {options.clearance_m:g} m clear of every surface; is it an object (--mode object), "
            "not in metres (--units), or is another axis up (--up)?"
        )
    without = [rooms.rooms[number - 1] for number in chosen if number not in set(of.tolist())]
    if without:
        names = ", ".join(f"{room.name} ({room.floor_m2:.1f} m2)" for room in without)
        warnings = [*warnings, f"no place for a station in {names}: nothing there keeps "
                    f"{options.clearance_m:g} m clear; see --clearance"]  # fmt: skip
    return Site(rooms, chosen, positions, position_room=of, spacing_m=spacing, warnings=tuple(warnings))


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


def _positions(
    scene: Scene, rooms: Rooms, chosen: tuple[int, ...], options: SiteOptions, spacing: float
) -> tuple[FloatArray, NDArray[np.int32]]:
    """Where the sensor may be (p, 3) in the chosen rooms, and the room (p,) of each."""
    floors = rooms.floors
    asked = [rooms.rooms[number - 1] for number in chosen]
    low, high = scene.mesh.bounds()
    x, y = (line_positions(low[axis], high[axis], spacing, options.clearance_m) for axis in range(2))
    places = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    clear = Clearance.of(scene.mesh, options.clearance_m)
    heights = np.array(options.heights_m or TRIPOD_HEIGHTS_M)
    stands = floors.can_stand & np.isin(rooms.room, chosen)
    found, of = _over(places, heights, rooms, stands, clear)
    missing = [room for room in asked if room.number not in set(of.tolist())]
    if missing:
        middles = np.array([room.place[:2] for room in missing])
        left = stands & np.isin(rooms.room, [room.number for room in missing])
        more, of_more = _over(middles, heights, rooms, left, clear)
        found, of = np.vstack([found, more]), np.append(of, of_more)
    return found, of


def _over(
    places: FloatArray, heights: FloatArray, rooms: Rooms, stands: BoolArray, clear: Clearance
) -> tuple[FloatArray, NDArray[np.int32]]:
    """Positions (p, 3) over places (k, 2) at heights above the floor, and their rooms (p,)."""
    columns = rooms.floors.columns
    cells = columns.cells_of(places)
    found, of = [np.zeros((0, 3))], [np.zeros(0, np.int32)]
    inside = np.flatnonzero(cells >= 0)
    for k in range(int(np.diff(columns.start).max(initial=0))):
        span = columns.start[cells[inside]] + k
        known = span < columns.start[cells[inside] + 1]
        at, span = inside[known], span[known]
        kept = stands[span]
        at, span = at[kept], span[kept]
        up = columns.bottom[span][:, None] + heights
        fits = up + clear.clearance_m <= columns.top[span][:, None]
        where = np.column_stack([np.repeat(places[at], len(heights), axis=0), up.ravel()])[fits.ravel()]
        free = clear.holds(where) if len(where) else np.zeros(0, np.bool_)
        found.append(where[free])
        of.append(np.repeat(rooms.room[span], len(heights))[fits.ravel()][free])
    positions, room = np.vstack(found), np.concatenate(of)
    order = np.lexsort(positions.T[::-1])
    return positions[order], room[order]


def _default_spacing(rooms: list[Room]) -> float:
    return _SPACING_M if sum(room.floor_m2 for room in rooms) <= _LARGE_M2 else _WIDE_M
