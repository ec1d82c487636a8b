# SPDX-License-Identifier: MIT
"""Voxel grid: equal cubes that fill a box of the world."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scenes.checks import FloatArray, InputError, frozen_copy, read_only_view
from scenes.pose import Pose
from texture.engine.compiled import compiled

_WISHED_VOXELS = 8e4
_WISHED_VOXELS_OF_LARGE = 4e5
_FINE_ENOUGH_M = 0.1  # large volumes get more voxels until they are this small
_MOST_VOXELS = 5e7


@dataclass(frozen=True, slots=True, eq=False)
class VoxelGrid:
    """Cubes of side `voxel_m` (metres) from `origin` (3,) along the world's axes, `shape` of them.

    Voxels are numbered in C order. Indices of points outside are -1.

    Examples
    --------
    >>> grid = VoxelGrid(np.zeros(3), (2, 3, 4), 0.5)
    >>> grid.index_of(np.array([[0.6, 0.1, 1.9], [9.0, 0.0, 0.0]])).tolist()
    [15, -1]
    >>> grid.centres()[15].tolist()
    [0.75, 0.25, 1.75]
    """

    origin: FloatArray
    shape: tuple[int, int, int]
    voxel_m: float

    def __post_init__(self) -> None:
        if not self.voxel_m > 0 or min(self.shape) < 1:
            raise InputError(
                f"a voxel grid needs a positive side and shape, got {self.voxel_m}, {self.shape}"
            )
        object.__setattr__(self, "origin", frozen_copy(self.origin, np.float64))

    @classmethod
    def around(cls, bounds: FloatArray, voxel_m: float | None = None) -> VoxelGrid:
        """Return the grid that holds `bounds` (2, 3) with at least half a voxel to spare on every side.

        Surfaces on the bounds then lie well inside voxels. Without `voxel_m` there are about 80,000 voxels,
        in large volumes up to 400,000 until a voxel is 0.1 m.

        Raises
        ------
        InputError
            Bounds that are not finite or upside down; a voxel so small that there are more than 5e7.
        """
        low, high = np.asarray(bounds, dtype=np.float64)
        extent = high - low
        if not np.isfinite(extent).all() or (extent < 0).any() or extent.max() <= 0:
            raise InputError(f"bounds must be finite and rise, got {low.tolist()} to {high.tolist()}")
        side = voxel_m or _default_side(extent)
        shape = np.ceil(extent / side - 1e-6).astype(int) + 1
        if np.prod(shape.astype(float)) > _MOST_VOXELS:
            raise InputError(
                f"a voxel of {side} m needs {np.prod(shape.astype(float)):.3g} voxels; use a larger one"
            )
        spare = (shape * side - extent) / 2
        return cls(low - spare, (int(shape[0]), int(shape[1]), int(shape[2])), side)

    @property
    def n_voxels(self) -> int:
        """How many voxels there are."""
        return int(np.prod(self.shape))

    def index_of(self, points: FloatArray) -> NDArray[np.int64]:
        """Voxel number (n,) of `points` (n, 3); -1 outside or where not finite."""
        flat = read_only_view(np.ascontiguousarray(points, dtype=np.float64).reshape(-1, 3))
        found: NDArray[np.int64] = _index_of(flat, self.origin, self.shape, self.voxel_m)
        return found.reshape(np.shape(points)[:-1])

    def centres(self, voxels: NDArray[np.int64] | None = None) -> FloatArray:
        """Centres (n, 3) of the numbered voxels, of all when not given."""
        numbers = np.arange(self.n_voxels) if voxels is None else voxels
        cell = np.stack(np.unravel_index(numbers, self.shape), axis=-1)
        centres: FloatArray = self.origin + (cell + 0.5) * self.voxel_m
        return centres

    def centres_in(self, sensor_from_world: Pose) -> FloatArray:
        """Centres (n_voxels, 3) of all voxels in another frame, metres.

        They are sums of one vector for each plane of voxels, which is faster than to move every centre.
        """
        planes = [
            (self.origin[axis] + (np.arange(n) + 0.5) * self.voxel_m)[:, None]
            * sensor_from_world.rotation[:, axis]
            for axis, n in enumerate(self.shape)
        ]
        floor = planes[0][:, None] + (planes[1] + sensor_from_world.translation)
        moved: FloatArray = (floor[:, :, None] + planes[2]).reshape(-1, 3)
        return moved

    def way_out(self, points: FloatArray, rays: FloatArray) -> tuple[FloatArray, NDArray[np.int64]]:
        """Return how far (n,) rays from `points` (n, 3) inside go until they leave the grid, metres.

        The second array is the side (n,) by which they leave: 0..5 for +x, +y, +z, -x, -y, -z.
        """
        high = self.origin + np.array(self.shape) * self.voxel_m
        with np.errstate(divide="ignore", invalid="ignore"):
            sides = np.where(rays > 0, high - points, self.origin - points) / rays
        sides = np.where(rays != 0, sides, np.inf)
        axis = sides.argmin(axis=1)
        rows = np.arange(len(rays))
        return np.maximum(sides[rows, axis], 0.0), axis + 3 * (rays[rows, axis] < 0)

    def around_cells(self, cells: NDArray[np.int64], radius_m: float) -> NDArray[np.int64]:
        """Numbers (n, k) of the voxels whose centres lie nearer than `radius_m` to those of `cells` (n,).

        Voxels beyond the grid are -1.
        """
        n = int(np.ceil(radius_m / self.voxel_m))
        steps = np.stack(np.meshgrid(*[np.arange(-n, n + 1)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
        steps = steps[np.linalg.norm(steps, axis=1) * self.voxel_m < radius_m]
        at = np.stack(np.unravel_index(cells, self.shape), axis=-1)[:, None] + steps
        inside = ((at >= 0) & (at < np.array(self.shape))).all(axis=-1)
        i, j, k = np.moveaxis(at, -1, 0)
        return np.where(inside, (i * self.shape[1] + j) * self.shape[2] + k, -1)


def _default_side(extent: FloatArray) -> float:
    volume = float(np.prod(np.maximum(extent, extent.max() / 20)))
    coarse, fine = ((volume / n) ** (1 / 3) for n in (_WISHED_VOXELS, _WISHED_VOXELS_OF_LARGE))
    return float(min(coarse, max(fine, _FINE_ENOUGH_M)))


@compiled
def _index_of(
    points: FloatArray, origin: FloatArray, shape: tuple[int, int, int], voxel_m: float
) -> NDArray[np.int64]:
    """Voxel number (n,) of points (n, 3); -1 outside or where not finite."""
    found = np.full(len(points), -1, np.int64)
    for n in range(len(points)):
        number, inside = 0, True
        for axis in range(3):
            cell = np.floor((points[n, axis] - origin[axis]) / voxel_m)
            if not (cell >= 0 and cell < shape[axis]):
                inside = False
                break
            number = number * shape[axis] + int(cell)
        if inside:
            found[n] = number
    return found
