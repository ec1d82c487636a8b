# SPDX-License-Identifier: MIT
"""Clearance: how far places are from every surface of a scene."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from nbv.visibility.limits import CLEARANCE_FINENESS
from nbv.visibility.samples import sample_surface
from nbv.visibility.site_options import CLEARANCE_M
from scenes.checks import BoolArray, FloatArray
from scenes.mesh.labelled_mesh import LabelledMesh

_MOST_SAMPLES = 2e6


@dataclass(frozen=True, slots=True, eq=False)
class Clearance:
    """Dense samples of a mesh, among which places are to keep `clearance_m` metres."""

    clearance_m: float
    surface: cKDTree

    @classmethod
    def of(cls, mesh: LabelledMesh, clearance_m: float = CLEARANCE_M) -> Clearance:
        """Sample a mesh; its samples are at most two million, and then further apart."""
        spacing = max(
            clearance_m / CLEARANCE_FINENESS, float(np.sqrt(mesh.face_areas().sum() / _MOST_SAMPLES))
        )
        samples = sample_surface(mesh, spacing)
        tree = cKDTree(
            samples.points, balanced_tree=False, compact_nodes=False
        )  # built in a third of the time
        return cls(clearance_m, tree)

    @classmethod
    def of_points(cls, points: FloatArray, clearance_m: float = CLEARANCE_M) -> Clearance:
        """Return the clearance from points (n, 3) that lie densely on what is to be kept clear of, metres."""
        cells = np.floor(points / (clearance_m / CLEARANCE_FINENESS)).astype(np.int64)
        low, high = cells.min(axis=0), cells.max(axis=0)
        numbers = np.ravel_multi_index((cells - low).T, (high - low + 1).tolist())
        return cls(clearance_m, cKDTree(points[np.unique(numbers, return_index=True)[1]]))

    def holds(self, positions: FloatArray) -> BoolArray:
        """Tell at which positions (p, 3) no surface is nearer than the clearance."""
        distance, _ = self.surface.query(positions, workers=1)
        return np.asarray(distance >= self.clearance_m - 1e-9)
