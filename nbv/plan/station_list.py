# SPDX-License-Identifier: MIT
"""Station list: where a surveyor sets up the instrument in a building, room by room and storey by storey."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nbv.plan.plan import Plan, aim_of
from nbv.visibility.limits import SAME_M
from nbv.visibility.rooms import SiteRoom
from scenes.checks import FloatArray
from scenes.run.csv_table import csv_text

STATION_COLUMNS = (
    "station", "room", "storey", "x_m", "y_m", "z_m", "height_m", "heading_deg", "pitch_deg", "visit",
    "views",
)  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Station:
    """A place where the sensor is set up, for one view or, where it turns there, for several.

    Attributes
    ----------
    number : int
        From 1, in the order of the plan's views.
    position : (3,) float
        Of the sensor, metres.
    room : Room or None
        Where it stands; None off the floor of all rooms.
    height_m : float
        Of the sensor above the floor, metres.
    views : tuple of int
        The plan's views from here, from 1.
    headings_deg, pitches_deg : tuple of float
        Where each of them looks, as `nbv.plan.plan.Aim` has it; none for a sensor that turns by itself.
    visit : int or None
        Its place in the tour, from 1; None without a tour.
    """

    number: int
    position: FloatArray
    room: SiteRoom | None
    height_m: float
    views: tuple[int, ...]
    headings_deg: tuple[float, ...]
    pitches_deg: tuple[float, ...]
    visit: int | None


def stations_of(plan: Plan) -> tuple[Station, ...]:
    """Return the stations of a plan in a building; nothing without rooms or without views."""
    if plan.site is None or not plan.views:
        return ()
    positions = np.array([view.world_from_sensor.translation for view in plan.views])
    of = _first_alike(positions)
    rooms = plan.site.rooms
    room, height = rooms.room_of(positions), rooms.height_above_floor(positions)
    order = [] if plan.stations is None else [int(of[number]) for number in plan.stations.tour.order]
    visits = {first: k for k, first in enumerate(dict.fromkeys(order), start=1)}
    turns = plan.sensor.kind == "spherical"
    stations = []
    for number, first in enumerate(np.unique(of).tolist(), start=1):
        views = np.flatnonzero(of == first).tolist()
        aims = [] if turns else [aim_of(plan.views[k].world_from_sensor) for k in views]
        stations.append(
            Station(
                number=number,
                position=positions[first],
                room=rooms.rooms[room[first] - 1] if room[first] else None,
                height_m=float(height[first]),
                views=tuple(k + 1 for k in views),
                headings_deg=tuple(aim.heading_deg for aim in aims),
                pitches_deg=tuple(aim.pitch_deg for aim in aims),
                visit=visits.get(first),
            )
        )
    return tuple(stations)


def station_csv(stations: tuple[Station, ...]) -> str:
    """Return a line for each station; of several views from one, headings and pitches stand in their order.

    Metres with millimetres, degrees with tenths.
    """
    rows: list[list[object]] = []
    for station in stations:
        where = [f"{value + 0.0:.3f}" for value in (*station.position.tolist(), station.height_m)]
        angles = [
            " ".join(f"{a + 0.0:.1f}" for a in angle) for angle in (station.headings_deg, station.pitches_deg)
        ]
        room = [station.room.name, station.room.storey] if station.room else ["", ""]
        views = " ".join(map(str, station.views))
        rows.append([station.number, *room, *where, *angles, station.visit or "", views])
    return csv_text(STATION_COLUMNS, rows)


def _first_alike(positions: FloatArray) -> NDArray[np.int64]:
    """For each position (n, 3) the number of the first that is the same."""
    apart = np.abs(positions[:, None] - positions[None]).max(axis=2)
    return np.asarray(np.argmax(apart <= SAME_M, axis=1))
