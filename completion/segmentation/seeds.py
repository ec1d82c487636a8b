# SPDX-License-Identifier: MIT
"""Seeds: the tiles that surfaces grow from, from the middle of the largest area on."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from completion.observe.tiles import Tiles, solve_plane
from completion.segmentation.growing import CHI2_3, quadratic
from scenes.checks import BoolArray, FloatArray
from texture.engine.compiled import compiled, inlined

_MAX_MISFIT = 3.0  # of a tile that an edge may not cross
_SEED_CUT = 0.25  # excess of the plane through 3 x 3 tiles below which they are one surface
_ACROSS, _ASLANT = 62_587, 89_738  # of a step, 1 / 65,536: Borgefors' best for steps to eight neighbours
_UNIT = 65_536


@dataclass(frozen=True, slots=True, eq=False)
class Seeds:
    """Where growing may begin and go."""

    flat: BoolArray  # (rows, columns) tiles that no edge crosses
    coherent: BoolArray  # (rows, columns) those that lie on one plane with the tiles around


def find_seeds(tiles: Tiles) -> Seeds:
    """Tell which tiles lie inside one surface, alone and with their neighbours."""
    flat: BoolArray = tiles.misfit <= _MAX_MISFIT * (1 + 3 * np.sqrt(2 / np.maximum(tiles.count - 3, 1)))
    return Seeds(flat, _coherent(flat, tiles.count, tiles.matrix, tiles.vector, tiles.plane, tiles.misfit))


def depths_within(area: BoolArray) -> NDArray[np.int64]:
    """Return how far from the outside each tile of an area (rows, columns) is at most, for `next_seed`.

    By steps to eight neighbours, after Borgefors (1986), Distance transformations in digital images.
    """
    depth = cv2.distanceTransform(np.pad(area, 1).astype(np.uint8), cv2.DIST_L2, 3)[1:-1, 1:-1]
    above = np.nextafter(depth, np.float32(np.inf)).astype(np.float64)  # it was rounded to single precision
    return np.where(area, np.ceil(_UNIT * above).astype(np.int64), 0)


def next_seed(candidates: BoolArray, depths: NDArray[np.int64]) -> tuple[int, int] | None:
    """Return row and column of the tile in the middle of the largest area of candidates (rows, columns).

    None when nothing is left. `depths` (rows, columns) are bounds from `depths_within` of an area that all
    candidates lie in. Candidates only ever leave: a bound is looked at again when it is the greatest, and
    lowered in place.
    """
    row, column = _deepest(candidates, depths)
    return (int(row), int(column)) if depths[row, column] > 0 else None


@compiled
def _deepest(candidates: BoolArray, depths: NDArray[np.int64]) -> tuple[int, int]:
    """The first of the tiles that are deepest within the candidates; the bounds are lowered on the way."""
    rows = depths.shape[0]
    where, most = np.zeros(rows, np.int64), np.zeros(rows, np.int64)
    for row in range(rows):
        for column in range(depths.shape[1]):
            if not candidates[row, column]:
                depths[row, column] = 0
        where[row] = np.argmax(depths[row])
        most[row] = depths[row, where[row]]
    while True:
        row = int(np.argmax(most))
        column, bound = where[row], most[row]
        if bound == 0:
            return row, column
        found = _depth(candidates, row, column, bound)
        if found == bound:
            return row, column
        depths[row, column] = found
        where[row] = np.argmax(depths[row])
        most[row] = depths[row, where[row]]


@inlined
def _depth(candidates: BoolArray, row: int, column: int, bound: int) -> int:
    """How far a tile is from the nearest that is no candidate; no more than the bound."""
    rows, columns = candidates.shape
    nearest, ring = bound, 1
    while ring * _ACROSS < nearest:
        for i in range(row - ring, row + ring + 1):
            whole = abs(i - row) == ring
            for j in range(column - ring, column + ring + 1, 1 if whole else 2 * ring):
                if 0 <= i < rows and 0 <= j < columns and candidates[i, j]:
                    continue
                aslant = min(abs(i - row), abs(j - column))
                nearest = min(nearest, (ring - aslant) * _ACROSS + aslant * _ASLANT)
        ring += 1
    return nearest


@compiled
def _coherent(
    flat: BoolArray,
    count: FloatArray,
    matrix: FloatArray,
    vector: FloatArray,
    plane: FloatArray,
    misfit: FloatArray,
) -> BoolArray:
    """Which flat tiles agree with the plane of their flat neighbours."""
    rows, columns = flat.shape
    result = np.zeros((rows, columns), np.bool_)
    a, b, w = np.zeros(6), np.zeros(3), np.zeros(3)
    for i in range(rows):
        for j in range(columns):
            if not flat[i, j]:
                continue
            a[:], b[:] = 0.0, 0.0
            n, n_pixels = 0, 0.0
            for k in range(max(i - 1, 0), min(i + 2, rows)):
                for m in range(max(j - 1, 0), min(j + 2, columns)):
                    if flat[k, m]:
                        for t in range(6):
                            a[t] += matrix[k, m, t]
                        for t in range(3):
                            b[t] += vector[k, m, t]
                        n += 1
                        n_pixels += count[k, m]
            if n < 5 or not solve_plane(a, b, w):
                continue
            excess, worst = 0.0, 1.0
            for k in range(max(i - 1, 0), min(i + 2, rows)):
                for m in range(max(j - 1, 0), min(j + 2, columns)):
                    if flat[k, m]:
                        own = plane[k, m]
                        excess += quadratic(matrix[k, m], w[0] - own[0], w[1] - own[1], w[2] - own[2])
                        worst = max(worst, misfit[k, m])
            result[i, j] = excess <= (_SEED_CUT * n_pixels + CHI2_3 * n) * worst
    return result
