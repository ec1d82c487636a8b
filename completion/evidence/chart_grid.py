# SPDX-License-Identifier: MIT
"""Chart grid: cells on a surface's metric chart, which evidence, extension and texture share."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scenes.checks import BoolArray, FloatArray, Value
from scenes.surfaces.catalogue import Cylinder, Plane, Surface


@dataclass(frozen=True, slots=True, eq=False)
class ChartGrid(Value):
    """Cells on a chart: rows run along v, columns along u; on a full cylinder columns wrap around."""

    surface: Surface  # whose chart it is
    corner: FloatArray  # (2,) chart coordinates of the corner of cell (0, 0), metres
    cell: FloatArray  # (2,) size of a cell along u and v, metres
    shape: tuple[int, int]  # rows and columns
    wraps: bool  # whether the last column touches the first

    @classmethod
    def over(
        cls, surface: Surface, low: FloatArray, high: FloatArray, cell_m: float, *, full_turn: bool
    ) -> ChartGrid:
        """Return the grid over the chart from `low` to `high` (2,); with `full_turn`, over a period of u."""
        low, high = np.array(low, dtype=np.float64), np.array(high, dtype=np.float64)
        size = np.array([cell_m, cell_m])
        if full_turn:
            low[0], high[0] = -surface.period / 2, surface.period / 2
        count = np.maximum(np.ceil((high - low) / cell_m - 1e-6), 1).astype(np.int64)
        if full_turn:
            size[0] = surface.period / count[0]
        return cls(surface, low, size, (int(count[1]), int(count[0])), full_turn)

    @property
    def cell_area(self) -> float:
        """Area of a cell in square metres."""
        return float(self.cell[0] * self.cell[1])

    def axes(self) -> tuple[FloatArray, FloatArray]:
        """Chart coordinates of the cell centres: u (columns,) and v (rows,), metres."""
        row, column = (np.arange(n, dtype=np.float64) + 0.5 for n in self.shape)
        return self.corner[0] + column * self.cell[0], self.corner[1] + row * self.cell[1]

    def centres_uv(self) -> FloatArray:
        """Chart coordinates (rows, columns, 2) of the cell centres."""
        uv = np.empty((*self.shape, 2))
        u, v = self.axes()
        uv[..., 0], uv[..., 1] = u, v[:, None]
        return uv

    def uv_of(self, row: FloatArray, column: FloatArray) -> FloatArray:
        """Chart coordinates (..., 2) of fractional cells (...,); integers are corners, halves centres."""
        return np.stack(
            [self.corner[0] + column * self.cell[0], self.corner[1] + row * self.cell[1]], axis=-1
        )

    def bounds(self) -> FloatArray:
        """Smallest and largest coordinates (2, 3) of the cell centres, to the bit those of `centres`."""
        if not isinstance(self.surface, Plane | Cylinder):
            centres = self.centres()
            return np.stack([centres.min(axis=0), centres.max(axis=0)])
        base, up = self._lines(self.surface)
        return np.stack([base.min(axis=0) + up.min(axis=0), base.max(axis=0) + up.max(axis=0)])

    def _lines(self, surface: Plane | Cylinder) -> tuple[FloatArray, FloatArray]:
        """Points (columns, 3) of a plane's or cylinder's lowest row, and what each row (rows, 3) adds."""
        u, v = self.axes()  # v is straight on both
        along = surface.v_direction if isinstance(surface, Plane) else surface.direction
        return surface.from_uv(np.stack([u, np.zeros(len(u))], axis=1)), v[:, None] * along

    def centres(self) -> FloatArray:
        """Points (rows * columns, 3) at the cell centres."""
        if not isinstance(self.surface, Plane | Cylinder):
            return self.surface.from_uv(self.centres_uv().reshape(-1, 2))
        base, up = self._lines(self.surface)
        return np.asarray((base + up[:, None]).reshape(-1, 3))

    def within(self, low: FloatArray, high: FloatArray) -> BoolArray:
        """Cells (rows, columns) in the rectangle from `low` to `high` (2,), all of u if it wraps."""
        half = self.cell * (0.5 - 1e-6)  # cells that only touch it are outside, however they are rounded
        across, up = (
            (centre >= low[axis] - half[axis]) & (centre <= high[axis] + half[axis])
            for axis, centre in enumerate(self.axes())
        )
        return np.asarray(up[:, None] & (across | self.wraps), dtype=np.bool_)

    def cells_of(self, points: FloatArray) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Indices of the points (n, 3) that fall into the grid, and the flat cell that each falls into."""
        return self.cells_at(self.surface.to_uv(points))

    def cells_at(self, uv: FloatArray) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Indices of the places (n, 2) of the chart that fall into the grid, and the flat cell of each."""
        column, row = np.floor((uv - self.corner) / self.cell).astype(np.int64).T
        if self.wraps:
            column %= self.shape[1]
        inside = (row >= 0) & (row < self.shape[0]) & (column >= 0) & (column < self.shape[1])
        index = np.flatnonzero(inside)
        return index, row[index] * self.shape[1] + column[index]
