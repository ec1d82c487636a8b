# SPDX-License-Identifier: MIT
"""Room surfaces: how probably a floor, a wall or a ceiling goes on to a hidden place, by what is around.

What tells is how far it is from what was measured, from how many ways it is supported by that, and for floors
and ceilings in which room of the plan it is. Distance in the surface's own size says next to nothing: what is
measured of a floor is a fragment of it.
"""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from completion.boundary.hidden_regions import HiddenRegions
from completion.evidence.chart_grid import ChartGrid
from completion.evidence.evidence import Evidence
from completion.extension.extent import Extent
from completion.room.limits import ASIDE_M
from completion.room.planes import Role
from completion.room.roles import Room
from scenes.checks import BoolArray, FloatArray

KNOWN_OF_LEVEL = (
    "distance to what was measured, metres",
    "share of the four ways in which something of it was measured",
    "improbability by its edges",
    "in a room where a scanner stands, by the plan",
    "share of four ways in which a wall ends that room",
    "a ceiling",
)
"""What the probability of a place on a floor or a ceiling depends on."""

LEVEL_WEIGHTS: FloatArray = np.array([0.99, -0.44, 2.44, -3.16, 1.06, 0.69, -1.81])
"""Constant, and weight of each of `KNOWN_OF_LEVEL`, in the logarithm of the odds (Cox 1958).

The most likely ones on sixty frames of flats, eight rooms, thirty frames of walks, five frames of each of
these together, and twelve real frames that other frames judge, each kind counted alike, rounded (`python -m
benchmarks run room-surfaces`).
"""

KNOWN_OF_WALL = (
    "log of the distance to what was measured, metres",
    "share of the four ways in which something of it was measured",
    "improbability by its edges",
    "sine of twice the angle by which it is turned from the plan's axes",
    "with a room before it, by the plan",
    "distance past its measured end along it, metres",
    "share of four ways in which a wall ends the room before it",
)
"""What the probability of a place on a wall depends on."""

WALL_WEIGHTS: FloatArray = np.array([0.97, -0.13, 1.68, -2.79, -1.82, 0.46, -0.88, 0.77])
"""Constant, and weight of each of `KNOWN_OF_WALL`, in the logarithm of the odds (Cox 1958).

The most likely ones on the same frames, each alone: with several together they are less likely on flats that
were left out of both.
"""

_AWAY_M = 0.05  # added to distances before their logarithm is taken


def supports(observed: BoolArray) -> FloatArray:
    """Of the four ways from each cell, the share (rows, columns) in which some cell was observed."""
    ways = [
        np.maximum.accumulate(observed, axis=1),
        np.maximum.accumulate(observed[:, ::-1], axis=1)[:, ::-1],
        np.maximum.accumulate(observed, axis=0),
        np.maximum.accumulate(observed[::-1], axis=0)[::-1],
    ]
    return np.asarray(np.mean(ways, axis=0, dtype=np.float64))


def room_probability(known: FloatArray, role: Role) -> FloatArray:
    """Return how probably a surface of the room is at places, by what is `known` (n, 6) or (n, 7) of them."""
    weights = WALL_WEIGHTS if role == "wall" else LEVEL_WEIGHTS
    return np.asarray(1 / (1 + np.exp(-(weights[0] + known @ weights[1:]))), dtype=np.float64)


def known_of_room(
    grid: ChartGrid,
    regions: HiddenRegions,
    extent: Extent,
    evidence: Evidence,
    *,
    base: FloatArray,
    room: Room,
) -> FloatArray:
    """Return `KNOWN_OF_LEVEL` (n, 6) or `KNOWN_OF_WALL` (n, 7) of the n hidden cells, as in `regions.region`.

    `base` (n,) is the probability by the surface's edges.
    """
    inside = regions.region >= 0
    away = ndimage.distance_transform_edt(~evidence.observed, sampling=grid.cell[::-1])[inside]
    support = supports(evidence.observed)[inside]
    points = grid.centres()[np.flatnonzero(inside)]
    if extent.role != "wall":
        is_own = np.isin(room.rooms_at(points), room.scanner_rooms)
        is_ceiling = np.full(len(points), extent.role == "ceiling")
        closed = is_own * room.closed_at(points)
        return np.column_stack([away, support, 1 - base, is_own, closed, is_ceiling])
    wall = room.wall(extent.index)
    before = points + ASIDE_M * wall.plane.normal_direction
    turn = float(np.arctan2(*(room.axes @ wall.along)))
    along = wall.places(points)[:, 0]
    measured = wall.places(grid.centres()[np.flatnonzero(evidence.observed)])[:, 0]
    past = np.maximum(np.maximum(measured.min() - along, along - measured.max()), 0.0)
    turned = np.full(len(points), abs(np.sin(2 * turn)))
    parts = [np.log(away + _AWAY_M), support, 1 - base, turned, room.rooms_at(before) > 0, past]
    return np.column_stack([*parts, room.closed_at(before)])
