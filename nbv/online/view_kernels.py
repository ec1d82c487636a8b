# SPDX-License-Identifier: MIT
"""Loops of view evaluation, compiled: cells of the spherical accumulator, and what apertures see in them."""

import numpy as np
from numpy.typing import NDArray

from scenes.checks import FloatArray
from texture.engine.compiled import compiled


@compiled
def fill_cells(offsets: FloatArray, n: int, cells: NDArray[np.int64]) -> None:
    """Write the cell (k,) of a cube map with n cells along an edge that each direction (k, 3) falls into."""
    for k in range(len(offsets)):
        axis = 0
        for other in range(1, 3):
            if abs(offsets[k, other]) > abs(offsets[k, axis]):
                axis = other
        away = abs(offsets[k, axis])
        cell = axis + 3 if offsets[k, axis] < 0 else axis
        for step in range(1, 3):
            along = (offsets[k, (axis + step) % 3] / away + 1) / 2 * n
            cell = cell * n + int(min(max(along, 0.0), n - 1.0))
        cells[k] = cell


@compiled
def add_gains(
    worth: FloatArray,
    cells: NDArray[np.int64],
    ends: NDArray[np.int64],
    begins: NDArray[np.int32],
    directions: NDArray[np.int32],
    gains: FloatArray,
) -> None:
    """Add to the gains (positions, directions) what each position sees within the aperture of each direction.

    What position i sees stands from `ends[i]` to `ends[i + 1]`, its `worth` and its cell; the directions in
    whose aperture a cell lies stand from `begins` of that cell to the next one's.
    """
    for i in range(len(gains)):
        for k in range(ends[i], ends[i + 1]):
            if worth[k] != 0:
                for at in range(begins[cells[k]], begins[cells[k] + 1]):
                    gains[i, directions[at]] += worth[k]
