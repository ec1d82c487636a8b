# SPDX-License-Identifier: MIT
"""Plan squares: where beams crossed a storey between floor and ceiling."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from completion.room import limits
from completion.room.planes import Beams
from scenes.checks import BoolArray, FloatArray, IntArray
from texture.engine.compiled import compiled


@dataclass(frozen=True, slots=True, eq=False)
class PlanSquares:
    """The plan of a storey in squares.

    Attributes
    ----------
    low : (2,) float
        Its lower corner along the plan's axes, metres.
    side_m : float
        Side of the squares, metres.
    free : (rows, columns) bool
        Which of them beams crossed between floor and ceiling.
    near : (rows, columns) bool
        Which are near such.
    """

    low: FloatArray
    side_m: float
    free: BoolArray
    near: BoolArray

    @classmethod
    def of(cls, beams: Beams, axes: FloatArray, up: FloatArray, band: tuple[float, float]) -> PlanSquares:
        """Look at beams along `axes` (2, 3) and `up` (3,), between two heights, metres."""
        frame = np.vstack([axes, up])
        begin, end = beams.origin @ frame.T, beams.point @ frame.T
        low = np.quantile(end[:, :2], limits.OUTLYING / 2, axis=0)
        high = np.quantile(end[:, :2], 1 - limits.OUTLYING / 2, axis=0)
        low, high = np.minimum(low, begin[:, :2].min(axis=0)), np.maximum(high, begin[:, :2].max(axis=0))
        low, high = low - limits.AROUND_M, high + limits.AROUND_M
        side_m = max(limits.PLAN_M, float(np.sqrt(np.prod(high - low) / limits.PLAN_CELLS)))
        shape = np.ceil((high - low) / side_m).astype(np.int64)
        count = np.zeros((shape[1], shape[0]), np.int64)
        _cross(begin, end, low, side_m, band[0], band[1], limits.SHORT_M + 3 * beams.sigma, count)
        free = count >= limits.CROSSINGS
        near = ndimage.distance_transform_edt(~free) * side_m <= limits.AROUND_M
        return cls(low, side_m, free, near)

    def areas(self, cell: IntArray, n: int) -> tuple[FloatArray, FloatArray]:
        """Of n cells, by the cell (squares,) of each square: square metres that beams crossed, and others."""
        free, near = self.free.ravel(), self.near.ravel()
        square = self.side_m**2
        crossed, unseen = (np.bincount(cell[part], minlength=n) for part in (free, near & ~free))
        return square * crossed.astype(np.float64), square * unseen.astype(np.float64)

    def number(self, places: FloatArray) -> IntArray:
        """Of the squares, the one (n,) that each place (n, 2) is in."""
        column, row = np.floor((places - self.low) / self.side_m).astype(np.int64).T
        return np.asarray(row * self.free.shape[1] + column)

    @property
    def high(self) -> FloatArray:
        """Upper corner (2,) of all squares."""
        return self.low + self.side_m * np.array(self.free.shape[::-1])

    def places(self) -> FloatArray:
        """Middles (n, 2) of the squares."""
        row, column = np.indices(self.free.shape)
        return self.low + self.side_m * (np.column_stack([column.ravel(), row.ravel()]) + 0.5)


@compiled
def _cross(
    begin: FloatArray,
    end: FloatArray,
    low: FloatArray,
    side_m: float,
    bottom: float,
    top: float,
    short_m: FloatArray,
    count: IntArray,
) -> None:
    """Count how many beams (n, 3) cross each square (rows, columns) between two heights."""
    for k in range(len(begin)):
        length = np.sqrt(((end[k] - begin[k]) ** 2).sum())
        n = int((length - short_m[k]) / (0.5 * side_m))
        last = -1
        for i in range(n):
            part = (i + 0.5) * 0.5 * side_m / length
            height = begin[k, 2] + part * (end[k, 2] - begin[k, 2])
            if height < bottom or height > top:
                continue
            column = int((begin[k, 0] + part * (end[k, 0] - begin[k, 0]) - low[0]) / side_m)
            row = int((begin[k, 1] + part * (end[k, 1] - begin[k, 1]) - low[1]) / side_m)
            if not (0 <= row < count.shape[0] and 0 <= column < count.shape[1]):
                continue
            if row * count.shape[1] + column != last:
                last = row * count.shape[1] + column
                count[row, column] += 1
