# SPDX-License-Identifier: MIT
"""Rooms: the parts of a scene's floor between doorways, and what joins them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nbv.visibility.standing.floors import Floors
from scenes.checks import FloatArray


@dataclass(frozen=True, slots=True)
class Room:
    """A room.

    Attributes
    ----------
    number : int
        From 1, by storey and then by size.
    storey : int
        From 1, the lowest.
    floor_m2, level_m : float
        Area of its floor in square metres, and the height that half of it lies below, metres.
    ceiling_m : float or None
        The height that half of its ceiling lies below, metres; None where it has none.
    place : (3,) float
        A place on its floor, far from walls, metres.
    is_outside : bool
        Whether it lies under the open sky, or is open to that along a quarter of its outline.
    joined : tuple of int
        Rooms to which doorways stand open, or steps lead.
    stairs : tuple of int
        Rooms of other storeys to which stairs lead.
    """

    number: int
    storey: int
    floor_m2: float
    level_m: float
    ceiling_m: float | None
    place: tuple[float, float, float]
    is_outside: bool
    joined: tuple[int, ...]
    stairs: tuple[int, ...]

    @property
    def name(self) -> str:
        """What to call it."""
        kind = "outside" if self.is_outside else "room"
        return f"{kind} {self.number}"

    def to_json(self) -> dict[str, Any]:
        """Return the entry of `plan.json`."""
        return {
            "room": self.number,
            "name": self.name,
            "storey": self.storey,
            "floor_m2": self.floor_m2,
            "level_m": self.level_m,
            "ceiling_m": self.ceiling_m,
            "place": list(self.place),
            "is_outside": self.is_outside,
            "joined": list(self.joined),
            "stairs": list(self.stairs),
        }


@dataclass(frozen=True, slots=True, eq=False)
class Rooms:
    """The rooms of a scene, and which span of its columns is of which.

    Attributes
    ----------
    floors : Floors
        The floor.
    room : (n,) int32
        Number of the room that a floor span is of, 0 for none: treads of stairs, and what is no floor.
    rooms : tuple of Room
        By number.
    solid_m2 : float
        Floor area that was left out since it is the inside of solids, square metres.
    doubts : tuple of str
        What was assumed.
    """

    floors: Floors
    room: NDArray[np.int32]
    rooms: tuple[Room, ...]
    solid_m2: float
    doubts: tuple[str, ...]

    def span_of(self, places: FloatArray) -> NDArray[np.int64]:
        """Return the span (n,) of free space that each place (n, 3) lies in, metres; -1 for none."""
        columns = self.floors.columns
        cells, found = columns.cells_of(places[:, :2]), np.full(len(places), -1, np.int64)
        inside = np.flatnonzero(cells >= 0)
        for k in range(int(np.diff(columns.start).max(initial=0))):
            span = columns.start[cells[inside]] + k
            known = (span < columns.start[cells[inside] + 1]) & (found[inside] < 0)
            at, span = inside[known], span[known]
            holds = (columns.bottom[span] <= places[at, 2]) & (columns.top[span] >= places[at, 2])
            found[at[holds]] = span[holds]
        return found

    def room_of(self, places: FloatArray) -> NDArray[np.int32]:
        """Return the number (n,) of the room on whose floor, or over it, each place (n, 3) is; 0 for none."""
        span = self.span_of(places)
        return np.where(span >= 0, np.append(self.room, 0)[span], 0).astype(np.int32)

    def height_above_floor(self, places: FloatArray) -> FloatArray:
        """Return how high (n,) each place (n, 3) is above what lies below, metres; nan where nothing does."""
        span = self.span_of(places)
        below = np.where(span >= 0, np.append(self.floors.columns.bottom, 0.0)[span], np.nan)
        return np.asarray(places[:, 2] - below)

    def connected(self, start: int) -> set[int]:
        """Numbers of the rooms to which one walks from a room, through doorways and by stairs."""
        reached, going = {start}, [start]
        while going:
            room = self.rooms[going.pop() - 1]
            new = (set(room.joined) | set(room.stairs)) - reached
            reached |= new
            going += sorted(new)
        return reached
