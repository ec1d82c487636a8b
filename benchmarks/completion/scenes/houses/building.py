# SPDX-License-Identifier: MIT
"""Building: a house of a file, its rooms cut into rectangles that are furnished by a seed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from benchmarks.completion.scenes.houses.furnishing import furnish
from benchmarks.completion.scenes.houses.furniture.fittings import MIRROR
from benchmarks.completion.scenes.houses.furniture.parts import Part, motion, moved, scene_of
from benchmarks.completion.scenes.houses.placing import Layout, Taken
from benchmarks.completion.scenes.houses.plan import Plan, Room, Side, Wall
from nbv.visibility.standing.columns import cut_columns
from nbv.visibility.standing.floors import find_floors
from nbv.visibility.standing.partition import find_rooms
from scenes.checks import BoolArray, FloatArray
from scenes.rays.raycast import RayCaster
from scenes.world.scene import Scene

_NARROWEST_M, _LEAST_M2 = 1.5, 4.0  # of a rectangle
_CEILING_M = 2.6  # where there is none
_INSET_M, _REACH_M, _EVEN_M = 0.3, 0.15, 0.03  # of rays at walls: start, farthest wall, what is one face
_HEIGHTS_M = (0.25, 0.9, 1.7)
_PASSAGE_M = 0.7  # before a way out of a rectangle
_PLASTER = (0.87, 0.85, 0.81)


@dataclass(frozen=True, slots=True)
class Rectangle:
    """Part of a room's floor: corners, level and height of the ceiling above it, metres."""

    low: tuple[float, float]
    high: tuple[float, float]
    level: float
    height: float


@dataclass(frozen=True, eq=False)
class Building:
    """A house with furniture.

    Attributes
    ----------
    scene : Scene
        Everything, each part with its name; metres, z up.
    standing : tuple of (polygon, float)
        For each rectangle where a person can stand, and the level of its floor.
    """

    scene: Scene
    standing: tuple[tuple[BaseGeometry, float], ...]

    @cached_property
    def caster(self) -> RayCaster:
        """The house, to cast rays at."""
        return self.scene.ray_caster()

    @cached_property
    def mirrors(self) -> BoolArray:
        """Which surfaces (n_surfaces,) are mirrors."""
        return np.array([MIRROR in name.split(": ")[-1] for name in self.scene.surface_names])


def furnished(shell: Scene, rng: np.random.Generator) -> Building:
    """Return a house without furniture, furnished; the same generator gives the same bytes.

    Pieces stand before walls, not before windows, and leave the ways out of each rectangle clear.
    """
    caster = shell.ray_caster()
    mesh = shell.mesh
    parts = [
        Part(name, mesh.corners[mesh.face_surface == k], _PLASTER)
        for k, name in enumerate(shell.surface_names)
        if (mesh.face_surface == k).any()
    ]
    standing = []
    density = float(rng.uniform(0.1, 0.7))
    for number, one in enumerate(rectangles_of(shell, caster)):
        layout = _layout(number, one, caster, rng)
        furnish(layout, rng, float(np.clip(density * rng.uniform(0.6, 1.4), 0, 1)))
        parts += moved(layout.parts, motion((0, 0, one.level)))
        standing.append((layout.standing_room(), one.level))
    return Building(scene_of(f"{shell.name}, furnished", parts), tuple(standing))


def rectangles_of(shell: Scene, caster: RayCaster) -> list[Rectangle]:
    """Return rectangles along the axes that lie within the rooms of a house, the largest of each first."""
    rooms = find_rooms(find_floors(cut_columns(shell.mesh, caster), caster), caster)
    columns = rooms.floors.columns
    found = []
    for room in rooms.rooms:
        if room.is_outside:
            continue
        free = np.zeros(columns.shape, np.bool_)
        free.ravel()[columns.cell[rooms.room == room.number]] = True
        height = _CEILING_M if room.ceiling_m is None else room.ceiling_m - room.level_m
        for i0, i1, j0, j1 in _largest_first(free, columns.cell_m):
            low = columns.low + columns.cell_m * np.array([i0, j0])
            high = columns.low + columns.cell_m * np.array([i1, j1])
            found.append(Rectangle((low[0], low[1]), (high[0], high[1]), room.level_m, height))
    return found


def _largest_first(free: BoolArray, cell_m: float) -> Iterator[tuple[int, int, int, int]]:
    """Cells from and to of rectangles of free cells, each taken out before the next is looked for."""
    left, narrow = free.copy(), int(np.ceil(_NARROWEST_M / cell_m))
    while True:
        best, area = None, _LEAST_M2 / cell_m**2
        run = np.zeros(left.shape[1], np.int64)
        for i, row in enumerate(left):
            run = np.where(row, run + 1, 0)
            for deep in np.unique(run[run >= narrow]):
                for j0, j1 in _runs(run >= deep):
                    if j1 - j0 >= narrow and deep * (j1 - j0) > area:
                        best, area = (i + 1 - int(deep), i + 1, j0, j1), deep * (j1 - j0)
        if best is None:
            return
        yield best
        left[best[0] : best[1], best[2] : best[3]] = False


def _runs(true: BoolArray) -> list[tuple[int, int]]:
    """Where runs of True begin and end."""
    steps = np.diff(np.concatenate([[0], true.astype(np.int8), [0]]))
    return list(zip(np.flatnonzero(steps > 0).tolist(), np.flatnonzero(steps < 0).tolist(), strict=True))


def _layout(number: int, one: Rectangle, caster: RayCaster, rng: np.random.Generator) -> Layout:
    """A rectangle with its walls where rays meet them, and its ways out kept clear."""
    (x0, y0), (x1, y1) = one.low, one.high
    corners = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])
    walls, sides, passages = [], [], []
    for k, corner in enumerate(corners):
        along = corners[(k + 1) % 4] - corner
        length = float(np.linalg.norm(along))
        along /= length
        inward = np.array([-along[1], along[0]])
        at = np.arange(0.05, length, 0.05)
        away = _to_wall(caster, corner + np.outer(at, along), inward, one.level)
        near = away[np.abs(away) < _REACH_M]
        face = float(near.min()) if len(near) else 0.0
        walls.append(Wall(corner - face * inward, along, 0.0, False))
        for first, last in _runs(np.abs(away - face).max(axis=1) < _EVEN_M):
            sides.append(Side(k, 1, float(at[first]), float(at[last - 1])))
        for first, last in _runs(away.min(axis=1) > _REACH_M):
            passages.append(walls[k].place(at[[first, last - 1]], np.zeros(2), 0.0)[:, :2])
    low = np.array([walls[3].point[0], walls[0].point[1]])
    high = np.array([walls[1].point[0], walls[2].point[1]])
    outline = np.array([low, [high[0], low[1]], high, [low[0], high[1]]])
    room = Room(
        outline, tuple(sides) or _bare(walls), np.array([[0.0, 0.0, one.height]]), _use(high - low, rng)
    )
    layout = Layout(Plan(tuple(walls), (room,)), room, number)
    for ends in passages:
        layout.taken.append(Taken(shapely.LineString(ends).buffer(_PASSAGE_M), 0.0, one.height))
    return layout


def _to_wall(caster: RayCaster, places: FloatArray, inward: FloatArray, level: float) -> FloatArray:
    """How far (n, 3) walls stand beyond places (n, 2) on a side, at three heights above the floor."""
    starts = np.concatenate(
        [np.column_stack([places + _INSET_M * inward, np.full(len(places), level + h)]) for h in _HEIGHTS_M]
    )
    ways = np.broadcast_to([-inward[0], -inward[1], 0.0], starts.shape)
    ranges = caster.first_hit(starts, np.ascontiguousarray(ways)).ranges
    return np.asarray(ranges.reshape(len(_HEIGHTS_M), -1).T - _INSET_M)


def _bare(walls: Sequence[Wall]) -> tuple[Side, ...]:
    """A side too short for anything: of a rectangle without walls."""
    return tuple(Side(k, 1, 0.0, 0.01) for k in range(len(walls)))


def _use(size: NDArray[np.float64], rng: np.random.Generator) -> str:
    """What a rectangle is used for, by its area."""
    if size.prod() > 12.0:
        return str(rng.choice(["living", "bedroom", "kitchen", "living"]))
    return str(rng.choice(["study", "bedroom", "bath", "hall", "storage", "kitchen"]))
