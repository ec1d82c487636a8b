# SPDX-License-Identifier: MIT
"""Floors: what one can walk on and stand a tripod on, apart from furniture, solids and drops.

As in maps for walking figures (after Haumont et al. 2003 and Recast, Mononen 2009): free spans above level
surface are joined where one steps from one to the next. Columns hold all surfaces that vertical lines over a
scene meet, and the free spans between them.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from nbv.visibility.limits import (
    ALMOST_ALL,
    CELL_M,
    CHEST_M,
    FOOT_M,
    HEADROOM_M,
    LEAST_SPAN_M,
    RAMP_DEG,
    SEAT_DROP,
    SILL_M,
    SMALL_M2,
    STEP_M,
    TABLE_DROP,
    UNEVEN_M,
    WALKABLE,
)
from scenes.checks import BoolArray, FloatArray, Value
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.rays.raycast import RayCaster
from texture.engine.compiled import compiled

_LEAST_CELLS = 60  # along the longer side: small scenes get smaller cells
_MOST_COLUMNS = 4_000_000  # large ones get larger cells
_ASIDE = np.array([0.413, 0.387])  # of a cell: lines that avoid walls at round coordinates
_STEP_OVER = 1e-6  # of the extent: how far below a surface the next one is looked for
_MOST_SURFACES = 400  # that one line meets; what lies lower is left out


@dataclass(frozen=True, slots=True, eq=False)
class FloorColumns(Value):
    """Free spans of vertical lines over a lattice of cells, sorted by cell and then from above.

    Attributes
    ----------
    low : (2,) float
        Corner of the lattice, metres.
    shape : (int, int)
        Cells along x and y.
    cell_m : float
        Side of a cell, metres.
    start : (n_cells + 1,) int64
        The spans of cell c (number x * shape[1] + y) are start[c] to start[c + 1].
    cell : (n,) int64
        The cell of each span.
    bottom, top : (n,) float
        Heights of the surfaces below and above; top is inf under the open sky, metres.
    slope : (n,) float
        Cosine between the normal of the surface below and the vertical.
    shows_back : (n,) bool
        Whether that surface turns its back to the span, as the inside of a solid does.
    face : (n,) int32
        The face below.
    is_partial : bool
        Whether a line without spans was not seen, rather than filled.
    """

    low: FloatArray
    shape: tuple[int, int]
    cell_m: float
    start: NDArray[np.int64]
    cell: NDArray[np.int64]
    bottom: FloatArray
    top: FloatArray
    slope: FloatArray
    shows_back: BoolArray
    face: NDArray[np.int32]
    is_partial: bool = False

    def places(self, cells: NDArray[np.int64]) -> FloatArray:
        """Where the lines of cells (n,) stand (n, 2), metres."""
        x, y = np.divmod(cells, self.shape[1])
        return np.asarray(self.low + (np.column_stack([x, y]) + _ASIDE) * self.cell_m)

    def cells_of(self, places: FloatArray) -> NDArray[np.int64]:
        """Cell (n,) in which each of the places (n, 2) lies, -1 outside."""
        at = np.floor((places - self.low) / self.cell_m).astype(np.int64)
        inside = ((at >= 0) & (at < np.array(self.shape))).all(axis=1)
        return np.where(inside, at[:, 0] * self.shape[1] + at[:, 1], -1)

    def seen_from_one_side(self) -> FloorColumns:
        """Return the spans for surface as scans show it, from one side and not all of it.

        There is nothing to stand on where it turns its back, and lines without spans were not seen.
        """
        kept = ~self.shows_back
        counts = np.bincount(self.cell[kept], minlength=len(self.start) - 1)
        parts = {name: getattr(self, name)[kept] for name in ("cell", "bottom", "top", "slope", "face")}
        start, backs = np.append(0, np.cumsum(counts)), self.shows_back[kept]
        return replace(self, start=start, shows_back=backs, is_partial=True, **parts)

    def neighbours(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Pairs (m,), (m,) of spans of cells side by side that are open to each other, by heights alone."""
        first, second = _beside(self.shape, self.start, self.bottom, self.top, LEAST_SPAN_M)
        return first, second


def cut_columns(mesh: LabelledMesh, caster: RayCaster) -> FloorColumns:
    """Cut the space over and within a scene into columns of free spans.

    Cells are 0.1 m, smaller in small scenes, larger where there would be more than four million. What lies
    below the lowest surface of a line is no span.
    """
    low, high = mesh.bounds()
    extent = np.maximum((high - low)[:2], 1e-6)
    cell = max(min(CELL_M, extent.max() / _LEAST_CELLS), float(np.sqrt(np.prod(extent) / _MOST_COLUMNS)))
    n_x, n_y = (int(n) for n in np.ceil(extent / cell) + 1)
    corner = (low + high)[:2] / 2 - cell * np.array([n_x, n_y]) / 2
    x, y = np.divmod(np.arange(n_x * n_y), n_y)
    places = corner + (np.column_stack([x, y]) + _ASIDE) * cell
    above = float(high[2] + 0.1 * (high[2] - low[2]) + 1.0)
    cells, heights, faces = _crossings(caster, places, above, float(np.ptp(mesh.bounds(), axis=0).max()))
    vertical = mesh.face_normals()[faces, 2]
    first = np.append(True, cells[1:] != cells[:-1]) if len(cells) else np.zeros(0, np.bool_)
    top = np.where(first, np.inf, np.append(np.inf, heights[:-1])) if len(cells) else heights
    kept = top - heights >= LEAST_SPAN_M
    counts = np.bincount(cells[kept], minlength=n_x * n_y)
    return FloorColumns(
        low=corner, shape=(n_x, n_y), cell_m=cell,
        start=np.append(0, np.cumsum(counts)), cell=cells[kept], bottom=heights[kept], top=top[kept],
        slope=np.abs(vertical[kept]), shows_back=vertical[kept] < 0, face=faces[kept],
    )  # fmt: skip


def _crossings(
    caster: RayCaster, places: FloatArray, above: float, extent: float
) -> tuple[NDArray[np.int64], FloatArray, NDArray[np.int32]]:
    """Cells (n,), heights (n,) and faces (n,) of all that lines down at places (c, 2) meet, in order."""
    going, height = np.arange(len(places)), np.full(len(places), above)
    crossings = []
    for _ in range(_MOST_SURFACES):
        origins = np.column_stack([places[going], height])
        hits = caster.first_hit(origins, np.broadcast_to(np.array([0.0, 0.0, -1.0]), origins.shape))
        met = hits.hit
        if not met.any():
            break
        going, height = going[met], height[met] - hits.ranges[met]
        crossings.append((going, height, hits.face[met]))
        height = height - _STEP_OVER * extent
    if not crossings:
        return np.zeros(0, np.int64), np.zeros(0), np.zeros(0, np.int32)
    cells, heights, faces = (np.concatenate(parts) for parts in zip(*crossings, strict=True))
    order = np.argsort(cells, kind="stable")  # of each line from above already
    return cells[order], heights[order], faces[order]


@compiled
def _beside(
    shape: tuple[int, int],
    start: NDArray[np.int64],
    bottom: FloatArray,
    top: FloatArray,
    least: float,
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Pairs of spans of cells side by side that share at least so much of their heights."""
    first, second = [np.int64(0) for _ in range(0)], [np.int64(0) for _ in range(0)]
    for x in range(shape[0]):
        for y in range(shape[1]):
            here = x * shape[1] + y
            for there in (here + shape[1], here + 1):
                if (there == here + 1 and y + 1 == shape[1]) or there >= shape[0] * shape[1]:
                    continue
                if there == here + shape[1] and x + 1 == shape[0]:
                    continue
                a, b = start[here], start[there]
                while a < start[here + 1] and b < start[there + 1]:
                    if min(top[a], top[b]) - max(bottom[a], bottom[b]) >= least:
                        first.append(np.int64(a))
                        second.append(np.int64(b))
                    if bottom[a] >= bottom[b]:
                        a += 1
                    else:
                        b += 1
    return np.array(first, dtype=np.int64), np.array(second, dtype=np.int64)


@dataclass(frozen=True, slots=True)
class Platform(Value):
    """Level surface that is no place to stand: no steps lead to it, and it drops along much of its edge.

    Attributes
    ----------
    floor_m2, level_m, drop_m : float
        Its area in square metres, its mean height, and the mean drop from its edges, metres.
    place : (3,) float
        A place on it, metres.
    """

    floor_m2: float
    level_m: float
    drop_m: float
    place: tuple[float, float, float]

    def to_json(self) -> dict[str, Any]:
        """Return the entry of `plan.json`."""
        return {**asdict(self), "place": list(self.place)}


@dataclass(frozen=True, slots=True, eq=False)
class Floors(Value):
    """What of the spans of `columns` is floor.

    Attributes
    ----------
    columns : Columns
        The spans.
    patch : (n,) int64
        Number of the level patch that lies below a span; -1 where one cannot walk.
    is_floor : (n,) bool
        Spans above floor: that one walks on, no furniture.
    can_stand : (n,) bool
        Spans above floor that is level under all of a tripod's feet.
    walk : (n,) int64
        What steps and stairs connect has one number; -1 off the floor.
    links : (m, 2) int64
        Pairs of floor spans side by side from one to the other of which one walks or steps.
    furniture_m2 : float
        Area that is level but stands on other floor, square metres.
    platforms : tuple of Platform
        Of that what is large and high: a floor, perhaps, of which the stairs or the rails are missing.
    """

    columns: FloorColumns
    patch: NDArray[np.int64]
    is_floor: BoolArray
    can_stand: BoolArray
    walk: NDArray[np.int64]
    links: NDArray[np.int64]
    furniture_m2: float
    platforms: tuple[Platform, ...]


def find_floors(columns: FloorColumns, caster: RayCaster, headroom_m: float = HEADROOM_M) -> Floors:
    """Tell floor from what else is level.

    A person walks where there is headroom above surface that is not steep, and steps up or down by no more
    than a riser, where no wall stands between. Level patches whose outline drops all round are furniture
    unless they are larger than 2 m2 and steps lead to them; so is what no step leads to and stands out above
    other floor.
    """
    walkable = (columns.top - columns.bottom >= headroom_m) & (columns.slope >= WALKABLE)
    first, second = columns.neighbours()
    rise = columns.bottom[second] - columns.bottom[first]
    low = np.minimum(columns.top[first], columns.top[second]) - np.maximum(
        columns.bottom[first], columns.bottom[second]
    )
    near = walkable[first] & walkable[second] & (np.abs(rise) <= STEP_M) & (low >= headroom_m)
    near[near] = ~_find_walls(columns, caster, first[near], second[near], CHEST_M)
    level = near & (np.abs(rise) <= SILL_M)
    patch = _label_components(walkable, first[level], second[level])
    walk = _label_components(walkable, first[near], second[near])
    outline = _FloorEdges.of(columns, caster, walkable, pairs=(first, second), near=near)
    kept = _kept_patches(columns, outline, walkable, patch, walk)
    is_floor = walkable & kept[np.maximum(patch, 0)]
    held = near & is_floor[first] & is_floor[second]
    walk_all, walk = walk, np.where(is_floor, _label_components(is_floor, first[held], second[held]), -1)
    return Floors(
        columns=columns,
        patch=np.where(is_floor, patch, -1),
        is_floor=is_floor,
        can_stand=is_floor & _is_even(columns, is_floor, walk),
        walk=walk,
        links=np.column_stack([first[held], second[held]]),
        furniture_m2=float(np.count_nonzero(walkable & ~is_floor)) * columns.cell_m**2,
        platforms=_platforms(columns, outline, np.where(walkable & ~is_floor, walk_all, -1)),
    )


def _find_walls(
    columns: FloorColumns,
    caster: RayCaster,
    first: NDArray[np.int64],
    second: NDArray[np.int64],
    height_m: float,
) -> BoolArray:
    """Tell between which spans (m,) side by side something stands, so high above the higher floor."""
    height = np.maximum(columns.bottom[first], columns.bottom[second]) + height_m
    ends = [np.column_stack([columns.places(columns.cell[side]), height]) for side in (first, second)]
    return np.asarray(caster.are_blocked(ends[0], ends[1]))


def _label_components(
    among: BoolArray, first: NDArray[np.int64], second: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Number (n,) what links connect, -1 for spans not among them."""
    n = len(among)
    links = coo_array((np.ones(len(first), np.int8), (first, second)), shape=(n, n))
    _, label = connected_components(links, directed=False)
    number = np.full(n, -1, np.int64)
    number[among] = np.unique(label[among], return_inverse=True)[1]
    return number


@dataclass(frozen=True, slots=True, eq=False)
class _FloorEdges:
    """Pairs of spans at edges: where one walks or steps on, and where a walkable span drops to another."""

    near: tuple[NDArray[np.int64], NDArray[np.int64]]
    high: NDArray[np.int64]
    low: NDArray[np.int64]

    @classmethod
    def of(
        cls,
        columns: FloorColumns,
        caster: RayCaster,
        walkable: BoolArray,
        *,
        pairs: tuple[NDArray[np.int64], NDArray[np.int64]],
        near: BoolArray,
    ) -> _FloorEdges:
        """Find the drops: to the span beside that shares most of the height, with no wall between."""
        first, second = pairs
        is_up = columns.bottom[second] > columns.bottom[first]
        high, low = np.where(is_up, second, first), np.where(is_up, first, second)
        shared = np.minimum(columns.top[high], columns.top[low]) - columns.bottom[high]
        side = 2 * (np.abs(columns.cell[low] - columns.cell[high]) > 1) + (
            columns.cell[low] > columns.cell[high]
        )
        key, most = 4 * high + side, np.full(4 * len(walkable), -np.inf)
        np.maximum.at(most, key, shared)
        falls = walkable[high] & (shared == most[key]) & (columns.bottom[high] - columns.bottom[low] > SILL_M)
        falls[falls] = ~_find_walls(columns, caster, high[falls], low[falls], SILL_M)
        return cls((first[near], second[near]), high[falls], low[falls])


def _kept_patches(
    columns: FloorColumns,
    outline: _FloorEdges,
    walkable: BoolArray,
    patch: NDArray[np.int64],
    walk: NDArray[np.int64],
) -> BoolArray:
    """Tell which patches (p,) are floor, by how their outlines drop and whether steps lead to them."""
    n, n_walks = int(patch.max(initial=-1)) + 1, int(walk.max(initial=-1)) + 1
    first, second = outline.near
    cells, walk_cells = (
        np.bincount(patch[walkable], minlength=n),
        np.bincount(walk[walkable], minlength=n_walks),
    )
    inner = np.bincount(patch[first[patch[first] == patch[second]]], minlength=n)
    edges = np.maximum(4 * cells - 2 * inner, 1)
    walk_edges = np.maximum(4 * walk_cells - 2 * np.bincount(walk[first], minlength=n_walks), 1)
    high, low = outline.high, outline.low
    drops = np.bincount(patch[high[patch[high] != patch[low]]], minlength=n)
    apart = (walk[high] != walk[low]) & (columns.bottom[high] - columns.bottom[low] > STEP_M)
    falls = np.bincount(walk[high[apart]], minlength=n_walks) / walk_edges
    stepped = np.zeros(n, np.bool_)
    stepped[patch[np.concatenate([first, second])[np.tile(patch[first] != patch[second], 2)]]] = True
    of = np.zeros(n, np.int64)
    of[patch[walkable]] = walk[walkable]
    cell_m2 = columns.cell_m**2
    furniture = (drops / edges >= ALMOST_ALL) & ~((cells * cell_m2 > SMALL_M2) & stepped)
    stands_out = (falls >= TABLE_DROP) | ((falls >= SEAT_DROP) & (walk_cells * cell_m2 <= SMALL_M2))
    return np.asarray(~(furniture | stands_out[of]))


def _platforms(columns: FloorColumns, outline: _FloorEdges, walk: NDArray[np.int64]) -> tuple[Platform, ...]:
    """Tell which of the walks (n,) of furniture, -1 elsewhere, are large and high, the largest first.

    What lies under the open sky is a roof, and what turns its back the inside of a solid.
    """
    left = np.flatnonzero(walk >= 0)
    edge = walk[outline.high] >= 0
    of = walk[outline.high[edge]]
    n_edges = np.bincount(of, minlength=int(walk.max(initial=-1)) + 1)
    depth = columns.bottom[outline.high[edge]] - columns.bottom[outline.low[edge]]
    drop = np.bincount(of, depth, len(n_edges)) / np.maximum(n_edges, 1)
    no_place = np.isinf(columns.top[left]) | columns.shows_back[left]
    area = np.bincount(walk[left], ~no_place, len(n_edges)) * columns.cell_m**2
    platforms = []
    for number in np.flatnonzero((area > SMALL_M2) & (drop > CHEST_M)):
        spans = left[(walk[left] == number) & ~no_place]
        places = np.column_stack([columns.places(columns.cell[spans]), columns.bottom[spans]])
        middle = places[np.argmin(np.linalg.norm(places - places.mean(axis=0), axis=1))]
        platforms.append(
            Platform(
                floor_m2=float(area[number]),
                level_m=float(places[:, 2].mean()),
                drop_m=float(drop[number]),
                place=(float(middle[0]), float(middle[1]), float(middle[2])),
            )
        )
    return tuple(sorted(platforms, key=lambda platform: -platform.floor_m2))


def _is_even(columns: FloorColumns, is_floor: BoolArray, walk: NDArray[np.int64]) -> BoolArray:
    """Tell where floor lies all around within a tripod's feet, no steeper than a ramp and no drop."""
    slack = FOOT_M * float(np.tan(np.radians(RAMP_DEG))) + UNEVEN_M
    radius = FOOT_M / columns.cell_m + 0.5  # cells; half a one, for a place lies beside its cell's line
    reach = int(radius)
    steps = np.stack(np.meshgrid(*[np.arange(-reach, reach + 1)] * 2, indexing="ij"), axis=-1).reshape(-1, 2)
    far = (steps**2).sum(axis=1)
    outward = np.argsort(-far, kind="stable")  # most of what is uneven shows at the feet
    left = np.flatnonzero(is_floor)
    n_spans = int(np.diff(columns.start).max(initial=0))
    for dx, dy in steps[outward[(far[outward] > 0) & (far[outward] <= radius**2)]]:
        if not len(left):
            break
        x, y = np.divmod(columns.cell[left], columns.shape[1])
        inside = (x + dx >= 0) & (x + dx < columns.shape[0]) & (y + dy >= 0) & (y + dy < columns.shape[1])
        there = np.where(inside, (x + dx) * columns.shape[1] + y + dy, 0)
        held = np.zeros(len(left), np.bool_)
        for k in range(n_spans):
            other = columns.start[there] + k
            known = inside & (other < columns.start[there + 1])
            other = np.where(known, other, 0)
            held |= (
                known & is_floor[other] & (walk[other] == walk[left])
                & (np.abs(columns.bottom[other] - columns.bottom[left]) <= slack)
            )  # fmt: skip
        left = left[held]
    even = np.zeros(len(is_floor), np.bool_)
    even[left] = True
    return even
