# SPDX-License-Identifier: MIT
"""Surface edits: all that a person says of one surface, and which cells of its chart that concerns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from shapely import Polygon, contains_xy

from completion.boundary.curves import Line
from completion.boundary.meshing import Trim
from completion.edits.edit import Action
from completion.evidence.chart_grid import ChartGrid
from scenes.checks import BoolArray, FloatArray
from scenes.surfaces.catalogue import Plane, Surface


@dataclass(frozen=True, slots=True, eq=False)
class Wish:
    """Hidden area that a person accepts or rejects: inside an outline (n, 3), or all of the surface's."""

    accepts: bool
    outline: FloatArray | None = None


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceEdits:
    """What a person says of one surface; working frame, metres.

    Attributes
    ----------
    actions : tuple of str
        What was done to it, in order.
    ends : tuple of Plane
        Where it ends; it lies on their normals' side.
    wishes : tuple of Wish
        What is accepted and rejected; later ones prevail.
    openings : tuple of (n, 3) float
        Outlines in which there is nothing.
    """

    actions: tuple[Action, ...] = ()
    ends: tuple[Plane, ...] = ()
    wishes: tuple[Wish, ...] = ()
    openings: tuple[FloatArray, ...] = ()

    @property
    def is_joined(self) -> bool:
        """Whether a person joined it from several."""
        return "merge" in self.actions

    def labels(self, grid: ChartGrid) -> NDArray[np.int8]:
        """Label each cell (rows, columns): 1 accepted, -1 rejected, 0 neither."""
        labels = np.zeros(grid.shape, np.int8)
        for wish in self.wishes:
            labels[_area(grid, wish.outline)] = 1 if wish.accepts else -1
        return labels

    def accepted(self, grid: ChartGrid, known: BoolArray) -> BoolArray:
        """Cells (rows, columns) to be filled: inside a drawn outline, without one those `known` to fit."""
        return np.asarray((self.labels(grid) > 0) & (known | self.drawn(grid)), dtype=np.bool_)

    def rejected(self, grid: ChartGrid) -> BoolArray:
        """Cells (rows, columns) that are to stay as measured."""
        return np.asarray(self.labels(grid) < 0, dtype=np.bool_)

    def drawn(self, grid: ChartGrid) -> BoolArray:
        """Cells (rows, columns) inside an outline that was drawn around what is accepted."""
        inside = np.zeros(grid.shape, dtype=np.bool_)
        for wish in self.wishes:
            if wish.accepts and wish.outline is not None:
                inside |= _area(grid, wish.outline)
        return inside

    def open_cells(self, grid: ChartGrid) -> BoolArray:
        """Cells (rows, columns) whose centre lies in a declared opening."""
        inside = np.zeros(grid.shape, dtype=np.bool_)
        for outline in self.openings:
            inside |= _area(grid, outline)
        return inside

    def trims(self, grid: ChartGrid) -> tuple[Trim, ...]:
        """Sides of declared openings, where the mesh of inferred cells is cut."""
        trims = []
        for outline in self.openings:
            corners = outline_uv(grid.surface, outline)
            sign = -1.0 if Polygon(corners).exterior.is_ccw else 1.0
            for shift in _turns(grid):
                for start, end in zip(corners + shift, np.roll(corners, -1, axis=0) + shift, strict=True):
                    if not np.allclose(start, end, rtol=0, atol=1e-9):
                        trims.append(_side(grid, start, end, sign))
        return tuple(trim for trim in trims if trim.cells.any())


def outline_uv(chart: Surface, outline: FloatArray) -> FloatArray:
    """Corners (n, 2) of an outline (n, 3) in a chart, also where it crosses the seam of a cylinder."""
    uv = chart.to_uv(outline)
    if np.isfinite(chart.period):
        uv[:, 0] = np.unwrap(uv[:, 0], period=chart.period)
    return uv


def _turns(grid: ChartGrid) -> list[FloatArray]:
    """Shifts in the chart that lead to the same places."""
    period = grid.surface.period
    return [np.array([k * period, 0.0]) for k in (-1, 0, 1)] if np.isfinite(period) else [np.zeros(2)]


def _area(grid: ChartGrid, outline: FloatArray | None) -> BoolArray:
    """Cells whose centre lies inside an outline; all without one."""
    if outline is None:
        return np.ones(grid.shape, dtype=np.bool_)
    corners, uv = outline_uv(grid.surface, outline), grid.centres_uv()
    inside = np.zeros(grid.shape, dtype=np.bool_)
    for shift in _turns(grid):
        inside |= contains_xy(Polygon(corners + shift), uv[..., 0], uv[..., 1])
    return inside


def _side(grid: ChartGrid, start: FloatArray, end: FloatArray, sign: float) -> Trim:
    """One side of an outline as a cut through the cells that it crosses."""
    length = float(np.linalg.norm(end - start))
    line = Line(start, (end - start) / length)
    uv = grid.centres_uv()
    half = float(np.hypot(*grid.cell)) / 2
    along = line.along(uv)
    near = (np.abs(line.across(uv)) <= half) & (along >= -half) & (along <= length + half)
    return Trim(line, sign, near)
