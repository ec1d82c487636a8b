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
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import breadth_first_order, connected_components, maximum_flow

from completion.room import limits
from completion.room.plan_squares import PlanSquares
from completion.room.planes import Beams
from completion.room.wall_lines import WallLine
from completion.room.walls import Wall
from scenes.checks import ArrayValue, BoolArray, FloatArray, IntArray
from texture.engine.compiled import compiled


@dataclass(frozen=True, slots=True, eq=False)
class Layout(ArrayValue):
    """The plan of a storey, working frame.

    Attributes
    ----------
    axes : (2, 3) float
        Level unit directions of the plan.
    lines : (l, 3) float
        Lines of walls, a x + b y = c, unit (a, b).
    walls : (l,) int64
        The number of the surface whose line each is, from 0; -1 of what is only supposed at a wall's end.
    cells : (n, l) bool
        Of each cell, on which side of each line it is; in the order of their bits.
    rooms : (n,) int64
        Which room each cell is of, from 1; 0 of what is none.
    enclosed : (r,) float
        Share of the outline of each room at which a wall stands; the rooms in order.
    scanner_rooms : tuple of int
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
    walls: IntArray
    cells: BoolArray
    rooms: IntArray
    enclosed: FloatArray
    scanner_rooms: tuple[int, ...] = ()
    low: FloatArray = field(default_factory=lambda: np.zeros(2))
    high: FloatArray = field(default_factory=lambda: np.zeros(2))
    floor_m: float = -np.inf
    ceiling_m: float = np.inf
    closed: NDArray[np.uint8] = field(default_factory=lambda: np.zeros((0, 0), dtype=np.uint8))

    def rooms_at(self, points: FloatArray) -> IntArray:
        """Which room (n,) points (n, 3) are in; 0 for none, and beyond what the plan shows."""
        if not len(self.lines):
            return np.zeros(len(points), dtype=np.int64)
        places = points @ self.axes.T
        is_shown = ((places >= self.low) & (places <= self.high)).all(axis=1)
        wanted, known = _keys(_sides(places, self.lines)), _keys(self.cells)
        cell = np.clip(np.searchsorted(known, wanted), 0, len(known) - 1)
        return np.where(is_shown & (known[cell] == wanted), self.rooms[cell], 0)

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
        return replace(self, rooms=rooms, scanner_rooms=tuple(room + n_before for room in self.scanner_rooms))

    def outlines(self) -> Iterator[tuple[shapely.Geometry, float]]:
        """Yield each room as polygons, coordinates along the axes, and at which share of it a wall stands."""
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
        for room, enclosed in zip(np.unique(self.rooms[self.rooms > 0]), self.enclosed.tolist(), strict=True):
            yield _without_gaps(shapely.union_all(cells[rooms == room], grid_size=_EXACT_M)), enclosed


def _without_gaps(area: shapely.Geometry) -> shapely.Geometry:
    """An area without gaps where lines nearly meet, narrower than the squares by which it was found."""
    wider = shapely.buffer(area, limits.PLAN_M / 2, join_style="mitre")
    return shapely.simplify(shapely.buffer(wider, -limits.PLAN_M / 2, join_style="mitre"), _STRAIGHT_M)


_EXACT_M, _STRAIGHT_M = 1e-6, 1e-4  # to which corners of outlines are told, and are straight
_STEPS_M, _MOST_STEPS = 1000.0, 2.0**30  # of costs, in a metre and in all
NO_LAYOUT = Layout(
    axes=np.eye(3)[:2],
    lines=np.zeros((0, 3)),
    walls=np.zeros(0, np.int64),
    cells=np.zeros((0, 0), dtype=np.bool_),
    rooms=np.zeros(0, np.int64),
    enclosed=np.zeros(0),
)


def find_layout(
    walls: Sequence[Wall],
    beams: Beams,
    up: FloatArray,
    band: tuple[float, float],
) -> Layout:
    """Divide the plan of a storey by its walls.

    Parameters
    ----------
    walls : sequence of Wall
        The walls, as far as they stand in this storey.
    beams : Beams
        Of all scans.
    up : (3,) float
        Which way is up in the working frame.
    band : two floats
        From which height to which one beams tell that there is a room, metres along `up`.
    """
    if not walls:
        return NO_LAYOUT
    # 1. Cells: the lines of walls, and of where they end, cut the plan.
    axes = _axes(walls, up)
    squares = PlanSquares.of(beams, axes, up, band)
    drawn = [WallLine.of(wall, axes) for wall in walls]
    for jamb in [jamb for line in drawn for jamb in line.jambs()]:
        drawn += [] if any(jamb.is_along(line) for line in drawn) else [jamb]
    lines = np.array([line.line for line in drawn])
    sides = _sides(squares.places(), lines)
    _, first, cell = np.unique(_keys(sides), return_index=True, return_inverse=True)

    # 2. Inside: by what beams crossed, and by walls on the borders.
    eyes = np.unique(beams.origin, axis=0)
    crossed, unseen = squares.areas(cell, len(first))
    crossed[cell[squares.number(eyes @ axes.T)]] += limits.STANDING_M2
    borders = _Borders.of(squares, cell, sides, drawn)
    edges = _Edges.of(borders, cell, squares.near.ravel())
    inside = _minimum_cut(limits.FREE_M2 * crossed, limits.UNSEEN_M2 * unseen, edges)

    # 3. Rooms: parts of the inside between which there is mostly wall.
    rooms = _number_rooms(inside, edges, crossed)
    closed = np.zeros(squares.free.shape, dtype=np.uint8)
    _count_closed(rooms[cell].reshape(closed.shape), *borders.beside(closed.shape), closed)
    layout = Layout(
        axes=axes,
        lines=lines,
        walls=np.array([line.number for line in drawn]),
        cells=sides[first],
        rooms=rooms,
        enclosed=borders.walled(rooms[cell]),
        low=squares.low,
        high=squares.high,
        closed=closed,
    )
    return replace(
        layout, scanner_rooms=tuple(np.unique(layout.rooms_at(eyes)[layout.rooms_at(eyes) > 0]).tolist())
    )


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
class _Borders:
    """Pairs of squares, by number, side by side in two cells."""

    first: IntArray
    second: IntArray
    length: FloatArray  # metres
    facing: FloatArray  # (2, n) how probably a wall stands between that faces the first, and the second
    free: BoolArray  # whether beams crossed both, and no wall stands between

    @classmethod
    def of(
        cls, squares: PlanSquares, cell: IntArray, sides: BoolArray, lines: Sequence[WallLine]
    ) -> _Borders:
        """Look along all lines, on whose `sides` (squares, l) the squares are."""
        places, number = squares.places(), np.arange(cell.size).reshape(squares.free.shape)
        pairs = ((number[:, :-1], number[:, 1:]), (number[:-1], number[1:]))
        first, second = (np.concatenate([pair[k].ravel() for pair in pairs]) for k in (0, 1))
        parts = cell[first] != cell[second]
        first, second = first[parts], second[parts]
        between = (places[first] + places[second]) / 2
        free = squares.free.ravel()[first] & squares.free.ravel()[second]
        length, facing = np.full(len(first), np.inf), np.zeros((2, len(first)))
        for k, line in enumerate(lines):
            at = np.flatnonzero(sides[first, k] != sides[second, k])
            length[at] = np.minimum(length[at], squares.side_m / np.abs(line.line[:2]).sum())
            towards = np.where(sides[first[at], k], 0, 1)
            stands = line.at(between[at]) * (line.is_measured | ~free[at])
            facing[towards, at] = np.maximum(facing[towards, at], stands)
        return cls(first, second, length, facing, free & (facing.max(axis=0) < limits.PARTED))

    def walled(self, rooms: IntArray) -> FloatArray:
        """Share of the outline of each room at which a wall stands, by the `rooms` (squares,) of all."""
        pair = np.concatenate([rooms[[self.first, self.second]], rooms[[self.second, self.first]]], axis=1)
        parts = (pair[0] > 0) & (pair[0] != pair[1])
        room, length = pair[0, parts] - 1, np.tile(self.length, 2)[parts]
        stands = np.tile(self.facing.max(axis=0) >= limits.PARTED, 2)[parts]
        n = int(rooms.max(initial=0))
        whole, wall = (np.bincount(room, values, n) for values in (length, length * stands))
        return np.asarray(wall / np.maximum(whole, 1e-9), dtype=np.float64)

    def beside(self, shape: tuple[int, ...]) -> tuple[BoolArray, BoolArray]:
        """Whether a wall stands between squares (rows, columns) and those right of them, and those below."""
        stands = self.facing.max(axis=0) >= limits.PARTED
        is_right = self.second - self.first == 1
        right, below = np.zeros(shape, dtype=np.bool_), np.zeros(shape, dtype=np.bool_)
        right.ravel()[self.first[stands & is_right]] = True
        below.ravel()[self.first[stands & ~is_right]] = True
        return right, below


@dataclass(frozen=True, slots=True, eq=False)
class _Edges:
    """Ordered pairs of cells that touch: `front` is where a wall between them would face."""

    front: IntArray
    back: IntArray
    length: FloatArray  # metres
    wall: FloatArray  # metres of them at which a wall stands that faces the front one
    crossed: FloatArray  # metres of them at which beams crossed both, and no wall stands

    @classmethod
    def of(cls, borders: _Borders, cell: IntArray, near: BoolArray) -> _Edges:
        """Add up the borders between squares that are `near` (squares,) what beams crossed."""
        counts = near[borders.first] & near[borders.second]
        first, second = cell[borders.first[counts]], cell[borders.second[counts]]
        length, facing = borders.length[counts], borders.facing[:, counts]
        pair, which = np.unique(
            np.concatenate([first, second]) * len(cell) + np.concatenate([second, first]), return_inverse=True
        )
        wall, crossed = (facing * length).ravel(), np.tile(borders.free[counts] * length, 2)
        metres = np.stack([np.tile(length, 2), wall, crossed])
        sums = [np.bincount(which, values, len(pair)).astype(np.float64) for values in metres]
        return cls(pair // len(cell), pair % len(cell), *sums)


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
    n = len(outside)
    source, sink = n, n + 1
    every = np.arange(n)
    rows = np.concatenate([np.full(n, source), every, edges.front])
    columns = np.concatenate([every, np.full(n, sink), edges.back])
    costs = np.concatenate([outside, inside, edges.length - edges.wall])
    unit = min(_STEPS_M, _MOST_STEPS / max(float(costs.sum()), 1.0))  # what flows is counted in 32 bits
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
