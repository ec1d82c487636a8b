# SPDX-License-Identifier: MIT
"""Voxels: equal cubes that fill a box of the world, and surfels: what scans have seen of the surface in each.

Image normals are the local surface of each pixel of a range image, from its neighbours in the image.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nbv.online.limits import FINE_ENOUGH_M, FLATTEST, STEADY_SD
from scenes.checks import FloatArray, InputError, Value, frozen_copy, read_only_view
from scenes.pose import Pose
from scenes.scan.range_image import RangeImage
from texture.engine.compiled import compiled, inlined

_MOST_BEND = (
    0.3  # the middle of three neighbours may lie off the middle by half of this share of their distance
)
_SAME = 7.5  # standard deviations of the range by which the steps to both sides may differ on one plane


@dataclass(frozen=True, slots=True, eq=False)
class ImageNormals(Value):
    """Local surface of each pixel (rows, columns), NaN where unknown.

    `normals` (rows, columns, 3) are world-frame units towards the sensor, `areas` the surface in square
    metres that each pixel stands for, `cosine` that of incidence; `points` (rows, columns, 3) are the
    measured points in world coordinates, metres.
    """

    points: FloatArray
    normals: FloatArray
    areas: FloatArray
    cosine: FloatArray


def image_normals(scan: RangeImage, baseline_m: float) -> ImageNormals:
    """Estimate the normals of a scan.

    In each image direction the two neighbours about `baseline_m` metres away (an even number of pixels, one
    for the whole scan; farther where the scan's noise asks for it) are tried with the pixel half way; the
    side on which that is more nearly their middle is used, so that normals do not reach across creases and
    jump edges. Where the two sides differ by no more than the noise makes them, their mean is used.

    Parameters
    ----------
    scan : RangeImage
        The scan; without a known `sigma_m` it counts as exact.
    baseline_m : float
        Metres.
    """
    sigma = scan.sigma_m or 0.0
    points, reach = scan.points(), scan.ranges[scan.valid]
    half = 1
    if len(reach):
        reach_m = max(baseline_m, STEADY_SD * sigma)
        half = max(round(reach_m / 2 / (float(np.median(reach)) * scan.projection.pixel_angle)), 1)
    normals, areas, cosine = np.empty(points.shape), np.empty(scan.shape), np.empty(scan.shape)
    origin = np.ascontiguousarray(scan.origin)
    _fill(np.ascontiguousarray(points), origin, half, sigma, normals=normals, areas=areas, cosine=cosine)
    return ImageNormals(points, normals, areas, cosine)


@compiled
def _fill(
    points: FloatArray,
    origin: FloatArray,
    half: int,
    sigma_m: float,
    normals: FloatArray,
    areas: FloatArray,
    cosine: FloatArray,
) -> None:
    """Write the normals of all pixels, pixel by pixel."""
    rows, columns = points.shape[:2]
    steps = np.empty((2, 3))  # across and down
    for r in range(rows):
        for c in range(columns):
            for axis in range(2):
                _slope(points, r, c, axis, half, sigma_m, steps[axis])
            across, down = steps[0], steps[1]
            x = across[1] * down[2] - across[2] * down[1]
            y = across[2] * down[0] - across[0] * down[2]
            z = across[0] * down[1] - across[1] * down[0]
            area = np.sqrt(x * x + y * y + z * z)
            areas[r, c] = area
            if not area > 0:
                normals[r, c] = np.nan
                cosine[r, c] = np.nan
                continue
            a = points[r, c, 0] - origin[0]
            b = points[r, c, 1] - origin[1]
            d = points[r, c, 2] - origin[2]
            slope = -(x * a + y * b + z * d) / (area * np.sqrt(a * a + b * b + d * d))
            sign = 1.0 if slope > 0 else (-1.0 if slope < 0 else 0.0)
            normals[r, c, 0] = sign * x / area
            normals[r, c, 1] = sign * y / area
            normals[r, c, 2] = sign * z / area
            cosine[r, c] = abs(slope)


@inlined
def _slope(
    points: FloatArray, row: int, column: int, axis: int, half: int, sigma_m: float, step: FloatArray
) -> None:
    """Write the step (3,) from pixel to pixel along an image direction, from the straighter side; or NaN."""
    n = points.shape[1] if axis == 0 else points.shape[0]
    here = column if axis == 0 else row
    bends = (np.inf, np.inf)
    for side in range(2):
        sign = 1 - 2 * side
        far = here + 2 * sign * half
        if far < 0 or far >= n:
            continue
        bend, chord = _bend(points, row, column, axis, sign * half)
        if bend < _MOST_BEND * chord:
            bends = (bend, bends[1]) if side == 0 else (bends[0], bend)
    both = bends[0] < np.inf and bends[1] < np.inf
    if both and sigma_m > 0:
        apart = 0.0
        for k in range(3):
            edge_step = _point(points, row, column, axis, 2 * half, k) - points[row, column, k]
            other = points[row, column, k] - _point(points, row, column, axis, -2 * half, k)
            apart += (edge_step - other) ** 2
        both = np.sqrt(apart) < _SAME * sigma_m
    else:
        both = False
    sign = -1 if bends[1] < bends[0] else 1
    for k in range(3):
        if both:
            first = _point(points, row, column, axis, 2 * half, k)
            last = _point(points, row, column, axis, -2 * half, k)
            step[k] = (first - last) / (4 * half)
        elif min(bends[0], bends[1]) < np.inf:
            end = _point(points, row, column, axis, 2 * sign * half, k)
            step[k] = sign * (end - points[row, column, k]) / (2 * half)
        else:
            step[k] = np.nan


@inlined
def _bend(points: FloatArray, row: int, column: int, axis: int, half: int) -> tuple[float, float]:
    """Return how far the middle of three pixels lies off, doubled, and how far apart the ends are, metres."""
    bend = chord = 0.0
    for k in range(3):
        here, end = points[row, column, k], _point(points, row, column, axis, 2 * half, k)
        bend += (here + end - 2 * _point(points, row, column, axis, half, k)) ** 2
        chord += (end - here) ** 2
    return np.sqrt(bend), np.sqrt(chord)


@inlined
def _point(points: FloatArray, row: int, column: int, axis: int, step: int, k: int) -> float:
    """Coordinate `k` of the pixel so many steps along an image direction."""
    if axis == 0:
        return float(points[row, column + step, k])
    return float(points[row + step, column, k])


_WISHED_VOXELS = 8e4
_WISHED_VOXELS_OF_LARGE = 4e5
_MOST_VOXELS = 5e7


@dataclass(frozen=True, slots=True, eq=False)
class VoxelGrid(Value):
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
        index: NDArray[np.int64] = _index_of(flat, self.origin, self.shape, self.voxel_m)
        return index.reshape(np.shape(points)[:-1])

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
    return float(min(coarse, max(fine, FINE_ENOUGH_M)))


@compiled
def _index_of(
    points: FloatArray, origin: FloatArray, shape: tuple[int, int, int], voxel_m: float
) -> NDArray[np.int64]:
    """Voxel number (n,) of points (n, 3); -1 outside or where not finite."""
    indices = np.full(len(points), -1, np.int64)
    for n in range(len(points)):
        number, inside = 0, True
        for axis in range(3):
            cell = np.floor((points[n, axis] - origin[axis]) / voxel_m)
            if not (cell >= 0 and cell < shape[axis]):
                inside = False
                break
            number = number * shape[axis] + int(cell)
        if inside:
            indices[n] = number
    return indices


_SIDES = 6
UPWARD = 2  # the side of normals that lean to +z


@dataclass(frozen=True, slots=True, eq=False)
class Surfels(Value):
    """Patches of seen surface: up to six a voxel, one for each axis direction that normals may lean to.

    A voxel in the corner of a room thus keeps its floor and its two walls apart.

    Attributes
    ----------
    keys : (n,) int64
        Voxel number * 6 + side, ascending.
    points, normals : (n, 3) float
        Mean of the samples in the scan that saw the patch best; metres, and towards the sensor.
    quality : (n,) float
        Best cosine of incidence over the scans, each the mean over its samples.
    areas : (n,) float
        Seen area in square metres, the largest of all scans.
    """

    keys: NDArray[np.int64]
    points: FloatArray
    normals: FloatArray
    quality: FloatArray
    areas: FloatArray

    @classmethod
    def none(cls) -> Surfels:
        """Return no surfels."""
        return cls(np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), np.zeros(0))

    @classmethod
    def of_image(cls, local: ImageNormals, grid: VoxelGrid) -> Surfels:
        """Return what one scan has seen; samples without a normal leave none."""
        points = local.points.reshape(-1, 3)
        voxel = grid.index_of(points)
        usable = (voxel >= 0) & (local.cosine.ravel() >= FLATTEST)
        normals = local.normals.reshape(-1, 3)[usable]
        weight, cosine = local.areas.ravel()[usable], local.cosine.ravel()[usable]
        keys, which = _each_once(voxel[usable] * _SIDES + sides_of(normals), grid.n_voxels * _SIDES)
        total = np.asarray(np.bincount(which, weight, len(keys)), dtype=np.float64)
        mean_normal = _means(which, normals, weight, total)
        mean_normal /= np.linalg.norm(mean_normal, axis=1, keepdims=True)
        mean_point = _means(which, points[usable], weight, total)
        quality = np.bincount(which, weight * cosine, len(keys)) / total
        return cls(keys, mean_point, mean_normal, quality, np.minimum(total, 1.5 * grid.voxel_m**2))

    @property
    def voxels(self) -> NDArray[np.int64]:
        """Voxel (n,) that each surfel lies in."""
        return self.keys // _SIDES

    @property
    def sides(self) -> NDArray[np.int64]:
        """Axis direction (n,) that each normal leans to: 0..5 for +x, +y, +z, -x, -y, -z."""
        return self.keys % _SIDES

    def normals_at(self, voxel: NDArray[np.int64], normals: FloatArray) -> FloatArray:
        """Return the normals (n, 3) of the surfels of `normals` (n, 3) in `voxel` (n,); NaN where none is."""
        known = np.flatnonzero((voxel >= 0) & np.isfinite(normals).all(axis=1))
        keys = voxel[known] * _SIDES + sides_of(normals[known])
        at = np.searchsorted(self.keys, keys)
        held = np.append(self.keys, -1)[at] == keys
        found = np.full(normals.shape, np.nan)
        found[known[held]] = self.normals[at[held]]
        return found

    def merge(self, other: Surfels) -> Surfels:
        """Return the union, each surfel from the side that saw it better."""
        keys = np.union1d(self.keys, other.keys)
        mine, theirs = np.searchsorted(keys, self.keys), np.searchsorted(keys, other.keys)
        quality, areas = np.full(len(keys), -1.0), np.zeros(len(keys))
        points, normals = np.zeros((len(keys), 3)), np.zeros((len(keys), 3))
        quality[mine], areas[mine] = self.quality, self.areas
        points[mine], normals[mine] = self.points, self.normals
        better = other.quality > quality[theirs]
        points[theirs[better]], normals[theirs[better]] = other.points[better], other.normals[better]
        quality[theirs] = np.maximum(quality[theirs], other.quality)
        areas[theirs] = np.maximum(areas[theirs], other.areas)
        return Surfels(keys, points, normals, quality, areas)


def _each_once(keys: NDArray[np.int64], n_most: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the different keys, ascending, and where each key (n,), 0 to below `n_most`, stands in them.

    As `np.unique` does, which sorts them: a scan has as many pixels as a volume has voxels.
    """
    held = np.zeros(n_most, np.bool_)
    held[keys] = True
    return np.flatnonzero(held), (np.cumsum(held) - 1)[keys]


def sides_of(normals: FloatArray) -> NDArray[np.int64]:
    """Axis direction 0..5 (+x, +y, +z, -x, -y, -z) that each normal (n, 3) leans to most."""
    axis = np.argmax(
        np.abs(normals) + np.array([2e-6, 1e-6, 0.0]), axis=1
    )  # ties go to x, then y, despite rounding
    backwards = np.take_along_axis(normals, axis[:, None], axis=1)[:, 0] < 0
    return np.asarray(axis + 3 * backwards, dtype=np.int64)


def _means(
    which: NDArray[np.int64], vectors: FloatArray, weight: FloatArray, total: FloatArray
) -> FloatArray:
    sums = [np.bincount(which, weight * vectors[:, axis], len(total)) for axis in range(3)]
    return np.stack(sums, axis=1) / total[:, None]
