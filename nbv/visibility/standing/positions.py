# SPDX-License-Identifier: MIT
"""Positions: where in rooms the sensor may be, on a lattice over their floor and clear of every surface."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nbv.run.wording import count
from nbv.visibility.site_options import CLEARANCE_M, SiteOptions
from nbv.visibility.standing.clearance import Clearance
from nbv.visibility.standing.floors import HEADROOM_M
from nbv.visibility.standing.rooms import Room, Rooms
from nbv.visibility.viewpoints import line_positions
from scenes.checks import BoolArray, FloatArray, InputError
from scenes.run.memory import require

_SPACING_M, _WIDE_M = 0.5, 1.0
_LARGE_M2 = 60.0  # of floor: from here on positions are a metre apart
_MOST_POSITIONS = 50_000  # 1e9 lines of sight to 20,000 samples: some five minutes on one core
_BYTES_A_POSITION = 80_000  # a third of 20,000 samples in sight, 12 bytes each


def check_fits(scene: str, asked: Sequence[Room], options: SiteOptions) -> None:
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
    asked: Sequence[Room], options: SiteOptions, *, turns: bool = False
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
    wished = options.spacing_m or (_SPACING_M if turns or floor_m2 <= _LARGE_M2 else _WIDE_M)
    n_positions = floor_m2 * n_heights / wished**2
    finest = float(np.ceil(1000 * np.sqrt(floor_m2 * n_heights / _MOST_POSITIONS)) / 1000)
    on_floor = f"{floor_m2:.1f} m2 of floor at {count(n_heights, 'height')}"
    if n_positions <= _MOST_POSITIONS:
        require(
            n_positions * _BYTES_A_POSITION,
            f"what about {n_positions:.0f} positions see, {wished:g} m apart on {on_floor},",
            "give a larger --spacing, fewer --heights or some --rooms",
        )
        return wished, []
    if options.spacing_m is not None:
        raise InputError(
            f"--spacing {wished:g} puts about {n_positions:.0f} positions on {on_floor}, and at most "
            f"{_MOST_POSITIONS} can be tried; give --spacing {finest:g} or more, fewer --heights or some "
            "--rooms"
        )
    return finest, [
        f"places for stations are {finest:g} m apart, not {wished:g} m: that would be about "
        f"{n_positions:.0f} positions on {on_floor}, and at most {_MOST_POSITIONS} can be tried; fewer "
        "--heights or some --rooms allow a smaller --spacing"
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
    found, of = _over(places, heights, rooms, stands, clear)
    missing = [room for room in asked if room.number not in set(of.tolist())]
    if missing:
        middles = np.array([room.place[:2] for room in missing])
        left = stands & np.isin(rooms.room, [room.number for room in missing])
        more, of_more = _over(middles, heights, rooms, left, clear)
        found, of = np.vstack([found, more]), np.append(of, of_more)
    if options.start is None:
        return RoomPositions(found, of, np.zeros((0, 3)))
    start, of_start = _start(options.start, heights, rooms, stands, clear)
    if not len(start):
        raise InputError(_why_no_start(options, found))
    new = np.array([np.abs(found - one).max(axis=1, initial=0.0).min(initial=np.inf) > 1e-6 for one in start])
    return RoomPositions(np.vstack([found, start[new]]), np.append(of, of_start[new]), start)


def _start(
    place: tuple[float, ...], heights: FloatArray, rooms: Rooms, stands: BoolArray, clear: Clearance
) -> tuple[FloatArray, NDArray[np.int32]]:
    """Positions (s, 3) at the start and their rooms (s,): over the lowest floor there, or at its own z."""
    spot = np.array([place[:2]])
    if len(place) == 2:
        found, of = _over(spot, heights, rooms, stands, clear)
        lowest = found[:, 2] < found[:, 2].min(initial=np.inf) + HEADROOM_M + heights.max()
        same = of == of[0] if len(of) else lowest
        return found[lowest & same], of[lowest & same]
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
    said = (
        f"--start {','.join(f'{value:g}' for value in place)} is no place for a station: not on floor of a "
    )
    said += f"room that is asked for, or nearer than {options.clearance_m:g} m to a surface (--clearance)"
    if not len(positions):
        return said
    away = np.linalg.norm(positions[:, : len(place)] - place, axis=1)
    nearest = ",".join(f"{value:.2f}" for value in positions[int(np.argmin(away)), : len(place)])
    return f"{said}; the nearest is --start {nearest}, {float(away.min()):.2f} m away"


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
