# SPDX-License-Identifier: MIT
"""Rooms: the plan of walls as closed outlines, each with its area, height and volume where they are known.

Storeys are found by level planes: what people stand on and what is above them, and the walls between these.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
import shapely

from completion.export.building import limits
from completion.export.building.bodies import Body
from completion.export.building.faces import (
    FaceFrame,
    PlaneFace,
    common,
    less,
    polygons,
    straighten_sides,
    union,
    wide,
)
from completion.export.building.model import BuildingModel
from completion.export.building.room_plans import RoomPlan
from scenes.checks import FloatArray, Value


@dataclass(frozen=True, slots=True, eq=False)
class Storey(Value):
    """A storey.

    Attributes
    ----------
    elevation_m : float
        Height of its lowest floor, world; of the lowest place of all where no floor was found.
    floors, ceilings : tuple of PlaneFace
        What was found of them; seen from above, and from below.
    walls : tuple of PlaneFace
        Upright planes from its floor to its ceiling, and the faces of its walls that were seen on both sides.
    """

    elevation_m: float
    floors: tuple[PlaneFace, ...]
    ceilings: tuple[PlaneFace, ...]
    walls: tuple[PlaneFace, ...]

    def with_faces(self, faces: Mapping[int, PlaneFace]) -> Storey:
        """Return the storey with other faces of the same numbers."""
        floors, ceilings, walls = (
            tuple(faces[face.number] for face in faces_of_kind)
            for faces_of_kind in (self.floors, self.ceilings, self.walls)
        )
        return replace(self, floors=floors, ceilings=ceilings, walls=walls)

    @property
    def ceiling_m(self) -> float | None:
        """Height of its largest ceiling in the middle; None where none was found."""
        if not self.ceilings:
            return None
        return level_of(max(self.ceilings, key=lambda face: (face.area.area, -face.number)))


def level_of(face: PlaneFace) -> float:
    """Height of a level face in the middle of its area."""
    middle = shapely.get_coordinates(shapely.centroid(face.area))
    return float(face.frame.place(middle)[0, 2])


def find_storeys(faces: Sequence[PlaneFace], bodies: Sequence[Body]) -> tuple[Storey, ...]:
    """Return the storeys from the lowest up; one at least, where there are faces."""
    floors = sorted((face for face in faces if _is_floor(face, faces)), key=level_of)
    groups: list[list[PlaneFace]] = []
    for floor in floors:
        if groups and level_of(floor) < level_of(groups[-1][0]) + limits.HEADROOM_M:
            groups[-1].append(floor)
        else:
            groups.append([floor])
    if not faces:
        return ()
    lowest = min(face.lowest_m for face in faces)
    levels = [level_of(group[0]) for group in groups] or [lowest]
    storeys = []
    for k, level in enumerate(levels):
        above = levels[k + 1] if k + 1 < len(levels) else np.inf
        own_floors = tuple(groups[k]) if groups else ()
        ceilings = tuple(face for face in faces if _is_ceiling(face, level, above, has_floor=bool(groups)))
        storey = Storey(level, own_floors, ceilings, ())
        walls = tuple(face for face in faces if _is_wall(face, storey, above, bodies))
        storeys.append(Storey(level, own_floors, ceilings, walls))
    return tuple(storeys)


def storey_at(storeys: Sequence[Storey], height_m: float) -> int:
    """Which storey a height belongs to: the highest that begins below it, or the first."""
    return max(0, *(k for k, storey in enumerate(storeys) if storey.elevation_m <= height_m), 0)


def bands(
    storeys: Sequence[Storey], area: Any, frame: FaceFrame, begin_m: float
) -> Sequence[tuple[int, Any]]:
    """Return an upright area by storeys: the number of each, and its part, coordinates of the frame.

    It is cut at the floors of storeys in which it is at least half a metre high. What is so in none of them
    is one part, of the storey at the height `begin_m`.
    """
    heights = frame.place(shapely.get_coordinates(area))[:, 2]
    tops = [*(storey.elevation_m for storey in storeys[1:]), np.inf]
    numbers = [
        k
        for k, (storey, top) in enumerate(zip(storeys, tops, strict=True))
        if min(top, heights.max()) - max(storey.elevation_m, heights.min()) >= limits.LEAST_PART_M
    ]
    if len(numbers) < 2:
        return [(numbers[0] if numbers else storey_at(storeys, begin_m), area)]
    left, low, right, high = area.bounds
    cuts = [(storeys[k].elevation_m - frame.origin[2]) / frame.up[2] for k in numbers[1:]]
    edges = zip((low - 1, *cuts), (*cuts, high + 1), strict=True)
    return [
        (k, common(area, shapely.box(left - 1, bottom, right + 1, top)))
        for k, (bottom, top) in zip(numbers, edges, strict=True)
    ]


def _is_floor(face: PlaneFace, faces: Sequence[PlaneFace]) -> bool:
    """Whether people may stand on a face: large, and no other one lies close below.

    What does not enclose the room, as the floor of a house of several rooms, is no floor where anything large
    was measured further down, unless that is another storey: seats and tables are level, too.
    """
    if face.frame.normal[2] < 0 or not face.is_level or face.area.area < limits.LEAST_ROOM_M2:
        return False
    if face.element.kind == "floor":
        return True
    outline, level = face.plan(), level_of(face)
    below = [
        other
        for other in faces
        if other.is_level
        and other.frame.normal[2] > 0
        and level - limits.HEADROOM_M < level_of(other) < level - limits.SAME_STOREY_M
    ]
    if any(common(outline, other.plan()).area >= limits.MAJORITY * outline.area for other in below):
        return False
    lower = [
        face
        for face in faces
        if face.lowest_m < level - limits.SAME_STOREY_M and face.measured.area >= limits.LEAST_LEVEL_M2
    ]
    storey_below = any(
        face.is_level
        and face.frame.normal[2] > 0
        and level_of(face) <= level - limits.HEADROOM_M
        and face.area.area >= limits.LEAST_ROOM_M2
        for face in lower
    )
    return storey_below or not lower


def _is_ceiling(face: PlaneFace, level: float, above: float, *, has_floor: bool) -> bool:
    """Whether a face hangs over people of a storey."""
    if face.frame.normal[2] > 0 or not face.is_level or face.area.area < limits.LEAST_ROOM_M2:
        return False
    if not has_floor:
        return face.element.kind == "ceiling"
    return level + limits.HEADROOM_M <= level_of(face) < above


def _is_wall(face: PlaneFace, storey: Storey, above: float, bodies: Sequence[Body]) -> bool:
    """Whether a face is a wall of a storey: seen from both sides, or from the floor to the ceiling."""
    lowest, highest, floor_m = face.lowest_m, face.highest_m, storey.elevation_m
    if not face.is_upright or highest < floor_m + limits.LEAST_ROOM_M or lowest > above - limits.LEAST_ROOM_M:
        return False
    if any(face.number in body.surfaces for body in bodies if body.kind == "wall"):
        return True
    top = storey.ceiling_m
    high = floor_m + limits.HEADROOM_M if top is None else top - limits.LEAST_ROOM_M
    is_whole = highest >= high and lowest <= floor_m + limits.LEAST_ROOM_M
    return is_whole or face.element.kind == "wall"


@dataclass(frozen=True, slots=True, eq=False)
class RoomSide(Value):
    """A side of a room's outline, (2, 2) world x and y, and the wall on whose line it is."""

    ends: FloatArray
    face: PlaneFace
    faces_in: bool

    @property
    def length_m(self) -> float:
        """Its length."""
        return float(np.linalg.norm(self.ends[1] - self.ends[0]))

    def band(self, bottom_m: float, top_m: float) -> Any:
        """What of the wall is between two heights along this side, coordinates of its frame."""
        frame = self.face.frame
        u = frame.flat(np.column_stack([self.ends, np.full(2, bottom_m)]))[:, 0]
        low, high = ((height - frame.origin[2]) / frame.up[2] for height in (bottom_m, top_m))
        return shapely.box(float(u.min()), low, float(u.max()), high)


@dataclass(frozen=True, slots=True, eq=False)
class BuildingRoom(Value):
    """A room.

    Attributes
    ----------
    storey : int
        Which one, from 0.
    outline : shapely polygon
        World x and y, metres; of an open one that of its floor.
    sides : tuple of RoomSide
        Of its outline, where a wall is; none of an open room.
    surfaces : tuple of int
        The walls around it, then its floors and ceilings.
    floor_m : float
        Height of its floor, in the middle.
    height_m : float or None
        From floor to ceiling; None where no ceiling was found.
    volume_m3 : float or None
        None where the room is open, or its height is not known.
    measured_share : float
        Share of floor, ceiling and walls around it that was measured; openings count as neither.
    closed : bool
        Whether walls stand all around it.
    by_facets : bool
        Whether its volume is that within its facets, which close.
    volume_origin : str
        How the volume was found, or why there is none.
    """

    storey: int
    outline: Any
    sides: tuple[RoomSide, ...]
    surfaces: tuple[int, ...]
    floor_m: float
    height_m: float | None
    volume_m3: float | None
    measured_share: float
    closed: bool
    by_facets: bool
    volume_origin: str

    @property
    def area_m2(self) -> float:
        """Of its floor plan."""
        return float(self.outline.area)


def find_rooms(model: BuildingModel, storeys: Sequence[Storey]) -> tuple[BuildingRoom, ...]:
    """Return the rooms of all storeys, in each first those that are closed, largest first.

    Those of the layout are closed around which walls stand; floor beside them is an open room.
    """
    rooms: list[BuildingRoom] = []
    for number, storey in enumerate(storeys):
        closed = [
            _room(model, storey, number, outline, list(_sides(outline, plan, storey)))
            for plan in model.plans
            if storey_at(storeys, plan.floor_m + limits.HEADROOM_M / 2) == number
            for outline in _closed(plan, storey)
        ]
        closed.sort(key=lambda room: -room.area_m2)
        rooms += [*closed, *_open_rooms(storey, number, closed)]
    return tuple(rooms)


def _closed(plan: RoomPlan, storey: Storey) -> Iterator[Any]:
    """The outline of a room around which walls stand, and that has a floor."""
    floor = union(face.plan() for face in storey.floors)
    for outline in polygons(straighten_sides(plan.outline), limits.LEAST_ROOM_M2):
        has_floor = common(floor, outline).area >= limits.MAJORITY * outline.area
        is_wide = wide(outline, limits.LEAST_PART_M).area >= limits.LEAST_ROOM_M2
        if plan.enclosed >= limits.ENCLOSED and has_floor and is_wide:
            yield outline


def _sides(outline: Any, plan: RoomPlan, storey: Storey) -> Iterator[RoomSide]:
    """The sides of an outline that are on the line of a wall."""
    faces = {face.number: face for face in storey.walls}
    for begin, end in pairwise(shapely.get_coordinates(outline.exterior)):
        ends = np.array([begin, end])
        off = np.abs(ends @ plan.lines[:, :2].T - plan.lines[:, 2]).max(axis=0)
        on = [faces[k] for k in plan.walls[off < limits.FINE_M].tolist() if k in faces]
        towards = {face.number: _is_inward(face, ends.mean(axis=0), outline) for face in on}
        if on:
            best = max(on, key=lambda face: (towards[face.number], -face.number))
            yield RoomSide(ends, best, towards[best.number])


def _is_inward(face: PlaneFace, place: FloatArray, cell: Any) -> bool:
    normal = face.frame.normal[:2] / np.linalg.norm(face.frame.normal[:2])
    return bool(shapely.contains_xy(cell, *(place + 1e-3 * normal)))


def _room(
    model: BuildingModel, storey: Storey, number: int, cell: Any, sides: Sequence[RoomSide]
) -> BuildingRoom:
    floors, ceilings = (_over(faces, cell) for faces in (storey.floors, storey.ceilings))
    roof = union(part for _, part in ceilings)
    has_roof = roof.area >= limits.MAJORITY * cell.area
    floor_m = _mean_height(floors)
    height = _mean_height(ceilings) - floor_m if has_roof else None
    walls = sorted({side.face.number for side in sides if side.faces_in})
    numbers = (*walls, *(face.number for face, _ in (*floors, *ceilings)))
    volume = cell.area * height if height is not None else None
    sentence = "area of the outline times the mean height between floor and ceiling"
    shut = shut_volume(model, numbers) if has_roof else None
    if shut is not None:
        volume, sentence = shut, "by its facets, which close"
    elif volume is not None:
        sentence += ", since its facets do not close"
    else:
        sentence = "no volume: a ceiling was not found over most of it"
    return BuildingRoom(
        storey=number,
        outline=cell,
        sides=tuple(sides),
        surfaces=numbers,
        floor_m=floor_m,
        height_m=height,
        volume_m3=volume,
        measured_share=_measured_share(storey, sides, (*floors, *ceilings)),
        closed=True,
        by_facets=shut is not None,
        volume_origin=sentence,
    )


def _over(faces: Sequence[PlaneFace], cell: Any) -> list[tuple[PlaneFace, Any]]:
    """Level faces that an outline has something in common with, and what."""
    parts = [(face, common(face.plan(), cell)) for face in faces]
    return [(face, part) for face, part in parts if not part.is_empty]


def _mean_height(parts: Sequence[tuple[PlaneFace, Any]]) -> float:
    """Mean height of level faces over parts of the plan, by area."""
    heights = [_height_at(face, shapely.get_coordinates(shapely.centroid(part))[0]) for face, part in parts]
    return float(np.average(heights, weights=[part.area for _, part in parts]))


def _height_at(face: PlaneFace, place: FloatArray) -> float:
    """Height of a level face at a place (2,) of the plan."""
    frame = face.frame
    off = frame.normal[:2] @ (place - frame.origin[:2])
    return float(frame.origin[2] - off / frame.normal[2])


def _measured_share(
    storey: Storey, sides: Sequence[RoomSide], level: Sequence[tuple[PlaneFace, Any]]
) -> float:
    """Share of what bounds a room that was measured, openings left out."""
    measured = whole = 0.0
    for face, part in level:
        seen = shapely.transform(face.measured, lambda uv, face=face: face.frame.place(uv)[:, :2])
        measured += common(union([seen]), part).area
        whole += part.area
    for side in sides:
        face, top = side.face, storey.ceiling_m
        band = side.band(storey.elevation_m, side.face.highest_m if top is None else top)
        open_area = union(shapely.Polygon(face.frame.flat(opening.points)) for opening in face.openings)
        wall = less(band, [open_area])
        measured += common(face.measured, wall).area
        whole += wall.area
    return float(measured / whole) if whole else 0.0


def _open_rooms(storey: Storey, number: int, closed: Sequence[BuildingRoom]) -> Iterator[BuildingRoom]:
    """Floor that walls do not stand all around."""
    floor = union(face.plan() for face in storey.floors)
    outlines = [shapely.buffer(room.outline, limits.SAME_STOREY_M, join_style="mitre") for room in closed]
    for part in polygons(wide(less(floor, outlines), limits.LEAST_PART_M), limits.LEAST_ROOM_M2):
        floors, ceilings = (_over(faces, part) for faces in (storey.floors, storey.ceilings))
        roof = union(ceiling_area for _, ceiling_area in ceilings)
        floor_m = _mean_height(floors)
        height = _mean_height(ceilings) - floor_m if roof.area >= limits.MAJORITY * part.area else None
        yield BuildingRoom(
            storey=number,
            outline=part,
            sides=(),
            surfaces=tuple(face.number for face, _ in (*floors, *ceilings)),
            floor_m=floor_m,
            height_m=height,
            volume_m3=None,
            measured_share=_measured_share(storey, (), (*floors, *ceilings)),
            closed=False,
            by_facets=False,
            volume_origin="no volume: walls were not found all around it",
        )


def shut_volume(model: BuildingModel, numbers: Sequence[int]) -> float | None:
    """Volume that the facets of some surfaces enclose, cubic metres; None where they do not close."""
    faces = model.faces[np.isin(model.surface, numbers)]
    edges = np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2)
    there = {(a, b) for a, b in edges.tolist()}
    if not len(faces) or len(there) != len(edges) or any((b, a) not in there for a, b in there):
        return None
    corners = model.vertices[faces] - model.vertices[faces[0, 0]]
    return abs(float(np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum()) / 6)
