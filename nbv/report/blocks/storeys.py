# SPDX-License-Identifier: MIT
"""Storeys of a plan: a floor plan of each, with its rooms, its stations and what of the tour lies on it."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from nbv.plan.plan import Plan
from nbv.plan.station_list import stations_of
from nbv.report.blocks.stations import cut_of
from nbv.report.figures.storey_plan import StoreyPlan
from nbv.run.wording import count, square_metres
from nbv.visibility.standing.rooms import Room, Rooms
from scenes.checks import FloatArray
from scenes.world.scene import Scene

CUT_M = 1.6  # of the cut where no station says the instrument's
_BELOW_M = 0.5  # a way so far below a storey's floor still belongs to it
_NEAR_M = 1.2  # a room's label keeps so far from its stations where there is space


def storey_plans(scene: Scene, plan: Plan) -> tuple[StoreyPlan, ...]:
    """Return the floor plan of each storey on which stations were asked for, the lowest first.

    It is cut at the height of the instruments that stand there. Nothing without rooms.
    """
    if plan.site is None:
        return ()
    rooms, stations = plan.site.rooms, stations_of(plan)
    asked = [rooms.rooms[number - 1] for number in plan.site.chosen]
    levels = {storey: level_of(rooms.rooms, storey) for storey in {room.storey for room in rooms.rooms}}
    ways = _ways_of(plan, levels)
    found = []
    for storey in sorted({room.storey for room in asked}):
        here = [one for one in stations if one.room is not None and one.room.storey == storey]
        heights = [one.height_m for one in here]
        height = float(np.median(heights)) if heights else CUT_M
        places = np.array([one.position[:2] for one in here]).reshape(-1, 2)
        shown = [room for room in rooms.rooms if room.storey == storey and not room.is_outside]
        shown += [room for room in asked if room.storey == storey and room.is_outside]
        found.append(
            StoreyPlan(
                storey=storey,
                title=f"{scene.name}, storey {storey}: {count(len(here), 'station')}",
                outline=around_rooms(cut_of(scene.mesh, levels[storey] + height), rooms, storey),
                cut_m=height,
                rooms=[(label_of(room), label_place(rooms, room, places)) for room in shown],
                stations=[(str(one.number), one.position[:2], one.headings_deg) for one in here],
                ways=ways.get(storey, ()),
            )
        )
    return tuple(found)


def label_of(room: Room) -> str:
    """What stands on a room: its name and its floor area."""
    return f"{room.name}\n{square_metres(room.floor_m2)} m\u00b2"


def level_of(rooms: Sequence[Room], storey: int) -> float:
    """Height of a storey's floor, metres: that of most of it."""
    here = [room for room in rooms if room.storey == storey]
    return max(here, key=lambda room: room.floor_m2).level_m


def label_place(rooms: Rooms, room: Room, there: FloatArray) -> FloatArray:
    """Where a room's label stands (2,), metres: near its middle, off its walls and the stations (n, 2)."""
    columns = rooms.floors.columns
    inside = np.zeros(columns.shape, np.bool_)
    inside.ravel()[columns.cell[rooms.room == room.number]] = True
    cells = np.flatnonzero(inside)
    off_walls = ndimage.distance_transform_edt(np.pad(inside, 1))[1:-1, 1:-1].ravel()[cells] * columns.cell_m
    places = columns.places(cells)
    away = np.full(len(places), _NEAR_M)
    if len(there):
        away = np.minimum(cKDTree(there).query(places)[0], _NEAR_M)
    middle = np.linalg.norm(places - np.array(room.place[:2]), axis=1)
    return np.asarray(places[np.argmax(away + 2 * np.minimum(off_walls, _NEAR_M / 2) - 0.15 * middle)])


def around_rooms(outline: FloatArray, rooms: Rooms, storey: int) -> FloatArray:
    """What of an outline (k, 2, 2) lies around the rooms of a storey: grounds go on far beyond."""
    numbers = [room.number for room in rooms.rooms if room.storey == storey and not room.is_outside]
    columns = rooms.floors.columns
    places = columns.places(columns.cell[np.isin(rooms.room, numbers)])
    if not len(places) or not len(outline):
        return outline
    low, high = places.min(axis=0) - 1.0, places.max(axis=0) + 1.0
    inside = ((outline >= low) & (outline <= high)).all(axis=2).any(axis=1)
    return np.asarray(outline[inside])


def _ways_of(plan: Plan, levels: dict[int, float]) -> dict[int, list[FloatArray]]:
    """What of the tour lies on each storey, as stretches (k, 2), metres.

    A leg between stations of one storey lies on it; of others each stretch on the one below its height.
    """
    if plan.stations is None or plan.site is None or not levels:
        return {}
    storeys = sorted(levels, key=lambda storey: levels[storey])
    floor = np.array([levels[storey] for storey in storeys])
    positions = np.array([view.world_from_sensor.translation for view in plan.views])
    room, storey_of = plan.site.rooms.room_of(positions), [0, *(one.storey for one in plan.site.rooms.rooms)]
    tour = plan.stations.tour
    found: dict[int, list[FloatArray]] = {}
    for (a, b), leg in zip(pairwise(tour.order), tour.legs, strict=True):
        if len(leg.path) < 2:
            continue
        of = np.maximum(np.searchsorted(floor, leg.path[:, 2] + _BELOW_M, side="right") - 1, 0)
        one, other = storey_of[room[a]], storey_of[room[b]]
        if one == other > 0:
            of[:] = storeys.index(one)
        ends = [0, *(np.flatnonzero(np.diff(of)) + 1).tolist(), len(of)]
        for first, last in pairwise(ends):
            stretch = leg.path[first : min(last + 1, len(of)), :2]
            if len(stretch) > 1:
                found.setdefault(storeys[of[first]], []).append(stretch)
    return found
