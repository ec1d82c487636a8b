# SPDX-License-Identifier: MIT
"""Tour: an order of stations with short legs, each a way that keeps clear of every surface.

Ways lead along a lattice. A step is taken only where the free balls around its two ends, less the radius of
what is carried, hold all of it between them: a sufficient condition that no step passes through a surface.
Within a room somebody walks: then the lattice lies on the floor, and what stands on it or hangs lower than
the sensor is in the way, so that nobody climbs through a window.
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

from nbv.plan.visiting_order import short_order
from nbv.visibility.samples import sample_surface
from nbv.visibility.zones import Box
from scenes.checks import FloatArray, InputError, check_points
from scenes.mesh.labelled_mesh import LabelledMesh

BODY_M = 0.15  # radius of the sensor's head, which is carried
_MOST_NODES = 60_000
_STEP_M = 0.15
_STEP_OVER_M = 0.1  # what lies lower on the floor is stepped over
_SAMPLES_A_BODY = 4.0  # samples of the surface along a body's radius


@dataclass(frozen=True, slots=True, eq=False)
class Leg:
    """A way (k, 3) from one station to the next and its length, metres; no points and inf where none is."""

    path: FloatArray
    length_m: float


@dataclass(frozen=True, slots=True, eq=False)
class Tour:
    """Stations by their numbers in their order, and the legs between them."""

    order: tuple[int, ...]
    legs: tuple[Leg, ...]

    @property
    def length_m(self) -> float:
        """Length of all legs that there are, metres."""
        return float(sum(leg.length_m for leg in self.legs if np.isfinite(leg.length_m)))

    def to_json(self) -> dict[str, Any]:
        """Return the entry of `stations.json`: views counted from 1, length null where there is no way."""
        legs = [
            {"length_m": leg.length_m if len(leg.path) else None, "path": leg.path.tolist()}
            for leg in self.legs
        ]
        return {"order": [number + 1 for number in self.order], "length_m": self.length_m, "legs": legs}


def plan_tour(
    mesh: LabelledMesh,
    stations: FloatArray,
    *,
    body_m: float = BODY_M,
    on_foot: bool = False,
    keep_out: Sequence[Box] = (),
    first: int | None = None,
) -> Tour:
    """Return a short open tour of `stations` (n, 3), metres, that keeps `body_m` clear of the mesh.

    It begins at the station `first` where that is given. No leg leads through the boxes `keep_out`; on foot
    they count where they reach lower than the sensor.

    Nearest neighbours from several starts, then 2-opt and the moving of short stretches (Or 1976) until
    neither helps. Legs between stations that no way joins come out as such. `on_foot` the ways lead over the
    floor, which is as high as what most stations stand on, and keep clear up to the highest station.

    Raises
    ------
    InputError
        A body without size.
    """
    if not body_m > 0:
        raise InputError(f"body_m must be positive, got {body_m}")
    stations = check_points("stations", stations)
    if len(stations) < 2:
        return Tour(tuple(range(len(stations))), ())
    find = _Ways.walked if on_foot else _Ways.flown
    ways = find(mesh, stations, body_m, keep_out)
    order = short_order(ways.lengths, first)
    legs = tuple(ways.leg(a, b) for a, b in pairwise(order))
    return Tour(tuple(order), legs)


@dataclass(frozen=True, slots=True, eq=False)
class _Ways:
    """Shortest ways between stations: nodes (m, d), these first, lengths (n, n), predecessors (n, m)."""

    nodes: FloatArray
    lengths: FloatArray
    before: NDArray[np.int32]

    @classmethod
    def flown(cls, mesh: LabelledMesh, stations: FloatArray, body_m: float, keep_out: Sequence[Box]) -> _Ways:
        """Return the ways through the air."""
        spacing = body_m / _SAMPLES_A_BODY
        obstacles = sample_surface(mesh, spacing).points
        extent = np.vstack([mesh.bounds(), stations])
        return cls._among(obstacles, stations, extent, body_m + spacing, keep_out)

    @classmethod
    def walked(
        cls, mesh: LabelledMesh, stations: FloatArray, body_m: float, keep_out: Sequence[Box]
    ) -> _Ways:
        """Return the ways over the floor, found in the plane; they start and end at the sensors."""
        spacing = body_m / _SAMPLES_A_BODY
        points = sample_surface(mesh, spacing).points
        floor, head = _floor_height(points, stations, body_m), stations[:, 2].max() + body_m
        obstacles = points[(points[:, 2] > floor + _STEP_OVER_M) & (points[:, 2] < head)]
        flat = np.vstack([mesh.bounds(), stations])[:, :2]
        boxes = [box for box in keep_out if box.low[2] < head and box.high[2] > floor]
        ways = cls._among(obstacles[:, :2], stations[:, :2], flat, body_m + spacing, boxes)
        height = np.full(len(ways.nodes), floor)
        height[: len(stations)] = stations[:, 2]
        return cls(np.column_stack([ways.nodes, height]), ways.lengths, ways.before)

    @classmethod
    def _among(
        cls,
        obstacles: FloatArray,
        stations: FloatArray,
        extent: FloatArray,
        clearance_m: float,
        keep_out: Sequence[Box],
    ) -> _Ways:
        """Return the ways among points (k, d), within the extent (m, d) of other points."""
        low, high = extent.min(axis=0), extent.max(axis=0)
        step = float((np.prod(np.maximum(high - low, 0.1)) / _MOST_NODES) ** (1 / len(low)))
        step = max(_STEP_M, step)
        axes = [np.arange(a, b + step, step) for a, b in zip(low, high, strict=True)]
        lattice = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(low))
        nodes = np.vstack([stations, lattice])
        room = np.full(len(nodes), np.inf)
        if len(obstacles):
            room = cKDTree(obstacles).query(nodes)[0] - clearance_m
        for box in keep_out:
            room = np.minimum(room, box.distance(nodes, nodes.shape[1]))
        kept = (room > 0) | (np.arange(len(nodes)) < len(stations))
        nodes, room = nodes[kept], room[kept]
        pairs = cKDTree(nodes).query_pairs(1.01 * np.sqrt(len(low)) * step, output_type="ndarray")
        length = np.linalg.norm(nodes[pairs[:, 0]] - nodes[pairs[:, 1]], axis=1)
        safe = (room[pairs] > 0).all(axis=1) & (room[pairs].sum(axis=1) >= length)
        steps = (np.maximum(length[safe], 1e-9), (pairs[safe, 0], pairs[safe, 1]))
        graph = coo_array(steps, shape=(len(nodes),) * 2).tocsr()
        ends = np.arange(len(stations))
        lengths, before = dijkstra(graph, directed=False, indices=ends, return_predecessors=True)
        return cls(nodes, lengths[:, : len(stations)], before)

    def leg(self, a: int, b: int) -> Leg:
        """Return the shortest way from station a to station b."""
        if not np.isfinite(self.lengths[a, b]):
            return Leg(np.zeros((0, 3)), np.inf)
        way = [b]
        while way[-1] != a:
            way.append(int(self.before[a, way[-1]]))
        return Leg(self.nodes[way[::-1]], float(self.lengths[a, b]))


def _floor_height(points: FloatArray, stations: FloatArray, body_m: float) -> float:
    """Height of what most stations stand on: of the highest surface point below each."""
    below: list[float] = []
    for station, near in zip(
        stations, cKDTree(points[:, :2]).query_ball_point(stations[:, :2], body_m), strict=True
    ):
        heights = points[near, 2]
        below.extend(np.sort(heights[heights < station[2] - body_m])[-1:])
    return float(np.median(below)) if below else float(points[:, 2].min(initial=np.inf))


@dataclass(frozen=True, slots=True)
class Overlap:
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
class Stations:
    """A short tour with collision-free legs, and all pairs of a plan's stations that are linked.

    `n_groups` are the groups of views that links join; 1 when all scans can be registered.
    """

    tour: Tour
    overlaps: tuple[Overlap, ...]
    n_groups: int

    def to_json(self) -> dict[str, Any]:
        """Return the contents of `stations.json`."""
        links = [overlap.to_json() for overlap in self.overlaps]
        return {"tour": self.tour.to_json(), "overlaps": links, "groups": self.n_groups}
