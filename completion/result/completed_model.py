# SPDX-License-Identifier: MIT
"""Completed model: what was measured and what was inferred, never mixed up, and what follows from them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from completion.backs.closed_things import ClosedThing
from completion.backs.options import BackOptions
from completion.boundary.meshing import ChartMesh, mesh_cells
from completion.edits.application import anchor_point
from completion.edits.edit import Edit
from completion.evidence.evidence import Scans
from completion.export.panels.model import PanelModel, PanelPart
from completion.export.panels.outline import (
    BoundarySegment,
    OutlineCells,
    outline_cells,
    surface_polygon,
    trace_boundary,
)
from completion.export.panels.pipeline import build_panels
from completion.export.panels.sheet import Sheet
from completion.export.panels.unexplained import PixelMesh, light_rest
from completion.extension.claims import Choice
from completion.extension.patch import Patch, Provenance
from completion.features.engine.template import TemplateFit
from completion.merging.merged_surface import MergedSurface
from completion.merging.pieces import UnconfirmedRegions
from completion.merging.scan_surfaces import ScanSurfaces
from completion.observe.observation import Observation
from completion.observe.user_options import Mode
from completion.registration.correction import Registration
from completion.relations.pipeline import SurfaceRelations
from completion.result.audit import AuditResult
from completion.result.doubts import doubts_of, ground_doubts
from completion.result.flat_scans import FlatScan, flat_doubts
from completion.result.labelled_points import (
    LabelledPoints,
    Remainder,
    Shifts,
    hypothesised_parts,
    join_points,
    mesh_area,
    observed_mesh,
    observed_parts,
    observed_step,
    remainder,
)
from completion.result.openings import SurfaceOpening, find_openings
from completion.result.unknown import unknown_part
from completion.room.roles import Room
from completion.texturing.chart_texture import Atlas, ChartTexture, make_atlas
from completion.uncertainty.joint_errors import JointErrors
from scenes.card import INFERRED, MEASURED, Card, CardShare
from scenes.checks import FloatArray, InputError, Value
from scenes.inclination import Up
from scenes.pose import Pose
from scenes.run.mapping import NoSpill, Spill, spill_of, trim
from scenes.scan.range_image import RangeImage


@dataclass(frozen=True, slots=True, eq=False)
class CompletedSurfaces(Value):
    """The surfaces of scans, continued behind their occluders, working frame.

    Attributes
    ----------
    patches : tuple of Patch
        The surfaces; number i + 1 in files.
    scans : Scans
        The scans as evidence, each pixel with the number of its surface.
    relations : SurfaceRelations, optional
        What surfaces are to each other; None where not asked for.
    errors : JointErrors
        Joint errors of the surfaces.
    room : Room
        What scans show of the room, its surfaces numbered as found, working frame.
    features : tuple of TemplateFit
        Openings fitted whole: accepted, ambiguous and rejected ones.
    choice : Choice
        Which surfaces were wanted.
    mode : str
        How probable inferred area had to be.
    edits : tuple of Edit
        What a person says of the surfaces, world coordinates.
    up : Up
        Which way is up in the world.
    """

    patches: tuple[Patch, ...]
    scans: Scans
    relations: SurfaceRelations | None
    errors: JointErrors
    room: Room
    features: tuple[TemplateFit, ...]
    choice: Choice
    mode: Mode
    edits: tuple[Edit, ...]
    up: Up


_MOST_SURFACES = 6  # that a card lists
_REACH = 3.0  # cells between the border of a panel and the outermost pixels of its surface


@dataclass(frozen=True, slots=True)
class Effect(Value):
    """What came of a person's edits on a surface; square metres, cells counted whole."""

    filled_m2: float  # inferred because a person says so
    vetoed_m2: float  # accepted, but beams went through: it stays empty
    measured_m2: float  # measured in a declared opening, or beyond an end that was set: it stays


@dataclass(frozen=True, eq=False)
class DerivedSurface(Value):
    """What follows from one completed surface; each property is computed when it is first read, and kept.

    Of large models it is kept on disk.

    Attributes
    ----------
    patch : Patch
        The surface.
    inferred_cells : ChartMesh
        Its inferred cells as triangles, every cell by itself.
    spill : Spill or NoSpill
        Where it is kept.
    """

    patch: Patch
    inferred_cells: ChartMesh
    spill: Spill | NoSpill

    @cached_property
    def observed(self) -> ChartMesh:
        """Measured cells as triangles, without more."""
        return self.spill.keep(mesh_cells(self.patch.grid, self.patch.observed, (), merged=True))

    @cached_property
    def unknown(self) -> ChartMesh:
        """Hidden cells that were neither measured nor inferred as triangles."""
        return self.spill.keep(unknown_part(self.patch))

    @cached_property
    def outline(self) -> OutlineCells:
        """What is known of each cell if it lies on the outline."""
        return self.spill.keep(outline_cells(self.patch))

    @cached_property
    def boundary(self) -> tuple[BoundarySegment, ...]:
        """The outline of the measured and inferred cells."""
        return self.spill.keep(tuple(trace_boundary(self.patch.grid, self.outline)))

    @cached_property
    def openings(self) -> tuple[SurfaceOpening, ...]:
        """Holes that the surface encloses, declared ones first."""
        return tuple(find_openings(self.patch))

    @cached_property
    def polygon(self) -> Any:
        """Measured and inferred area as straight polygons of the chart (shapely geometry)."""
        return self.spill.keep(surface_polygon(self.patch, self.inferred_cells))

    @cached_property
    def effect(self) -> Effect:
        """What came of a person's edits.

        Where a surface is accepted as a whole, what beams went through counts in its measured rectangle and
        on to its known ends.
        """
        patch, grid, verdict = self.patch, self.patch.grid, self.patch.verdict
        accepted = verdict.accepted_cells(grid, grid.within(*patch.limits.known_window()))
        against = verdict.open_cells(grid)
        for end in verdict.ends:
            against |= (end.distance(grid.centres()) < -float(np.hypot(*grid.cell)) / 2).reshape(grid.shape)
        filled = patch.hypothesised & (patch.provenance == Provenance.USER)
        vetoed = accepted & patch.evidence.open & ~patch.observed
        return Effect(*(float(c.sum()) * grid.cell_area for c in (filled, vetoed, against & patch.observed)))


@dataclass(frozen=True, slots=True, eq=False)
class TexturedPart(Value):
    """Facets of one surface that have one provenance, with their places in the atlas."""

    number: int  # of the surface, from 1
    provenance: Provenance  # of all its facets
    part: PanelPart  # the facets, working frame
    uv: FloatArray  # (n, 2) texture coordinates, (0, 0) the page's lower left; zeros for none
    page: int  # its page of the atlas, -1 without texture


@dataclass(frozen=True, eq=False)
class CompletedModel(Value):
    """What `complete` found, before any file; `Completion` describes the attributes.

    What follows from it is computed when it is first read, and kept; threads that read a property at the same
    moment may compute it twice, with the same result.
    """

    measured_surfaces: ScanSurfaces
    completed: CompletedSurfaces
    textures: tuple[ChartTexture | None, ...]
    inferred: tuple[ChartMesh, ...]
    audit: AuditResult
    flattened: tuple[FlatScan, ...]
    things: tuple[ClosedThing, ...]
    backs: BackOptions | None
    world_from_reference: Pose

    @cached_property
    def _spill(self) -> Spill | NoSpill:
        """Where what follows from a large model is kept."""
        return spill_of(sum(seen.scan.ranges.size for seen in self.observations))

    @property
    def _shifts(self) -> Shifts:
        """By how much pixels move along their rays in the meshes of what was measured."""
        return tuple(scan.shift_m for scan in self.flattened)

    @cached_property
    def surfaces(self) -> tuple[DerivedSurface, ...]:
        """What follows from each completed surface."""
        pairs = zip(self.patches, self.inferred, strict=True)
        return tuple(DerivedSurface(patch, mesh, self._spill) for patch, mesh in pairs)

    @property
    def derived(self) -> CompletedModel:
        """Itself: what follows from it are its own properties."""
        return self

    @property
    def observations(self) -> tuple[Observation, ...]:
        """The scans as they were used; their frame is the first scan's sensor frame, the working frame."""
        return self.measured_surfaces.observations

    @property
    def patches(self) -> tuple[Patch, ...]:
        """The completed surfaces, working frame; number i + 1 in files."""
        return self.completed.patches

    @property
    def owners(self) -> tuple[NDArray[np.int32], ...]:
        """For each scan, the number (rows, columns) of the surface of each pixel; 0 for none."""
        return self.completed.scans.owners

    @property
    def key_frames(self) -> tuple[int, ...]:
        """Numbers, from 0, of the scans that show something new; all of up to 64."""
        return self.measured_surfaces.key_frames

    @property
    def unconfirmed(self) -> UnconfirmedRegions:
        """Regions of single frames of a sequence that other frames did not confirm, left out."""
        return self.measured_surfaces.unconfirmed

    @property
    def registration(self) -> Registration:
        """What the scans say of each other's poses, and the corrections."""
        return self.measured_surfaces.registration

    @property
    def flatness_m(self) -> float:
        """How far real surfaces were taken to stray from their ideal form, metres."""
        return self.measured_surfaces.tolerance.flatness_m

    @property
    def choice(self) -> Choice:
        """Which surfaces were wanted."""
        return self.completed.choice

    @property
    def mode(self) -> Mode:
        """Mode it was made in."""
        return self.completed.mode

    @property
    def edits(self) -> tuple[Edit, ...]:
        """What a person said of the surfaces, world coordinates."""
        return self.completed.edits

    @property
    def up(self) -> Up:
        """Which way is up in the world."""
        return self.completed.up

    @property
    def up_in_reference(self) -> FloatArray:
        """Which way is up, (3,), in the working frame."""
        return np.asarray(self.up.direction @ self.world_from_reference.rotation)

    @property
    def drawing_from_reference(self) -> Pose:
        """From the working frame to that of drawings: the world, turned so that z is up."""
        return self.up.drawing_from_world @ self.world_from_reference

    @property
    def relations(self) -> SurfaceRelations | None:
        """What its surfaces are to each other, working frame; None where not asked for."""
        return self.completed.relations

    @property
    def errors(self) -> JointErrors:
        """Joint errors of its surfaces, working frame."""
        return self.completed.errors

    @property
    def features(self) -> tuple[TemplateFit, ...]:
        """Openings that were fitted whole: accepted, ambiguous and rejected, working frame."""
        return self.completed.features

    @cached_property
    def scans(self) -> tuple[RangeImage, ...]:
        """The scans in world coordinates."""
        return tuple(seen.scan.transform(self.world_from_reference) for seen in self.observations)

    @property
    def drawn_scans(self) -> tuple[RangeImage, ...]:
        """The same in coordinates of drawings, z up."""
        return tuple(scan.transform(self.up.drawing_from_world) for scan in self.scans)

    @cached_property
    def atlas(self) -> Atlas:
        """The textures on few pages; none when texture was not asked for."""
        return make_atlas(self.textures or (None,) * len(self.surfaces))

    @cached_property
    def _panels(self) -> PanelModel:
        sheets = [
            Sheet.of(number, surface.patch, surface.polygon)
            for number, surface in enumerate(self.surfaces, start=1)
        ]
        points, reach = self.remainder.points, [_REACH * sheet.cell_m for sheet in sheets]
        faces, owner = points.faces.astype(np.int64), points.surface.astype(np.int64)
        free = points.vertices[owner == 0]
        panels = build_panels(sheets, lambda index: self.surfaces[index].outline, free)
        pixels = PixelMesh(points.vertices, faces, owner, self.remainder.error_m)
        surfaces = [sheet.surface for sheet in sheets]
        return self._spill.keep(light_rest(panels, pixels, surfaces, np.array(reach)))

    @cached_property
    def textured(self) -> tuple[TexturedPart, ...]:
        """The facets of each surface by provenance, what was measured first."""
        panels, parts = self._panels, []
        for number in range(1, len(self.surfaces) + 1):
            is_facet = panels.face_surface == number
            for provenance in np.unique(panels.face_provenance[is_facet]).tolist():
                part = panels.part(is_facet & (panels.face_provenance == provenance))
                uv, page = self.atlas.coordinates(number - 1, part.uv), int(self.atlas.page[number - 1])
                parts.append(TexturedPart(number, Provenance(provenance), part, uv, page))
        return tuple(parts)

    def hypothesised_parts(self) -> Iterator[LabelledPoints]:
        """Yield the inferred area surface by surface, working frame."""
        meshes = [surface.inferred_cells for surface in self.surfaces]
        return hypothesised_parts([surface.patch for surface in self.surfaces], meshes, self.textures)

    @cached_property
    def observed_m2(self) -> float:
        """Measured area of all surfaces, square metres."""
        total = 0.0
        for surface in self.surfaces:
            total += surface.patch.observed_m2
            trim()
        return total

    @cached_property
    def hypothesised_m2(self) -> float:
        """Inferred area of all surfaces, square metres."""
        total = 0.0
        for surface in self.surfaces:
            total += mesh_area(surface.inferred_cells.vertices, surface.inferred_cells.faces)
            trim()
        return total

    @cached_property
    def hypothesised(self) -> LabelledPoints:
        """All inferred area as one mesh, working frame: provenance, confidence, deviation at every vertex."""
        return join_points(list(self.hypothesised_parts()))

    @cached_property
    def observed_step(self) -> int:
        """Every how many rows and columns of the scans observed.ply holds, unless it is to hold them all."""
        return observed_step(self.observations)

    def observed_parts(self, step: int = 1) -> Iterator[LabelledPoints]:
        """Yield measured points of every step-th row and column, working frame, some rows at a time."""
        return observed_parts(self.observations, self.owners, step, self._shifts)

    @cached_property
    def observed(self) -> LabelledPoints:
        """All measured points of all scans as one mesh, working frame."""
        return observed_mesh(self.observations, self.owners, self._shifts)

    @cached_property
    def remainder(self) -> Remainder:
        """Measured points of no completed surface, working frame; of every k-th row and column."""
        return self._spill.keep(remainder(self.observations, self.owners, self._shifts))

    @cached_property
    def light_remainder(self) -> LabelledPoints:
        """The same as few triangles, those of the light model, with what is known of the nearest points."""
        facets, points = self._panels.remainder, self.remainder.points
        columns = {name: getattr(points, name)[facets.source] for name in points.of_vertices}
        columns["vertices"] = self._panels.vertices[facets.vertex]
        faces = np.searchsorted(facets.vertex, facets.faces).astype(np.int32)
        return self._spill.keep(LabelledPoints(faces=faces, **columns))

    @property
    def free_space_violation_m2(self) -> float:
        """Inferred area that observed beams went through, by the audit, square metres."""
        return self.audit.violation_m2

    @property
    def overlapping_claims_m2(self) -> float:
        """Area that was inferred of several surfaces at once, by the audit, square metres."""
        return self.audit.overlap_m2

    @property
    def warnings(self) -> tuple[str, ...]:
        """What to know before trusting it, in plain words."""
        doubts = doubts_of(
            self.observations, self.patches, self.registration, self.unconfirmed, self.relations
        )
        told_of_up = (self.up.word,) if self.up.word else ()
        up = self.up.within(self.world_from_reference).direction
        ground = ground_doubts(self.patches, self.completed.room, self.observations, up)
        return (*told_of_up, *doubts, *ground, *flat_doubts(self.flattened))

    def anchor(self, number: int) -> FloatArray:
        """Return a measured point (3,) deep inside surface `number`, from 1: its name in edits.

        World coordinates, metres. Of a face of a feature that nobody measured it is the middle.

        Raises
        ------
        InputError
            There is no such surface.
        """
        if not 1 <= number <= len(self.patches):
            raise InputError(f"there is no surface {number}: there are {len(self.patches)}, counted from 1")
        return self.world_from_reference.apply(anchor_of(self.patches[number - 1].source, self.observations))

    def observed_mesh(self) -> LabelledPoints:
        """Return all measured points of all scans as one mesh, working frame."""
        return self.observed

    def panels(self) -> PanelModel:
        """Return the light model, working frame: few facets, and the folds and corners that they share."""
        return self._panels

    def _facts(self) -> list[tuple[str, str]]:
        """What is measured, and what is inferred."""
        observed, inferred = self.observed_m2, self.hypothesised_m2
        more = f" (+{100 * inferred / observed:.1f} %)" if observed > 0 else ""
        things = [("things", f"{len(self.things)}, with the sides that nobody saw")] if self.things else []
        return [
            ("measured", f"{observed:.2f} m\u00b2 on {len(self.patches)} surfaces"),
            ("inferred", f"{inferred:.2f} m\u00b2{more}, mode {self.mode}"),
            ("inferred where a beam went through", f"{self.free_space_violation_m2:.3f} m\u00b2"),
            *things,
        ]

    def _repr_html_(self) -> str:
        """What a notebook shows: measured and inferred area, the largest surfaces, a small picture."""
        from scenes.scan.thumbnail import thumbnails  # only notebooks need it

        observed, inferred = self.observed_m2, self.hypothesised_m2
        whole = max(observed + inferred, 1e-12)
        figures = [
            *self._facts(),
            *(
                (f"surface {number}", f"{patch.grid.surface.kind}, {_areas(patch)}")
                for number, patch in enumerate(self.patches[:_MOST_SURFACES], start=1)
            ),
        ]
        n_more, first = len(self.patches) - _MOST_SURFACES, self.observations[0].scan
        return Card(
            "Completion",
            first.name if len(self.observations) == 1 else f"{len(self.observations)} scans",
            figures,
            bar=(
                CardShare("measured", observed / whole, MEASURED),
                CardShare("inferred", inferred / whole, INFERRED),
            ),
            pictures=thumbnails(first.ranges, first.colour, first.projection)[:1],
            note=" · ".join([*([f"and {n_more} more"] if n_more > 0 else []), *self.warnings]),
        ).to_html()


def anchor_of(surface: MergedSurface, observations: Sequence[Observation]) -> FloatArray:
    """Return a measured point (3,) deep inside a surface, or the middle of one that nobody measured."""
    if not surface.n_pixels:
        middle: FloatArray = surface.fit.surface.from_uv(np.zeros((1, 2)))[0]
        return middle
    return anchor_point(surface, observations)


def _areas(patch: Patch) -> str:
    """Measured and inferred area of a surface."""
    inferred = f" + {patch.hypothesised_m2:.2f} m\u00b2 inferred" if patch.hypothesised_m2 > 0 else ""
    return f"{patch.observed_m2:.2f} m\u00b2{inferred}"
