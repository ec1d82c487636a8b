# SPDX-License-Identifier: MIT
"""Storeys: what people stand on and what is above them, by level planes; and the walls between these."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import shapely

from completion.export.building.bodies import Body
from completion.export.building.faces import Frame, PlaneFace, common

_HEADROOM_M = 1.8  # that people need above a floor, and from one storey to the next
_LEAST_M2 = 1.0  # of a floor, and of a ceiling
_LARGE_M2 = 0.25  # of what was measured below a level plane, which is no floor then
_COVERED = 0.5  # of a level plane that another one lies below, which makes it a table top
_SAME_M = 0.2  # by which floors of one storey may differ and be none on another
_LEAST_HIGH_M = 0.5  # of the part of a wall in a storey
_AT_MOST_M = 0.3  # between a wall and the floor or the ceiling that it ends at


@dataclass(frozen=True, slots=True, eq=False)
class Storey:
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
            tuple(faces[one.number] for one in own) for own in (self.floors, self.ceilings, self.walls)
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
        if groups and level_of(floor) < level_of(groups[-1][0]) + _HEADROOM_M:
            groups[-1].append(floor)
        else:
            groups.append([floor])
    if not faces:
        return ()
    lowest = min(face.lowest_m for face in faces)
    levels = [level_of(group[0]) for group in groups] or [lowest]
    found = []
    for k, level in enumerate(levels):
        above = levels[k + 1] if k + 1 < len(levels) else np.inf
        own_floors = tuple(groups[k]) if groups else ()
        ceilings = tuple(face for face in faces if _is_ceiling(face, level, above, has_floor=bool(groups)))
        storey = Storey(level, own_floors, ceilings, ())
        walls = tuple(face for face in faces if _is_wall(face, storey, above, bodies))
        found.append(Storey(level, own_floors, ceilings, walls))
    return tuple(found)


def storey_at(storeys: Sequence[Storey], height_m: float) -> int:
    """Which storey a height belongs to: the highest that begins below it, or the first."""
    return max(0, *(k for k, one in enumerate(storeys) if one.elevation_m <= height_m), 0)


def bands(storeys: Sequence[Storey], area: Any, frame: Frame, begin_m: float) -> Sequence[tuple[int, Any]]:
    """Return an upright area by storeys: the number of each, and its part, coordinates of the frame.

    It is cut at the floors of storeys in which it is at least half a metre high. What is so in none of them
    is one part, of the storey at the height `begin_m`.
    """
    heights = frame.place(shapely.get_coordinates(area))[:, 2]
    tops = [*(one.elevation_m for one in storeys[1:]), np.inf]
    own = [
        k
        for k, (one, top) in enumerate(zip(storeys, tops, strict=True))
        if min(top, heights.max()) - max(one.elevation_m, heights.min()) >= _LEAST_HIGH_M
    ]
    if len(own) < 2:
        return [(own[0] if own else storey_at(storeys, begin_m), area)]
    left, low, right, high = area.bounds
    cuts = [(storeys[k].elevation_m - frame.origin[2]) / frame.up[2] for k in own[1:]]
    edges = zip((low - 1, *cuts), (*cuts, high + 1), strict=True)
    return [
        (k, common(area, shapely.box(left - 1, bottom, right + 1, top)))
        for k, (bottom, top) in zip(own, edges, strict=True)
    ]


def _is_floor(face: PlaneFace, faces: Sequence[PlaneFace]) -> bool:
    """Whether people may stand on a face: large, and no other one lies close below.

    What does not enclose the room, as the floor of a house of several rooms, is no floor where anything large
    was measured further down, unless that is another storey: seats and tables are level, too.
    """
    if face.frame.normal[2] < 0 or not face.is_level or face.area.area < _LEAST_M2:
        return False
    if face.element.kind == "floor":
        return True
    own, level = face.plan(), level_of(face)
    below = [
        other
        for other in faces
        if other.is_level
        and other.frame.normal[2] > 0
        and level - _HEADROOM_M < level_of(other) < level - _SAME_M
    ]
    if any(common(own, other.plan()).area >= _COVERED * own.area for other in below):
        return False
    lower = [one for one in faces if one.lowest_m < level - _SAME_M and one.measured.area >= _LARGE_M2]
    storey_below = any(
        one.is_level
        and one.frame.normal[2] > 0
        and level_of(one) <= level - _HEADROOM_M
        and one.area.area >= _LEAST_M2
        for one in lower
    )
    return storey_below or not lower


def _is_ceiling(face: PlaneFace, level: float, above: float, *, has_floor: bool) -> bool:
    """Whether a face hangs over people of a storey."""
    if face.frame.normal[2] > 0 or not face.is_level or face.area.area < _LEAST_M2:
        return False
    if not has_floor:
        return face.element.kind == "ceiling"
    return level + _HEADROOM_M <= level_of(face) < above


def _is_wall(face: PlaneFace, storey: Storey, above: float, bodies: Sequence[Body]) -> bool:
    """Whether a face is a wall of a storey: seen from both sides, or from the floor to the ceiling."""
    lowest, highest, floor_m = face.lowest_m, face.highest_m, storey.elevation_m
    if not face.is_upright or highest < floor_m + _AT_MOST_M or lowest > above - _AT_MOST_M:
        return False
    if any(face.number in body.surfaces for body in bodies if body.kind == "wall"):
        return True
    top = storey.ceiling_m
    high = floor_m + _HEADROOM_M if top is None else top - _AT_MOST_M
    is_whole = highest >= high and lowest <= floor_m + _AT_MOST_M
    return is_whole or face.element.kind == "wall"
