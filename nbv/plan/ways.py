# SPDX-License-Identifier: MIT
"""Ways: the shortest ways between stations that keep clear of every surface, on foot or through the air.

Ways lead along a lattice. A step is taken only where the free balls around its two ends, less the radius of
what is carried, hold all of it between them: a sufficient condition that no step passes through a surface.
Within a building somebody walks: then the lattice lies on all that is level with headroom above
(`nbv.visibility.standing.columns`), storey by storey, and what stands on it higher than a step is in the way,
so that nobody climbs through a window. Treads are a step from one another: stairs join storeys.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from nbv.visibility.samples import sample_surface
from nbv.visibility.standing.columns import Columns, cut_columns
from nbv.visibility.standing.floors import HEADROOM_M, STEP_M
from nbv.visibility.zones import Box
from scenes.checks import FloatArray
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.rays.raycast import RayCaster

BODY_M = 0.15  # radius of the sensor's head, which is carried
_MOST_NODES = 60_000  # of the lattice in the air
_MOST_PLACES = 120_000  # on floors; of more only every second or third cell of either axis is one
_STEP_M = 0.15  # of the lattice in the air
_SAMPLES_A_BODY = 4.0  # samples of the surface along a body's radius
_MOST_OBSTACLES = 1e6  # of them; in scenes of more than 1,400 m2 they are further apart
_STEEPEST = float(np.cos(np.radians(45.0)))  # of what one walks on
_LEVEL_M = 0.05  # floors that differ by less are looked at together


@dataclass(frozen=True, slots=True, eq=False)
class Leg:
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
        step = max(_STEP_M, float((np.prod(np.maximum(high - low, 0.1)) / _MOST_NODES) ** (1 / 3)))
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
    def walked(
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
    spacing = max(body_m / _SAMPLES_A_BODY, float(np.sqrt(mesh.face_areas().sum() / _MOST_OBSTACLES)))
    return sample_surface(mesh, spacing).points, spacing


def _walkable(columns: Columns) -> tuple[FloatArray, FloatArray, float]:
    """Places (m, 2) on which one can walk, the height (m,) of each, and how far they are apart, metres."""
    walkable = (columns.top - columns.bottom >= HEADROOM_M) & (columns.slope >= _STEEPEST)
    every = max(int(np.ceil(np.sqrt(np.count_nonzero(walkable) / _MOST_PLACES))), 1)
    x, y = np.divmod(columns.cell, columns.shape[1])
    spans = np.flatnonzero(walkable & (x % every == 0) & (y % every == 0))
    return columns.places(columns.cell[spans]), columns.bottom[spans], every * columns.cell_m


def _floor_below(columns: Columns, sensors: FloatArray) -> FloatArray:
    """Height (n,) of what lies below each sensor (n, 3), metres; its own where nothing does."""
    found = sensors[:, 2].copy()
    for k, cell in enumerate(columns.cells_of(sensors[:, :2]).tolist()):
        spans = np.arange(columns.start[cell], columns.start[cell + 1]) if cell >= 0 else np.zeros(0, int)
        below = columns.bottom[spans][columns.bottom[spans] < sensors[k, 2]]
        found[k] = below.max(initial=-np.inf) if len(below) else found[k]
    return found


def _room_around(
    flat: FloatArray, floor: FloatArray, points: FloatArray, clearance_m: float, enough_m: float
) -> FloatArray:
    """Distance (m,) of places (m, 2) on floors of heights (m,) from what is in a person's way there.

    That are the points (k, 3) higher than a step above the floor and lower than the headroom; the clearance
    is taken off. Distances from `enough_m` on may come out as inf.
    """
    room = np.full(len(flat), np.inf)
    points = points[np.argsort(points[:, 2], kind="stable")]
    level = np.rint(floor / _LEVEL_M)
    for one in np.unique(level):
        here = np.flatnonzero(level == one)
        band = np.searchsorted(points[:, 2], [floor[here].max() + STEP_M, floor[here].min() + HEADROOM_M])
        among = points[band[0] : band[1], :2]
        reach = clearance_m + enough_m
        low, high = flat[here].min(axis=0) - reach, flat[here].max(axis=0) + reach
        among = among[((among >= low) & (among <= high)).all(axis=1)]
        if len(among):
            room[here] = cKDTree(among).query(flat[here], distance_upper_bound=reach)[0] - clearance_m
    return room
