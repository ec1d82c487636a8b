# SPDX-License-Identifier: MIT
"""Site options: what a surveyor says of where stations may stand."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from scenes.card import Value
from scenes.run.option import NumberRange, numbers, option

CLEARANCE_M = 0.3
"""Distance from the sensor to every surface where none is given, metres: a tripod's legs fit."""
TRIPOD_HEIGHTS_M = (0.4, 1.0, 1.6, 2.2)
"""Heights of the sensor above the floor where none are given, metres."""


def parse_rooms(text: str) -> Literal["all", "connected"] | tuple[int, ...]:
    """Return the rooms of a text: all, connected, or whole numbers from 1 with commas between them."""
    if text == "all":
        return "all"
    if text == "connected":
        return "connected"
    given = numbers(0)(text)
    rooms = tuple(int(number) for number in given)
    if rooms != given or min(rooms) < 1:
        raise ValueError(f"--rooms takes all, connected, or whole numbers from 1, got {text}")
    return rooms


def parse_start(text: str) -> tuple[float, ...]:
    """Return the two or three finite numbers of a text."""
    start: tuple[float, ...] = numbers(3 if len(numbers(0)(text)) == 3 else 2)(text)
    return start


def parse_heights(text: str) -> tuple[float, ...]:
    """Return the positive heights of a text."""
    heights: tuple[float, ...] = numbers(0)(text)
    if min(heights) <= 0:
        raise ValueError(f"--heights are above the floor, metres, got {min(heights):g}")
    return heights


@dataclass(frozen=True, slots=True, kw_only=True)
class SiteOptions(Value):
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
    start : (2,) or (3,) tuple of float, optional
        Where the first station stands: x, y and, if it matters, z of the sensor, metres.
    several_heights : bool
        Whether a plan may put stations at several heights over one spot of the floor.

    Raises
    ------
    InputError
        A height, spacing or clearance that is not positive; rooms that are no numbers from 1; a start that
        is not two or three finite numbers.
    """

    rooms: Literal["all", "connected"] | tuple[int, ...] = option(
        "--rooms", "Rooms in which stations may stand.", "all", metavar="all|connected|N,N,...",
        parse=parse_rooms,
    )  # fmt: skip
    outdoors: bool = option("--outdoors", "Stations may also stand outside.", False)
    all_round: bool = option("--all-round", "Views of an object may be from below.", False)
    heights_m: tuple[float, ...] | None = option(
        "--heights", "Heights of the sensor above the floor.", None, metavar="M,M,...",
        shown=",".join(map(str, TRIPOD_HEIGHTS_M)), parse=parse_heights,
    )  # fmt: skip
    spacing_m: float | None = option(
        "--spacing", "Distance between places for stations.", None, metavar="M",
        shown="0.5; 1 for cameras in large buildings", limits=NumberRange(least=0.01),
    )  # fmt: skip
    clearance_m: float = option(
        "--clearance", "Distance from the sensor to every surface.", CLEARANCE_M, metavar="M",
        limits=NumberRange(least=0.001),
    )  # fmt: skip
    start: tuple[float, ...] | None = option(
        "--start", "Position of the first station, metres.", None, metavar="X,Y[,Z]", shown=False,
        parse=parse_start,
    )  # fmt: skip
    several_heights: bool = option(
        "--several-heights", "Stations may stand at several heights over one spot.", False
    )

    def __post_init__(self) -> None:
        from scenes.checks import InputError  # numpy comes with it, which help does without

        lengths = {"clearance_m": (self.clearance_m,), "heights_m": self.heights_m or (), "spacing_m": ()}
        if self.heights_m is not None and not self.heights_m:
            raise InputError("heights_m holds no height; give at least one, or leave it out")
        if self.spacing_m is not None:
            lengths["spacing_m"] = (self.spacing_m,)
        for name, values in lengths.items():
            if wrong := [value for value in values if not (math.isfinite(value) and value > 0)]:
                raise InputError(f"{name} must be positive, metres, got {wrong[0]}")
        if self.start is not None and not (len(self.start) in (2, 3) and all(map(math.isfinite, self.start))):
            raise InputError(f"start is X,Y or X,Y,Z, finite numbers of metres, got {self.start}")
        named = self.rooms if isinstance(self.rooms, tuple) else ()
        if wrong_rooms := [room for room in named if room < 1]:
            raise InputError(f"rooms are numbered from 1, got {wrong_rooms[0]}")
        if isinstance(self.rooms, str) and self.rooms not in ("all", "connected"):
            raise InputError(f"rooms must be all, connected, or their numbers, got {self.rooms!r}")

    @property
    def heights_above_floor_m(self) -> tuple[float, ...]:
        """Heights at which the sensor may be above the floor, metres."""
        return self.heights_m or TRIPOD_HEIGHTS_M

    def heights_in_words(self) -> str:
        """Return the heights of the sensor for people."""
        return ",".join(f"{height:g}" for height in self.heights_above_floor_m) + " m"
