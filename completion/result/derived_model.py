# SPDX-License-Identifier: MIT
"""Derived model: what follows from completed surfaces, computed once for all files and pictures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from completion.boundary.meshing import ChartMesh, mesh_cells
from completion.extension.patch import Patch, Provenance
from completion.observe.observation import Observation
from completion.result.labelled_points import LabelledPoints, observed_mesh
from completion.result.openings import Opening, find_openings
from completion.result.outline import BoundarySegment, OutlineCells, outline_cells, trace_boundary
from completion.result.straightening import surface_polygon
from completion.texturing.chart_texture import Atlas, ChartTexture, make_atlas
from scenes.checks import BoolArray, FloatArray


@dataclass(frozen=True, slots=True)
class Effect:
    """What came of a person's edits on a surface; square metres, cells counted whole."""

    filled_m2: float  # inferred because a person says so
    vetoed_m2: float  # accepted, but beams went through: it stays empty
    measured_m2: float  # measured in a declared opening, or beyond an end that was set: it stays


@dataclass(frozen=True, eq=False)
class DerivedSurface:
    """What follows from one completed surface; each property is computed when it is first read, and kept.

    Attributes
    ----------
    patch : Patch
        The surface.
    inferred_cells : ChartMesh
        Its inferred cells as triangles, every cell by itself.
    """

    patch: Patch
    inferred_cells: ChartMesh

    @cached_property
    def observed(self) -> ChartMesh:
        """Measured cells as few triangles."""
        return mesh_cells(self.patch.grid, self.patch.observed, (), merged=True)

    @cached_property
    def hypothesised(self) -> ChartMesh:
        """Inferred cells as few triangles, cut where the surface ends."""
        return self._inferred(self.patch.hypothesised)

    @cached_property
    def by_provenance(self) -> Mapping[Provenance, ChartMesh]:
        """The same for the cells of each provenance, in the order of their numbers."""
        patch = self.patch
        reasons = [Provenance(int(why)) for why in np.unique(patch.provenance[patch.hypothesised])]
        if len(reasons) == 1:
            return {reasons[0]: self.hypothesised}
        return {why: self._inferred(patch.hypothesised & (patch.provenance == why)) for why in reasons}

    def _inferred(self, cells: BoolArray) -> ChartMesh:
        return mesh_cells(self.patch.grid, cells, self.patch.limits.cuts, self.patch.trims, merged=True)

    @cached_property
    def outline(self) -> OutlineCells:
        """What is known of each cell if it lies on the outline."""
        return outline_cells(self.patch)

    @cached_property
    def boundary(self) -> tuple[BoundarySegment, ...]:
        """The outline of the measured and inferred cells."""
        return tuple(trace_boundary(self.patch.grid, self.outline))

    @cached_property
    def openings(self) -> tuple[Opening, ...]:
        """Holes that the surface encloses, declared ones first."""
        return tuple(find_openings(self.patch))

    @cached_property
    def polygon(self) -> Any:
        """Measured and inferred area of a plane as straight polygons of its chart (shapely geometry)."""
        return surface_polygon(self.patch, self.inferred_cells)

    @cached_property
    def effect(self) -> Effect:
        """What came of a person's edits.

        Where a surface is accepted as a whole, what beams went through counts in its measured rectangle and
        on to its known ends.
        """
        patch, grid, verdict = self.patch, self.patch.grid, self.patch.verdict
        accepted = verdict.accepted(grid, grid.within(*patch.limits.known_window()))
        against = verdict.open_cells(grid)
        for end in verdict.ends:
            against |= (end.distance(grid.centres()) < -float(np.hypot(*grid.cell)) / 2).reshape(grid.shape)
        filled = patch.hypothesised & (patch.provenance == Provenance.USER)
        vetoed = accepted & patch.evidence.open & ~patch.observed
        return Effect(*(float(c.sum()) * grid.cell_area for c in (filled, vetoed, against & patch.observed)))


@dataclass(frozen=True, slots=True, eq=False)
class TexturedMesh:
    """Cells of one surface that have one provenance, as few triangles with their places in the atlas."""

    number: int  # of the surface, from 1
    provenance: Provenance  # of all its cells
    mesh: ChartMesh  # the triangles, working frame
    uv: FloatArray  # (n, 2) texture coordinates, (0, 0) the page's lower left; zeros for none
    page: int  # its page of the atlas, -1 without texture


@dataclass(frozen=True, eq=False)
class DerivedModel:
    """What follows from a completed model; each property is computed when it is first read, and kept.

    Threads that read a property at the same moment may compute it twice, with the same result.

    Attributes
    ----------
    observations : tuple of Observation
        The scans, working frame.
    owners : tuple of (rows, columns) int32
        For each scan, the number of the surface that each pixel belongs to; 0 for none.
    surfaces : tuple of DerivedSurface
        One for each completed surface.
    textures : tuple of ChartTexture or None
        Colour of each; empty when texture was not asked for.
    """

    observations: tuple[Observation, ...]
    owners: tuple[NDArray[np.int32], ...]
    surfaces: tuple[DerivedSurface, ...]
    textures: tuple[ChartTexture | None, ...]

    @cached_property
    def atlas(self) -> Atlas:
        """The textures on few pages; none when texture was not asked for."""
        return make_atlas(self.textures or (None,) * len(self.surfaces))

    def texture_coordinates(self, index: int, mesh: ChartMesh) -> FloatArray:
        """Return places (n, 2) in the atlas of the vertices of a mesh of surface `index`, from 0."""
        return self.atlas.coordinates(index, self.surfaces[index].patch.grid.uv_of(*mesh.cells.T))

    @cached_property
    def textured(self) -> tuple[TexturedMesh, ...]:
        """What was measured of each surface, and what was inferred, by provenance."""
        found = []
        for index, surface in enumerate(self.surfaces):
            for why, mesh in ((Provenance.MEASURED, surface.observed), *surface.by_provenance.items()):
                uv = self.texture_coordinates(index, mesh)
                found.append(TexturedMesh(index + 1, why, mesh, uv, int(self.atlas.page[index])))
        return tuple(found)

    @cached_property
    def observed(self) -> LabelledPoints:
        """All measured points of all scans as one mesh, working frame."""
        return observed_mesh(self.observations, self.owners)

    @cached_property
    def remainder(self) -> LabelledPoints:
        """Measured points that belong to no completed surface, with the triangles at them, working frame."""
        points = self.observed
        return points.part((points.surface == 0)[points.faces].any(axis=1))
