# SPDX-License-Identifier: MIT
"""Standing room of a known scene: its floor, its free space, and the candidates that stand there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import label
from scipy.spatial import cKDTree

from nbv.scanning.sensors.sensor import Sensor
from nbv.visibility.samples import sample_surface
from nbv.visibility.viewpoints import Candidates, room_lattice, sensor_directions, viewing_sphere
from nbv.visibility.voxel_grid import VoxelGrid
from scenes.checks import BoolArray, FloatArray, InputError
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.rays.raycast import RayCaster
from scenes.world.scene import Scene

CLEARANCE_M = 0.3
_LEVEL = float(np.cos(np.radians(15.0)))  # |cosine| between normal and vertical of what one can stand on
_STEP_M = 0.1  # surface within so much of the floor's level is floor
_SHARE = 0.5  # of the largest level area: the lowest level of at least this is the floor


def scene_floor(mesh: LabelledMesh) -> float | None:
    """Return the height in metres of the lowest large level surface; None without level surface.

    Faces need no orientation: the ceiling is as large as the floor, and higher.
    """
    areas, normals = mesh.face_areas(), mesh.face_normals()
    level = (areas > 0) & (np.abs(normals[:, 2]) >= _LEVEL)
    if not level.any():
        return None
    heights, areas = mesh.corners[level, :, 2].mean(axis=1), areas[level]
    low = float(heights.min())
    layer = np.floor((heights - low) / _STEP_M)
    layers, member = np.unique(layer, return_inverse=True)
    area = np.bincount(member, areas)
    lowest = int(np.argmax(area >= _SHARE * area.max()))
    floor = layer == layers[lowest]
    return float(np.average(heights[floor], weights=areas[floor]))


def stand_on(caster: RayCaster, level: float, positions: FloatArray) -> BoolArray:
    """Tell straight below which positions (p, 3) the first surface is the floor at height `level`."""
    down = np.broadcast_to(np.array([0.0, 0.0, -1.0]), positions.shape)
    below = positions[:, 2] - caster.first_hit(positions, down).ranges
    return np.asarray(np.abs(below - level) <= _STEP_M)


_WISHED_VOXELS = 4e5
_SAMPLES_A_VOXEL = 3.0  # along a line: a surface cannot slip between samples from voxel to voxel


@dataclass(frozen=True, slots=True, eq=False)
class FreeSpace:
    """The largest connected space of a scene's bounding box that no surface passes through.

    Faces need no orientation: the inside of a closed box is another, smaller component. Rooms behind closed
    doors are other components too; a walking scanner does not get there. `free` (n_voxels,) are its cells,
    `surface` dense samples of the mesh, metres.
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


def scene_candidates(
    scene: Scene,
    sensor: Sensor,
    *,
    mode: str | None = None,
    clearance_m: float = CLEARANCE_M,
    subdivisions: int = 1,
) -> Candidates:
    """Return the candidates of a known scene.

    Room mode: the free positions of a lattice at tripod heights above the floor (anywhere, in a scene
    without floor), each with the sensor's directions all round (42 for a camera at 1 subdivision of the
    icosahedron, 162 at 2). Object mode: a viewing sphere.

    Raises
    ------
    InputError
        Another mode, or nowhere to stand.
    """
    mode = mode or scene.mode
    if mode == "object":
        return viewing_sphere(scene.mesh.bounds(), sensor)
    if mode != "room":
        raise InputError(f"mode must be room or object, got {mode!r}")
    lattice = scene_lattice(scene, clearance_m)
    free = FreeSpace.of(scene.mesh).holds(lattice, clearance_m)
    if not free.any():
        raise InputError(
            f"none of {len(lattice)} positions in {scene.name} is free with {clearance_m} m clearance; "
            "is it an object (mode object), or not in metres?"
        )
    level = scene_floor(scene.mesh)
    if level is not None and (footed := free & stand_on(scene.ray_caster(), level, lattice)).any():
        free = footed
    return Candidates(lattice[free], sensor_directions(sensor, subdivisions))


def scene_lattice(scene: Scene, clearance_m: float = CLEARANCE_M) -> FloatArray:
    """Return positions (p, 3) over a scene's floor at tripod heights, free or not, metres."""
    bounds = scene.mesh.bounds()
    level = scene_floor(scene.mesh)
    bounds[0, 2] = bounds[0, 2] if level is None else level
    return room_lattice(bounds, clearance_m=clearance_m)
