# SPDX-License-Identifier: MIT
"""Completed surfaces of the scans so far, asked point by point.

A place that was measured too obliquely is modelled where its surface is determined well by all of its
pixels. A place that was never seen may be inferred. Both are looked up in the surfaces' charts.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from completion.extension.patch import Patch
from completion.observe.tolerance import EvidenceOptions
from completion.options import CompletionOptions
from completion.pipeline import complete
from completion.result.completion import Completion
from scenes.checks import BoolArray, FloatArray
from scenes.scan.range_image import RangeImage

_MAX_CELLS = 40_000  # of a surface: places a few centimetres apart are told apart in a room
_SAME_WAY = float(np.cos(np.radians(30.0)))  # normals closer than this may belong to one surface


@dataclass(frozen=True, slots=True, eq=False)
class CompletedSurfaces:
    """Surfaces that completion finds in some scans, measured and inferred.

    A surface is known where its fit has a standard deviation of no more than `max_sd_m`, metres.
    """

    completion: Completion
    max_sd_m: float

    @classmethod
    def of(
        cls,
        scans: Sequence[RangeImage],
        max_sd_m: float | None = None,
        *,
        relates: bool = True,
        n_threads: int | None = None,
    ) -> CompletedSurfaces:
        """Complete `scans`, without texture; `max_sd_m` is completion's own when not given.

        What surfaces are to each other is left out where nothing is to be related: it takes longer than all
        else of a few scans.
        """
        options = CompletionOptions(texture=False, evidence=EvidenceOptions(max_cells=_MAX_CELLS))
        options = options if relates else replace(options, relations=None)
        options = replace(options, max_sd_m=max_sd_m or options.max_sd_m)
        return cls(complete(scans, options, rng=0, n_threads=n_threads), options.max_sd_m)

    def modelled(self, points: FloatArray, normals: FloatArray, close_m: float) -> BoolArray:
        """Tell which points (n, 3) lie on measured surface whose fit is exact enough.

        Parameters
        ----------
        points, normals : (n, 3) float
            World coordinates in metres, unit normals (of either sign).
        close_m : float
            How far from the fitted surface a point may lie, metres.
        """
        return self._lie_on(points, normals, close_m, self._exact)

    def inferred(self, points: FloatArray, normals: FloatArray, close_m: float) -> BoolArray:
        """Tell which points (n, 3) lie on inferred surface; parameters as for `modelled`."""
        return self._lie_on(points, normals, close_m, lambda patch: patch.hypothesised)

    def hypothesised(self) -> tuple[FloatArray, NDArray[np.int32], FloatArray]:
        """Inferred surface: vertices (n, 3) in world coordinates, faces (m, 3), confidence (m,) of each."""
        mesh = self.completion.hypothesised
        vertices = self.completion.world_from_reference.apply(mesh.vertices)
        return vertices, mesh.faces, mesh.confidence[mesh.faces].min(axis=1)

    def measured(self) -> tuple[FloatArray, NDArray[np.int32]]:
        """Measured surface without the gaps between pixels: vertices (n, 3), world, and faces (m, 3)."""
        meshes = [surface.observed for surface in self.completion.derived.surfaces]
        start = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
        faces = [mesh.faces + first for mesh, first in zip(meshes, start, strict=False)]
        vertices = np.concatenate([np.zeros((0, 3)), *(mesh.vertices for mesh in meshes)])
        world = self.completion.world_from_reference.apply(vertices)
        return world, np.concatenate([np.zeros((0, 3), np.int32), *faces]).astype(np.int32)

    def _exact(self, patch: Patch) -> BoolArray:
        return patch.observed & (patch.spread <= self.max_sd_m)

    def _lie_on(
        self, points: FloatArray, normals: FloatArray, close_m: float, cells_of: Callable[[Patch], BoolArray]
    ) -> BoolArray:
        """Tell which points lie near such cells of a surface, their normals along its own."""
        found = np.zeros(len(points), dtype=np.bool_)
        reference_from_world = self.completion.world_from_reference.inverse()
        local, turned = reference_from_world.apply(points), reference_from_world.rotate(normals)
        for patch in self.completion.patches:
            surface, cells = patch.grid.surface, cells_of(patch)
            near = np.flatnonzero(np.abs(surface.distance(local)) <= close_m)
            along = np.abs(np.einsum("ij,ij->i", surface.normal(local[near]), turned[near])) >= _SAME_WAY
            near = near[along]
            index, cell = patch.grid.cells_of(local[near])
            found[near[index]] |= cells.ravel()[cell]
        return found
