# SPDX-License-Identifier: MIT
"""Rectangles: where the beams' odds for no wall sum up to most (after Kadane), found exactly."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scenes.checks import FloatArray
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
