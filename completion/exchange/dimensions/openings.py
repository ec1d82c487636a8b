# SPDX-License-Identifier: MIT
"""Sizes of openings: how wide and how high they are within their wall."""

from __future__ import annotations

import numpy as np

from completion.exchange.building.building_model import BuildingModel, OpeningOutline
from completion.exchange.building.elements import PlaneElement
from completion.exchange.dimensions.dimension import Dimension, Kind, Support, half_interval
from scenes.checks import FloatArray

_SQUARE = float(np.cos(np.radians(20.0)))  # of a side, to the direction that it ends an opening in


def opening_sizes(model: BuildingModel) -> tuple[Dimension, ...]:
    """Return width and height of each opening in a wall, from side to side where both are straight.

    A size is taken between the two sides that end the opening in its direction. An opening that has not two
    such sides, as a round one, has its extent, and the interval of its worst side on either end. What is
    measured of it is the share that beams went through.
    """
    walls = {wall.number: wall for wall in model.walls}
    found = []
    for one in model.openings:
        wall = walls.get(one.surface)
        if wall is None:
            continue
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
    ends, sd = [], []
    for sign in (-1.0, 1.0):
        beyond = is_end & (sign * (at - centre @ along) > 0)
        if beyond.any():
            share = length[beyond] / length[beyond].sum()
            ends.append(float(share @ at[beyond]))
            sd.append(float(opening.side_sd_m[beyond].max()))
        else:
            ends.append(float(reach.max() if sign > 0 else reach.min()))
            sd.append(float(opening.side_sd_m.max()))
    places = centre + (np.array(ends) - centre @ along)[:, None] * along
    supports = tuple(Support(wall, place, 0.0) for place in places)
    return Dimension(
        kind=kind,
        value=ends[1] - ends[0],
        half=half_interval(supports, model.errors, more_sd=float(np.hypot(sd[0], sd[1]))),
        supports=supports,
        ends=places,
        measured_share=opening.seen_share,
        existence=1.0,
    )
