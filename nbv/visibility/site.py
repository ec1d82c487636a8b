# SPDX-License-Identifier: MIT
"""Site: the rooms of a scene that are asked for, and the candidates that stand in them.

Positions in rooms lie on a lattice over their floor and clear of every surface.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nbv.run.wording import count
from nbv.scanning.sensor import Sensor, View
from nbv.visibility import limits
from nbv.visibility.clearance import Clearance
from nbv.visibility.floors import Platform, cut_columns, find_floors
from nbv.visibility.rooms import Rooms, SiteRoom, find_rooms
from nbv.visibility.site_options import CLEARANCE_M, SiteOptions
from nbv.visibility.viewpoints import Candidates, line_positions, sensor_directions
from scenes.checks import ArrayValue, BoolArray, FloatArray, InputError
from scenes.run.memory import require
from scenes.world.scene import Scene

_BYTES_A_POSITION = 80_000  # a third of 20,000 samples in sight, 12 bytes each


def check_fits(scene: str, asked: Sequence[SiteRoom], options: SiteOptions) -> None:
    """Check that the sensor fits between floor and ceiling of some room of a scene by this name.

    Raises
    ------
    InputError
        All heights above the ceilings, or a clearance that leaves no height.
    """
    heights, clearance = options.heights_above_floor_m, options.clearance_m
    nowhere, default = f"nowhere to stand in {scene}", f"it is {CLEARANCE_M:g} when not given"
    if max(heights) < clearance:
        raise InputError(
            f"{nowhere}: --clearance {clearance:g} m holds of the floor too, and the sensor is at most "
            f"{max(heights):g} m above it; give a --clearance below that ({default}), or greater --heights"
        )
    ceilings = [room.ceiling_m - room.level_m for room in asked if room.ceiling_m is not None]
    if not asked or len(ceilings) < len(asked):
        return  # under the sky there is no end
    highest = max(ceilings)
    if 2 * clearance >= highest:
        raise InputError(
            f"{nowhere}: --clearance {clearance:g} m of floor and ceiling needs {2 * clearance:g} m, and the "
            f"highest room has {highest:.2f} m; give a --clearance below {highest / 2:.2f} ({default})"
        )
    if min(heights) > highest - clearance:
        raise InputError(
            f"{nowhere}: the sensor is at {min(heights):g} m or more above the floor, the highest room has "
            f"{highest:.2f} m, and {clearance:g} m stay clear; give --heights up to {highest - clearance:.2f}"
        )


def lattice_spacing(
    asked: Sequence[SiteRoom], options: SiteOptions, *, turns: bool = False
) -> tuple[float, list[str]]:
    """Return the distance between places, metres, and what is to be said of it.

    A camera's is larger in large buildings; that of a sensor that `turns` by itself is not. Where there are
    more positions than can be tried, a distance that was asked for is refused, and another one made larger.

    Raises
    ------
    InputError
        A spacing that makes more than 50,000 positions, or more than fit into memory.
    """
    floor_m2, n_heights = sum(room.floor_m2 for room in asked), len(options.heights_above_floor_m)
    wished = options.spacing_m or (
        limits.SPACING_M if turns or floor_m2 <= limits.LARGE_M2 else limits.WIDE_SPACING_M
    )
    n_positions = floor_m2 * n_heights / wished**2
    finest = float(np.ceil(1000 * np.sqrt(floor_m2 * n_heights / limits.MOST_SITE_POSITIONS)) / 1000)
    on_floor = f"{floor_m2:.1f} m2 of floor at {count(n_heights, 'height')}"
    if n_positions <= limits.MOST_SITE_POSITIONS:
        require(
            n_positions * _BYTES_A_POSITION,
            f"what about {n_positions:.0f} positions see, {wished:g} m apart on {on_floor},",
            "give a larger --spacing, fewer --heights or some --rooms",
        )
        return wished, []
    if options.spacing_m is not None:
        raise InputError(
            f"--spacing {wished:g} puts about {n_positions:.0f} positions on {on_floor}, and at most "
            f"{limits.MOST_SITE_POSITIONS} can be tried; give --spacing {finest:g} or more, fewer --heights "
            "or some --rooms"
        )
    return finest, [
        f"places for stations are {finest:g} m apart, not {wished:g} m: that would be about "
        f"{n_positions:.0f} positions on {on_floor}, and at most {limits.MOST_SITE_POSITIONS} can be tried; "
        "fewer --heights or some --rooms allow a smaller --spacing"
    ]


@dataclass(frozen=True, slots=True, eq=False)
class RoomPositions:
    """Positions (p, 3), metres, the room (p,) of each, and the positions (s, 3) at the start."""

    positions: FloatArray
    room: NDArray[np.int32]
    start: FloatArray


def room_positions(
    bounds: FloatArray,
    rooms: Rooms,
    chosen: tuple[int, ...],
    *,
    options: SiteOptions,
    spacing_m: float,
    clear: Clearance,
) -> RoomPositions:
    """Return where the sensor may be in the chosen rooms of a place with these bounds (2, 3), metres.

    A room that no place of the lattice falls in gets one in its middle; the start, where one is asked for, is
    a place, too.

    Raises
    ------
    InputError
        A start at which the sensor cannot be.
    """
    floors = rooms.floors
    asked = [rooms.rooms[number - 1] for number in chosen]
    low, high = bounds
    x, y = (line_positions(low[axis], high[axis], spacing_m, options.clearance_m) for axis in range(2))
    places = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    heights = np.array(options.heights_above_floor_m)
    stands = floors.can_stand & np.isin(rooms.room, chosen)
    positions, of = _over(places, heights, rooms, stands, clear)
    missing = [room for room in asked if room.number not in set(of.tolist())]
    if missing:
        middles = np.array([room.place[:2] for room in missing])
        left = stands & np.isin(rooms.room, [room.number for room in missing])
        more, of_more = _over(middles, heights, rooms, left, clear)
        positions, of = np.vstack([positions, more]), np.append(of, of_more)
    if options.start is None:
        return RoomPositions(positions, of, np.zeros((0, 3)))
    start, of_start = _start(options.start, heights, rooms, stands, clear)
    if not len(start):
        raise InputError(_why_no_start(options, positions))
    new = np.array(
        [np.abs(positions - place).max(axis=1, initial=0.0).min(initial=np.inf) > 1e-6 for place in start]
    )
    return RoomPositions(np.vstack([positions, start[new]]), np.append(of, of_start[new]), start)


def _start(
    place: tuple[float, ...], heights: FloatArray, rooms: Rooms, stands: BoolArray, clear: Clearance
) -> tuple[FloatArray, NDArray[np.int32]]:
    """Positions (s, 3) at the start and their rooms (s,): over the lowest floor there, or at its own z."""
    spot = np.array([place[:2]])
    if len(place) == 2:
        positions, of = _over(spot, heights, rooms, stands, clear)
        lowest = positions[:, 2] < positions[:, 2].min(initial=np.inf) + limits.HEADROOM_M + heights.max()
        same = of == of[0] if len(of) else lowest
        return positions[lowest & same], of[lowest & same]
    span = rooms.span_of(np.array([place]))
    if span[0] < 0 or not stands[span[0]]:
        return np.zeros((0, 3)), np.zeros(0, np.int32)
    up = np.array([place[2] - rooms.floors.columns.bottom[span[0]]])
    only = np.zeros_like(stands)
    only[span[0]] = True
    return _over(spot, up, rooms, only, clear)


def _why_no_start(options: SiteOptions, positions: FloatArray) -> str:
    """Return why the sensor cannot be at the start, and the nearest place where it can."""
    place = np.array(options.start)
    sentence = (
        f"--start {','.join(f'{value:g}' for value in place)} is no place for a station: not on floor of a "
    )
    sentence += f"room that is asked for, or nearer than {options.clearance_m:g} m to a surface (--clearance)"
    if not len(positions):
        return sentence
    away = np.linalg.norm(positions[:, : len(place)] - place, axis=1)
    nearest = ",".join(f"{value:.2f}" for value in positions[int(np.argmin(away)), : len(place)])
    return f"{sentence}; the nearest is --start {nearest}, {float(away.min()):.2f} m away"


def _over(
    places: FloatArray, heights: FloatArray, rooms: Rooms, stands: BoolArray, clear: Clearance
) -> tuple[FloatArray, NDArray[np.int32]]:
    """Positions (p, 3) over places (k, 2) at heights above the floor, and their rooms (p,)."""
    columns = rooms.floors.columns
    cells = columns.cells_of(places)
    arrays, of = [np.zeros((0, 3))], [np.zeros(0, np.int32)]
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
        arrays.append(where[free])
        of.append(np.repeat(rooms.room[span], len(heights))[fits.ravel()][free])
    positions, room = np.vstack(arrays), np.concatenate(of)
    order = np.lexsort(positions.T[::-1])
    return positions[order], room[order]


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Site(ArrayValue):
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
        return float(np.median(ceilings)) - limits.BELOW_CEILING_M if ceilings else None

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
        return np.asarray(~known | (mine & (bottom >= level_m - limits.STEP_M)))

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
    chosen, warnings = _choose_rooms(scene, rooms, options)
    warnings += platforms_in_words(rooms.floors.platforms)
    asked = [rooms.rooms[number - 1] for number in chosen]
    warnings += storeys_in_words(rooms.rooms, asked)
    check_fits(scene.name, asked, options)
    spacing, widened = lattice_spacing(asked, options, turns=turns)
    clear = Clearance.of(scene.mesh, options.clearance_m)
    bounds = np.asarray(scene.mesh.bounds())
    positions = room_positions(bounds, rooms, chosen, options=options, spacing_m=spacing, clear=clear)
    if not len(positions.positions):
        level = sum(room.floor_m2 for room in rooms.rooms)
        n_rooms = count(len(rooms.rooms), "room")
        raise InputError(
            f"nowhere to stand in {scene.name}: {level:.1f} m2 of floor in {n_rooms}, and no place on it "
            f"keeps {options.clearance_m:g} m clear (--clearance) of every surface at a height of "
            f"{options.heights_in_words()} (--heights); is it an object (--mode object), not in metres "
            "(--units), or is another axis up (--up)?"
        )
    warnings += widened
    without = [room for room in asked if room.number not in set(positions.room.tolist())]
    if without:
        names = ", ".join(f"{room.name} ({room.floor_m2:.1f} m2)" for room in without)
        warnings = [*warnings, f"no place for a station in {names}: nothing there keeps "
                    f"{options.clearance_m:g} m clear; see --clearance"]  # fmt: skip
    return Site(
        rooms=rooms,
        chosen=chosen,
        positions=positions.positions,
        position_room=positions.room,
        start=positions.start,
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


def storeys_in_words(rooms: Sequence[SiteRoom], asked: Sequence[SiteRoom]) -> list[str]:
    """Return a sentence on storeys above the lowest, with rooms that are asked for, without stairs."""
    storeys = sorted({room.storey for room in rooms if not room.is_outside})
    cut_off = []
    for storey in storeys[1:]:
        own = [room for room in asked if room.storey == storey]
        if not own or any(room.stairs for room in rooms if room.storey == storey):
            continue
        area, top = sum(room.floor_m2 for room in own), " (the top one)" if storey == storeys[-1] else ""
        names = ", ".join(room.name for room in own[:3]) + (", ..." if len(own) > 3 else "")
        cut_off.append(f"storey {storey}{top}, {area:.1f} m2 at {own[0].level_m:.2f} m: {names}")
    if not cut_off:
        return []
    return [
        f"no stairs lead to {'; '.join(cut_off)}. Stations there need a ladder, or a way that the file does "
        "not show; --rooms leaves them out"
    ]


def _choose_rooms(scene: Scene, rooms: Rooms, options: SiteOptions) -> tuple[tuple[int, ...], list[str]]:
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
    reached = rooms.reachable_from(largest.number)
    kept = tuple(room.number for room in open_ if room.number in reached)
    if len(kept) < len(open_):
        warnings.append(f"{count(len(open_) - len(kept), 'room')} not connected with {largest.name} left out")
    return kept, warnings
