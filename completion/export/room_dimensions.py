# SPDX-License-Identifier: MIT
"""Dimensions of rooms: widths, heights, areas, volumes, thickness of walls and slabs, sizes of openings."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, pairwise, product

import numpy as np
import shapely

from completion.export.building import limits
from completion.export.building.cut import CutLine, LevelCut, plan_of
from completion.export.building.model import REST, BuildingModel, OpeningOutline, PlaneElement
from completion.export.building.parts import BuildingParts
from completion.export.building.rooms import BuildingRoom, Storey
from completion.export.dimension import Dimension, Kind, Support, half_interval, length_between
from completion.uncertainty.joint_errors import JointErrors
from scenes.checks import FloatArray

_KINDS: dict[str, Kind] = {"wall": "wall thickness", "slab": "slab thickness"}
_SHARES = (0.5, 0.25, 0.75)  # of a side, where it is asked whether its wall is there


def room_sizes(building: BuildingParts) -> tuple[Dimension, ...]:
    """Return area and volume of each closed room.

    An area changes with each wall by its length in the plan, a volume with each of its faces by its area.
    """
    planes = {plane.number: plane for plane in building.model.planes}
    sizes = []
    for room in building.rooms:
        if not room.closed:
            continue
        sides = [support for support in _sides(room, planes) if support is not None]
        area = _size(room, sides, building.model.errors)
        sizes.append(area)
        level = [planes[k] for k in room.surfaces if k in planes and planes[k].kind in ("floor", "ceiling")]
        if room.volume_m3 is not None and room.height_m is not None and level:
            sizes.append(_volume(room, sides, level, building.model.errors))
    return tuple(sizes)


@dataclass(frozen=True, slots=True, eq=False)
class RoomStamp:
    """What a drawing writes into a closed room: its name as in IFC, its area, its height where known."""

    name: str
    area: Dimension
    height_m: float | None


def room_stamps(building: BuildingParts) -> tuple[RoomStamp, ...]:
    """Return the stamps of closed rooms."""
    areas = iter(size for size in room_sizes(building) if size.kind == "room area")
    stamps, counts = [], Counter[int]()
    for room in building.rooms:
        counts[room.storey] += 1
        if room.closed:
            name = f"Room {room.storey}.{counts[room.storey]}"
            stamps.append(RoomStamp(name, next(areas), room.height_m))
    return tuple(stamps)


def told_area(size: Dimension) -> str:
    """Return an area as drawings show it, square metres, the interval, if known, rounded up."""
    half = ""
    if np.isfinite(size.half):
        half = f" \u00b1 {max(np.ceil(100 * size.half - 1e-9) / 100, 0.01):.2f}"
    return f"{size.value:.2f}{half} m\u00b2"


def thicknesses(building: BuildingParts) -> tuple[Dimension, ...]:
    """Return the thickness of each wall and slab that was seen from both sides, the greatest first."""
    planes = {plane.number: plane for plane in building.model.planes}
    dimensions = []
    for body in building.bodies:
        faces = planes[body.surfaces[0]], planes[body.surfaces[1]]
        through = -faces[0].normal
        reach = float((faces[1].point - body.place) @ faces[1].normal / (through @ faces[1].normal))
        ends = np.stack([body.place, body.place + reach * through])
        if reach > 0:
            dimensions.append(length_between(_KINDS[body.kind], ends, faces, building.model.errors))
    return tuple(sorted(dimensions, key=lambda dimension: -dimension.value))


def _sides(room: BuildingRoom, planes: dict[int, PlaneElement]) -> list[Support | None]:
    """For each side of a room's outline the wall that it is of, which changes the area by its length."""
    corners = shapely.get_coordinates(shapely.normalize(room.outline).exterior)
    walls = [planes[k] for k in room.surfaces if k in planes and planes[k].kind not in ("floor", "ceiling")]
    height = room.floor_m + (room.height_m or 2.0) / 2
    sides: list[Support | None] = []
    for start, end in pairwise(corners):
        length = float(np.linalg.norm(end - start))
        middle = np.array([*(start + end) / 2, height])
        wall = _wall_at(middle, (end - start) / max(length, 1e-12), walls)
        place = None if wall is None else _there(wall, start, end, height)
        sides.append(None if wall is None or place is None else Support(wall, place, length))
    return sides


def _wall_at(middle: FloatArray, along: FloatArray, walls: list[PlaneElement]) -> PlaneElement | None:
    """The wall through a place (3,) along a direction (2,) of the plan; None where there is none."""
    square = np.array([along[1], -along[0]])
    near = [
        (abs(float((middle - wall.point) @ wall.normal)), wall.number, wall)
        for wall in walls
        if abs(float(wall.normal[:2] @ square)) >= limits.PARALLEL
    ]
    best = min(near, key=lambda triple: triple[:2], default=None)
    return best[2] if best is not None and best[0] <= limits.THIN_M else None


def _there(wall: PlaneElement, start: FloatArray, end: FloatArray, height: float) -> FloatArray:
    """A place (3,) on a side of a wall, measured if there is one."""
    places = [np.array([*(start + share * (end - start)), height]) for share in _SHARES]
    return max(places, key=lambda place: (wall.provenance(place) == 0, wall.confidence(place)))


def _size(room: BuildingRoom, sides: list[Support], errors: JointErrors) -> Dimension:
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


def _volume(
    room: BuildingRoom, sides: list[Support], level: list[PlaneElement], errors: JointErrors
) -> Dimension:
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
    supports = [*(Support(side.element, side.place, side.weight * height) for side in sides), *above]
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
    return min((side.element.confidence(side.place) or 1.0 for side in sides), default=1.0)


def _middle(room: BuildingRoom) -> FloatArray:
    point = room.outline.representative_point()
    return np.array([point.x, point.y, room.floor_m + (room.height_m or 2.0) / 2])


_PLACES = np.linspace(0.1, 0.9, 17)[np.argsort(np.abs(np.linspace(0.1, 0.9, 17) - 0.5), kind="stable")]


def widths_of(building: BuildingParts) -> tuple[Dimension, ...]:
    """Return the widths of all storeys, each by a plan 1.1 m above its floor; see `room_widths`."""
    widths: list[Dimension] = []
    model = building.model
    for number, storey in enumerate(building.storeys):
        plan = plan_of(model if number == 0 else replace(model, floor_m=storey.elevation_m))
        rooms = [room.outline for room in building.rooms if room.storey == number and room.closed]
        walls = sorted((face.element for face in storey.walls), key=lambda wall: wall.number)
        widths += room_widths(walls, plan, model.errors, rooms, barriers=_barriers(building, storey))
    return tuple(widths)


def room_widths(
    walls: Sequence[PlaneElement],
    plan: LevelCut,
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
    entries = {wall.number: [line for line in plan.lines if line.surface == wall.number] for wall in walls}
    closed = {*entries, *barriers}
    solid = [
        shapely.LineString(line.points[:, :2])
        for line in plan.lines
        if line.surface in closed or line.kind == "wall"
    ]
    inferred_areas = [
        shapely.LineString(line.points[:, :2])
        for line in plan.lines
        if line.surface not in closed and line.kind not in ("wall", REST)
    ]
    borders = shapely.union_all([room.exterior for room in rooms])
    obstacles = shapely.union_all([*solid, borders]), shapely.union_all(inferred_areas)
    widths = []
    for first, second in combinations([wall for wall in walls if entries[wall.number]], 2):
        facing = (
            float((second.point - first.point) @ first.normal)
            > 0
            > float((second.point - first.point) @ second.normal)
        )
        if facing and float(first.normal @ second.normal) <= -limits.PARALLEL:
            ends = _ends(
                (first, second), (entries[first.number], entries[second.number]), plan.height_m, obstacles
            )
            widths += [] if ends is None else [length_between("room width", ends, (first, second), errors)]
    return tuple(sorted(widths, key=lambda dimension: -dimension.value))


def _barriers(building: BuildingParts, storey: Storey) -> set[int]:
    """Numbers of the upright surfaces that may part a storey: those as high as people need."""
    least = storey.elevation_m + limits.HEADROOM_M
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
    reach = [np.concatenate([line.points @ along for line in cut_line]) for cut_line in lines]
    low, high = max(r.min() for r in reach), min(r.max() for r in reach)
    if high - low < limits.LEAST_ROOM_M:
        return None
    best, least = None, (3, 3)
    for share in _PLACES:
        start = low + share * (high - low)
        ends = np.array([_wall_crossing(wall, start * along, square, height_m) for wall in walls])
        value = float((ends[1] - ends[0]) @ square)
        states = tuple(_state(line, start, along) for line in lines)
        inner = ends[:, :2] + np.array([[limits.THIN_M], [-limits.THIN_M]]) * square[:2]
        sight = shapely.LineString(inner)
        if value < limits.LEAST_ROOM_M or None in states or sight.intersects(obstacles[0]):
            continue
        cost = (sum(not state for state in states), int(sight.intersects(obstacles[1])))
        if cost < least:
            least, best = cost, ends
    return best


def _wall_crossing(
    wall: PlaneElement, through: FloatArray, square: FloatArray, height_m: float
) -> FloatArray:
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


_PER_SIDE = 12  # places along each side of what they share, at which a height may be taken


def room_heights(storey: Storey, errors: JointErrors) -> tuple[Dimension, ...]:
    """Return the height of each ceiling above the floor below it, with no floor or ceiling in between.

    It is taken upright, near the middle of what both share, where both were measured if there is such a
    place. The greatest come first.
    """
    floors, ceilings = ([face.element for face in faces] for faces in (storey.floors, storey.ceilings))
    level = {element.number: plan_area(element) for element in (*floors, *ceilings)}
    heights = []
    for floor, ceiling in product(floors, ceilings):
        shared = level[floor.number].intersection(level[ceiling.number])
        if shared.area < limits.LEAST_LEVEL_M2:
            continue
        others = [element for element in (*floors, *ceilings) if element not in (floor, ceiling)]
        ends = _ends_of_height(
            floor, ceiling, shared, [(element, level[element.number]) for element in others]
        )
        heights += [] if ends is None else [length_between("room height", ends, (floor, ceiling), errors)]
    return tuple(sorted(heights, key=lambda dimension: -dimension.value))


def plan_area(plane: PlaneElement) -> shapely.Geometry:
    """What of a plan a plane lies over, holes left out."""
    outer = shapely.union_all([_area(ring) for ring in plane.rings[: plane.n_outer]])
    return outer.difference(shapely.union_all([_area(ring) for ring in plane.rings[plane.n_outer :]]))


def level_at(plane: PlaneElement, place: FloatArray) -> FloatArray:
    """Where (3,) a plane is above or below a place (2,) of the plan."""
    rise = (plane.point[:2] - place) @ plane.normal[:2] / plane.normal[2]
    return np.array([*place, plane.point[2] + rise])


def _area(ring: FloatArray) -> shapely.Geometry:
    return shapely.make_valid(shapely.Polygon(ring[:, :2])) if len(ring) >= 3 else shapely.Polygon()


def _ends_of_height(
    floor: PlaneElement,
    ceiling: PlaneElement,
    shared: shapely.Geometry,
    others: Sequence[tuple[PlaneElement, shapely.Geometry]],
) -> FloatArray | None:
    """Where (2, 3) a height is taken; None where the ceiling is not above, or something is in between."""
    low_x, low_y, high_x, high_y = shared.bounds
    share = (np.arange(_PER_SIDE) + 0.5) / _PER_SIDE
    places = np.stack(
        np.meshgrid(low_x + share * (high_x - low_x), low_y + share * (high_y - low_y)), axis=-1
    )
    places = np.concatenate([[[shared.centroid.x, shared.centroid.y]], places.reshape(-1, 2)])
    middle = np.array([shared.centroid.x, shared.centroid.y])
    near = np.argsort(np.linalg.norm(places - middle, axis=1), kind="stable")
    best, least = None, 3
    for place in places[near]:
        point = shapely.Point(place)
        if not shared.contains(point):
            continue
        ends = np.array([level_at(plane, place) for plane in (floor, ceiling)])
        heights = [level_at(element, place)[2] for element, area in others if area.contains(point)]
        if ends[1, 2] - ends[0, 2] < limits.LEAST_ROOM_M or any(ends[0, 2] < h < ends[1, 2] for h in heights):
            continue
        cost = sum(plane.provenance(end) != 0 for plane, end in zip((floor, ceiling), ends, strict=True))
        if cost < least:
            best, least = ends, cost
    return best


_OF_SIDES = ("sd_m", "inwards_m", "outwards_m")


def opening_sizes(building: BuildingParts) -> tuple[Dimension, ...]:
    """Return width and height of each opening in a wall, from side to side where both are straight.

    Of those that are 0.2 m wide and high at least: smaller ones are gaps in what was measured. One without an
    outline has no size.

    A size is taken between the two longest sides that end the opening in its direction. An opening that has
    not two such sides, as a round one, has its extent, and the interval of its worst side on either end. A
    side that is hidden may be anywhere between where beams went through and where the wall was measured.
    """
    model, sizes = building.model, []
    within = [
        (face.element, opening)
        for face in building.faces
        if face.is_upright
        for opening in face.openings
        if len(opening.points) and min(opening.width_m, opening.height_m) >= limits.LEAST_OPENING_M
    ]
    for wall, outline in within:
        level = np.cross([0.0, 0.0, 1.0], wall.normal)
        level /= np.linalg.norm(level)
        sizes.append(_opening_size("opening width", outline, wall, level, model))
        sizes.append(_opening_size("opening height", outline, wall, np.cross(wall.normal, level), model))
    return tuple(sizes)


def _opening_size(
    kind: Kind, opening: OpeningOutline, wall: PlaneElement, along: FloatArray, model: BuildingModel
) -> Dimension:
    """The extent of an opening along a direction (3,) in its wall."""
    points, following = opening.points, np.roll(opening.points, -1, axis=0)
    side, middle = following - points, (points + following) / 2
    length = np.linalg.norm(side, axis=1)
    is_end = np.abs(side @ along) <= np.sqrt(1 - limits.SQUARE**2) * length
    centre = points.mean(axis=0)
    at, reach = middle @ along, points @ along
    ends, sides = [], []
    for sign in (-1.0, 1.0):
        beyond = np.flatnonzero(is_end & (sign * (at - centre @ along) > 0))
        if len(beyond):
            main = at[beyond[int(np.argmax(length[beyond]))]]
            beyond = beyond[np.abs(at[beyond] - main) <= limits.SAME_SIDE * np.ptp(reach)]
            ends.append(float(length[beyond] @ at[beyond] / length[beyond].sum()))
        else:
            ends.append(float(reach.max() if sign > 0 else reach.min()))
            beyond = np.arange(len(points))
        tables = [opening.sides[k] for k in beyond.tolist()]
        sides.append({name: max(sides_seen[name] for sides_seen in tables) for name in _OF_SIDES})
        sides[-1]["measured_share"] = min(sides_seen["measured_share"] for sides_seen in tables)
    places = centre + (np.array(ends) - centre @ along)[:, None] * along
    supports = tuple(Support(wall, place, 0.0) for place in places)
    sd = float(np.hypot(sides[0]["sd_m"], sides[1]["sd_m"]))
    half = half_interval(supports, model.errors, more_sd=sd)
    value = ends[1] - ends[0]
    return Dimension(
        kind=kind,
        value=value,
        low=max(value - half - sum(side["inwards_m"] for side in sides), 0.0),
        high=value + half + sum(side["outwards_m"] for side in sides),
        supports=supports,
        ends=places,
        measured_share=float(np.mean([side["measured_share"] for side in sides])),
        existence=1.0,
    )
