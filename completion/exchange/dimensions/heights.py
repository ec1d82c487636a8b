# SPDX-License-Identifier: MIT
"""Heights of rooms: from a floor up to the ceiling above it."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np
import shapely

from completion.exchange.building.elements import PlaneElement
from completion.exchange.building.storeys import Storey
from completion.exchange.dimensions.dimension import Dimension, between
from completion.uncertainty.joint_errors import JointErrors
from scenes.checks import FloatArray

_LEAST_M2 = 0.25  # of floor below ceiling, below which there is no height
_PER_SIDE = 12  # places along each side of what they share, at which a height may be taken
_APART_M = 0.3  # from floor to ceiling at least


def room_heights(storey: Storey, errors: JointErrors) -> tuple[Dimension, ...]:
    """Return the height of each ceiling above the floor below it, with no floor or ceiling in between.

    It is taken upright, near the middle of what both share, where both were measured if there is such a
    place. The greatest come first.
    """
    floors, ceilings = ([face.element for face in some] for some in (storey.floors, storey.ceilings))
    level = {one.number: plan_area(one) for one in (*floors, *ceilings)}
    found = []
    for floor, ceiling in product(floors, ceilings):
        shared = level[floor.number].intersection(level[ceiling.number])
        if shared.area < _LEAST_M2:
            continue
        others = [one for one in (*floors, *ceilings) if one not in (floor, ceiling)]
        ends = _ends(floor, ceiling, shared, [(one, level[one.number]) for one in others])
        found += [] if ends is None else [between("room height", ends, (floor, ceiling), errors)]
    return tuple(sorted(found, key=lambda one: -one.value))


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


def _ends(
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
        heights = [level_at(one, place)[2] for one, area in others if area.contains(point)]
        if ends[1, 2] - ends[0, 2] < _APART_M or any(ends[0, 2] < h < ends[1, 2] for h in heights):
            continue
        cost = sum(plane.provenance(end) != 0 for plane, end in zip((floor, ceiling), ends, strict=True))
        if cost < least:
            best, least = ends, cost
    return best
