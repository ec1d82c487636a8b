# SPDX-License-Identifier: MIT
"""Surfels: the normals of a range image, and what scans have seen of the surface in each voxel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nbv.visibility.voxel_grid import VoxelGrid
from scenes.checks import FloatArray
from scenes.scan.range_image import RangeImage

_MOST_BEND = (
    0.3  # the middle of three neighbours may lie off the middle by half of this share of their distance
)
_STEADY = 16.0  # standard deviations of the range to reach over: one side's slope then errs by about 5 deg
_SAME = 7.5  # standard deviations of the range by which the steps to both sides may differ on one plane


@dataclass(frozen=True, slots=True, eq=False)
class ImageNormals:
    """Local surface of each pixel (rows, columns), NaN where unknown.

    `normals` (rows, columns, 3) are world-frame units towards the sensor, `areas` the surface in square
    metres that each pixel stands for, `cosine` that of incidence.
    """

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
    points = scan.points()
    reach = scan.ranges[scan.valid]
    if not len(reach):
        nothing = np.full(scan.shape, np.nan)
        return ImageNormals(np.full((*scan.shape, 3), np.nan), nothing, nothing)
    reach_m = max(baseline_m, _STEADY * sigma)
    half = max(round(reach_m / 2 / (float(np.median(reach)) * scan.projection.pixel_angle)), 1)
    across = _slope(points, half, sigma)
    down = np.moveaxis(_slope(np.moveaxis(points, 0, 1), half, sigma), 0, 1)
    normal = np.cross(across, down)
    areas = np.linalg.norm(normal, axis=-1)
    with np.errstate(invalid="ignore", divide="ignore"):
        normal /= areas[..., None]
        cosine = -np.einsum("ijk,ijk->ij", normal, scan.rays())
    return ImageNormals(normal * np.sign(cosine)[..., None], areas, np.abs(cosine))


def _slope(points: FloatArray, half: int, sigma_m: float) -> FloatArray:
    """Step along the second axis, metres a pixel, from the straighter side; NaN where both sides bend."""
    n = points.shape[1]
    sides, bends = np.full((2, *points.shape), np.nan), np.full((2, *points.shape[:2]), np.inf)
    first, last = slice(0, max(n - 2 * half, 0)), slice(2 * half, n)
    middle = slice(half, max(n - half, half))
    for k, (sign, here, far) in enumerate(((1, first, last), (-1, last, first))):
        chord = points[:, far] - points[:, here]
        bend = np.linalg.norm(points[:, here] + points[:, far] - 2 * points[:, middle], axis=-1)
        with np.errstate(invalid="ignore"):
            straight = bend < _MOST_BEND * np.linalg.norm(chord, axis=-1)
        sides[k][:, here][straight] = sign * chord[straight] / (2 * half)
        bends[k][:, here][straight] = bend[straight]
    best: FloatArray = np.where((bends[1] < bends[0])[..., None], sides[1], sides[0])
    if sigma_m > 0:
        with np.errstate(invalid="ignore"):
            alike = np.linalg.norm(sides[0] - sides[1], axis=-1) * 2 * half < _SAME * sigma_m
        best[alike] = sides.mean(axis=0)[alike]
    return best


_SIDES = 6
UPWARD = 2  # the side of normals that lean to +z
_FLATTEST = 0.05  # cosine below which a normal more likely joins two surfaces than belongs to one


@dataclass(frozen=True, slots=True, eq=False)
class Surfels:
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
    def of_scan(cls, scan: RangeImage, grid: VoxelGrid) -> Surfels:
        """Return what one scan has seen; samples without a normal leave none."""
        local = image_normals(scan, grid.voxel_m / 2)
        points = scan.points().reshape(-1, 3)
        voxel = grid.index_of(points)
        usable = (voxel >= 0) & (local.cosine.ravel() >= _FLATTEST)
        normals = local.normals.reshape(-1, 3)[usable]
        weight, cosine = local.areas.ravel()[usable], local.cosine.ravel()[usable]
        keys, which = np.unique(voxel[usable] * _SIDES + sides_of(normals), return_inverse=True)
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

    def merged(self, other: Surfels) -> Surfels:
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
