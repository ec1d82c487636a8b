# SPDX-License-Identifier: MIT
"""The solid that scans leave possible: all space that no beam has shown to be empty, and its surface.

Where scans have met the object, its surface is the object's; elsewhere it is the side of a shadow, the
surface that the next views are planned for. After B. Curless and M. Levoy, "A volumetric method for building
complex models from range images", SIGGRAPH 1996: signed distances along the beams, averaged near the surface;
space behind what was met is solid until a beam goes through it (their "hole filling by space carving").
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from skimage.measure import marching_cubes

from nbv.online.limits import FLATTEST, FLATTEST_EXPECTED, SURE_SD
from nbv.online.occupancy import EMPTY, DepthView, VoxelMap
from scenes.checks import BoolArray, FloatArray
from scenes.rays.raycast import RayCaster

_NEVER = -1.0  # cosine of what no scan has measured
_BARELY = 0.1  # of a voxel's side: least distance of the middle of an empty voxel from the surface
_SAME_SIDE = (
    0.5  # cosine between the normals of a pixel and of the surface, below which they are of two surfaces
)
_NEAR = 1.5  # sides of a voxel, across the surface, within which a scan that met something met this surface


@dataclass(frozen=True, slots=True, eq=False)
class PossibleSurface:
    """Surface of the possible solid, in small triangles.

    Attributes
    ----------
    vertices, faces : (n_vertices, 3) float, (n, 3) int32
        Metres, world coordinates; counterclockwise seen from the empty side.
    centres, normals, areas : (n, 3) float, (n, 3) float, (n,) float
        Of the triangles; normals point into the empty space and are those of the surface around.
    voxel : (n,) int64
        Voxel behind each triangle.
    cosine : (n,) float
        Best cosine of incidence at which a scan measured each; -1 where none did.
    """

    vertices: FloatArray
    faces: NDArray[np.int32]
    centres: FloatArray
    normals: FloatArray
    areas: FloatArray
    voxel: NDArray[np.int64]
    cosine: FloatArray

    @classmethod
    def of(cls, voxels: VoxelMap) -> PossibleSurface:
        """Return the surface of what the scans of a map leave possible."""
        grid, side = voxels.grid, voxels.grid.voxel_m
        field = np.pad(
            _distances(voxels).reshape(grid.shape),
            1,
            constant_values=side if voxels.outside_is_empty else -side,
        )
        if not (field.min() < 0 < field.max()):
            return cls._none()
        vertices, faces, _, _ = marching_cubes(field, 0.0)
        vertices = grid.origin + (vertices - 0.5) * side
        corners = vertices[faces]
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        double = np.linalg.norm(across, axis=1)
        kept = double > 1e-9 * side**2
        faces, areas, corners = faces[kept].astype(np.int32), double[kept] / 2, corners[kept]
        normals = _smooth(across[kept], faces, len(vertices))
        centres = corners.mean(axis=1)
        cosine = np.full(len(faces), _NEVER)
        behind, best = grid.index_of(centres - normals * (side / 2)), normals.copy()
        for view in voxels.views:
            index, met, measured = _met_by(view, centres, normals, side)
            better = met > cosine[index]
            cosine[index[better]], best[index[better]] = met[better], measured[better]
        return cls(
            vertices=vertices,
            faces=faces,
            centres=centres,
            normals=best,
            areas=areas,
            voxel=behind,
            cosine=cosine,
        )

    @classmethod
    def _none(cls) -> PossibleSurface:
        """Return the surface of a solid that has none: nothing, or everything, is known to be empty."""
        vectors, numbers = np.zeros((0, 3)), np.zeros(0)
        return cls(
            vertices=vectors,
            faces=np.zeros((0, 3), np.int32),
            centres=vectors,
            normals=vectors,
            areas=numbers,
            voxel=np.zeros(0, np.int64),
            cosine=numbers,
        )

    @property
    def is_unknown(self) -> BoolArray:
        """Tell which triangles (n,) no scan has measured."""
        return self.cosine < 0

    def ray_caster(self) -> RayCaster:
        """Return what ends lines of sight, on one thread."""
        return RayCaster(self.vertices, self.faces, n_threads=1)


def _distances(voxels: VoxelMap) -> FloatArray:
    """Signed distance (n_voxels,) of the voxels from the surface, metres; positive where it is empty."""
    side, near = voxels.grid.voxel_m, voxels.near
    mean = np.divide(near.sums, near.counts, out=np.full(len(near.sums), -np.inf), where=near.counts > 0)
    empty = voxels.labels == EMPTY
    least = np.where(near.counts > 0, _BARELY * side, np.inf)
    distances: FloatArray = np.where(empty, np.maximum(mean, least), mean)
    return np.clip(distances, -side, side)


def _smooth(across: FloatArray, faces: NDArray[np.int32], n_vertices: int) -> FloatArray:
    """Unit normals (n, 3) of triangles, each the mean of all that share a corner, twice."""
    sizes, normals = np.linalg.norm(across, axis=1, keepdims=True), across
    for _ in range(2):
        sums = [np.bincount(faces.ravel(), np.repeat(normals[:, axis], 3), n_vertices) for axis in range(3)]
        around = np.stack(sums, axis=1)[faces].sum(axis=1)
        unit: FloatArray = around / np.maximum(np.linalg.norm(around, axis=1, keepdims=True), 1e-30)
        normals = unit * sizes
    return unit


def _met_by(
    view: DepthView, points: FloatArray, normals: FloatArray, side: float
) -> tuple[NDArray[np.int64], FloatArray, FloatArray]:
    """Return which points (n, 3) of the surface a scan met, its cosines of incidence there, and normals.

    The normals are those of the pixels, or those of the surface, `normals` (n, 3), where a pixel has none or
    one that joins two surfaces.
    """
    scan = view.scan
    towards = scan.origin - points
    distance = np.linalg.norm(towards, axis=1)
    towards /= np.maximum(distance, 1e-30)[:, None]
    slope = np.einsum("ij,ij->i", towards, normals)
    index = np.flatnonzero(slope > FLATTEST)
    pixels = scan.pixels(points[index])
    inside = np.isfinite(pixels).all(axis=1)
    index = index[inside]
    row, column = np.rint(pixels[inside]).astype(np.int64).T
    off = np.abs(scan.ranges[row, column] - distance[index])  # NaN without return
    across = off * np.maximum(slope[index], FLATTEST_EXPECTED)
    met = across <= max(_NEAR * side, side / 2 + SURE_SD * (scan.sigma_m or 0.0))
    index = index[met]
    measured = view.normals[row[met], column[met]].astype(np.float64)
    agree = np.einsum("ij,ij->i", measured, normals[index]) > _SAME_SIDE  # NaN without a normal
    measured = np.where(agree[:, None], measured, normals[index])
    return index, np.einsum("ij,ij->i", towards[index], measured), measured
