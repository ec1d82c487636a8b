# SPDX-License-Identifier: MIT
"""Free space of a known mesh: where a sensor can stand, with clearance, without passing through surfaces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import label
from scipy.spatial import cKDTree

from nbv.visibility.samples import sample_surface
from nbv.visibility.voxel_grid import VoxelGrid
from scenes.checks import BoolArray, FloatArray
from scenes.mesh.labelled_mesh import LabelledMesh

_WISHED_VOXELS = 4e5
_SAMPLES_A_VOXEL = 3.0  # along a line: a surface cannot slip between samples from voxel to voxel


@dataclass(frozen=True, slots=True, eq=False)
class FreeSpace:
    """The largest connected space of a scene's bounding box that no surface passes through.

    Faces need no orientation: the inside of a closed box is another, smaller component. Rooms behind closed
    doors are other components too; a walking scanner does not get there.

    Attributes
    ----------
    grid : VoxelGrid
        Cells of the bounding box.
    free : (n_voxels,) bool
        Cells of the largest component.
    surface : cKDTree
        Dense samples of the mesh, metres.
    """

    grid: VoxelGrid
    free: BoolArray
    surface: cKDTree

    @classmethod
    def of(cls, mesh: LabelledMesh) -> FreeSpace:
        """Return the free space within the bounds of `mesh`."""
        bounds = mesh.bounds()
        extent = np.maximum(np.ptp(bounds, axis=0), np.ptp(bounds, axis=0).max() / 20)
        grid = VoxelGrid.around(bounds, float((np.prod(extent) / _WISHED_VOXELS) ** (1 / 3)))
        samples = sample_surface(mesh, grid.voxel_m / _SAMPLES_A_VOXEL)
        solid = np.zeros(grid.n_voxels, dtype=np.bool_)
        solid[grid.index_of(samples.points)] = True
        component, n_components = label(~solid.reshape(grid.shape))
        sizes = np.bincount(component.ravel(), minlength=n_components + 1)
        sizes[0] = 0
        free = (component.ravel() == int(np.argmax(sizes))) & ~solid
        return cls(grid, free, cKDTree(samples.points))

    def holds(self, positions: FloatArray, clearance_m: float) -> BoolArray:
        """Tell which positions (p, 3) are free, with no surface nearer than `clearance_m` metres."""
        cell: NDArray[np.int64] = self.grid.index_of(positions)
        distance, _ = self.surface.query(positions, workers=1)
        clear: BoolArray = np.asarray(distance) >= clearance_m - 1e-9
        return (cell >= 0) & self.free[cell] & clear
