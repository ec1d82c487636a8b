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

    def room_of(self, places: FloatArray) -> NDArray[np.int32]:
        """Return the number (n,) of the room on whose floor, or over it, each place (n, 3) is; 0 for none."""
        columns, of = self.floors.columns, np.zeros(len(places), np.int32)
        for k, cell in enumerate(columns.cells_of(places[:, :2]).tolist()):
            spans = np.arange(columns.start[cell], columns.start[cell + 1]) if cell >= 0 else np.zeros(0, int)
            held = spans[(columns.bottom[spans] <= places[k, 2]) & (columns.top[spans] >= places[k, 2])]
            of[k] = self.room[held[0]] if len(held) else 0
        return of

    def connected(self, start: int) -> set[int]:
        """Numbers of the rooms to which one walks from a room, through doorways and by stairs."""
        reached, going = {start}, [start]
        while going:
            room = self.rooms[going.pop() - 1]
            new = (set(room.joined) | set(room.stairs)) - reached
            reached |= new
            going += sorted(new)
        return reached
