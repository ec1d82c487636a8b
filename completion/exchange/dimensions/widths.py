# SPDX-License-Identifier: MIT
"""Widths of rooms between opposite walls, by a plan."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np
import shapely

from completion.exchange.building.building_model import REST
from completion.exchange.building.cut import CutLine, Plan, plan_of
from completion.exchange.building.elements import PlaneElement
from completion.exchange.building.parts import BuildingParts
from completion.exchange.building.storeys import Storey
from completion.exchange.dimensions.dimension import Dimension, between
from completion.uncertainty.joint_errors import JointErrors
from scenes.checks import FloatArray

_PARALLEL = float(np.cos(np.radians(5.0)))  # how far walls may be from parallel and have a width between them
_HEADROOM_M = 1.8  # above a floor, up to which a surface reaches that may part what is before and behind it
_LEAST_M = 0.3  # of a width, and of the stretch along which two walls face each other
_PLACES = np.linspace(0.1, 0.9, 17)[np.argsort(np.abs(np.linspace(0.1, 0.9, 17) - 0.5), kind="stable")]
_AT_WALL_M = 0.02  # from its ends, where what a dimension meets is its own wall


def widths_of(building: BuildingParts) -> tuple[Dimension, ...]:
    """Return the widths of all storeys, each by a plan 1.1 m above its floor; see `room_widths`."""
    found: list[Dimension] = []
    model = building.model
    for number, storey in enumerate(building.storeys):
        plan = plan_of(model if number == 0 else replace(model, floor_m=storey.elevation_m))
        rooms = [room.outline for room in building.rooms if room.storey == number and room.closed]
        walls = sorted((face.element for face in storey.walls), key=lambda wall: wall.number)
        found += room_widths(walls, plan, model.errors, rooms, barriers=_barriers(building, storey))
    return tuple(found)


def room_widths(
    walls: Sequence[PlaneElement],
    plan: Plan,
    errors: JointErrors,
    rooms: Sequence[shapely.Geometry] = (),
    *,
    barriers: Collection[int] = (),
) -> tuple[Dimension, ...]:
    """Return the widths between walls that face each other in a plan, with nothing of a wall between them.

    They are taken square to the first wall, where that is measured on both sides if there is such a place,
    and else as near the middle as walls let. One whose middle lies in one of the outlines of `rooms` ends in
    that room, and does not go through its door. None goes through a wall, or a surface of the numbers
    `barriers`. The greatest come first.
    """
    own = {wall.number: [line for line in plan.lines if line.surface == wall.number] for wall in walls}
    closed = {*own, *barriers}
    solid = [
        shapely.LineString(line.points[:, :2])
        for line in plan.lines
        if line.surface in closed or line.kind == "wall"
    ]
    rest = [
        shapely.LineString(line.points[:, :2])
        for line in plan.lines
        if line.surface not in closed and line.kind not in ("wall", REST)
    ]
    borders = shapely.union_all([room.exterior for room in rooms])
    obstacles = shapely.union_all([*solid, borders]), shapely.union_all(rest)
    found = []
    for one, other in combinations([wall for wall in walls if own[wall.number]], 2):
        facing = (
            float((other.point - one.point) @ one.normal)
            > 0
            > float((other.point - one.point) @ other.normal)
        )
        if facing and float(one.normal @ other.normal) <= -_PARALLEL:
            ends = _ends((one, other), (own[one.number], own[other.number]), plan.height_m, obstacles)
            found += [] if ends is None else [between("room width", ends, (one, other), errors)]
    return tuple(sorted(found, key=lambda dimension: -dimension.value))


def _barriers(building: BuildingParts, storey: Storey) -> set[int]:
    """Numbers of the upright surfaces that may part a storey: those as high as people need."""
    least = storey.elevation_m + _HEADROOM_M
    return {face.number for face in building.faces if face.is_upright and face.highest_m >= least}


def _ends(
    walls: tuple[PlaneElement, PlaneElement],
    lines: tuple[Sequence[CutLine], Sequence[CutLine]],
    height_m: float,
    obstacles: tuple[shapely.Geometry, shapely.Geometry],
) -> FloatArray | None:
    """Where (2, 3) a width is taken; None where walls do not face each other, or a wall stands between."""
    normal = walls[0].normal
    square = np.array([*normal[:2], 0.0]) / np.hypot(*normal[:2])
    along = np.array([-square[1], square[0], 0.0])
    reach = [np.concatenate([line.points @ along for line in some]) for some in lines]
    low, high = max(r.min() for r in reach), min(r.max() for r in reach)
    if high - low < _LEAST_M:
        return None
    best, least = None, (3, 3)
    for share in _PLACES:
        start = low + share * (high - low)
        ends = np.array([_meeting(wall, start * along, square, height_m) for wall in walls])
        value = float((ends[1] - ends[0]) @ square)
        states = tuple(_state(some, start, along) for some in lines)
        inner = ends[:, :2] + np.array([[_AT_WALL_M], [-_AT_WALL_M]]) * square[:2]
        sight = shapely.LineString(inner)
        if value < _LEAST_M or None in states or sight.intersects(obstacles[0]):
            continue
        cost = (sum(not state for state in states), int(sight.intersects(obstacles[1])))
        if cost < least:
            least, best = cost, ends
    return best


def _meeting(wall: PlaneElement, through: FloatArray, square: FloatArray, height_m: float) -> FloatArray:
    """Where the level line along `square` (3,) through a place (3,) at a height meets a wall."""
    place = np.array([through[0], through[1], height_m])
    return np.asarray(place + (wall.point - place) @ wall.normal / (square @ wall.normal) * square)


def _state(lines: Sequence[CutLine], start: float, along: FloatArray) -> bool | None:
    """Whether a wall was measured at a place along it; None where it is not there."""
    states = []
    for line in lines:
        reach = line.points @ along
        if reach.min() <= start <= reach.max():
            states.append(line.is_measured)
    return all(states) if states else None
