# SPDX-License-Identifier: MIT
"""Parts: what people order of a building, of a building model: walls, slabs, rooms, columns, pipes.

Gaps: doorways and windows in the walls of closed rooms, and what of surfaces lies beyond the rooms.
Openings are found on single surfaces where these go on all around. In a building a doorway reaches down to a
floor that other rooms share, and windows to the ceiling; there the outline of the room says where the wall
should be, and beams say where it is not.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, pairwise
from typing import Any

import numpy as np
import shapely

from completion.export.building import limits
from completion.export.building.bodies import Body, ScanBeams, find_bodies
from completion.export.building.faces import (
    FaceFrame,
    PlaneFace,
    common,
    faces_of,
    less,
    polygons,
    union,
    wide,
)
from completion.export.building.model import BuildingModel, CylinderElement, OpeningOutline
from completion.export.building.rooms import BuildingRoom, RoomSide, Storey, find_rooms, find_storeys
from scenes.checks import FloatArray, Value

_LINES = (0.1, 0.9, 41)  # where lines run through it, as shares of its size


def with_gaps(
    faces: Sequence[PlaneFace], rooms: Sequence[BuildingRoom], beams: ScanBeams
) -> tuple[PlaneFace, ...]:
    """Return the faces with the doorways and windows that rooms' walls have beside those found before."""
    gaps: dict[int, list[OpeningOutline]] = {face.number: list(face.openings) for face in faces}
    for room in rooms:
        for side in room.sides:
            known = union(
                shapely.Polygon(side.face.frame.flat(outline.points)) for outline in gaps[side.face.number]
            )
            gaps[side.face.number] += _gaps(side, room, known, beams)
    return tuple(replace(face, openings=tuple(gaps[face.number])) for face in faces)


def _gaps(side: RoomSide, room: BuildingRoom, known: Any, beams: ScanBeams) -> Iterator[OpeningOutline]:
    """Openings along a side of a room."""
    if room.height_m is None or not side.faces_in:
        return
    face, frame = side.face, side.face.frame
    band = side.band(room.floor_m, room.floor_m + room.height_m)
    gap = wide(less(band, [face.area, known]), limits.LEAST_OPENING_M)
    for part in polygons(gap, limits.LEAST_OPENING_M2):
        if beams.free(part, frame, limits.NEAR_FACE_M).area < limits.MAJORITY * part.area:
            continue
        around = _rectangle(part)
        ring = around if part.area >= limits.RECTANGLE * around.area else part
        left, low, right, high = ring.bounds
        corners = shapely.get_coordinates(ring.exterior)
        points = frame.place(corners[:-1])
        kind = "door" if points[:, 2].min() < room.floor_m + limits.DOOR_M else "window"
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
    beside = shapely.distance(face.measured, places) <= limits.BESIDE_CELLS * cell
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
    faces: Sequence[PlaneFace], storeys: Sequence[Storey], rooms: Sequence[BuildingRoom]
) -> tuple[PlaneFace, ...]:
    """Return faces without what was inferred of them where no room is before it, if they bound one.

    Surfaces are continued through the walls and slabs that they meet, where nothing speaks against it. A
    building's walls, floors and ceilings are wanted as far as rooms show them. What was measured stays.
    """
    plane_face = []
    for face in faces:
        shown = list(_areas_in_rooms(face, storeys, rooms))
        if shown:
            inferred = common(face.inferred, union(shown))
            area = union((face.measured, inferred))
            plane_face.append(replace(face, inferred=inferred, area=area))
        else:
            plane_face.append(face)
    return tuple(plane_face)


def _areas_in_rooms(
    face: PlaneFace, storeys: Sequence[Storey], rooms: Sequence[BuildingRoom]
) -> Iterator[Any]:
    """Where rooms lie before a face; none of faces that are no wall, floor or ceiling."""
    for k, storey in enumerate(storeys):
        level = face in storey.floors or face in storey.ceilings
        for room in (room for room in rooms if room.storey == k):
            if level and face.number in room.surfaces:
                outline = shapely.buffer(room.outline, limits.FINE_M, join_style="mitre")
                yield union([shapely.transform(outline, lambda xy: face.frame.flat(_on(face.frame, xy)))])
            elif face in storey.walls and room.closed:
                top = face.highest_m if room.height_m is None else room.floor_m + room.height_m
                for ends in _before(face, room):
                    band = RoomSide(ends, face, faces_in=True).band(room.floor_m, top)
                    yield shapely.buffer(band, limits.FINE_M, join_style="mitre")


def _before(face: PlaneFace, room: BuildingRoom) -> Iterator[FloatArray]:
    """The stretches (2, 2) of a wall in the plan before which a room lies."""
    left, _, right, _ = face.area.bounds
    v = (room.floor_m + (room.height_m or 0.0) / 2 - face.frame.origin[2]) / face.frame.up[2]
    ends = face.frame.place(np.array([[left, v], [right, v]]))[:, :2]
    line = shapely.LineString(ends + limits.THIN_M * face.frame.normal[:2])
    for part in shapely.get_parts(shapely.intersection(line, room.outline)).tolist():
        if part.geom_type == "LineString" and not part.is_empty:
            yield shapely.get_coordinates(part) - limits.THIN_M * face.frame.normal[:2]


def _on(frame: FaceFrame, xy: Any) -> Any:
    """Points (n, 3) of a level plane above places (n, 2) of the plan."""
    rise = -((xy - frame.origin[:2]) @ frame.normal[:2]) / frame.normal[2]
    return np.column_stack([xy, frame.origin[2] + rise])


def trimmed_bodies(bodies: Sequence[Body], faces: Sequence[PlaneFace]) -> tuple[Body, ...]:
    """Return walls without what is no longer inferred of either face; slabs go on below walls."""
    by_number = {face.number: face for face in faces}
    trimmed = []
    for body in bodies:
        if body.kind == "wall":
            first, second = (by_number[number] for number in body.surfaces)
            left = common(first.area, union(second.laid_on(first.frame)))
            body = replace(body, inferred=common(body.inferred, left))
        trimmed.append(body)
    return tuple(trimmed)


@dataclass(frozen=True, slots=True, eq=False)
class BuildingColumn(Value):
    """A column.

    Attributes
    ----------
    surfaces : tuple of int
        Its cylinder, or its four planes.
    cylinder : CylinderElement or None
        None of one with four sides.
    footprint : shapely polygon
        Seen from above, world x and y.
    bottom_m, top_m : float
        Heights of its ends.
    sd_m : float
        Standard deviation of its radius, or of its thicker side.
    measured_share : float
        Of its sides.
    """

    surfaces: tuple[int, ...]
    cylinder: CylinderElement | None
    footprint: Any
    bottom_m: float
    top_m: float
    sd_m: float
    measured_share: float


def find_columns(
    cylinders: Sequence[CylinderElement], bodies: Sequence[Body], storeys: Sequence[Storey]
) -> tuple[BuildingColumn, ...]:
    """Return what stands on a floor: upright solid cylinders, and posts of four planes."""
    floors = [face for storey in storeys for face in storey.floors]
    levels = [storey.elevation_m for storey in storeys]
    columns = [_round(cylinder) for cylinder in cylinders if _is_upright(cylinder)]
    columns += [
        post
        for first, second in combinations([body for body in bodies if body.kind == "wall"], 2)
        if (post := _post(first, second)) is not None
    ]
    return tuple(
        column
        for column in columns
        if floors
        and column.top_m - column.bottom_m >= limits.STANDING_M
        and min(abs(column.bottom_m - level) for level in levels) < limits.FOOT_M
    )


def find_pipes(
    cylinders: Sequence[CylinderElement], columns: Sequence[BuildingColumn]
) -> tuple[CylinderElement, ...]:
    """Return the straight segments of pipes: slender solid cylinders that are no columns."""
    taken = {number for column in columns for number in column.surfaces}
    return tuple(
        cylinder
        for cylinder in cylinders
        if cylinder.number not in taken
        and cylinder.is_solid
        and cylinder.radius_m <= limits.PIPE_M
        and cylinder.length_m >= max(limits.PIPE_M, 2 * limits.SLENDER * cylinder.radius_m)
    )


def _is_upright(element: CylinderElement) -> bool:
    if not element.is_solid or element.radius_m < limits.NEAR_FACE_M or element.length_m <= 0:
        return False
    return element.inclination.is_upright


def _round(element: CylinderElement) -> BuildingColumn:
    middle = element.ends.mean(axis=0)[:2]
    return BuildingColumn(
        surfaces=(element.number,),
        cylinder=element,
        footprint=shapely.Point(middle).buffer(element.radius_m),
        bottom_m=float(element.ends[:, 2].min()),
        top_m=float(element.ends[:, 2].max()),
        sd_m=element.radius_sd_m,
        measured_share=element.measured_share,
    )


def _post(first: Body, second: Body) -> BuildingColumn | None:
    """The post whose four sides two bodies are, across each other; None where they are not."""
    prints = [_footprint(body) for body in (first, second)]
    shared = common(*prints)
    if shared.is_empty or shared.area < limits.SAME_POST * max(part.area for part in prints):
        return None
    if abs(float(first.frame.normal @ second.frame.normal)) > np.sin(np.radians(10.0)):
        return None
    heights = [body.frame.place(shapely.get_coordinates(body.area))[:, 2] for body in (first, second)]
    return BuildingColumn(
        surfaces=(*first.surfaces, *second.surfaces),
        cylinder=None,
        footprint=shared.convex_hull,
        bottom_m=float(min(z.min() for z in heights)),
        top_m=float(max(z.max() for z in heights)),
        sd_m=max(first.thickness_sd_m, second.thickness_sd_m),
        measured_share=float(np.mean([first.measured_share, second.measured_share])),
    )


def _footprint(body: Body) -> Any:
    """A body seen from above."""
    uv = shapely.get_coordinates(body.area)
    ends = body.frame.place(np.array([[uv[:, 0].min(), 0.0], [uv[:, 0].max(), 0.0]]))[:, :2]
    depth = body.thickness_m * body.frame.normal[:2]
    return union([shapely.Polygon([*ends, *(ends[::-1] - depth)])])


@dataclass(frozen=True, slots=True, eq=False)
class BuildingParts(Value):
    """What a building consists of.

    Attributes
    ----------
    model : BuildingModel
        Where it comes from.
    faces : tuple of PlaneFace
        Its planes as areas, of those that bound rooms what these show, with all openings.
    bodies : tuple of Body
        Walls and slabs that were seen from both sides.
    storeys : tuple of Storey
        From the lowest up; none where there is nothing.
    rooms : tuple of Room
        By storey.
    columns : tuple of Column
        What stands on a floor.
    pipes : tuple of CylinderElement
        Straight segments.
    """

    model: BuildingModel
    faces: tuple[PlaneFace, ...]
    bodies: tuple[Body, ...]
    storeys: tuple[Storey, ...]
    rooms: tuple[BuildingRoom, ...]
    columns: tuple[BuildingColumn, ...]
    pipes: tuple[CylinderElement, ...]


def building_parts(model: BuildingModel, beams: ScanBeams) -> BuildingParts:
    """Return the parts of a building; `beams` say where there can be no wall.

    Planes that are back to back are bodies where nothing speaks against it; level planes give storeys; the
    walls of a storey enclose rooms. What was inferred beyond the rooms is left out, and doorways and windows
    are found where a room's wall is not. Posts of four planes are no walls.
    """
    faces = faces_of(model)
    bodies = find_bodies(faces, beams)
    storeys = find_storeys(faces, bodies)
    columns = find_columns(model.cylinders, bodies, storeys)
    posts = {number for column in columns if column.cylinder is None for number in column.surfaces}
    rooms = find_rooms(model, storeys)
    shown = with_gaps(within_rooms(faces, storeys, rooms), rooms, beams)
    new = {face.number: face for face in shown}
    return BuildingParts(
        model=model,
        faces=shown,
        bodies=trimmed_bodies([body for body in bodies if not posts & {*body.surfaces}], shown),
        storeys=tuple(storey.with_faces(new) for storey in storeys),
        rooms=rooms,
        columns=columns,
        pipes=find_pipes(model.cylinders, columns),
    )
