# SPDX-License-Identifier: MIT
"""Unseen boundary: where known empty space ends without a measured surface, and what explains it.

These areas are areas of a boundary in space, not of surface: what lies behind it may be more, less or none.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from nbv.online.occupancy import OCCPLANE, UNSEEN, BoundaryFaces, VoxelMap
from nbv.run.wording import square_metres
from nbv.visibility.samples import sample_surface
from nbv.visibility.zones import EVERYWHERE, Zones
from scenes.checks import BoolArray, FloatArray
from scenes.mesh.labelled_mesh import LabelledMesh

_SAMPLES_A_VOXEL = 2.0  # along a line
_WITHIN = 0.5 * np.sqrt(3)  # voxels from its centre to its corners


@dataclass(frozen=True, slots=True, eq=False)
class UnseenBoundary:
    """Faces between known empty space and what is not known.

    Attributes
    ----------
    faces : BoundaryFaces
        Voxel faces, unknown on one side.
    areas : (n,) float
        What each counts for, square metres: voxel faces make stairs of a slanted boundary, so that each is
        foreshortened to the slope of the stairs.
    occluded : (n,) bool
        Behind something measured; the others are where no scan has looked (the frontier).
    explained : (n,) bool
        A measured or inferred surface passes there: no more is to be expected.
    """

    faces: BoundaryFaces
    areas: FloatArray
    occluded: BoolArray
    explained: BoolArray

    @classmethod
    def of(
        cls,
        voxels: VoxelMap,
        surface: LabelledMesh | None = None,
        zones: Zones = EVERYWHERE,
        stood: FloatArray | None = None,
        clearance_m: float = 0.0,
    ) -> UnseenBoundary:
        """Return the unseen boundary of a map, in the region of `zones`; `surface` may explain a shadow.

        Where sensors `stood` (m, 3) space counts as empty within `clearance_m` for that reason alone: the end
        of it is no boundary that a scan has found. Metres.
        """
        faces = voxels.boundary()
        label = voxels.labels[faces.voxel]
        centres = voxels.grid.centres(faces.voxel)
        unknown = ((label == OCCPLANE) | (label == UNSEEN)) & zones.of_interest(centres, voxels.grid.voxel_m)
        if stood is not None and len(stood):
            around = clearance_m + 2 * voxels.grid.voxel_m
            unknown &= cKDTree(stood).query(centres)[0] > around
        kept = np.flatnonzero(unknown)
        chosen = BoundaryFaces(faces.voxel[kept], faces.centres[kept], faces.outward[kept])
        slope = np.einsum("ij,ij->i", voxels.towards_empty(chosen.voxel), chosen.outward)
        areas = voxels.grid.voxel_m**2 * np.maximum(slope, 0.0)
        explained = _near(centres[kept], surface, voxels.grid.voxel_m)
        return cls(chosen, areas, label[kept] == OCCPLANE, explained)

    def area_m2(self, where: BoolArray) -> float:
        """Area of the faces at `where` (n,), square metres."""
        return float(self.areas[where].sum())

    @property
    def occluded_m2(self) -> float:
        """Boundary of shadows that no surface explains, square metres."""
        return self.area_m2(self.occluded & ~self.explained)

    @property
    def explained_m2(self) -> float:
        """Boundary of shadows along which a measured or inferred surface passes, square metres."""
        return self.area_m2(self.occluded & self.explained)

    @property
    def frontier_m2(self) -> float:
        """Boundary beyond which no scan has looked, square metres."""
        return self.area_m2(~self.occluded & ~self.explained)

    def describe(self) -> str:
        """Return both areas in words."""
        return (
            f"boundary of unseen space: {square_metres(self.occluded_m2)} m2 at shadows, "
            f"{square_metres(self.frontier_m2)} m2 at limits of the fields of view (not areas of surface)"
        )

    def to_json(self) -> dict[str, Any]:
        """Return the areas."""
        return {
            "occluded_m2": self.occluded_m2,
            "explained_m2": self.explained_m2,
            "frontier_m2": self.frontier_m2,
        }

    def triangles(self, where: BoolArray, voxel_m: float) -> tuple[FloatArray, NDArray[np.int32]]:
        """Return vertices and triangles of the faces at `where` (n,)."""
        faces = self.faces
        chosen = BoundaryFaces(faces.voxel[where], faces.centres[where], faces.outward[where])
        return chosen.triangles(voxel_m)


def _near(centres: FloatArray, surface: LabelledMesh | None, voxel_m: float) -> BoolArray:
    """Tell which voxels, by their centres (n, 3), some surface passes through or nearly touches."""
    if surface is None or not len(surface.faces) or not len(centres):
        return np.zeros(len(centres), np.bool_)
    samples = sample_surface(surface, voxel_m / _SAMPLES_A_VOXEL)
    reach = _WITHIN * voxel_m
    distance = cKDTree(samples.points).query(centres, distance_upper_bound=reach)[0]
    return np.asarray(np.isfinite(distance))
