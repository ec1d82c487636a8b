# SPDX-License-Identifier: MIT
"""Tour: an order of stations with short legs that keep clear of every surface.

The order is found by 2-opt and the moving of short stretches. Ways lead along a lattice. A step is taken only
where the free balls around its two ends, less the radius of what is carried, hold all of it between them: a
sufficient condition that no step passes through a surface. Within a building somebody walks: then the lattice
lies on all that is level with headroom above (`nbv.visibility.floors`), storey by storey, and what stands on
it higher than a step is in the way, so that nobody climbs through a window. Treads are a step from one
another: stairs join storeys.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from nbv.online.limits import BODY_M, LEVEL_M, SAMPLES_A_BODY
from nbv.run.wording import count
from nbv.visibility.floors import FloorColumns, cut_columns
from nbv.visibility.limits import HEADROOM_M, STEP_M, WALKABLE
from nbv.visibility.samples import sample_surface
from nbv.visibility.zones import Box
from scenes.checks import FloatArray, InputError, Value, check_points
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.rays.raycast import RayCaster

_MOST_STARTS = 8


def short_order(lengths: FloatArray, first: int | None = None) -> list[int]:
    """Return a short order in which to visit all of n places, from `first` on where one is given.

    `lengths` (n, n) may hold inf.

    Examples
    --------
    >>> places = np.array([0.0, 5.0, 1.0, 4.0])
    >>> short_order(np.abs(places[:, None] - places))
    [0, 2, 3, 1]
    >>> short_order(np.abs(places[:, None] - places), first=3)
    [3, 1, 2, 0]
    """
    finite = lengths[np.isfinite(lengths)]
    no_way = (1 + float(finite.max(initial=0.0))) * len(lengths)  # dearer than any tour without such a leg
    cost = np.where(np.isfinite(lengths), lengths, no_way)
    if first is not None:
        return _order_from(cost, first)
    few = np.unique(np.linspace(0, len(cost) - 1, _MOST_STARTS).astype(int))
    starts = [_nearest_first(cost, int(start)) for start in few]
    return min((_improve_order(cost, order) for order in starts), key=lambda order: _total(cost, order))


def _order_from(cost: FloatArray, first: int) -> list[int]:
    """Return a short order from a place: one more place, near it alone, is an end of any short tour."""
    n = len(cost)
    far = (1 + float(cost.max(initial=0.0))) * (n + 1)  # dearer than any tour
    with_end = np.full((n + 1, n + 1), far)
    with_end[:n, :n] = cost
    with_end[n, first] = with_end[first, n] = with_end[n, n] = 0.0
    order = _improve_order(with_end, _nearest_first(with_end, n))
    return order[1:] if order[0] == n else order[-2::-1]


def _nearest_first(cost: FloatArray, start: int) -> list[int]:
    order, left = [start], set(range(len(cost))) - {start}
    while left:
        order.append(min(left, key=lambda place: (cost[order[-1], place], place)))
        left.remove(order[-1])
    return order


def _improve_order(cost: FloatArray, order: list[int]) -> list[int]:
    """Turn and move stretches as long as that makes an open tour shorter."""
    while True:
        shorter = _reverse_stretch(cost, order) or _move_stretch(cost, order)
        if shorter is None:
            return order
        order = shorter


def _reverse_stretch(cost: FloatArray, order: list[int]) -> list[int] | None:
    """Return the order with the one stretch turned round that gains most, None where none does."""
    n = len(order)
    route = np.array(order)
    first, last = np.triu_indices(n, 1)
    before, after = np.maximum(first - 1, 0), np.minimum(last + 1, n - 1)
    change = np.zeros(len(first))
    inner, outer = first > 0, last < n - 1
    change += inner * (cost[route[before], route[last]] - cost[route[before], route[first]])
    change += outer * (cost[route[first], route[after]] - cost[route[last], route[after]])
    best = int(np.argmin(change))
    if change[best] >= -_gain(cost):
        return None
    a, b = int(first[best]), int(last[best]) + 1
    return order[:a] + order[a:b][::-1] + order[b:]


def _move_stretch(cost: FloatArray, order: list[int]) -> list[int] | None:
    """Return the order with a stretch of up to three places moved elsewhere, None where none gains."""
    now = _total(cost, order)
    for size in range(1, min(4, len(order))):
        for start in range(len(order) - size + 1):
            stretch, remainder = order[start : start + size], order[:start] + order[start + size :]
            inside = _total(cost, stretch)
            route = np.array(remainder)
            joined = cost[route, stretch[0]], cost[stretch[-1], route]
            between = joined[0][:-1] + joined[1][1:] - cost[route[:-1], route[1:]]
            added = np.concatenate([joined[1][:1], between, joined[0][-1:]])
            at = int(np.argmin(added))
            if _total(cost, remainder) + inside + added[at] < now - _gain(cost):
                return remainder[:at] + stretch + remainder[at:]
    return None


def _gain(cost: FloatArray) -> float:
    """Least gain that counts, metres: well above rounding, so that the search ends."""
    return 1e-12 * float(cost.max(initial=0.0)) * len(cost) + 1e-9


def _total(cost: FloatArray, order: list[int]) -> float:
    route = np.array(order)
    return float(cost[route[:-1], route[1:]].sum())


_MOST_NODES = 60_000  # of the lattice in the air
_MOST_PLACES = 120_000  # on floors; of more only every second or third cell of either axis is one
_MOST_OBSTACLES = 1e6  # of them; in scenes of more than 1,400 m2 they are further apart


@dataclass(frozen=True, slots=True, eq=False)
class Leg(Value):
    """A way (k, 3) from one station to the next and its length, metres; no points and inf where none is."""

    path: FloatArray
    length_m: float


@dataclass(frozen=True, slots=True, eq=False)
class Ways:
    """Shortest ways between n stations.

    Attributes
    ----------
    nodes : (m, 3) float
        Places of the lattice, those where stations are first, each once, metres.
    place : (n,) int64
        The node of each station.
    lengths : (n, n) float
        Metres; inf where no way is.
    before : (u, m) int32
        The node before each on the way from each of the u places of stations.
    """

    nodes: FloatArray
    place: NDArray[np.int64]
    lengths: FloatArray
    before: NDArray[np.int32]

    @classmethod
    def flown(
        cls, mesh: LabelledMesh, stations: FloatArray, *, body_m: float, keep_out: Sequence[Box] = ()
    ) -> Ways:
        """Return the ways through the air between stations (n, 3), `body_m` clear of the mesh, metres."""
        places, place = np.unique(stations, axis=0, return_inverse=True)
        obstacles, spacing = _obstacles(mesh, body_m)
        extent = np.vstack([mesh.bounds(), stations])
        low, high = extent.min(axis=0), extent.max(axis=0)
        step = max(BODY_M, float((np.prod(np.maximum(high - low, 0.1)) / _MOST_NODES) ** (1 / 3)))
        axes = [np.arange(a, b + step, step) for a, b in zip(low, high, strict=True)]
        lattice = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        nodes = np.vstack([places, lattice])
        room = cKDTree(obstacles).query(nodes)[0] - body_m - spacing
        for box in keep_out:
            room = np.minimum(room, box.distance(nodes))
        kept = (room > 0) | (np.arange(len(nodes)) < len(places))
        nodes, room = nodes[kept], room[kept]
        pairs = cKDTree(nodes).query_pairs(1.01 * np.sqrt(3) * step, output_type="ndarray")
        return cls._along(nodes, room, pairs, place.reshape(-1))

    @classmethod
    def over_floors(
        cls,
        mesh: LabelledMesh,
        caster: RayCaster,
        stations: FloatArray,
        *,
        body_m: float,
        keep_out: Sequence[Box] = (),
    ) -> Ways:
        """Return the ways over the floors between stations (n, 3); they start and end at the sensors."""
        sensors, place = np.unique(stations, axis=0, return_inverse=True)
        columns = cut_columns(mesh, caster)
        flat, floor, cell_m = _walkable(columns)
        flat = np.vstack([sensors[:, :2], flat])
        floor = np.concatenate([_floor_below(columns, sensors), floor])
        points, spacing = _obstacles(mesh, body_m)
        room = _room_around(flat, floor, points, body_m + spacing, 2 * cell_m)
        for box in keep_out:
            in_way = (box.low[2] < floor + HEADROOM_M) & (box.high[2] > floor)
            room[in_way] = np.minimum(room[in_way], box.distance(flat[in_way], 2))
        kept = (room > 0) | (np.arange(len(flat)) < len(sensors))
        nodes, room = np.column_stack([flat, floor])[kept], room[kept]
        pairs = cKDTree(nodes[:, :2]).query_pairs(1.01 * np.sqrt(2) * cell_m, output_type="ndarray")
        pairs = pairs[np.abs(nodes[pairs[:, 0], 2] - nodes[pairs[:, 1], 2]) <= STEP_M]
        ways = cls._along(nodes, room, pairs, place.reshape(-1))
        ends = np.vstack([sensors, nodes[len(sensors) :]])
        return cls(ends, ways.place, ways.lengths, ways.before)

    @classmethod
    def _along(
        cls, nodes: FloatArray, room: FloatArray, pairs: NDArray[np.int64], place: NDArray[np.int64]
    ) -> Ways:
        """Return the ways along those `pairs` (p, 2) of nodes between which the free balls hold all."""
        length = np.linalg.norm(nodes[pairs[:, 0]] - nodes[pairs[:, 1]], axis=1)
        safe = (room[pairs] > 0).all(axis=1) & (room[pairs].sum(axis=1) >= length)
        steps = (np.maximum(length[safe], 1e-9), (pairs[safe, 0], pairs[safe, 1]))
        graph = coo_array(steps, shape=(len(nodes),) * 2).tocsr()
        ends = np.arange(place.max(initial=-1) + 1)
        lengths, before = dijkstra(graph, directed=False, indices=ends, return_predecessors=True)
        return cls(nodes, place, lengths[np.ix_(place, place)], before)

    def leg(self, a: int, b: int) -> Leg:
        """Return the shortest way from station a to station b."""
        if not np.isfinite(self.lengths[a, b]):
            return Leg(np.zeros((0, 3)), np.inf)
        start, way = int(self.place[a]), [int(self.place[b])]
        while way[-1] != start:
            way.append(int(self.before[start, way[-1]]))
        if len(way) == 1:
            way = [start, start]
        return Leg(self.nodes[way[::-1]], float(self.lengths[a, b]))


def _obstacles(mesh: LabelledMesh, body_m: float) -> tuple[FloatArray, float]:
    """Points (k, 3) of the surface, dense beside a body's radius, and their spacing, metres."""
    spacing = max(body_m / SAMPLES_A_BODY, float(np.sqrt(mesh.face_areas().sum() / _MOST_OBSTACLES)))
    return sample_surface(mesh, spacing).points, spacing


def _walkable(columns: FloorColumns) -> tuple[FloatArray, FloatArray, float]:
    """Places (m, 2) on which one can walk, the height (m,) of each, and how far they are apart, metres."""
    walkable = (columns.top - columns.bottom >= HEADROOM_M) & (columns.slope >= WALKABLE)
    every = max(int(np.ceil(np.sqrt(np.count_nonzero(walkable) / _MOST_PLACES))), 1)
    x, y = np.divmod(columns.cell, columns.shape[1])
    spans = np.flatnonzero(walkable & (x % every == 0) & (y % every == 0))
    return columns.places(columns.cell[spans]), columns.bottom[spans], every * columns.cell_m


def _floor_below(columns: FloorColumns, sensors: FloatArray) -> FloatArray:
    """Height (n,) of what lies below each sensor (n, 3), metres; its own where nothing does."""
    heights = sensors[:, 2].copy()
    for k, cell in enumerate(columns.cells_of(sensors[:, :2]).tolist()):
        spans = np.arange(columns.start[cell], columns.start[cell + 1]) if cell >= 0 else np.zeros(0, int)
        below = columns.bottom[spans][columns.bottom[spans] < sensors[k, 2]]
        heights[k] = below.max(initial=-np.inf) if len(below) else heights[k]
    return heights


def _room_around(
    flat: FloatArray, floor: FloatArray, points: FloatArray, clearance_m: float, enough_m: float
) -> FloatArray:
    """Distance (m,) of places (m, 2) on floors of heights (m,) from what is in a person's way there.

    That are the points (k, 3) higher than a step above the floor and lower than the headroom; the clearance
    is taken off. Distances from `enough_m` on may come out as inf.
    """
    room = np.full(len(flat), np.inf)
    points = points[np.argsort(points[:, 2], kind="stable")]
    level = np.rint(floor / LEVEL_M)
    for level_number in np.unique(level):
        here = np.flatnonzero(level == level_number)
        band = np.searchsorted(points[:, 2], [floor[here].max() + STEP_M, floor[here].min() + HEADROOM_M])
        among = points[band[0] : band[1], :2]
        reach = clearance_m + enough_m
        low, high = flat[here].min(axis=0) - reach, flat[here].max(axis=0) + reach
        among = among[((among >= low) & (among <= high)).all(axis=1)]
        if len(among):
            room[here] = cKDTree(among).query(flat[here], distance_upper_bound=reach)[0] - clearance_m
    return room


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Tour(Value):
    """Stations by their numbers in their order, and the legs between them.

    It `is_given` where the stations were to be visited as they come, as scans are that decide the next one.
    """

    order: tuple[int, ...]
    legs: tuple[Leg, ...]
    is_given: bool = False

    def __repr__(self) -> str:
        return f"Tour({count(len(self.order), 'station')}, {self.describe()})"

    @property
    def length_m(self) -> float:
        """Length of all legs that have a way, metres."""
        return float(sum(leg.length_m for leg in self.legs if np.isfinite(leg.length_m)))

    @property
    def n_without_way(self) -> int:
        """How many legs have no way, which the length leaves out."""
        return sum(1 for leg in self.legs if not np.isfinite(leg.length_m))

    def describe(self) -> str:
        """Return the length in words, and how many legs it leaves out.

        Examples
        --------
        >>> there, nowhere = Leg(np.zeros((2, 3)), 3.25), Leg(np.zeros((0, 3)), np.inf)
        >>> Tour((0, 1), (there,)).describe()
        '3.2 m'
        >>> Tour((0, 1, 2), (there, nowhere)).describe()
        '3.2 m, without 1 of 2 legs that has no way (closed doors, storeys without stairs, narrow places)'
        """
        text = f"{self.length_m:.1f} m"
        if not self.n_without_way:
            return text
        have = "has" if self.n_without_way == 1 else "have"
        return (
            f"{text}, without {self.n_without_way} of {count(len(self.legs), 'leg')} that {have} no way "
            "(closed doors, storeys without stairs, narrow places)"
        )

    def to_json(self) -> dict[str, Any]:
        """Return the entry of `stations.json`: views counted from 1, length null where there is no way."""
        legs = [
            {"length_m": leg.length_m if len(leg.path) else None, "path": leg.path.tolist()}
            for leg in self.legs
        ]
        order = [number + 1 for number in self.order]
        lost = self.n_without_way
        return {
            "order": order,
            "is_given": self.is_given,
            "length_m": self.length_m,
            "legs_without_way": lost,
            "legs": legs,
        }


def plan_tour(
    mesh: LabelledMesh,
    stations: FloatArray,
    *,
    body_m: float = BODY_M,
    on_foot: bool = False,
    in_order: bool = False,
    keep_out: Sequence[Box] = (),
    first: int | None = None,
    caster: RayCaster | None = None,
) -> Tour:
    """Return a short open tour of `stations` (n, 3), metres, that keeps `body_m` clear of the mesh.

    It begins at the station `first` where that is given. No leg leads through the boxes `keep_out`; on foot
    they count where they stand in a person's way.

    Nearest neighbours from several starts, then 2-opt and the moving of short stretches (Or 1976) until
    neither helps; `in_order` the stations are visited as they come. Legs between stations that no way joins
    come out as such. `on_foot` the ways lead over the floors of all storeys, by steps and stairs. `caster` is
    of the mesh, made here when not given.

    Raises
    ------
    InputError
        A body without size.
    """
    if not body_m > 0:
        raise InputError(f"body_m must be positive, got {body_m}")
    stations = check_points("stations", stations)
    if len(stations) < 2:
        return Tour(tuple(range(len(stations))), (), in_order)
    if on_foot:
        caster = caster or RayCaster(mesh.vertices, mesh.faces)
        ways = Ways.over_floors(mesh, caster, stations, body_m=body_m, keep_out=keep_out)
    else:
        ways = Ways.flown(mesh, stations, body_m=body_m, keep_out=keep_out)
    order = list(range(len(stations))) if in_order else short_order(ways.lengths, first)
    legs = tuple(ways.leg(a, b) for a, b in pairwise(order))
    return Tour(tuple(order), legs, in_order)


@dataclass(frozen=True, slots=True)
class Overlap(Value):
    """Two views, counted from 0, whose scans can be registered with one another.

    `share` is of the smaller one's surface what both measure, `stiffness` the least eigenvalue of the
    normalised Hessian (`nbv.cover.overlap`).
    """

    first: int
    second: int
    share: float
    stiffness: float

    def to_json(self) -> dict[str, Any]:
        """Return the entry of `stations.json`, views counted from 1."""
        views = [self.first + 1, self.second + 1]
        return {"views": views, "overlap": self.share, "stiffness": self.stiffness}


@dataclass(frozen=True, slots=True, eq=False)
class Stations(Value):
    """A tour with collision-free legs, and all pairs of a plan's stations that are linked.

    `n_groups` are the groups of views that links join; 1 when all scans can be registered. Both are None
    where overlap was not looked at: in plans of scenes that the planner did not know, and of baselines.
    """

    tour: Tour
    overlaps: tuple[Overlap, ...] | None = None
    n_groups: int | None = None

    def to_json(self) -> dict[str, Any]:
        """Return the contents of `stations.json`."""
        links = None if self.overlaps is None else [overlap.to_json() for overlap in self.overlaps]
        return {"tour": self.tour.to_json(), "overlaps": links, "groups": self.n_groups}
