# SPDX-License-Identifier: MIT
"""Surfels: what scans have seen of the surface in each voxel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nbv.online.image_normals import image_normals
from nbv.visibility.voxel_grid import VoxelGrid
from scenes.checks import FloatArray
from scenes.scan.range_image import RangeImage

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
        points = local.points.reshape(-1, 3)
        voxel = grid.index_of(points)
        usable = (voxel >= 0) & (local.cosine.ravel() >= _FLATTEST)
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
