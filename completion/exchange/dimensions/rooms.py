# SPDX-License-Identifier: MIT
"""Areas and volumes of closed rooms, thickness of walls and slabs."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import shapely

from completion.exchange.building.elements import PlaneElement
from completion.exchange.building.parts import BuildingParts
from completion.exchange.building.rooms import Room
from completion.exchange.dimensions.dimension import Dimension, Kind, Support, between, half_interval
from completion.uncertainty.joint_errors import JointErrors
from scenes.checks import FloatArray

_ON_LINE_M = 0.02  # between a side of an outline and the wall that it is of
_SAME = float(np.cos(np.radians(5.0)))
_KINDS: dict[str, Kind] = {"wall": "wall thickness", "slab": "slab thickness"}
_SHARES = (0.5, 0.25, 0.75)  # of a side, where it is asked whether its wall is there


def room_sizes(building: BuildingParts) -> tuple[Dimension, ...]:
    """Return area and volume of each closed room.

    An area changes with each wall by its length in the plan, a volume with each of its faces by its area.
    """
    planes = {plane.number: plane for plane in building.model.planes}
    found = []
    for room in building.rooms:
        if not room.closed:
            continue
        sides = [support for support in _sides(room, planes) if support is not None]
        area = _size(room, sides, building.model.errors)
        found.append(area)
        level = [planes[k] for k in room.surfaces if k in planes and planes[k].kind in ("floor", "ceiling")]
        if room.volume_m3 is not None and room.height_m is not None and level:
            found.append(_volume(room, sides, level, building.model.errors))
    return tuple(found)


def thicknesses(building: BuildingParts) -> tuple[Dimension, ...]:
    """Return the thickness of each wall and slab that was seen from both sides, the greatest first."""
    planes = {plane.number: plane for plane in building.model.planes}
    found = []
    for body in building.bodies:
        faces = planes[body.surfaces[0]], planes[body.surfaces[1]]
        through = -faces[0].normal
        reach = float((faces[1].point - body.place) @ faces[1].normal / (through @ faces[1].normal))
        ends = np.stack([body.place, body.place + reach * through])
        if reach > 0:
            found.append(between(_KINDS[body.kind], ends, faces, building.model.errors))
    return tuple(sorted(found, key=lambda one: -one.value))


def _sides(room: Room, planes: dict[int, PlaneElement]) -> list[Support | None]:
    """For each side of a room's outline the wall that it is of, which changes the area by its length."""
    corners = shapely.get_coordinates(shapely.normalize(room.outline).exterior)
    walls = [planes[k] for k in room.surfaces if k in planes and planes[k].kind not in ("floor", "ceiling")]
    height = room.floor_m + (room.height_m or 2.0) / 2
    found: list[Support | None] = []
    for start, end in pairwise(corners):
        length = float(np.linalg.norm(end - start))
        middle = np.array([*(start + end) / 2, height])
        wall = _wall_at(middle, (end - start) / max(length, 1e-12), walls)
        place = None if wall is None else _there(wall, start, end, height)
        found.append(None if wall is None or place is None else Support(wall, place, length))
    return found


def _wall_at(middle: FloatArray, along: FloatArray, walls: list[PlaneElement]) -> PlaneElement | None:
    """The wall through a place (3,) along a direction (2,) of the plan; None where there is none."""
    square = np.array([along[1], -along[0]])
    near = [
        (abs(float((middle - wall.point) @ wall.normal)), wall.number, wall)
        for wall in walls
        if abs(float(wall.normal[:2] @ square)) >= _SAME
    ]
    best = min(near, key=lambda one: one[:2], default=None)
    return best[2] if best is not None and best[0] <= _ON_LINE_M else None


def _there(wall: PlaneElement, start: FloatArray, end: FloatArray, height: float) -> FloatArray:
    """A place (3,) on a side of a wall, measured if there is one."""
    places = [np.array([*(start + share * (end - start)), height]) for share in _SHARES]
    return max(places, key=lambda place: (wall.provenance(place) == 0, wall.confidence(place)))


def _size(room: Room, sides: list[Support], errors: JointErrors) -> Dimension:
    half, middle = half_interval(sides, errors), _middle(room)
    return Dimension(
        kind="room area",
        value=room.area_m2,
        low=max(room.area_m2 - half, 0.0),
        high=room.area_m2 + half,
        supports=tuple(sides),
        ends=np.stack([middle, middle]),
        measured_share=room.measured_share,
        existence=_existence(sides),
        unit="m2",
        across_m=float(room.outline.length) / 2,
    )


def _volume(room: Room, sides: list[Support], level: list[PlaneElement], errors: JointErrors) -> Dimension:
    height, volume = float(room.height_m or 0.0), float(room.volume_m3 or 0.0)
    middle = _middle(room)
    share = {kind: sum(plane.kind == kind for plane in level) for kind in ("floor", "ceiling")}
    above = [
        Support(
            plane,
            np.array([*middle[:2], room.floor_m + (height if plane.kind == "ceiling" else 0.0)]),
            room.area_m2 / share[plane.kind],
        )
        for plane in level
    ]
    supports = [*(Support(one.element, one.place, one.weight * height) for one in sides), *above]
    half = half_interval(supports, errors)
    return Dimension(
        kind="room volume",
        value=volume,
        low=max(volume - half, 0.0),
        high=volume + half,
        supports=tuple(supports),
        ends=np.stack([middle, middle]),
        measured_share=room.measured_share,
        existence=_existence(sides),
        unit="m3",
        across_m=(float(room.outline.length) * height + 2 * room.area_m2) / 2,
    )


def _existence(sides: list[Support]) -> float:
    """Probability that the least certain side is there; that of an opening in it does not count."""
    return min((one.element.confidence(one.place) or 1.0 for one in sides), default=1.0)


def _middle(room: Room) -> FloatArray:
    point = room.outline.representative_point()
    return np.array([point.x, point.y, room.floor_m + (room.height_m or 2.0) / 2])
