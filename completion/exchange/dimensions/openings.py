# SPDX-License-Identifier: MIT
"""Sizes of openings: how wide and how high they are within their wall."""

from __future__ import annotations

import numpy as np

from completion.exchange.building.building_model import BuildingModel, OpeningOutline
from completion.exchange.building.elements import PlaneElement
from completion.exchange.building.parts import BuildingParts
from completion.exchange.dimensions.dimension import Dimension, Kind, Support, half_interval
from scenes.checks import FloatArray

_LEAST_M = 0.2  # of an opening's width and height
_OF_SIDES = ("sd_m", "inwards_m", "outwards_m")
_SAME_SIDE = 0.05  # of the extent, within which short sides are parts of the longest one there
_SQUARE = float(np.cos(np.radians(20.0)))  # of a side, to the direction that it ends an opening in


def opening_sizes(building: BuildingParts) -> tuple[Dimension, ...]:
    """Return width and height of each opening in a wall, from side to side where both are straight.

    Of those that are 0.2 m wide and high at least: smaller ones are gaps in what was measured.

    A size is taken between the two longest sides that end the opening in its direction. An opening that has
    not two such sides, as a round one, has its extent, and the interval of its worst side on either end. A
    side that is hidden may be anywhere between where beams went through and where the wall was measured.
    """
    model, found = building.model, []
    within = [
        (face.element, one)
        for face in building.faces
        if face.is_upright
        for one in face.openings
        if min(one.width_m, one.height_m) >= _LEAST_M
    ]
    for wall, one in within:
        level = np.cross([0.0, 0.0, 1.0], wall.normal)
        level /= np.linalg.norm(level)
        found.append(_size("opening width", one, wall, level, model))
        found.append(_size("opening height", one, wall, np.cross(wall.normal, level), model))
    return tuple(found)


def _size(
    kind: Kind, opening: OpeningOutline, wall: PlaneElement, along: FloatArray, model: BuildingModel
) -> Dimension:
    """The extent of an opening along a direction (3,) in its wall."""
    points, following = opening.points, np.roll(opening.points, -1, axis=0)
    side, middle = following - points, (points + following) / 2
    length = np.linalg.norm(side, axis=1)
    is_end = np.abs(side @ along) <= np.sqrt(1 - _SQUARE**2) * length
    centre = middle[int(np.argmax(length))] if not len(points) else points.mean(axis=0)
    at, reach = middle @ along, points @ along
    ends, sides = [], []
    for sign in (-1.0, 1.0):
        beyond = np.flatnonzero(is_end & (sign * (at - centre @ along) > 0))
        if len(beyond):
            main = at[beyond[int(np.argmax(length[beyond]))]]
            beyond = beyond[np.abs(at[beyond] - main) <= _SAME_SIDE * np.ptp(reach)]
            ends.append(float(length[beyond] @ at[beyond] / length[beyond].sum()))
        else:
            ends.append(float(reach.max() if sign > 0 else reach.min()))
            beyond = np.arange(len(points))
        some = [opening.sides[k] for k in beyond.tolist()]
        sides.append({name: max(one[name] for one in some) for name in _OF_SIDES})
        sides[-1]["measured_share"] = min(one["measured_share"] for one in some)
    places = centre + (np.array(ends) - centre @ along)[:, None] * along
    supports = tuple(Support(wall, place, 0.0) for place in places)
    sd = float(np.hypot(sides[0]["sd_m"], sides[1]["sd_m"]))
    half = half_interval(supports, model.errors, more_sd=sd)
    value = ends[1] - ends[0]
    return Dimension(
        kind=kind,
        value=value,
        low=max(value - half - sum(one["inwards_m"] for one in sides), 0.0),
        high=value + half + sum(one["outwards_m"] for one in sides),
        supports=supports,
        ends=places,
        measured_share=float(np.mean([one["measured_share"] for one in sides])),
        existence=1.0,
    )
