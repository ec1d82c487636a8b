# SPDX-License-Identifier: MIT
"""Gaps: doorways and windows in the walls of closed rooms, and what of surfaces lies beyond the rooms.

Openings are found on single surfaces where these go on all around. In a building a doorway reaches down to a
floor that other rooms share, and windows to the ceiling; there the outline of the room says where the wall
should be, and beams say where it is not.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import shapely

from completion.exchange.building.areas import common, joined, less, polygons, wide
from completion.exchange.building.beams import Beams
from completion.exchange.building.bodies import Body
from completion.exchange.building.building_model import OpeningOutline
from completion.exchange.building.faces import Frame, PlaneFace
from completion.exchange.building.rooms import Room, RoomSide
from completion.exchange.building.storeys import Storey
from scenes.checks import FloatArray

_LEAST_WIDE_M, _LEAST_M2 = 0.2, 0.2  # of an opening
_THROUGH = 0.5  # share of it that beams must have gone through
_BEHIND_M = 0.05  # a wall's face, where they are looked for
_RECTANGLE = 0.85  # of the rectangle around it that it must fill to be one
_LINES = (0.1, 0.9, 41)  # where lines run through it, as shares of its size
_BESIDE_CELLS = 2.0  # between a side and what was measured of its wall
_DOOR_M = 0.1  # how far above the floor a door may begin
_BEFORE_M = 0.02  # a wall, where a room must be
_MARGIN_M = 0.002  # by which surfaces may go on beyond a room: its outline is that of fitted planes


def with_gaps(faces: Sequence[PlaneFace], rooms: Sequence[Room], beams: Beams) -> tuple[PlaneFace, ...]:
    """Return the faces with the doorways and windows that rooms' walls have beside those found before."""
    found: dict[int, list[OpeningOutline]] = {face.number: list(face.openings) for face in faces}
    for room in rooms:
        for side in room.sides:
            known = joined(
                shapely.Polygon(side.face.frame.flat(one.points)) for one in found[side.face.number]
            )
            found[side.face.number] += _gaps(side, room, known, beams)
    return tuple(replace(face, openings=tuple(found[face.number])) for face in faces)


def _gaps(side: RoomSide, room: Room, known: Any, beams: Beams) -> Iterator[OpeningOutline]:
    """Openings along a side of a room."""
    if room.height_m is None or not side.faces_in:
        return
    face, frame = side.face, side.face.frame
    band = side.band(room.floor_m, room.floor_m + room.height_m)
    gap = wide(less(band, [face.area, known]), _LEAST_WIDE_M)
    for part in polygons(gap, _LEAST_M2):
        if beams.free(part, frame, _BEHIND_M).area < _THROUGH * part.area:
            continue
        around = _rectangle(part)
        ring = around if part.area >= _RECTANGLE * around.area else part
        left, low, right, high = ring.bounds
        corners = shapely.get_coordinates(ring.exterior)
        points = frame.place(corners[:-1])
        kind = "door" if points[:, 2].min() < room.floor_m + _DOOR_M else "window"
        yield OpeningOutline(
            surface=face.number,
            kind=kind,
            points=points,
            sides=[_side(face, *ends) for ends in pairwise(corners)],
            width_m=float(right - left),
            height_m=float(high - low),
            seen_share=1.0,
        )


def _side(face: PlaneFace, start: FloatArray, end: FloatArray) -> dict[str, float]:
    """How well a side, from a corner (2,) to the next, is known: to a cell, where its wall was measured."""
    cell = float(face.element.patch.grid.cell.max())
    places = shapely.points(start + np.linspace(0.05, 0.95, 19)[:, None] * (end - start))
    beside = shapely.distance(face.measured, places) <= _BESIDE_CELLS * cell
    known = {"inwards_m": 0.0, "outwards_m": 0.0, "measured_share": float(np.mean(beside))}
    return {"sd_m": cell, **known}


def _rectangle(part: Any) -> Any:
    """The rectangle whose sides are the medians of where an area ends along lines through it."""
    left, low, right, high = part.bounds
    shares = np.linspace(*_LINES)
    level = [shapely.LineString([(left, v), (right, v)]) for v in low + shares * (high - low)]
    upright = [shapely.LineString([(u, low), (u, high)]) for u in left + shares * (right - left)]
    (near, _, far, _), (_, bottom, _, top) = (
        np.median(shapely.bounds(met[~shapely.is_empty(met)]), axis=0)
        for met in (shapely.intersection(lines, part) for lines in (level, upright))
    )
    return shapely.box(near, bottom, far, top)


def within_rooms(
    faces: Sequence[PlaneFace], storeys: Sequence[Storey], rooms: Sequence[Room]
) -> tuple[PlaneFace, ...]:
    """Return faces without what was inferred of them where no room is before it, if they bound one.

    Surfaces are continued through the walls and slabs that they meet, where nothing speaks against it. A
    building's walls, floors and ceilings are wanted as far as rooms show them. What was measured stays.
    """
    found = []
    for face in faces:
        shown = list(_shown(face, storeys, rooms))
        if shown:
            inferred = common(face.inferred, joined(shown))
            area = joined((face.measured, inferred))
            found.append(replace(face, inferred=inferred, area=area))
        else:
            found.append(face)
    return tuple(found)


def _shown(face: PlaneFace, storeys: Sequence[Storey], rooms: Sequence[Room]) -> Iterator[Any]:
    """Where rooms lie before a face; none of faces that are no wall, floor or ceiling."""
    for k, storey in enumerate(storeys):
        level = face in storey.floors or face in storey.ceilings
        for room in (one for one in rooms if one.storey == k):
            if level and face.number in room.surfaces:
                outline = shapely.buffer(room.outline, _MARGIN_M, join_style="mitre")
                yield joined([shapely.transform(outline, lambda xy: face.frame.flat(_on(face.frame, xy)))])
            elif face in storey.walls and room.closed:
                top = face.highest_m if room.height_m is None else room.floor_m + room.height_m
                for ends in _before(face, room):
                    band = RoomSide(ends, face, faces_in=True).band(room.floor_m, top)
                    yield shapely.buffer(band, _MARGIN_M, join_style="mitre")


def _before(face: PlaneFace, room: Room) -> Iterator[FloatArray]:
    """The stretches (2, 2) of a wall in the plan before which a room lies."""
    left, _, right, _ = face.area.bounds
    v = (room.floor_m + (room.height_m or 0.0) / 2 - face.frame.origin[2]) / face.frame.up[2]
    ends = face.frame.place(np.array([[left, v], [right, v]]))[:, :2]
    line = shapely.LineString(ends + _BEFORE_M * face.frame.normal[:2])
    for part in shapely.get_parts(shapely.intersection(line, room.outline)).tolist():
        if part.geom_type == "LineString" and not part.is_empty:
            yield shapely.get_coordinates(part) - _BEFORE_M * face.frame.normal[:2]


def _on(frame: Frame, xy: Any) -> Any:
    """Points (n, 3) of a level plane above places (n, 2) of the plan."""
    rise = -((xy - frame.origin[:2]) @ frame.normal[:2]) / frame.normal[2]
    return np.column_stack([xy, frame.origin[2] + rise])


def trimmed_bodies(bodies: Sequence[Body], faces: Sequence[PlaneFace]) -> tuple[Body, ...]:
    """Return walls without what is no longer inferred of either face; slabs go on below walls."""
    by_number = {face.number: face for face in faces}
    found = []
    for body in bodies:
        if body.kind == "wall":
            one, other = (by_number[number] for number in body.surfaces)
            left = common(one.area, joined(other.laid_on(one.frame)))
            body = replace(body, inferred=common(body.inferred, left))
        found.append(body)
    return tuple(found)
