# SPDX-License-Identifier: MIT
"""Bounding surface: which surface bounds the rooms that are asked for, and what becomes of the rest."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nbv.visibility.samples import SurfaceSamples
from nbv.visibility.standing.columns import Columns
from nbv.visibility.standing.rooms import Rooms
from nbv.visibility.standing.site import Site
from scenes.checks import FloatArray
from scenes.rays.raycast import RayCaster

APART = ("inside_a_solid", "another_room", "another_storey", "outside")
_LIFT_M = 0.01  # off a face: where the air before it is asked for
_OUTSIDE = -1  # the number of the open air


@dataclass(frozen=True, slots=True, eq=False)
class BoundingSurface:
    """Samples of which only those count that bound the rooms asked for; the others stand for no area.

    `reason` (n,) is the index into `APART` of what was set apart, -1 elsewhere; `apart_m2` the area of each.
    """

    samples: SurfaceSamples
    reason: NDArray[np.int8]
    apart_m2: Mapping[str, float]


def bounding_surface(samples: SurfaceSamples, site: Site, caster: RayCaster) -> BoundingSurface:
    """Tell which samples bound the rooms that are asked for.

    A sample bounds the room whose air lies before it, on either side of its face. All free spans that are
    open to a room's floor are its air, those over and under furniture among them.
    """
    sides = _sides(samples, site, caster)
    chosen = np.isin(sides, site.chosen).any(axis=1)
    storey = np.array([0, *(room.storey for room in site.rooms.rooms)])
    outside = np.array([False, *(room.is_outside for room in site.rooms.rooms)])
    asked = np.unique(storey[list(site.chosen)])
    known = np.maximum(sides, 0)
    is_room = (sides > 0) & ~outside[known]
    reason = np.select(
        [
            chosen,
            (is_room & np.isin(storey[known], asked)).any(axis=1),
            is_room.any(axis=1),
            ((sides == _OUTSIDE) | outside[known]).any(axis=1),
        ],
        [-1, 1, 2, 3],
        0,
    ).astype(np.int8)
    areas = {name: float(samples.areas[reason == k].sum()) for k, name in enumerate(APART)}
    counted = replace(samples, areas=np.where(reason < 0, samples.areas, 0.0))
    return BoundingSurface(counted, reason, {name: area for name, area in areas.items() if area > 0})


def room_before(samples: SurfaceSamples, site: Site, caster: RayCaster) -> NDArray[np.int64]:
    """Return the room (n,) among those asked for that each sample bounds, 0 for none.

    Of two it is that before the front of the sample's face.
    """
    front, back = _sides(samples, site, caster).T
    asked_front, asked_back = np.isin(front, site.chosen), np.isin(back, site.chosen)
    return np.where(asked_front, front, np.where(asked_back, back, 0))


def _sides(samples: SurfaceSamples, site: Site, caster: RayCaster) -> NDArray[np.int64]:
    """Room (n, 2) of the air before the front and the back of each sample's face."""
    air = room_of_air(site.rooms, caster)
    columns = site.rooms.floors.columns
    return np.column_stack([_air_before(columns, air, samples, side, caster) for side in (1.0, -1.0)])


def room_of_air(rooms: Rooms, caster: RayCaster) -> NDArray[np.int64]:
    """Room (n,) whose air each span of the columns holds; -1 in the open, 0 within solids."""
    columns = rooms.floors.columns
    one, other = columns.neighbours()
    height = (
        np.maximum(columns.bottom[one], columns.bottom[other])
        + np.minimum(np.minimum(columns.top[one], columns.top[other]), 1e6)
    ) / 2
    high = np.isinf(columns.top[one]) & np.isinf(columns.top[other])
    height[high] = np.maximum(columns.bottom[one], columns.bottom[other])[high] + 1.0
    ends = [np.column_stack([columns.places(columns.cell[side]), height]) for side in (one, other)]
    open_ = ~caster.blocked(ends[0], ends[1])
    one, other = one[open_], other[open_]
    air = rooms.room.astype(np.int64)
    air[(air == 0) & np.isinf(columns.top)] = _OUTSIDE
    both = np.column_stack([np.concatenate([one, other]), np.concatenate([other, one])])
    while True:
        reached = both[(air[both[:, 0]] == 0) & (air[both[:, 1]] != 0)]
        if not len(reached):
            return air
        order = np.lexsort((-air[reached[:, 1]], reached[:, 0]))
        first = np.unique(reached[order, 0], return_index=True)[1]
        chosen = reached[order[first]]
        air[chosen[:, 0]] = air[chosen[:, 1]]


def _air_before(
    columns: Columns, air: NDArray[np.int64], samples: SurfaceSamples, side: float, caster: RayCaster
) -> NDArray[np.int64]:
    """Room (n,) of the air a little off each sample on one side of its face, 0 where there is none.

    It is that of the nearest of the lines around to which nothing stands between.
    """
    places = samples.points + side * _LIFT_M * samples.normals
    found = np.where(columns.cells_of(places[:, :2]) < 0, _OUTSIDE, 0)
    steps = np.stack(np.meshgrid([0, -1, 1], [0, -1, 1], indexing="ij"), axis=-1).reshape(-1, 2)
    for step in steps[np.argsort(np.abs(steps).sum(axis=1), kind="stable")]:
        left = np.flatnonzero(found <= 0)  # a room's air is looked for beyond the open
        cells = columns.cells_of(places[left, :2] + step * columns.cell_m)
        room = _air_at(columns, air, cells, places[left, 2])
        left, cells, room = left[room != 0], cells[room != 0], room[room != 0]
        line = np.column_stack([columns.places(cells), places[left, 2]])
        open_ = ~caster.blocked(places[left], line)
        found[left[open_]] = room[open_]
    return found


def _air_at(
    columns: Columns, air: NDArray[np.int64], cells: NDArray[np.int64], heights: FloatArray
) -> NDArray[np.int64]:
    """Room (n,) of the span that holds each height (n,) over a cell (n,): the open below all surfaces."""
    inside = np.flatnonzero(cells >= 0)
    n_spans = np.diff(columns.start)[cells[inside]]
    last = np.append(columns.bottom, 0.0)[columns.start[cells[inside] + 1] - 1]
    lowest = np.where(n_spans > 0, last, np.inf)
    found = np.full(len(cells), _OUTSIDE)
    found[inside[heights[inside] > lowest]] = 0
    for k in range(int(np.diff(columns.start).max(initial=0))):
        span = columns.start[cells[inside]] + k
        known = span < columns.start[cells[inside] + 1]
        at, span = inside[known], span[known]
        holds = (columns.bottom[span] < heights[at]) & (columns.top[span] > heights[at])
        found[at[holds]] = air[span[holds]]
    return found
