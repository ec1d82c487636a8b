# SPDX-License-Identifier: MIT
"""Provenance: how each place of a completed surface came to be in the model."""

from __future__ import annotations

from enum import IntEnum

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from shapely import MultiPoint, contains_xy

from completion.evidence.chart_grid import ChartGrid
from completion.extension.extent import Limits
from scenes.checks import BoolArray


class Provenance(IntEnum):
    """How a place came to be in the model."""

    MEASURED = 0
    INTERIOR = 1  # a hole in the measured part: the surface goes on behind the occluder
    BETWEEN = 2  # between parts that an occluder had cut apart
    EDGES = 3  # inside the measured part's own straight edges, continued until they meet
    ARCHITECTURAL = 4  # on to the plane that encloses the room there
    FULL_TURN = 5  # around the back of a cylinder
    USER = 6  # because a person says so


def hull_of(grid: ChartGrid, cells: BoolArray) -> BoolArray:
    """Cells whose centre lies in the convex hull of the given ones."""
    rows, columns = np.nonzero(cells)
    if len(rows) < 3:
        return cells.copy()
    outline = MultiPoint(np.column_stack([columns, rows]).astype(np.float64)[_extremes(rows)]).convex_hull
    row, column = np.mgrid[: grid.shape[0], : grid.shape[1]]
    return np.asarray(contains_xy(outline.buffer(0.5), column, row), dtype=np.bool_)


def _extremes(rows: NDArray[np.int64]) -> NDArray[np.int64]:
    """Indices of the first and last cell in each row; `rows` ascends, and columns ascend in each."""
    first = np.flatnonzero(np.diff(rows, prepend=-1))
    return np.unique(np.concatenate([first, np.append(first[1:] - 1, len(rows) - 1)]))


def provenance_of(
    grid: ChartGrid, limits: Limits, observed: BoolArray, hypothesised: BoolArray
) -> NDArray[np.int8]:
    """Give each observed or hypothesised cell its `Provenance`, -1 to the others."""
    result = np.full(grid.shape, -1, np.int8)
    uv = grid.centres_uv()
    beyond = ((uv < limits.own_low) | (uv > limits.own_high)).any(axis=-1)
    if limits.full_turn:
        beyond = (uv[..., 1] < limits.own_low[1]) | (uv[..., 1] > limits.own_high[1])
        turned = (uv[..., 0] < limits.own_low[0]) | (uv[..., 0] > limits.own_high[0])
        result[hypothesised & turned] = Provenance.FULL_TURN
    result[hypothesised & beyond] = Provenance.ARCHITECTURAL
    within = hypothesised & (result < 0)
    result[within] = Provenance.EDGES
    part, n_parts = ndimage.label(observed, structure=np.ones((3, 3)))
    sizes = np.bincount(part.ravel(), minlength=n_parts + 1)[1:]
    if len(sizes):
        largest = part == int(np.argmax(sizes)) + 1
        result[within & hull_of(grid, observed)] = Provenance.BETWEEN
        result[within & hull_of(grid, largest)] = Provenance.INTERIOR
    result[observed] = Provenance.MEASURED
    return result
