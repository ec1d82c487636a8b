# SPDX-License-Identifier: MIT
"""Sheet: a completed surface as an area of its chart, each place with its provenance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy import ndimage

from completion.extension.patch import Patch, Provenance
from scenes.checks import BoolArray, FloatArray
from scenes.surfaces.catalogue import Surface

_AROUND = 12  # cells beyond what is covered, as far as an outline may be laid
_LEAST_CELLS = 9  # of a measured part of its own


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
        found = self.provenance[np.clip(row, 0, rows - 1), np.clip(column, 0, columns - 1)]
        return np.asarray(found, dtype=np.int8)

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
        found = np.asarray(shapely.dwithin(self.area, shapely.points(uv), distance_m), dtype=np.bool_)
        if self.wraps:
            half = self.surface.period / 2
            near = np.flatnonzero(~found & (np.abs(uv[:, 0]) > half - 4 * self.cell_m - distance_m))
            beyond = uv[near] - np.stack([np.sign(uv[near, 0]) * 2 * half, np.zeros(len(near))], axis=1)
            found[near] = shapely.dwithin(self.area, shapely.points(beyond), distance_m)
        return found


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
    return np.asarray((sizes >= _LEAST_CELLS)[part], dtype=np.bool_)
