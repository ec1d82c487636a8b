# SPDX-License-Identifier: MIT
"""Rectangles of a wall that beams go through, best first, to whole cells."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from scipy import ndimage

from completion.features.openings.limits import (
    BESIDE_NATS,
    CELL_GAPS,
    CELL_M,
    CELL_PRICE,
    DEAR_NATS,
    DENSE_SHARE,
    LEAST_NATS,
    LEAST_PROPOSED_M,
    LEAST_SEEN,
    MOST_CELL_NATS,
    PLACE_M,
    SPECK_M2,
)
from completion.features.openings.recess import Recess
from completion.features.openings.walls import WallBeams
from scenes.checks import BoolArray, FloatArray, IntArray
from texture.engine.compiled import compiled


class CellRectangle(NamedTuple):
    """Rows and columns from the first to before the last, and the sum within."""

    top: int
    left: int
    bottom: int
    right: int
    total: float


def best_rectangle(values: FloatArray) -> CellRectangle:
    """Return the rectangle of cells (rows, columns) whose values sum up to most.

    The exact optimum, in rows squared times columns: for each pair of rows, the best run of columns
    (Bentley 1984, "Programming pearls: algorithm design techniques", after Kadane).
    """
    top, left, bottom, right, total = _search(np.ascontiguousarray(values, dtype=np.float64))
    return CellRectangle(int(top), int(left), int(bottom), int(right), float(total))


@compiled
def _search(values: FloatArray) -> tuple[int, int, int, int, float]:
    rows, columns = values.shape
    best = (0, 0, 0, 0, -np.inf)
    for top in range(rows):
        sums = np.zeros(columns)
        for bottom in range(top, rows):
            run, start = 0.0, 0
            for column in range(columns):
                sums[column] += values[bottom, column]
                if run <= 0.0:
                    run, start = 0.0, column
                run += sums[column]
                if run > best[4]:
                    best = (top, start, bottom + 1, column + 1, run)
    return best


_MOST_CELLS = 400  # along the longer side of the chart
_AROUND = 4  # cells along a larger one
_MOST = 16  # of one wall


@dataclass(frozen=True, slots=True, eq=False)
class WallChart:
    """What beams say of cells of a wall.

    Attributes
    ----------
    corner : (2,) float
        Least u and v, metres.
    cell : float
        Side of a cell, metres.
    nats : (rows, columns) float
        Odds for no wall, clipped; where no beam crosses a cell those of the larger cell around it.
    """

    corner: FloatArray
    cell: float
    nats: FloatArray

    @classmethod
    def of(cls, beams: WallBeams) -> WallChart:
        """Return the chart that holds all beams; cells are not smaller than the closest beams lie apart."""
        low, high = beams.uv.min(axis=0), beams.uv.max(axis=0)
        cell = max(CELL_M, CELL_GAPS * _closest(beams), float((high - low).max()) / _MOST_CELLS)
        shape = np.maximum(np.ceil((high - low) / cell).astype(np.int64), 1)[::-1]
        place = np.minimum(((beams.uv - low) / cell).astype(np.int64), shape[::-1] - 1)
        odds = np.clip(beams.nats, -MOST_CELL_NATS, MOST_CELL_NATS)
        nats, is_met = _sums(odds, place, shape)
        around, _ = _sums(odds, place // _AROUND, shape // _AROUND + 1)
        whole = np.kron(np.clip(around, -BESIDE_NATS, BESIDE_NATS), np.ones((_AROUND, _AROUND)))
        return cls(low, cell, np.where(is_met, nats, whole[: shape[0], : shape[1]]))

    @property
    def wall_m2(self) -> float:
        """Area of the cells that are wall, square metres."""
        return float(np.count_nonzero(self.nats < -1.0)) * self.cell**2

    def hull(self) -> BoolArray:
        """Cells (rows, columns) within the convex hull of the wall's larger pieces."""
        part, n = ndimage.label(self.nats < -1.0, np.ones((3, 3)))
        sizes = np.bincount(part.ravel(), minlength=n + 1)
        large = sizes * self.cell**2 >= SPECK_M2
        large[0] = False
        rows, columns = np.nonzero(large[part])
        inside = np.zeros(self.nats.shape, np.uint8)
        if len(rows) >= 3:
            hull = cv2.convexHull(np.column_stack([columns, rows]).astype(np.int32))
            cv2.fillConvexPoly(inside, hull, 1)
        return inside.astype(np.bool_)


def _sums(odds: FloatArray, place: IntArray, shape: IntArray) -> tuple[FloatArray, BoolArray]:
    """Sums of odds (n,) over cells (rows, columns), clipped, and the cells that beams cross."""
    flat = place[:, 1] * shape[1] + place[:, 0]
    nats = np.bincount(flat, odds, minlength=int(shape.prod())).reshape(shape)
    is_met = np.bincount(flat, minlength=int(shape.prod())).reshape(shape) > 0
    return np.clip(nats, -MOST_CELL_NATS, MOST_CELL_NATS), is_met


def _closest(beams: WallBeams) -> float:
    """The distance between beams, of the scan that sees each place best, that most places come up to."""
    column, row = np.floor((beams.uv - beams.uv.min(axis=0)) / PLACE_M).astype(np.int64).T
    _, place = np.unique(row * (column.max() + 1) + column, return_inverse=True)
    least = np.full(int(place.max()) + 1, np.inf)
    np.minimum.at(least, place, beams.gap)
    return float(np.quantile(least, DENSE_SHARE))


def _undivided_part(nats: FloatArray, rectangle: CellRectangle) -> CellRectangle:
    """The rectangle, or the best part of it where wall divides it from one side to the other.

    Two holes with the wall between them are likelier than one that claims the wall, by as many nats as speak
    for wall in the strip between; more than a rectangle of its own must be worth.
    """
    top, left, bottom, right, _ = rectangle
    part = nats[top:bottom, left:right]
    for axis in (0, 1):
        sums = part.sum(axis=axis)  # of columns, then of rows
        wall = best_rectangle(-sums[None])
        if wall.total < LEAST_NATS:
            continue
        before, after = float(sums[: wall.left].sum()), float(sums[wall.right :].sum())
        first, last = (0, wall.left) if before >= after else (wall.right, len(sums))
        ends = (
            (top, left + first, bottom, left + last) if axis == 0 else (top + first, left, top + last, right)
        )
        return _undivided_part(nats, CellRectangle(*ends, total=max(before, after)))
    return rectangle


def _share(is_open: BoolArray, rectangle: CellRectangle) -> float:
    """The share of a rectangle's cells that beams went through."""
    part = is_open[rectangle.top : rectangle.bottom, rectangle.left : rectangle.right]
    return float(part.mean()) if part.size else 1.0


def propose(chart: WallChart | None, floors: Sequence[FloatArray] = ()) -> Iterator[tuple[Recess, float]]:
    """Yield rectangles in the wall with the odds that they hold, nats, each clear of those before.

    That without wall is worth something only within the hull of what was measured of the wall: beyond its
    ends everything is open. No opening goes on where `floors` meet the wall, at places (n, 2) each.
    """
    if chart is None:
        return
    values = np.where((chart.nats > 0) & ~chart.hull(), 0.0, chart.nats) - CELL_PRICE
    is_open = chart.nats > 1.0
    for places in floors:
        column, row = np.floor((places - chart.corner) / chart.cell).astype(np.int64).T
        inside = (column >= 0) & (column < values.shape[1]) & (row >= 0) & (row < values.shape[0])
        values[row[inside], column[inside]] = -MOST_CELL_NATS
    for _ in range(_MOST):
        rectangle = best_rectangle(values)
        if _share(is_open, rectangle) < LEAST_SEEN:  # two holes, and what nobody saw between them
            rectangle = best_rectangle(np.where(values == -CELL_PRICE, -DEAR_NATS, values))
        if rectangle.total < LEAST_NATS:
            return
        rectangle = _undivided_part(values + CELL_PRICE, rectangle)
        values[rectangle.top : rectangle.bottom, rectangle.left : rectangle.right] = -CELL_PRICE
        left, bottom = chart.corner + chart.cell * np.array([rectangle.left, rectangle.top])
        right, top = chart.corner + chart.cell * np.array([rectangle.right, rectangle.bottom])
        half = chart.cell / 2  # outwards: a side that nobody saw must not lie in what is open
        recess = Recess(
            float(left) - half, float(right) + half, bottom=float(bottom) - half, top=float(top) + half
        )
        if min(recess.size) >= LEAST_PROPOSED_M:
            yield recess, rectangle.total
