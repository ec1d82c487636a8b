# SPDX-License-Identifier: MIT
"""Ray grid: the rays of an image, turned and put in the world by compiled code.

A pinhole's ray is (s, q, 1) and a turning scanner's (p s, q, p t), with p and q of the row, s and t of the
column; so a grid of rays costs one pass over its pixels.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from scenes.checks import FloatArray, IntArray, Value, read_only_view
from scenes.run.memory import in_blocks
from scenes.run.stored_code import can_store

_NOWHERE = np.zeros((0, 0))


@dataclass(frozen=True, slots=True, eq=False)
class RayGrid(Value):
    """Directions (p s, q, p t), of any length, sensor frame.

    Attributes
    ----------
    scale, down : (rows,) float
        p and q.
    right, forward : (columns,) float
        s and t.
    """

    scale: FloatArray
    down: FloatArray
    right: FloatArray
    forward: FloatArray

    def of_rows(self, rows: slice) -> RayGrid:
        """The rays of some rows."""
        return RayGrid(self.scale[rows], self.down[rows], self.right, self.forward)

    def at(self, row: IntArray, column: IntArray) -> FloatArray:
        """Return the unit rays (n, 3) of pixels, sensor frame."""
        scale = self.scale[row]
        rays = np.stack([scale * self.right[column], self.down[row], scale * self.forward[column]], axis=-1)
        return np.asarray(rays / np.linalg.norm(rays, axis=-1, keepdims=True), dtype=np.float64)

    def directions(self, rotation: FloatArray, n_threads: int | None = None) -> FloatArray:
        """Return unit rays (rows, columns, 3), turned by `rotation` (3, 3)."""
        return self._fill(rotation, np.zeros(3), _NOWHERE, n_threads)

    def points(
        self, rotation: FloatArray, origin: FloatArray, ranges: FloatArray, n_threads: int | None = None
    ) -> FloatArray:
        """Return points (rows, columns, 3) at `ranges` along the rays; NaN where a range is not finite."""
        return self._fill(rotation, origin, ranges, n_threads)

    def _fill(
        self, rotation: FloatArray, origin: FloatArray, ranges: FloatArray, n_threads: int | None
    ) -> FloatArray:
        shape = len(self.scale), len(self.right)
        out = np.empty((shape[0] * shape[1], 3))
        matrix, start = np.ascontiguousarray(rotation), np.ascontiguousarray(origin)
        reach = read_only_view(np.ascontiguousarray(ranges).ravel())
        parts = self.scale, self.down, self.right, self.forward

        def fill(rows: slice) -> None:
            _fill(*parts, matrix, start, reach, rows.start, out[rows])

        in_blocks(len(out), fill, n_threads)
        return out.reshape(*shape, 3)


@njit(cache=can_store(), nogil=True)
def _fill(
    scale: FloatArray,
    down: FloatArray,
    right: FloatArray,
    forward: FloatArray,
    rotation: FloatArray,
    origin: FloatArray,
    reach: FloatArray,
    first: int,
    out: FloatArray,
) -> None:
    """Write unit rays, or points where `reach` holds ranges, of pixels `first`.. to `out` (n, 3)."""
    columns = right.size
    for k in range(out.shape[0]):
        row, column = (first + k) // columns, (first + k) % columns
        x, y, z = scale[row] * right[column], down[row], scale[row] * forward[column]
        length = 1.0 / np.sqrt(x * x + y * y + z * z)
        if reach.size:
            r = reach[first + k]
            length = length * r if np.isfinite(r) else np.nan
        for axis in range(3):
            turned = rotation[axis, 0] * x + rotation[axis, 1] * y + rotation[axis, 2] * z
            out[k, axis] = turned * length + origin[axis]
