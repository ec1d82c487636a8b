# SPDX-License-Identifier: MIT
"""Layout: the plan of a storey, divided into rooms and what is none, by its walls and the beams.

The lines of walls cut the plan into convex cells. Which of them are inside is a minimum cut (Kolmogorov &
Zabih 2004): outside costs the area that beams crossed between floor and ceiling, inside the area that none
did, and a boundary its length where no wall was measured that faces inwards. Cells between which there is
mostly wall are of different rooms.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy import ndimage
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import breadth_first_order, connected_components, maximum_flow

from completion.room import limits
from completion.room.planes import Beams
from completion.room.walls import Wall
from scenes.checks import BoolArray, FloatArray, IntArray, freeze_arrays
from texture.engine.compiled import compiled


@dataclass(frozen=True, slots=True, eq=False)
class Layout:
    """The plan of a storey, working frame.

    Attributes
    ----------
    axes : (2, 3) float
        Level unit directions of the plan.
    lines : (l, 3) float
        Lines of walls, a x + b y = c, unit (a, b).
    cells : (n, l) bool
        Of each cell, on which side of each line it is.
    rooms : (n,) int64
        Which room each cell is of, from 1; 0 of what is none.
    own : tuple of int
        The rooms in which scanners stand.
    low, high : (2,) float
        What the plan shows, coordinates along its axes, metres.
    floor_m, ceiling_m : float
        From which height to which one it holds, metres along what is up.
    closed : (rows, columns) uint8
        In how many of the four ways along its axes a wall ends the room, from each square of the plan.
    """

    axes: FloatArray
    lines: FloatArray
    cells: BoolArray
    rooms: IntArray
    own: tuple[int, ...] = ()
    low: FloatArray = field(default_factory=lambda: np.zeros(2))
    high: FloatArray = field(default_factory=lambda: np.zeros(2))
    floor_m: float = -np.inf
    ceiling_m: float = np.inf
    closed: NDArray[np.uint8] = field(default_factory=lambda: np.zeros((0, 0), dtype=np.uint8))

    def __post_init__(self) -> None:
        freeze_arrays(self)

    def rooms_at(self, points: FloatArray) -> IntArray:
        """Which room (n,) points (n, 3) are in; 0 for none."""
        if not len(self.lines):
            return np.zeros(len(points), dtype=np.int64)
        keys, own = _keys(_sides(points @ self.axes.T, self.lines)), _keys(self.cells)
        order = np.argsort(own)
        at = np.clip(np.searchsorted(own[order], keys), 0, len(own) - 1)
        found = order[at]
        return np.where(own[found] == keys, self.rooms[found], 0)

    def closed_at(self, points: FloatArray) -> FloatArray:
        """Of the four ways along the axes, the share (n,) in which a wall ends the room of points (n, 3)."""
        if not self.closed.size:
            return np.zeros(len(points))
        shape = np.array(self.closed.shape[::-1])
        place = (points @ self.axes.T - self.low) / (self.high - self.low) * shape
        column, row = np.clip(place.astype(np.int64), 0, shape - 1).T
        return np.asarray(self.closed[row, column] / 4.0, dtype=np.float64)

    def numbered_from(self, n_before: int) -> Layout:
        """Return the same with its rooms numbered on from `n_before`."""
        rooms = np.where(self.rooms > 0, self.rooms + n_before, 0)
        return replace(self, rooms=rooms, own=tuple(room + n_before for room in self.own))

    def outlines(self) -> Iterator[tuple[int, shapely.Geometry]]:
        """Yield the rooms by number, each as a polygon, or several, in coordinates along the axes."""
        box = shapely.box(*self.low, *self.high)
        reach = float(np.linalg.norm(self.high - self.low))
        middle = (self.low + self.high) / 2
        drawn = [box.exterior]
        for a, b, c in self.lines:
            foot = middle + (c - np.array([a, b]) @ middle) * np.array([a, b])
            along = reach * np.array([-b, a])
            drawn.append(shapely.LineString([foot - along, foot + along]))
        cells = shapely.get_parts(shapely.polygonize([shapely.union_all(drawn)]))
        cells = cells[shapely.contains_properly(shapely.buffer(box, 1e-6), cells)]
        places = shapely.get_coordinates(shapely.point_on_surface(cells))
        rooms = self.rooms_at(places @ self.axes)
        for room in np.unique(rooms[rooms > 0]).tolist():
            yield room, shapely.union_all(cells[rooms == room])


NO_LAYOUT = Layout(np.eye(3)[:2], np.zeros((0, 3)), np.zeros((0, 0), dtype=np.bool_), np.zeros(0, np.int64))


def find_layout(
    walls: Sequence[Wall],
    measured: Sequence[FloatArray],
    beams: Beams,
    up: FloatArray,
    band: tuple[float, float],
) -> Layout:
    """Divide the plan of a storey by its walls.

    Parameters
    ----------
    walls : sequence of Wall
        The walls.
    measured : sequence of (n, 3) float
        Points of each.
    beams : Beams
        Of all scans.
    up : (3,) float
        Which way is up in the working frame.
    band : two floats
        From which height to which one beams tell that there is a room, metres along `up`.
    """
    if not walls:
        return replace(NO_LAYOUT, floor_m=band[0] - limits.BAND_M)
    axes = _axes(walls, up)
    raster = _Raster.of(beams, axes, up, band)
    known = [_Support.of(wall, points, axes) for wall, points in zip(walls, measured, strict=True)]
    known += [jamb for wall, each in zip(walls, known, strict=True) for jamb in each.jambs()]
    lines = np.array([support.line for support in known])
    sides = _sides(raster.places(), lines)
    _, first, cell = np.unique(_keys(sides), return_index=True, return_inverse=True)
    eyes = np.unique(beams.origin, axis=0)
    free, unseen = raster.areas(cell, len(first))
    free[cell[raster.number(eyes @ axes.T)]] += limits.STANDING_M2
    edges = _Edges.of(raster, cell, sides, lines, known)
    inside = _minimum_cut(limits.FREE_M2 * free, limits.UNSEEN_M2 * unseen, edges)
    rooms = _number_rooms(inside, edges, free)
    layout = Layout(
        axes, lines, sides[first], rooms, low=raster.low, high=raster.high, floor_m=band[0] - limits.BAND_M
    )
    own = tuple(int(room) for room in np.unique(layout.rooms_at(eyes)) if room > 0)
    closed = np.zeros(raster.free.shape, dtype=np.uint8)
    _count_closed(rooms[cell].reshape(closed.shape), *_walls_beside(raster, sides, lines, known), closed)
    return replace(layout, own=own, closed=closed)


def _axes(walls: Sequence[Wall], up: FloatArray) -> FloatArray:
    """Level directions (2, 3) along and across the largest wall."""
    largest = max(walls, key=lambda wall: float(np.prod(wall.high - wall.low)))
    along = largest.along - (largest.along @ up) * up
    along = along / np.linalg.norm(along)
    return np.stack([along, np.cross(up, along)])


def _sides(places: FloatArray, lines: FloatArray) -> BoolArray:
    """On which side (n, l) of each line places (n, 2) are."""
    return np.asarray(places @ lines[:, :2].T > lines[:, 2], dtype=np.bool_)


def _keys(sides: BoolArray) -> NDArray[np.void]:
    """Sides (n, l) as one value (n,) each."""
    packed = np.ascontiguousarray(np.packbits(sides, axis=1))
    return packed.view(np.dtype((np.void, packed.shape[1]))).ravel()


@dataclass(frozen=True, slots=True, eq=False)
class _Raster:
    """The plan in squares: which of them (rows, columns) beams crossed, and which are near those."""

    low: FloatArray
    cell_m: float
    free: BoolArray
    near: BoolArray

    @classmethod
    def of(cls, beams: Beams, axes: FloatArray, up: FloatArray, band: tuple[float, float]) -> _Raster:
        frame = np.vstack([axes, up])
        begin, end = beams.origin @ frame.T, beams.point @ frame.T
        low = np.quantile(end[:, :2], limits.OUTLYING / 2, axis=0)
        high = np.quantile(end[:, :2], 1 - limits.OUTLYING / 2, axis=0)
        low, high = np.minimum(low, begin[:, :2].min(axis=0)), np.maximum(high, begin[:, :2].max(axis=0))
        low, high = low - limits.AROUND_M, high + limits.AROUND_M
        cell_m = max(limits.PLAN_M, float(np.sqrt(np.prod(high - low) / limits.PLAN_CELLS)))
        shape = np.ceil((high - low) / cell_m).astype(np.int64)
        count = np.zeros((shape[1], shape[0]), np.int64)
        _cross(begin, end, low, cell_m, band[0], band[1], limits.SHORT_M + 3 * beams.sigma, count)
        free = count >= limits.CROSSINGS
        near = ndimage.distance_transform_edt(~free) * cell_m <= limits.AROUND_M
        return cls(low, cell_m, free, near)

    def areas(self, cell: IntArray, n: int) -> tuple[FloatArray, FloatArray]:
        """Of n cells, by the cell (squares,) of each square: square metres that beams crossed, and others."""
        free, near = self.free.ravel(), self.near.ravel()
        square = self.cell_m**2
        counts = (np.bincount(cell[part], minlength=n) for part in (free, near & ~free))
        is_free, is_unseen = (square * count.astype(np.float64) for count in counts)
        return is_free, is_unseen

    def number(self, places: FloatArray) -> IntArray:
        """Of the squares, the one (n,) that each place (n, 2) is in."""
        column, row = np.floor((places - self.low) / self.cell_m).astype(np.int64).T
        return np.asarray(row * self.free.shape[1] + column)

    @property
    def high(self) -> FloatArray:
        """Upper corner (2,) of all squares."""
        return self.low + self.cell_m * np.array(self.free.shape[::-1])

    def places(self) -> FloatArray:
        """Middles (n, 2) of the squares."""
        row, column = np.indices(self.free.shape)
        return self.low + self.cell_m * (np.column_stack([column.ravel(), row.ravel()]) + 0.5)


@compiled
def _cross(
    begin: FloatArray,
    end: FloatArray,
    low: FloatArray,
    cell_m: float,
    bottom: float,
    top: float,
    short_m: FloatArray,
    count: IntArray,
) -> None:
    """Count how many beams (n, 3) cross each square (rows, columns) between two heights."""
    for k in range(len(begin)):
        length = np.sqrt(((end[k] - begin[k]) ** 2).sum())
        n = int((length - short_m[k]) / (0.5 * cell_m))
        last = -1
        for i in range(n):
            part = (i + 0.5) * 0.5 * cell_m / length
            height = begin[k, 2] + part * (end[k, 2] - begin[k, 2])
            if height < bottom or height > top:
                continue
            column = int((begin[k, 0] + part * (end[k, 0] - begin[k, 0]) - low[0]) / cell_m)
            row = int((begin[k, 1] + part * (end[k, 1] - begin[k, 1]) - low[1]) / cell_m)
            if not (0 <= row < count.shape[0] and 0 <= column < count.shape[1]):
                continue
            if row * count.shape[1] + column != last:
                last = row * count.shape[1] + column
                count[row, column] += 1


@dataclass(frozen=True, slots=True, eq=False)
class _Support:
    """A line in the plan, and how probably a wall stands on it: in columns from `low` on."""

    line: FloatArray  # (3,) a x + b y > c on its inner side
    along: FloatArray  # (2,)
    low: float
    share: FloatArray  # (n,)
    ends: FloatArray  # (2,) of what was measured, along
    is_measured: bool = True  # else it is only supposed, and beams contradict it

    @classmethod
    def of(cls, wall: Wall, points: FloatArray, axes: FloatArray) -> _Support:
        """Look at the points of a wall, and at the beams that passed it."""
        normal = axes @ wall.plane.normal_direction
        normal = normal / np.linalg.norm(normal)
        line = np.append(normal, normal @ (axes @ wall.plane.point))
        along = axes @ wall.along
        along = along / np.linalg.norm(along)
        where = (points @ axes.T) @ along
        shift = float(np.mean(where - points @ wall.along))
        ends = np.quantile(where, (limits.OUTLYING, 1 - limits.OUTLYING))
        low = float(where.min()) - 3 * limits.SUPPORT_M
        n = int((float(where.max()) + 3 * limits.SUPPORT_M - low) / limits.COLUMN_M) + 1
        column = ((where - low) / limits.COLUMN_M).astype(np.int64)
        apart = ndimage.distance_transform_edt(np.bincount(column, minlength=n) == 0) * limits.COLUMN_M
        share = np.exp(-np.maximum(apart - limits.COLUMN_M, 0) / limits.SUPPORT_M)
        tops = np.full(n, -np.inf)
        np.maximum.at(tops, column, points @ wall.up)
        passed = ((wall.crossed[:, 0] + shift - low) / limits.COLUMN_M).astype(np.int64)
        inside = (passed >= 0) & (passed < n)
        passed, height = passed[inside], wall.crossed[inside, 1]
        is_passed = np.bincount(passed[height > tops[passed]], minlength=n) >= limits.CROSSINGS
        return cls(line, along, low, np.where(is_passed, 0.0, share), ends)

    def jambs(self) -> list[_Support]:
        """Lines at right angles to it where it was seen to end: something goes on behind it from there."""
        lines = []
        for end, way in zip(self.ends, (-1.0, 1.0), strict=True):
            beside = end + way * limits.COLUMN_M * np.array([1.5, 2.5, 3.5])
            column = np.clip(((beside - self.low) / limits.COLUMN_M).astype(np.int64), 0, len(self.share) - 1)
            is_seen = bool((self.share[column] == 0).any())
            normal = self.line[:2]
            behind = np.arange(0.0, 3 * limits.SUPPORT_M, limits.COLUMN_M)
            share = is_seen * limits.JAMB * np.exp(-behind / limits.SUPPORT_M)
            line = np.append(way * self.along, way * end)
            at = -float(self.line[2])
            lines.append(_Support(line, -normal, at, share, np.zeros(2), is_measured=False))
        return lines

    def at(self, places: FloatArray) -> FloatArray:
        """The support (n,) at places (n, 2) of the plan."""
        column = ((places @ self.along - self.low) / limits.COLUMN_M).astype(np.int64)
        inside = (column >= 0) & (column < len(self.share))
        return np.where(inside, self.share[np.clip(column, 0, len(self.share) - 1)], 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class _Edges:
    """Ordered pairs of cells that touch: `front` is where a wall between them would face."""

    front: IntArray
    back: IntArray
    length: FloatArray  # metres
    wall: FloatArray  # metres of them at which a wall stands that faces the front one
    crossed: FloatArray  # metres of them at which beams crossed both, and no wall stands

    @classmethod
    def of(
        cls,
        raster: _Raster,
        cell: IntArray,
        sides: BoolArray,
        lines: FloatArray,
        support: Sequence[_Support],
    ) -> _Edges:
        """Walk along all borders between cells."""
        places = raster.places()
        number = np.arange(cell.size).reshape(raster.free.shape)
        parts: list[tuple[IntArray, IntArray, FloatArray, FloatArray, FloatArray]] = []
        for a, b in ((number[:, :-1], number[:, 1:]), (number[:-1], number[1:])):
            border = cell[a.ravel()] != cell[b.ravel()]
            border &= raster.near.ravel()[a.ravel()] & raster.near.ravel()[b.ravel()]
            first, second = a.ravel()[border], b.ravel()[border]
            place = (places[first] + places[second]) / 2
            free = raster.free.ravel()[first] & raster.free.ravel()[second]
            length, facing = np.full(len(first), np.inf), np.zeros((2, len(first)))
            for k, line in enumerate(lines):
                at = np.flatnonzero(sides[first, k] != sides[second, k])
                length[at] = np.minimum(length[at], raster.cell_m / np.abs(line[:2]).sum())
                towards = np.where(sides[first[at], k], 0, 1)
                stands = support[k].at(place[at]) * (support[k].is_measured | ~free[at])
                facing[towards, at] = np.maximum(facing[towards, at], stands)
            free &= facing.max(axis=0) < limits.PARTED
            for front, back, share in ((first, second, facing[0]), (second, first, facing[1])):
                parts.append((cell[front], cell[back], length, share * length, free * length))
        front, back, length, wall, crossed = (np.concatenate(part) for part in zip(*parts, strict=True))
        n = int(cell.max()) + 1
        pair, which = np.unique(front * n + back, return_inverse=True)
        metres = np.stack([length, wall, crossed])
        sums = [np.bincount(which, values, len(pair)).astype(np.float64) for values in metres]
        return cls(pair // n, pair % n, *sums)


def _walls_beside(
    raster: _Raster, sides: BoolArray, lines: FloatArray, support: Sequence[_Support]
) -> tuple[BoolArray, BoolArray]:
    """Whether a wall stands between squares and those right of them, and between squares and those below."""
    places = raster.places()
    number = np.arange(raster.free.size).reshape(raster.free.shape)
    walls = []
    for a, b in ((number[:, :-1], number[:, 1:]), (number[:-1], number[1:])):
        first, second = a.ravel(), b.ravel()
        stands = np.zeros(len(first), dtype=np.bool_)
        free = raster.free.ravel()[first] & raster.free.ravel()[second]
        for k in range(len(lines)):
            at = np.flatnonzero(sides[first, k] != sides[second, k])
            there = support[k].at((places[first[at]] + places[second[at]]) / 2) >= limits.PARTED
            stands[at] |= there & (support[k].is_measured | ~free[at])
        walls.append(stands.reshape(a.shape))
    return walls[0], walls[1]


@compiled
def _count_closed(rooms: IntArray, right: BoolArray, below: BoolArray, closed: NDArray[np.uint8]) -> None:
    """Add up in how many of four ways from each square of a room (rows, columns) a wall ends it."""
    n_rows, n_columns = rooms.shape
    for row in range(n_rows):
        ends = False
        for column in range(1, n_columns):
            if rooms[row, column] != rooms[row, column - 1]:
                ends = right[row, column - 1]
            closed[row, column] += ends and rooms[row, column] > 0
        ends = False
        for column in range(n_columns - 2, -1, -1):
            if rooms[row, column] != rooms[row, column + 1]:
                ends = right[row, column]
            closed[row, column] += ends and rooms[row, column] > 0
    for column in range(n_columns):
        ends = False
        for row in range(1, n_rows):
            if rooms[row, column] != rooms[row - 1, column]:
                ends = below[row - 1, column]
            closed[row, column] += ends and rooms[row, column] > 0
        ends = False
        for row in range(n_rows - 2, -1, -1):
            if rooms[row, column] != rooms[row + 1, column]:
                ends = below[row, column]
            closed[row, column] += ends and rooms[row, column] > 0


def _minimum_cut(outside: FloatArray, inside: FloatArray, edges: _Edges) -> BoolArray:
    """Which cells (n,) are inside, by what it costs that they are outside or inside."""
    n, unit = len(outside), 1000.0
    source, sink = n, n + 1
    every = np.arange(n)
    rows = np.concatenate([np.full(n, source), every, edges.front])
    columns = np.concatenate([every, np.full(n, sink), edges.back])
    costs = np.concatenate([outside, inside, edges.length - edges.wall])
    capacity = np.round(costs * unit).astype(np.int32)
    graph = csr_array(coo_array((capacity, (rows, columns)), shape=(n + 2, n + 2)))
    graph.sum_duplicates()
    flow = maximum_flow(graph, source, sink).flow
    left = csr_array(graph - flow)
    left.data = np.maximum(left.data, 0)
    left.eliminate_zeros()
    reached = np.zeros(n + 2, dtype=np.bool_)
    reached[breadth_first_order(left, source, return_predecessors=False)] = True
    return reached[:n]


def _number_rooms(inside: BoolArray, edges: _Edges, free: FloatArray) -> IntArray:
    """Rooms (n,) from 1, those with most free area first; 0 outside.

    Cells between which beams crossed the border, and that is no wall for the most part, are of one room. What
    was not seen is of the room to which it is most open.
    """
    n = len(inside)
    within = inside[edges.front] & inside[edges.back]
    key = np.minimum(edges.front, edges.back) * n + np.maximum(edges.front, edges.back)
    pair, which = np.unique(key[within], return_inverse=True)
    first, second = pair // n, pair % n
    length, wall, crossed = (
        np.bincount(which, values[within], len(pair)) for values in (edges.length, edges.wall, edges.crossed)
    )
    is_border = wall < limits.PARTED * length / 2  # between parts of one room
    is_open = is_border & (crossed > 0)
    graph = coo_array((is_open[is_open], (first[is_open], second[is_open])), shape=(n, n))
    _, part = connected_components(graph, directed=False)
    size = np.bincount(part, free * inside, part.max() + 1)
    order = np.argsort(-size, kind="stable")
    numbers = np.zeros(len(size), np.int64)
    n_rooms = int(np.count_nonzero(size > limits.LEAST_FREE_M2))
    numbers[order[:n_rooms]] = np.arange(1, n_rooms + 1)
    rooms = np.where(inside, numbers[part], 0)
    while n_rooms:
        to = np.zeros((n, n_rooms + 1))
        for a, b in ((first, second), (second, first)):
            np.add.at(to, (a[is_border], rooms[b[is_border]]), (length / 2 - wall)[is_border])
        to[:, 0] = 0.0
        joins = inside & (rooms == 0) & (to.max(axis=1) > 0)
        if not joins.any():
            break
        rooms[joins] = to[joins].argmax(axis=1)
    return rooms
