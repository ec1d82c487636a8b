# SPDX-License-Identifier: MIT
"""Floor of a known scene: the level on which tripods stand, and the places that are above it."""

from __future__ import annotations

import numpy as np

from scenes.checks import BoolArray, FloatArray
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.rays.raycast import RayCaster

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
