# SPDX-License-Identifier: MIT
"""Expected gain: how probably a view into unknown space finds new surface.

A line of sight is followed through the voxels, and may meet surface where:

* it crosses inferred surface: with its confidence, and not new, where that is large enough to count;
* it crosses where a measured surface may go on unseen, with a probability by how far that is from what was
  measured, or inferred surface that does not count;
* it passes unknown space, at a constant rate a metre (a Poisson process), by the side it goes towards;
* it leaves the volume unmet, with a probability by side.

The probabilities are shares of what the rays of the scans so far have met; later scans count more, for what
is left unknown changes. Measured surface that is met from its front tells nothing new; from its rear it has
an unseen front before it.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from nbv.coverage.surface_classes import KnownSurfaces
from nbv.online.gain import cell_directions
from nbv.online.limits import CONTINUED_M, FLATTEST, FLATTEST_EXPECTED, REMEMBERED, TRUSTED_RAYS
from nbv.online.occupancy import EMPTY, SEEN, VoxelMap
from nbv.online.voxels import UPWARD, VoxelGrid
from scenes.checks import BoolArray, FloatArray
from scenes.scan.range_image import RangeImage
from texture.engine.compiled import compiled

_CELLS = 32  # of the cube map along an edge: rays 2.8 deg apart
DOUBTFUL = len(CONTINUED_M) + 1  # number of inferred surface that does not count
_EMPTY, _UNKNOWN, _SKIN, _SURFACE = range(4)  # kinds of voxels; skin: unknown ones beside known surface


@dataclass(frozen=True, slots=True, eq=False)
class SurfacePrior:
    """How likely a ray is to meet surface: what rays 2.8 deg apart passed, and what of it they met.

    Attributes
    ----------
    metres, surfaces : (6,) float
        Unknown space that rays passed, metres, and surfaces met there, by the side (+x, +y, +z, -x, -y, -z)
        by which they would leave the volume.
    left, stopped : (6,) float
        Rays that came as far as that side through unknown space, and those that met surface on it.
    crossed, met : (6,) float
        Crossings of possible surface by the numbers of `UnknownSpace.possible`, and those that met it there.
    """

    metres: FloatArray
    surfaces: FloatArray
    left: FloatArray
    stopped: FloatArray
    crossed: FloatArray
    met: FloatArray

    @classmethod
    def none(cls) -> SurfacePrior:
        """Return the prior before any scan: even chances, as if `TRUSTED_RAYS` rays had shown them."""
        rays, sides, bins = TRUSTED_RAYS, np.ones(6), np.ones(DOUBTFUL + 1)
        return cls(
            metres=rays * sides,
            surfaces=rays / 2 * sides,
            left=rays * sides,
            stopped=rays / 2 * sides,
            crossed=rays * bins,
            met=rays / 2 * bins,
        )

    def rate_per_m(self) -> FloatArray:
        """Surfaces a metre (6,) of unknown space, by side."""
        return np.asarray(self.surfaces / self.metres)

    def trust(self) -> FloatArray:
        """Probability (6,) of surface on each side of the volume."""
        return np.asarray(self.stopped / self.left)

    def possible(self) -> FloatArray:
        """Probability (6,) of possible surface of each kind."""
        return np.asarray(self.met / self.crossed)

    def after(self, scan: RangeImage, space: UnknownSpace) -> SurfacePrior:
        """Return the prior updated by a scan of a `space` as it was known before."""
        rays, _ = _directions()
        pixels = scan.pixels(scan.origin + rays)
        looked = np.isfinite(pixels).all(axis=1)
        row, column = np.rint(pixels[looked]).astype(np.int64).T
        ranges = np.where(np.isfinite(scan.ranges), scan.ranges, np.inf)[row, column]
        counts = [REMEMBERED * getattr(self, field.name) for field in fields(self)]
        grid = space.grid
        _tally(
            scan.origin, rays[looked], ranges, grid.origin, grid.shape, grid.voxel_m, space.kind,
            space.confidence, space.possible, *counts,
        )  # fmt: skip
        return SurfacePrior(*counts)


@dataclass(frozen=True, slots=True, eq=False)
class UnknownSpace:
    """A map after completion of its scans, prepared for rays.

    Attributes
    ----------
    grid : VoxelGrid
        The voxels.
    kind : (n_voxels,) int8
        Empty, unknown, unknown beside known surface, or surface.
    confidence : (n_voxels,) float
        In unknown voxels the probability of inferred surface that counts as known, 0 where there is none.
    possible : (n_voxels,) int8
        Unknown voxels where a measured surface may go on, 1 to 4 by how far (`CONTINUED_M`), and those with
        inferred surface that does not count, 5; 0 elsewhere.
    outdoors : (columns,) bool
        Columns of voxels known to be empty down to the bottom of the volume, or up to its top over no floor:
        what is seen through them bounds no room.
    first, normals : (n_voxels + 1,) int64, (m, 3) float
        Where the measured normals of each voxel begin, and these.
    """

    grid: VoxelGrid
    kind: NDArray[np.int8]
    confidence: FloatArray
    possible: NDArray[np.int8]
    outdoors: BoolArray
    first: NDArray[np.int64]
    normals: FloatArray

    @classmethod
    def of(cls, voxels: VoxelMap, completed: KnownSurfaces | None = None) -> UnknownSpace:
        """Return the unknown space of a map; without completion nothing is inferred."""
        grid, surfels, n = voxels.grid, voxels.surfels, voxels.grid.n_voxels
        seen, confidence, possible = voxels.labels == SEEN, np.zeros(n), np.zeros(n, np.int8)
        unknown = ~seen & (voxels.labels != EMPTY)
        if completed is not None:
            at, away = _within(grid, *completed.continued_points(grid.voxel_m / 2))
            order = np.argsort(-away, kind="stable")
            possible[at[order]] = 1 + np.searchsorted(CONTINUED_M[:-1], away[order])
            at, sure = _within(grid, *completed.inferred_points(grid.voxel_m / 2))
            np.maximum.at(confidence, at, sure)
            possible[confidence > 0] = DOUBTFUL
            confidence[~unknown | (confidence < completed.min_confidence)] = 0.0
            possible[~unknown | (confidence > 0)] = 0
        beside = binary_dilation((seen | (confidence > 0)).reshape(grid.shape), np.ones((3, 3, 3))).ravel()
        kind = np.full(n, _EMPTY, np.int8)
        kind[unknown] = np.where(beside[unknown], _SKIN, _UNKNOWN)
        kind[seen] = _SURFACE
        first = np.searchsorted(surfels.keys, 6 * np.arange(n + 1))
        return cls(
            grid=grid,
            kind=kind,
            confidence=confidence,
            possible=possible,
            outdoors=_outdoors(voxels),
            first=first,
            normals=np.ascontiguousarray(surfels.normals),
        )


def _outdoors(voxels: VoxelMap) -> BoolArray:
    """Tell which columns of voxels (columns,) are in the open; none around an object."""
    empty = (voxels.labels == EMPTY).reshape(-1, voxels.grid.shape[2])
    if voxels.outside_is_empty:
        return np.zeros(len(empty), np.bool_)
    is_floored = np.zeros(len(empty), np.bool_)
    is_floored[voxels.surfels.voxels[voxels.surfels.sides == UPWARD] // voxels.grid.shape[2]] = True
    return np.asarray(empty[:, 0] | (empty[:, -1] & ~is_floored))


def _within(grid: VoxelGrid, points: FloatArray, values: FloatArray) -> tuple[NDArray[np.int64], FloatArray]:
    """Voxels of those of the points (n, 3) that lie in the grid, and their values."""
    at = grid.index_of(points)
    return at[at >= 0], values[at >= 0]


@dataclass(frozen=True, slots=True, eq=False)
class ExpectedGain:
    """Unknown space, where surface in it is worth seeing (`wanted`, (n_voxels,)), and how likely it is."""

    space: UnknownSpace
    prior: SurfacePrior
    wanted: BoolArray

    def chance_behind(self, position: FloatArray, offsets: FloatArray, max_range_m: float) -> FloatArray:
        """Probability (n,) that rays from a position (3,) find new surface where, and behind where, they end.

        `offsets` (n, 3) are from the position to the places, metres along the world's axes.
        """
        space, prior = self.space, self.prior
        near = np.linalg.norm(offsets, axis=1)
        return _expect(
            position, offsets / near[:, None], near - space.grid.voxel_m, max_range_m, space.grid.origin,
            space.grid.shape, space.grid.voxel_m, space.kind, space.confidence, space.possible,
            space.outdoors, space.first, space.normals, self.wanted,
            prior.rate_per_m(), prior.trust(), prior.possible(),
        )  # fmt: skip


@compiled
def _cross(
    position: FloatArray,
    ray: FloatArray,
    origin: FloatArray,
    shape: tuple[int, int, int],
    voxel_m: float,
    voxels: NDArray[np.int64],
    ends: FloatArray,
) -> tuple[int, float, int]:
    """Write the voxels that a ray crosses, and where it leaves each, metres (Amanatides and Woo 1987).

    Returns how many there are, where it enters the first, and the side by which it leaves the volume.
    """
    begin, end, side = 0.0, np.inf, -1
    for axis in range(3):
        high = origin[axis] + shape[axis] * voxel_m
        if ray[axis] == 0.0:
            if not origin[axis] <= position[axis] < high:
                return 0, 0.0, -1
            continue
        to_low, to_high = (origin[axis] - position[axis]) / ray[axis], (high - position[axis]) / ray[axis]
        begin = max(begin, min(to_low, to_high))
        if max(to_low, to_high) < end:
            end, side = max(to_low, to_high), axis if ray[axis] > 0 else axis + 3
    if begin >= end:
        return 0, 0.0, -1
    cell, step = np.zeros(3, np.int64), np.zeros(3, np.int64)
    following, across = np.full(3, np.inf), np.full(3, np.inf)
    for axis in range(3):
        at = (position[axis] + (begin + 1e-9) * ray[axis] - origin[axis]) / voxel_m
        cell[axis] = min(max(int(np.floor(at)), 0), shape[axis] - 1)
        if ray[axis] != 0.0:
            step[axis] = 1 if ray[axis] > 0 else -1
            face = origin[axis] + (cell[axis] + (1 if ray[axis] > 0 else 0)) * voxel_m
            following[axis], across[axis] = (face - position[axis]) / ray[axis], voxel_m / abs(ray[axis])
    n = 0
    while n < len(voxels):
        axis = 0
        for other in range(1, 3):
            if following[other] < following[axis]:
                axis = other
        voxels[n] = (cell[0] * shape[1] + cell[1]) * shape[2] + cell[2]
        ends[n] = following[axis]
        n += 1
        cell[axis] += step[axis]
        if cell[axis] < 0 or cell[axis] >= shape[axis]:
            break
        following[axis] += across[axis]
    return n, begin, side


@compiled
def _expect(
    position: FloatArray,
    rays: FloatArray,
    near: FloatArray,
    max_range_m: float,
    origin: FloatArray,
    shape: tuple[int, int, int],
    voxel_m: float,
    kind: NDArray[np.int8],
    confidence: FloatArray,
    possible: NDArray[np.int8],
    outdoors: BoolArray,
    first: NDArray[np.int64],
    normals: FloatArray,
    wanted: BoolArray,
    rate_per_m: FloatArray,
    trust: FloatArray,
    chances: FloatArray,
) -> FloatArray:
    """Return how probably each ray (n, 3) finds new surface beyond `near` (n,), metres."""
    most = shape[0] + shape[1] + shape[2] + 3
    voxels, ends, found = np.zeros(most, np.int64), np.zeros(most), np.zeros(len(rays))
    for i in range(len(rays)):
        ray = rays[i]
        n, begin, side = _cross(position, ray, origin, shape, voxel_m, voxels, ends)
        left, was_inferred, was_possible, is_open = 1.0, False, False, n > 0
        for k in range(n):
            voxel, end = voxels[k], ends[k]
            if end <= near[i]:
                begin = end
                continue
            if begin > max_range_m or (kind[voxel] == _EMPTY and outdoors[voxel // shape[2]]):
                is_open = False
                break
            if kind[voxel] == _SURFACE:
                is_rear = first[voxel + 1] > first[voxel]
                for at in range(first[voxel], first[voxel + 1]):
                    slope = ray[0] * normals[at, 0] + ray[1] * normals[at, 1] + ray[2] * normals[at, 2]
                    is_rear = is_rear and slope > FLATTEST
                if is_rear and wanted[voxel]:
                    found[i] += left
                is_open = False
                break
            if confidence[voxel] > 0.0 and not was_inferred:
                left *= 1.0 - confidence[voxel]
            was_inferred = confidence[voxel] > 0.0
            if possible[voxel] > 0 and not was_possible:
                meets = chances[possible[voxel]]
                if wanted[voxel]:
                    found[i] += left * meets
                left *= 1.0 - meets
            was_possible = possible[voxel] > 0
            if kind[voxel] == _UNKNOWN and not was_inferred and not was_possible:
                meets = 1.0 - np.exp(-rate_per_m[side] * (end - begin))
                if wanted[voxel]:
                    found[i] += left * meets
                left *= 1.0 - meets
            begin = end
        last = voxels[n - 1] if n else 0
        is_open = is_open and begin <= max_range_m and abs(ray[side % 3]) >= FLATTEST_EXPECTED
        if is_open and kind[last] != _EMPTY and wanted[last] and not (was_inferred or was_possible):
            found[i] += left * trust[side]
    return found


@compiled
def _tally(
    position: FloatArray,
    rays: FloatArray,
    ranges: FloatArray,
    origin: FloatArray,
    shape: tuple[int, int, int],
    voxel_m: float,
    kind: NDArray[np.int8],
    confidence: FloatArray,
    possible: NDArray[np.int8],
    metres: FloatArray,
    surfaces: FloatArray,
    left: FloatArray,
    stopped: FloatArray,
    crossed: FloatArray,
    met: FloatArray,
) -> None:
    """Add to what `SurfacePrior` counts what rays (n, 3) that end at `ranges` (n,) metres passed and met."""
    most = shape[0] + shape[1] + shape[2] + 3
    voxels, ends = np.zeros(most, np.int64), np.zeros(most)
    for i in range(len(rays)):
        n, begin, side = _cross(position, rays[i], origin, shape, voxel_m, voxels, ends)
        if n == 0:
            continue
        out, last, was_possible = ends[n - 1], voxels[n - 1], False
        comes_out = ranges[i] > out - 2 * voxel_m / abs(rays[i, side % 3])
        is_unknown = kind[last] == _UNKNOWN or kind[last] == _SKIN
        if comes_out and is_unknown and confidence[last] == 0.0 and possible[last] == 0:
            left[side] += 1.0
            stopped[side] += 1.0 if ranges[i] <= out else 0.0
        for k in range(n):
            number = possible[voxels[k]]
            if number > 0 and not was_possible:
                crossed[number] += 1.0
                met[number] += 1.0 if ranges[i] <= ends[k] + 1.5 * voxel_m else 0.0
            was_possible = number > 0
            if kind[voxels[k]] == _UNKNOWN and confidence[voxels[k]] == 0.0 and not was_possible:
                metres[side] += max(min(ends[k], ranges[i]) - begin, 0.0)
                surfaces[side] += 1.0 if begin < ranges[i] <= ends[k] and not comes_out else 0.0
            begin = ends[k]
            if begin >= ranges[i]:
                break


@cache
def _directions() -> tuple[FloatArray, FloatArray]:
    """Unit rays (n, 3) through the cells of a cube map, and the solid angle (n,) of each cell, sr."""
    rays = cell_directions(_CELLS)
    largest = np.abs(rays).max(axis=1)
    return rays, (2 / _CELLS) ** 2 * largest**3
