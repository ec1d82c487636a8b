# SPDX-License-Identifier: MIT
"""Rooms: the parts of a scene's floor between doorways, what joins them, and storeys."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from skimage.segmentation import watershed

from nbv.run.wording import count
from nbv.visibility import limits
from nbv.visibility.floors import FloorColumns, Floors
from scenes.checks import BoolArray, FloatArray, Value
from scenes.rays.raycast import RayCaster


@dataclass(frozen=True, slots=True)
class SiteRoom(Value):
    """A room.

    Attributes
    ----------
    number : int
        From 1, by storey and then by size.
    storey : int
        From 1, the lowest.
    floor_m2, level_m : float
        Area of its floor in square metres, and the height that half of it lies below, metres.
    ceiling_m : float or None
        The height that half of its ceiling lies below, metres; None where it has none.
    place : (3,) float
        A place on its floor, far from walls, metres.
    is_outside : bool
        Whether it lies under the open sky, or is open to that along a quarter of its outline.
    joined : tuple of int
        Rooms to which doorways stand open, or steps lead.
    stairs : tuple of int
        Rooms of other storeys to which stairs lead.
    """

    number: int
    storey: int
    floor_m2: float
    level_m: float
    ceiling_m: float | None
    place: tuple[float, float, float]
    is_outside: bool
    joined: tuple[int, ...]
    stairs: tuple[int, ...]

    @property
    def name(self) -> str:
        """What to call it."""
        kind = "outside" if self.is_outside else "room"
        return f"{kind} {self.number}"

    def to_json(self) -> dict[str, Any]:
        """Return the entry of `plan.json`."""
        return {
            "room": self.number,
            "name": self.name,
            "storey": self.storey,
            "floor_m2": self.floor_m2,
            "level_m": self.level_m,
            "ceiling_m": self.ceiling_m,
            "place": list(self.place),
            "is_outside": self.is_outside,
            "joined": list(self.joined),
            "stairs": list(self.stairs),
        }


@dataclass(frozen=True, slots=True, eq=False)
class Rooms(Value):
    """The rooms of a scene, and which span of its columns is of which.

    Attributes
    ----------
    floors : Floors
        The floor.
    room : (n,) int32
        Number of the room that a floor span is of, 0 for none: treads of stairs, and what is no floor.
    rooms : tuple of Room
        By number.
    solid_m2 : float
        Floor area that was left out since it is the inside of solids, square metres.
    doubts : tuple of str
        What was assumed.
    """

    floors: Floors
    room: NDArray[np.int32]
    rooms: tuple[SiteRoom, ...]
    solid_m2: float
    doubts: tuple[str, ...]

    def span_of(self, places: FloatArray) -> NDArray[np.int64]:
        """Return the span (n,) of free space that each place (n, 3) lies in, metres; -1 for none."""
        columns = self.floors.columns
        cells, spans = columns.cells_of(places[:, :2]), np.full(len(places), -1, np.int64)
        inside = np.flatnonzero(cells >= 0)
        for k in range(int(np.diff(columns.start).max(initial=0))):
            span = columns.start[cells[inside]] + k
            known = (span < columns.start[cells[inside] + 1]) & (spans[inside] < 0)
            at, span = inside[known], span[known]
            holds = (columns.bottom[span] <= places[at, 2]) & (columns.top[span] >= places[at, 2])
            spans[at[holds]] = span[holds]
        return spans

    def room_of(self, places: FloatArray) -> NDArray[np.int32]:
        """Return the number (n,) of the room on whose floor, or over it, each place (n, 3) is; 0 for none."""
        span = self.span_of(places)
        return np.where(span >= 0, np.append(self.room, 0)[span], 0).astype(np.int32)

    def height_above_floor(self, places: FloatArray) -> FloatArray:
        """Return how high (n,) each place (n, 3) is above what lies below, metres; nan where nothing does."""
        span = self.span_of(places)
        below = np.where(span >= 0, np.append(self.floors.columns.bottom, 0.0)[span], np.nan)
        return np.asarray(places[:, 2] - below)

    def reachable_from(self, start: int) -> set[int]:
        """Numbers of the rooms to which one walks from a room, through doorways and by stairs."""
        reached, going = {start}, [start]
        while going:
            room = self.rooms[going.pop() - 1]
            new = (set(room.joined) | set(room.stairs)) - reached
            reached |= new
            going += sorted(new)
        return reached


def part_at_doorways(columns: FloorColumns, floor: BoolArray, caster: RayCaster) -> NDArray[np.int64]:
    """Number (k,) the parts of a storey's floor spans (n,) between doorways, from 1; 0 for doorways.

    What counts is the plan 1.9 m above the floor. A doorway is where the headroom is lower than on both
    sides over no more than a wall's thickness, or the plan half as wide as on both sides. Where floor was
    not seen nothing is taken to stand but what is seen to.
    """
    plan = _StoreyGrid(columns, floor)
    air = plan.air(caster)
    headroom = plan.under_sheets(air, caster)
    doors = _under_lintels(np.where(air, headroom, 0.0), air, columns.cell_m)
    parts = _parted_where_narrow(air & ~doors, columns.cell_m)
    return np.asarray(parts.ravel()[columns.cell[floor]], dtype=np.int64)


class _StoreyGrid:
    """A storey's plan: heights (x, y) of its floor, and the headroom above, metres."""

    def __init__(self, columns: FloorColumns, floor: BoolArray) -> None:
        self.columns = columns
        known = np.full(columns.shape, np.nan)
        known.ravel()[columns.cell[floor]] = columns.bottom[floor]
        away, nearest = ndimage.distance_transform_edt(
            np.isnan(known), sampling=columns.cell_m, return_indices=True
        )
        height = known[tuple(nearest)]
        self.height: FloatArray = np.where(away <= limits.NEAR_FLOOR_M, height, np.nan)
        eye = (self.height.ravel() + limits.OVER_FURNITURE_M)[columns.cell]
        holds = (columns.bottom < eye) & (columns.top > eye + 0.05)
        headroom = np.zeros(columns.shape)
        room = np.minimum(columns.top, eye + limits.MOST_HEADROOM_M) - (eye - limits.OVER_FURNITURE_M)
        headroom.ravel()[columns.cell[holds]] = np.minimum(room[holds], limits.MOST_HEADROOM_M)
        if columns.is_partial:
            unseen = np.diff(columns.start) == 0
            unseen[columns.cell[holds & np.isinf(columns.top)]] = True
            headroom = self._over_unseen(headroom, unseen.reshape(columns.shape))
        self.headroom: FloatArray = headroom

    def _over_unseen(self, headroom: FloatArray, unseen: BoolArray) -> FloatArray:
        """Return the headroom, where floor or ceiling was not seen that of the nearest cell with both."""
        known = (headroom > 0) & ~unseen
        if not known.any():
            return headroom
        nearest = ndimage.distance_transform_edt(~known, return_distances=False, return_indices=True)
        return np.where(unseen & ~np.isnan(self.height), headroom[tuple(nearest)], headroom)

    def air(self, caster: RayCaster) -> BoolArray:
        """Tell which cells (x, y) are open at eye height, and have no wall to a cell beside."""
        air = self.headroom > 0
        return air & ~self._find_stops(air, np.full(air.shape, limits.OVER_FURNITURE_M), caster)

    def under_sheets(self, air: BoolArray, caster: RayCaster) -> FloatArray:
        """Return the headroom (x, y), lower under a head of a doorway that is thinner than a cell.

        It hangs at least as low as the highest of doors, or as the ceiling less what makes a lintel.
        """
        headroom = self.headroom
        for head in (limits.DOOR_HEAD_M, limits.GATE_HEAD_M):
            level = np.minimum(self.headroom - limits.LINTEL_M / 2, head)
            under = self._find_stops(air & (level > limits.OVER_FURNITURE_M), level, caster)
            headroom = np.where(
                under, np.minimum(headroom, np.minimum(self.headroom - limits.LINTEL_M, head)), headroom
            )
        return headroom

    def _find_stops(self, among: BoolArray, above: FloatArray, caster: RayCaster) -> BoolArray:
        """Tell the cells (x, y) with surface between them and one beside, so high above the floor, metres."""
        columns, number = self.columns, np.arange(among.size).reshape(among.shape)
        walled = np.zeros(among.size, np.bool_)
        for values, other in ((number[:-1], number[1:]), (number[:, :-1], number[:, 1:])):
            pair = (among.ravel()[values] & among.ravel()[other]).ravel()
            first, second = values.ravel()[pair], other.ravel()[pair]
            level = np.minimum(*((self.height + above).ravel()[side] for side in (first, second)))
            ends = [np.column_stack([columns.places(side), level]) for side in (first, second)]
            stopped = caster.are_blocked(ends[0], ends[1])
            walled[first[stopped]] = True
            walled[second[stopped]] = True
        return walled.reshape(among.shape)


def _under_lintels(headroom: FloatArray, air: BoolArray, cell_m: float) -> BoolArray:
    """Tell the cells (x, y) under the heads of doorways."""
    lintels = np.zeros(air.shape, np.bool_)
    reach = int(np.ceil(limits.WALL_M / cell_m)) + 1
    for axis in range(2):
        before, after = (
            ndimage.maximum_filter1d(headroom, reach + 1, axis=axis, origin=shift, mode="constant")
            for shift in (reach // 2, -(reach // 2))
        )
        lower = np.minimum(before, after) - headroom >= limits.LINTEL_M
        lintels |= air & lower & (headroom <= limits.DOOR_HEAD_M)
    label, _ = ndimage.label(lintels, np.ones((3, 3)))
    for number, box in enumerate(ndimage.find_objects(label), start=1):
        sides = sorted((side.stop - side.start) * cell_m for side in box)
        inside = label[box] == number
        head = float(np.median(headroom[box][inside]))
        if sides[0] > limits.WALL_M + 2 * cell_m or (
            sides[1] > limits.WIDE_DOOR_M and head > limits.GATE_HEAD_M
        ):
            lintels[box][inside] = False
    return lintels


def _parted_where_narrow(air: BoolArray, cell_m: float) -> NDArray[np.int64]:
    """Number the parts (x, y) of a plan, cut at narrow places between wide ones."""
    clear = np.asarray(ndimage.distance_transform_edt(np.pad(air, 1)))[1:-1, 1:-1] * cell_m
    basin = watershed(-clear, mask=air)
    return _merge_basins(basin, clear)


def _merge_basins(basin: NDArray[np.int64], clear: FloatArray) -> NDArray[np.int64]:
    """Join basins that no doorway parts, from the widest pass down."""
    n = int(basin.max(initial=0)) + 1
    peak = np.zeros(n)
    np.maximum.at(peak, basin.ravel(), clear.ravel())
    passes: dict[tuple[int, int], float] = {}
    for pair, other in ((np.s_[:-1], np.s_[1:]), (np.s_[:, :-1], np.s_[:, 1:])):
        first, second = basin[pair].ravel(), basin[other].ravel()
        width = np.minimum(clear[pair], clear[other]).ravel()
        meets = (first != second) & (first > 0) & (second > 0)
        for a, b, w in zip(first[meets].tolist(), second[meets].tolist(), width[meets].tolist(), strict=True):
            key = (min(a, b), max(a, b))
            passes[key] = max(passes.get(key, 0.0), w)
    parent = list(range(n))

    def root(k: int) -> int:
        while parent[k] != k:
            parent[k] = parent[parent[k]]
            k = parent[k]
        return k

    for (a, b), least in sorted(passes.items(), key=lambda item: (-item[1], item[0])):
        one_root, other_root = sorted((root(a), root(b)))
        narrow = least <= limits.NARROW_M and min(peak[one_root], peak[other_root]) >= limits.WIDER * least
        if one_root != other_root and not narrow:
            parent[other_root] = one_root
            peak[one_root] = max(peak[one_root], peak[other_root])
    roots = np.array([root(k) for k in range(n)])
    return np.asarray(np.unique(roots, return_inverse=True)[1].reshape(-1)[basin], dtype=np.int64)


_RAYS, _MOST_PLACES = 32, 50  # level rays from each of so many places of a floor
_EYE_M = 1.5


def find_rooms(floors: Floors, caster: RayCaster) -> Rooms:
    """Part the floor of a scene into rooms.

    Floor that turns its back is the inside of a solid, unless only such floor lies under ceilings. Floors
    within one and a half metres of the lowest are a storey. Each storey is parted at its doorways
    (`nbv.visibility.rooms.part_at_doorways`).
    """
    columns, spans = floors.columns, np.flatnonzero(floors.is_floor)
    walk = floors.walk[spans]
    solid = _is_solid(walk, columns.shows_back[spans])
    rooms = _part_into_rooms(floors, caster, spans, solid[walk], ())
    if solid.any() and all(room.is_outside for room in rooms.rooms):
        turned = "all floor under ceilings turns its back upwards: its faces are taken to be turned over"
        rooms = _part_into_rooms(floors, caster, spans, np.zeros(len(spans), np.bool_), (turned,))
    return rooms


def _part_into_rooms(
    floors: Floors,
    caster: RayCaster,
    spans: NDArray[np.int64],
    in_solid: BoolArray,
    doubts: Sequence[str],
) -> Rooms:
    """Part the floor spans that lie in no solid (n,) into rooms."""
    columns = floors.columns
    inner = np.zeros(len(floors.is_floor), np.bool_)
    inner[spans] = ~in_solid
    solid_m2 = float(np.count_nonzero(in_solid)) * columns.cell_m**2
    storey = _storeys(floors, inner)
    region = np.zeros(len(inner), np.int64)
    for number in range(1, int(storey.max(initial=0)) + 1):
        part = part_at_doorways(columns, storey == number, caster)
        region[storey == number] = np.where(part > 0, part + region.max(initial=0), 0)
    region = _spread(region, storey > 0, floors.links)
    return _describe_rooms(floors, caster, region=region, storey=storey, solid_m2=solid_m2, doubts=doubts)


def _is_solid(walk: NDArray[np.int64], shows_back: BoolArray) -> BoolArray:
    """Tell which connected floors (w,) are the insides of solids, by their cells (n,)."""
    n_cells = np.maximum(np.bincount(walk), 1)
    backs = np.bincount(walk, shows_back) / n_cells
    largest = np.argsort(-n_cells, kind="stable")
    half = largest[: int(np.searchsorted(np.cumsum(n_cells[largest]), n_cells.sum() / 2)) + 1]
    is_orderly = len(half) > 0 and float(np.average(backs[half], weights=n_cells[half])) <= limits.ORDERLY
    return np.asarray(backs >= (limits.MAJORITY if is_orderly else limits.ALMOST_ALL))


def _storeys(floors: Floors, inner: BoolArray) -> NDArray[np.int64]:
    """Storey (n,) of each floor span, from 1; 0 for treads of stairs and what is no floor."""
    columns = floors.columns
    cell_m2 = columns.cell_m**2
    n = int(floors.patch.max(initial=-1)) + 1
    spans = np.flatnonzero(inner)
    area = np.bincount(floors.patch[spans], minlength=n) * cell_m2
    level = np.bincount(floors.patch[spans], columns.bottom[spans], n) / np.maximum(area / cell_m2, 1)
    large = np.flatnonzero(area >= limits.STOREY_M2)
    of_patch = np.zeros(n, np.int64)
    base, number = -np.inf, 0
    for patch in large[np.argsort(level[large], kind="stable")]:
        if level[patch] > base + limits.STOREY_M:
            base, number = level[patch], number + 1
        of_patch[patch] = number
    storey = np.zeros(len(inner), np.int64)
    storey[spans] = of_patch[floors.patch[spans]]
    return storey


def _spread(region: NDArray[np.int64], among: BoolArray, links: NDArray[np.int64]) -> NDArray[np.int64]:
    """Give floor spans `among` without region that of a span beside, ring by ring."""
    region = region.copy()
    both = np.vstack([links, links[:, ::-1]])
    both = both[among[both].all(axis=1)]
    while True:
        open_ = both[(region[both[:, 0]] == 0) & (region[both[:, 1]] > 0)]
        if not len(open_):
            return region
        order = np.lexsort((region[open_[:, 1]], open_[:, 0]))
        first = np.unique(open_[order, 0], return_index=True)[1]
        chosen = open_[order[first]]
        region[chosen[:, 0]] = region[chosen[:, 1]]


def _describe_rooms(
    floors: Floors,
    caster: RayCaster,
    *,
    region: NDArray[np.int64],
    storey: NDArray[np.int64],
    solid_m2: float,
    doubts: Sequence[str],
) -> Rooms:
    """Number the rooms and say what each is."""
    columns, cell_m2 = floors.columns, floors.columns.cell_m**2
    n = int(region.max(initial=0)) + 1
    area = np.bincount(region, minlength=n) * cell_m2
    area[0] = 0.0
    of = np.zeros(n, np.int64)
    np.maximum.at(of, region, storey)
    holds = np.bincount(region, floors.can_stand, n) > 0
    large = np.flatnonzero((area >= limits.ROOM_M2) & holds)
    order = large[np.lexsort((large, -area[large], of[large]))]
    number = np.zeros(n, np.int32)
    number[order] = np.arange(1, len(order) + 1)
    room = number[region]
    outside = _outside(floors, room, len(order))
    whole = area[order]
    if len(order) and whole[~outside].sum() < limits.ROOFED * whole.sum():
        unwalled = _find_unwalled(floors, room, len(order), caster)
        bare = outside & ~unwalled
        if bare.any() and whole[~outside].sum() < limits.ROOFED * whole[~unwalled].sum():
            outside, walled = unwalled, int((~unwalled).sum())
            floor = count(walled, "floor with walls around is", "floors with walls around are")
            doubts = [
                *doubts,
                f"no ceiling over {whole[bare].sum():.0f} m2 of floor: {floor} taken for rooms",
            ]
    joined, stairs = _ways(floors, room, storey, len(order))
    rooms = []
    for index, source in enumerate(order.tolist(), start=1):
        spans = np.flatnonzero(room == index)
        rooms.append(
            SiteRoom(
                number=index,
                storey=int(of[source]),
                floor_m2=float(area[source]),
                level_m=float(np.median(columns.bottom[spans])),
                ceiling_m=_ceiling_height(columns.top[spans]),
                place=_middle(floors, spans),
                is_outside=bool(outside[index - 1]),
                joined=tuple(sorted(joined[index])),
                stairs=tuple(sorted(stairs[index])),
            )
        )
    return Rooms(floors, room, tuple(rooms), solid_m2, tuple(doubts))


def _outside(floors: Floors, room: NDArray[np.int32], n_rooms: int) -> BoolArray:
    """Tell which rooms (n_rooms,) lie under the sky, or are wide open to what does."""
    sky = np.isinf(floors.columns.top)
    size = np.maximum(np.bincount(room, minlength=n_rooms + 1), 1)
    outside = np.bincount(room, sky, n_rooms + 1) / size >= limits.MAJORITY
    outline = 4.0 * size - np.bincount(room[floors.links].ravel(), minlength=n_rooms + 1)
    while True:
        first, second = room[floors.links].T
        crossing = first != second
        open_ = np.bincount(first[crossing], outside[second[crossing]], n_rooms + 1)
        open_ += np.bincount(second[crossing], outside[first[crossing]], n_rooms + 1)
        wide = outside | (open_ / np.maximum(outline, 1) >= limits.OPEN_SIDE)
        wide[0] = False
        if (wide == outside).all():
            return np.asarray(outside[1:])
        outside = wide


def _find_unwalled(floors: Floors, room: NDArray[np.int32], n_rooms: int, caster: RayCaster) -> BoolArray:
    """Tell from which rooms (n_rooms,) most level rays meet no wall."""
    turn = 2 * np.pi * (np.arange(_RAYS) + 0.3) / _RAYS
    around = np.stack([np.cos(turn), np.sin(turn), np.zeros(_RAYS)], axis=1)
    columns, outside = floors.columns, np.zeros(n_rooms, np.bool_)
    for number in range(1, n_rooms + 1):
        spans = np.flatnonzero(room == number)
        spans = spans[:: -(-len(spans) // _MOST_PLACES)]
        origins = np.column_stack([columns.places(columns.cell[spans]), columns.bottom[spans] + _EYE_M])
        hits = caster.first_hit(np.repeat(origins, _RAYS, axis=0), np.tile(around, (len(origins), 1)))
        outside[number - 1] = float(hits.hit.mean()) < 1 - limits.MAJORITY
    return outside


def _ways(
    floors: Floors, room: NDArray[np.int32], storey: NDArray[np.int64], n_rooms: int
) -> tuple[list[set[int]], list[set[int]]]:
    """Rooms that each room is joined to directly, and by treads of stairs."""
    joined: list[set[int]] = [set() for _ in range(n_rooms + 1)]
    stairs: list[set[int]] = [set() for _ in range(n_rooms + 1)]
    room_a, other = room[floors.links].T
    key = np.sort(np.column_stack([room_a, other])[(room_a != other) & (room_a > 0) & (other > 0)], axis=1)
    pairs, times = np.unique(key, axis=0, return_counts=True)
    for (first, second), n in zip(pairs.tolist(), times.tolist(), strict=True):
        if n >= limits.PASSAGE_CELLS:
            joined[first].add(second)
            joined[second].add(first)
    tread = floors.is_floor & (room == 0)
    inner = floors.links[tread[floors.links].all(axis=1)]
    graph = coo_array((np.ones(len(inner), np.int8), inner.T), shape=(len(room), len(room)))
    _, flight = connected_components(graph, directed=False)
    ends: dict[int, set[int]] = {}
    for a, b in ((0, 1), (1, 0)):
        touch = tread[floors.links[:, a]] & (room[floors.links[:, b]] > 0)
        for number, end in zip(
            flight[floors.links[touch, a]].tolist(), room[floors.links[touch, b]].tolist(), strict=True
        ):
            ends.setdefault(number, set()).add(end)
    level = np.zeros(n_rooms + 1, np.int64)
    np.maximum.at(level, room, storey)
    for group in ends.values():
        for first in group:
            for second in group - {first}:
                (stairs if level[first] != level[second] else joined)[first].add(second)
    return joined, stairs


def _ceiling_height(tops: FloatArray) -> float | None:
    """The height that half of a ceiling lies below, by the tops (n,) of spans; None under the sky."""
    height = float(np.median(tops))
    return height if np.isfinite(height) else None


def _middle(floors: Floors, spans: NDArray[np.int64]) -> tuple[float, float, float]:
    """The place of a room's floor that is nearest to the middle of where one can stand, or of all of it."""
    columns = floors.columns
    sample = spans[floors.can_stand[spans]]
    sample = sample if len(sample) else spans
    places = columns.places(columns.cell[sample])
    best = int(np.argmin(((places - places.mean(axis=0)) ** 2).sum(axis=1)))
    x, y = places[best].tolist()
    return x, y, float(columns.bottom[sample[best]])
