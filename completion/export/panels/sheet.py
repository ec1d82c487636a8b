# SPDX-License-Identifier: MIT
"""Sheet: a completed surface as an area of its chart, each place with its provenance."""

from __future__ import annotations

from dataclasses import dataclass
from math import atan2, pi
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy import ndimage

from completion.export.panels.limits import LEAST_CELLS
from completion.extension.patch import Patch, Provenance
from scenes.checks import BoolArray, FloatArray
from scenes.surfaces.catalogue import Surface
from texture.engine.compiled import compiled, inlined

_AROUND = 12  # cells beyond what is covered, as far as an outline may be laid


@dataclass(frozen=True, slots=True, eq=False)
class Sheet:
    """A completed surface as an area of its chart.

    Attributes
    ----------
    number : int
        Of the surface, from 1.
    patch : Patch
        The surface.
    area : shapely geometry
        Polygons of the chart that it covers, metres.
    provenance : (rows, columns) int8
        The `Provenance` of each cell; outside the surface, that of the nearest cell inside.
    """

    number: int
    patch: Patch
    area: Any
    provenance: NDArray[np.int8]

    @classmethod
    def of(cls, number: int, patch: Patch, area: Any) -> Sheet:
        """Return the sheet of a patch that covers an area of its chart (`surface_polygon`).

        Holes of a closed cylinder through which no beam went are closed, as inferred: they lie at its limb,
        where a pixel is many cells wide.
        """
        if not patch.grid.wraps:
            return cls(number, patch, area, spread_provenance(patch, patch.provenance))
        known = patch.provenance
        holes = ndimage.binary_fill_holes(known >= 0) & (known < 0)
        part, n_parts = ndimage.label(holes)
        free = np.bincount(part.ravel(), patch.evidence.open.ravel(), minlength=n_parts + 1)
        known = np.where(holes & (free[part] == 0), np.int8(Provenance.FULL_TURN), known)
        uv = patch.grid.centres_uv().reshape(-1, 2)[(holes & (known < 0)).ravel()]
        return cls(number, patch, _without_holes(area, uv), spread_provenance(patch, known))

    @property
    def surface(self) -> Surface:
        """The surface in its chart's frame."""
        return self.patch.grid.surface

    @property
    def cell_m(self) -> float:
        """Side of a cell, metres."""
        return float(self.patch.grid.cell.max())

    @property
    def wraps(self) -> bool:
        """Whether the chart's left side is its right one."""
        return self.patch.grid.wraps

    def along(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Places (n, 2) in the chart of points (n, 3) of a curve, and the unit vectors (n, 2) to its left.

        They go on past the chart's seam, and so may what lies beside them.
        """
        uv = self.surface.to_uv(points)
        if np.isfinite(self.surface.period):
            uv[:, 0] = np.unwrap(uv[:, 0], period=self.surface.period)
        return uv, left_of(uv)

    def _within_period(self, uv: FloatArray) -> FloatArray:
        """The same places (n, 2) within the chart's period."""
        period = self.surface.period
        if not np.isfinite(period):
            return uv
        return np.stack([(uv[:, 0] + period / 2) % period - period / 2, uv[:, 1]], axis=1)

    def provenance_at(self, uv: FloatArray) -> NDArray[np.int8]:
        """The provenance (n,) of places (n, 2) of the chart."""
        grid = self.patch.grid
        column, row = np.floor((self._within_period(uv) - grid.corner) / grid.cell).astype(np.int64).T
        rows, columns = grid.shape
        cell_provenance = self.provenance[np.clip(row, 0, rows - 1), np.clip(column, 0, columns - 1)]
        return np.asarray(cell_provenance, dtype=np.int8)

    def is_free(self, uv: FloatArray) -> BoolArray:
        """Which places (n, 2) of the chart beams went through."""
        inside, cells = self.patch.grid.cells_at(self._within_period(uv))
        free = np.zeros(len(uv), np.bool_)
        free[inside] = self.patch.evidence.open.ravel()[cells]
        return free

    def is_within(self, uv: FloatArray, distance_m: float) -> BoolArray:
        """Which places (n, 2) of the chart lie in the area, or no farther from it than a distance."""
        shapely.prepare(self.area)
        uv = self._within_period(uv)
        mask = np.asarray(shapely.dwithin(self.area, shapely.points(uv), distance_m), dtype=np.bool_)
        if self.wraps:
            half = self.surface.period / 2
            near = np.flatnonzero(~mask & (np.abs(uv[:, 0]) > half - 4 * self.cell_m - distance_m))
            beyond = uv[near] - np.stack([np.sign(uv[near, 0]) * 2 * half, np.zeros(len(near))], axis=1)
            mask[near] = shapely.dwithin(self.area, shapely.points(beyond), distance_m)
        return mask


def left_of(uv: FloatArray) -> FloatArray:
    """Return the unit vectors (n, 2) to the left of a polyline (n, 2) at its places."""
    along = np.gradient(uv, axis=0)
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-12)
    return np.stack([-along[:, 1], along[:, 0]], axis=1)


def _without_holes(area: Any, free: FloatArray) -> Any:
    """The polygons of an area with those of their holes in which there are `free` places (n, 2) alone."""
    points, parts = shapely.points(free), shapely.get_parts(shapely.get_parts(area))
    kept = []
    for part in (part for part in parts if part.geom_type == "Polygon"):
        open_ = [hole for hole in part.interiors if shapely.intersects(shapely.Polygon(hole), points).any()]
        kept.append(shapely.Polygon(part.exterior, open_))
    return shapely.union_all(kept)


def spread_provenance(patch: Patch, known: NDArray[np.int8]) -> NDArray[np.int8]:
    """Give every cell (rows, columns) the provenance of the nearest `known` one; -1 is none.

    Measured cells are closed by one cell, never over free space; what was inferred in parts of fewer than
    nine cells counts as measured (each of its cells is beside a measured one), and what was measured in such
    parts within inferred surface as inferred.
    """
    measured = known == Provenance.MEASURED
    if not measured.any():
        return np.full(known.shape, Provenance.MEASURED, np.int8)
    closed = ndimage.binary_closing(np.pad(measured, 1), np.ones((3, 3)))[1:-1, 1:-1]
    closed = (closed & ~patch.evidence.open) | measured
    closed |= ~_large_parts(~closed & (known >= 0)) & ~closed & (known >= 0)
    large = _large_parts(closed)
    closed = large if large.any() else closed
    result = np.where(closed, np.int8(Provenance.MEASURED), known)
    result[~closed & (known == Provenance.MEASURED)] = -1
    return spread_out(result, result >= 0)


def spread_out(values: NDArray[Any], known: BoolArray) -> NDArray[Any]:
    """Give cells (rows, columns) that are not `known` the value of the nearest one that is.

    Farther than 12 cells around the known ones they get 0.
    """
    if not known.any():
        return values
    box = tuple(
        slice(max(int(index.min()) - _AROUND, 0), int(index.max()) + _AROUND + 1)
        for index in np.nonzero(known)
    )
    _, nearest = ndimage.distance_transform_edt(~known[box], return_indices=True)
    spread = np.zeros_like(values)
    spread[box] = values[box][tuple(nearest)]
    return spread


def _large_parts(cells: BoolArray) -> BoolArray:
    """Those of some cells (rows, columns) that are of connected parts of at least nine."""
    part, n_parts = ndimage.label(cells)
    sizes = np.bincount(part.ravel(), minlength=n_parts + 1)
    sizes[0] = 0
    return np.asarray((sizes >= LEAST_CELLS)[part], dtype=np.bool_)


_PARTS = 10_000  # of a cell's side, to which corners are rounded


def polygons_of_cells(whole: BoolArray, triangles: FloatArray) -> shapely.MultiPolygon:
    """Return what `whole` cells (rows, columns) and triangles (n, 3, 2) cover; x is the column, y the row.

    No triangle lies in a whole cell or leaves its own; they are anticlockwise, rows and columns of their
    corners rounded to a ten thousandth. Corners of cells stay corners of the polygons along straight sides.
    """
    corner = np.rint(triangles * _PARTS).astype(np.int64)
    ends = np.stack([corner, np.roll(corner, -1, axis=1)], axis=2).reshape(-1, 2, 2)
    level, upright = ((ends[:, 0, k] == ends[:, 1, k]) & (ends[:, 0, k] % _PARTS == 0) for k in (0, 1))
    filled = np.pad(whole, 1).astype(np.int8)
    step: NDArray[np.int8] = filled[1:, 1:-1] - filled[:-1, 1:-1]
    along_rows = _on_lines(step, ends[level & ~upright])
    step = filled[1:-1, :-1] - filled[1:-1, 1:]
    along_columns = _on_lines(step.T, ends[upright & ~level][..., ::-1])[..., ::-1]
    within = _within_cells(ends[~level & ~upright], whole.shape[1] * _PARTS + 1)
    edges = np.concatenate([along_rows, along_columns, within])
    if not len(edges):
        return shapely.MultiPolygon()
    places, node = np.unique(edges.reshape(-1, 2), axis=0, return_inverse=True)
    begin, end = node.reshape(-1, 2).T
    order = np.argsort(begin, kind="stable")
    begin, end = begin[order], end[order]
    first = np.searchsorted(begin, np.arange(len(places) + 1))
    chain, size = _rings(begin, end, first, places)
    rings = np.split(places[chain][:, ::-1] / _PARTS, np.cumsum(size)[:-1])
    return _nest_rings([ring for ring in rings if len(ring) > 2])


def _on_lines(step: NDArray[np.int8], ends: NDArray[np.int64]) -> NDArray[np.int64]:
    """Edges (k, 2, 2) on the lines between rows that are left of the whole cells' sides and of others.

    `step` (rows + 1, columns) is 1 where a cell's side leads along its line, -1 where one leads back;
    `ends` (n, 2, 2) are row and column, in parts, of where the others begin and end.
    """
    length = step.shape[1] * _PARTS + 1
    line, cell = np.nonzero(step)
    side = (line * length + cell * _PARTS)[:, None] + [0, _PARTS]
    back = step[line, cell] < 0
    side[back] = side[back, ::-1]
    other = ends[..., 0] // _PARTS * length + ends[..., 1]
    key, index = np.unique(np.concatenate([side, other]), return_inverse=True)
    index = index.reshape(-1, 2)
    net = np.bincount(index[:, 0], minlength=len(key)) - np.bincount(index[:, 1], minlength=len(key))
    covered = np.cumsum(net)[:-1]
    left = np.flatnonzero(covered)
    pair = np.stack([key[left], key[left + 1]], axis=1)
    pair[covered[left] < 0] = pair[covered[left] < 0, ::-1]
    return np.stack([pair // length * _PARTS, pair % length], axis=-1)


def _within_cells(ends: NDArray[np.int64], width: int) -> NDArray[np.int64]:
    """Of edges (n, 2, 2) those that none leads back along; `width` is more than any column, in parts."""
    place = ends @ [width, 1]
    place = place[place[:, 0] != place[:, 1]]
    pair, index = np.unique(np.sort(place, axis=1), axis=0, return_inverse=True)
    net = np.bincount(index.ravel(), np.where(place[:, 0] < place[:, 1], 1, -1), len(pair))
    pair[net < 0] = pair[net < 0, ::-1]
    return np.stack(np.divmod(pair[net != 0], width), axis=-1)


@compiled
def _rings(
    begin: NDArray[np.int64], end: NDArray[np.int64], first: NDArray[np.int64], places: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Chain edges between nodes to rings that pass no node twice: their nodes, and how many each has.

    Edges are sorted by where they begin; those of node k are `first[k]` to `first[k + 1]`. Where several go
    on, the one that turns most to the left does, so that rings touch and do not cross.
    """
    n = len(begin)
    used, on_path = np.zeros(n, np.bool_), np.full(len(places), -1)
    path, chain, size = np.empty(n + 1, np.int64), np.empty(n, np.int64), np.empty(n, np.int64)
    n_chained, n_rings = 0, 0
    for seed in range(n):
        edge, depth = seed, 0
        if not used[seed]:
            path[0], on_path[begin[seed]], depth = begin[seed], 0, 1
        while edge >= 0 and not used[edge]:
            used[edge] = True
            node = end[edge]
            back = on_path[node]
            if back >= 0:
                size[n_rings] = depth - back
                n_rings += 1
                for k in range(back, depth):
                    chain[n_chained] = path[k]
                    n_chained += 1
                    on_path[path[k]] = -1
                depth = back
            path[depth], on_path[node] = node, depth
            depth += 1
            edge = _leftmost(edge, begin, end, first, places, used)
        for k in range(depth):
            on_path[path[k]] = -1
    return chain[:n_chained], size[:n_rings]


@inlined
def _leftmost(
    edge: int,
    begin: NDArray[np.int64],
    end: NDArray[np.int64],
    first: NDArray[np.int64],
    places: NDArray[np.int64],
    used: BoolArray,
) -> int:
    """The unused edge from where one ends that turns most to the left; -1 without any."""
    node, best, most = end[edge], -1, -2 * pi
    row, column = places[node, 0] - places[begin[edge], 0], places[node, 1] - places[begin[edge], 1]
    for k in range(first[node], first[node + 1]):
        if not used[k]:
            down, right = places[end[k], 0] - places[node, 0], places[end[k], 1] - places[node, 1]
            turn = atan2(float(column * down - row * right), float(column * right + row * down))
            turn = -pi if turn == pi else turn
            if turn > most:
                best, most = k, turn
    return best


def _nest_rings(rings: list[FloatArray]) -> shapely.MultiPolygon:
    """Anticlockwise rings as polygons, clockwise ones as holes of the smallest that they lie in."""
    faces = shapely.polygons([shapely.linearrings(ring) for ring in rings])
    size, is_shell = shapely.area(faces), shapely.is_ccw(shapely.get_exterior_ring(faces))
    shell, hole = np.flatnonzero(is_shell & (size > 0)), np.flatnonzero(~is_shell & (size > 0))
    inside = shapely.point_on_surface(faces[hole])
    of_hole, of_shell = shapely.STRtree(faces[shell]).query(inside, predicate="within")
    holes: list[list[FloatArray]] = [[] for _ in shell]
    larger = size[shell[of_shell]] > size[hole[of_hole]]
    order = np.lexsort((size[shell[of_shell]], of_hole, ~larger))[: larger.sum()]
    _, nearest = np.unique(of_hole[order], return_index=True)
    for k in order[nearest]:
        holes[of_shell[k]].append(rings[hole[of_hole[k]]])
    return shapely.MultiPolygon([
        shapely.Polygon(rings[k], inner) for k, inner in zip(shell, holes, strict=True)
    ])  # fmt: skip
