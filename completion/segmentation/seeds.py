# SPDX-License-Identifier: MIT
"""Seeds: tiles in the middle of flat areas, where growing begins."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from completion.observe.tiles import Tiles, solve_plane
from completion.segmentation.growing import CHI2_3, quadratic
from scenes.checks import BoolArray, FloatArray
from texture.engine.compiled import compiled

_MAX_MISFIT = 3.0  # of a tile that an edge may not cross
_SEED_CUT = 0.25  # excess of the plane through 3 x 3 tiles below which they are one surface


@dataclass(frozen=True, slots=True, eq=False)
class Seeds:
    """Where growing may begin and go.

    Attributes
    ----------
    flat : (rows, columns) bool
        Tiles that no edge crosses.
    coherent : (rows, columns) bool
        Those that lie on one plane with the tiles around.
    """

    flat: BoolArray
    coherent: BoolArray


def find_seeds(tiles: Tiles) -> Seeds:
    """Tell which tiles lie inside one surface, alone and with their neighbours."""
    flat: BoolArray = tiles.misfit <= _MAX_MISFIT * (1 + 3 * np.sqrt(2 / np.maximum(tiles.count - 3, 1)))
    return Seeds(flat, _coherent(flat, tiles.count, tiles.matrix, tiles.vector, tiles.plane, tiles.misfit))


def next_seed(candidates: BoolArray) -> tuple[int, int] | None:
    """Return row and column of the tile in the middle of the largest area of candidates (rows, columns).

    None when nothing is left.
    """
    if not candidates.any():
        return None
    depth = cv2.distanceTransform(np.pad(candidates, 1).astype(np.uint8), cv2.DIST_L2, 3)[1:-1, 1:-1]
    row, column = np.unravel_index(int(np.argmax(depth)), depth.shape)
    return int(row), int(column)


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
