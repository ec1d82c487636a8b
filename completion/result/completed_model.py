# SPDX-License-Identifier: MIT
"""Completed model: the result, in which what was measured and what was inferred are never mixed up."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from completion.boundary.meshing import ChartMesh, mesh_cells, mesh_range_image
from completion.edits.application import anchor_point
from completion.edits.edit import Edit
from completion.evidence.chart_grid import ChartGrid
from completion.extension.extent import Mode
from completion.extension.patch import Patch, Provenance
from completion.observe.observation import Observation
from completion.result.audit import AuditResult
from completion.texturing.chart_texture import ChartTexture
from scenes.checks import FloatArray, InputError
from scenes.mesh.labelled_mesh import triangle_areas
from scenes.pose import Pose


@dataclass(frozen=True, slots=True, eq=False)
class LabelledPoints:
    """A mesh whose every vertex says where it comes from.

    Attributes
    ----------
    vertices : (n, 3) float
        Metres.
    faces : (m, 3) int32
        Triangles.
    surface : (n,) int32
        Number of the surface, from 1; 0 for none.
    provenance : (n,) int32
        A `Provenance`.
    sd : (n,) float
        Predicted standard deviation, metres.
    confidence : (n,) float
        Probability that the surface is there; 1 for what was measured.
    colour : (n, 3) uint8
        sRGB.
    """

    vertices: FloatArray
    faces: NDArray[np.int32]
    surface: NDArray[np.int32]
    provenance: NDArray[np.int32]
    sd: FloatArray
    confidence: FloatArray
    colour: NDArray[np.uint8]


@dataclass(frozen=True, slots=True, eq=False)
class CompletedModel:
    """What `complete` found.

    Attributes
    ----------
    observations : tuple of Observation
        The scans as they were used; their frame is the first scan's sensor frame, the working frame.
    patches : tuple of Patch
        The completed surfaces, working frame; number i + 1 in files.
    textures : tuple of ChartTexture or None
        Colour of each patch; empty when texture was not asked for.
    hypothesised : LabelledPoints
        All inferred area as one mesh, working frame.
    audit : AuditResult
        How much of it stands in observed free space.
    owners : tuple of (rows, columns) int32
        For each scan, the number of the surface that each pixel belongs to.
    mode : str
        Mode it was made in.
    edits : tuple of Edit
        What a person said of the surfaces, world coordinates.
    world_from_reference : Pose
        From the working frame to the world.
    """

    observations: tuple[Observation, ...]
    patches: tuple[Patch, ...]
    textures: tuple[ChartTexture | None, ...]
    hypothesised: LabelledPoints
    audit: AuditResult
    owners: tuple[NDArray[np.int32], ...]
    mode: Mode
    edits: tuple[Edit, ...]
    world_from_reference: Pose

    @property
    def observed_m2(self) -> float:
        """Measured area of all surfaces, square metres."""
        return float(sum(patch.observed_m2 for patch in self.patches))

    @property
    def hypothesised_m2(self) -> float:
        """Inferred area of all surfaces, square metres."""
        return mesh_area(self.hypothesised.vertices, self.hypothesised.faces)

    @property
    def free_space_violation_m2(self) -> float:
        """Inferred area that observed beams went through, by the audit, square metres."""
        return self.audit.violation_m2

    def anchor(self, number: int) -> FloatArray:
        """A measured point (3,) deep inside surface `number`, from 1, world coordinates: its name in edits.

        Raises
        ------
        InputError
            There is no such surface.
        """
        if not 1 <= number <= len(self.patches):
            raise InputError(f"there is no surface {number}: there are {len(self.patches)}, counted from 1")
        point = anchor_point(self.patches[number - 1].source, self.observations)
        return self.world_from_reference.apply(point)

    def observed_mesh(self) -> LabelledPoints:
        """All measured points of all scans as one mesh, working frame."""
        return _joined(
            [_scan_mesh(seen, owner) for seen, owner in zip(self.observations, self.owners, strict=True)]
        )


def mesh_area(vertices: FloatArray, faces: NDArray[np.int32]) -> float:
    """Area of a triangle mesh in square metres."""
    return float(triangle_areas(vertices[faces]).sum())


def hypothesised_mesh(patches: Sequence[Patch], textures: Sequence[ChartTexture | None]) -> LabelledPoints:
    """All hypothesised cells as one mesh with provenance and predicted deviation at every vertex."""
    parts = []
    for index, patch in enumerate(patches):
        mesh = mesh_cells(patch.grid, patch.hypothesised, patch.limits.cuts, patch.trims, merged=False)
        if not len(mesh.faces):
            continue
        provenance = np.zeros(len(mesh.vertices), np.int32)
        of_face = patch.provenance.ravel()[mesh.face_cell].astype(np.int32)
        np.maximum.at(provenance, mesh.faces.ravel(), np.repeat(of_face, 3))
        confidence = np.zeros(len(mesh.vertices))
        np.maximum.at(confidence, mesh.faces.ravel(), np.repeat(patch.confidence.ravel()[mesh.face_cell], 3))
        texture = textures[index] if index < len(textures) else None
        parts.append(
            LabelledPoints(
                vertices=mesh.vertices,
                faces=mesh.faces,
                surface=np.full(len(mesh.vertices), index + 1, np.int32),
                provenance=provenance,
                sd=patch.source.fit.standard_deviation(mesh.vertices),
                confidence=confidence,
                colour=_vertex_colour(mesh, patch.grid, texture),
            )
        )
    return _joined(parts)


def _vertex_colour(mesh: ChartMesh, grid: ChartGrid, texture: ChartTexture | None) -> NDArray[np.uint8]:
    if texture is None:
        return np.full((len(mesh.vertices), 3), 160, np.uint8)
    return texture.colour_at(grid.uv_of(mesh.cells[:, 0], mesh.cells[:, 1]))


def to_8_bits(colour: NDArray[np.floating[Any]]) -> NDArray[np.uint8]:
    """Colours 0..1 as 0..255."""
    return np.asarray(np.rint(np.clip(colour, 0, 1) * 255), dtype=np.uint8)


def _scan_mesh(seen: Observation, owner: NDArray[np.int32]) -> LabelledPoints:
    footprint = np.where(seen.valid, seen.scan.ranges, 0.0) * seen.scan.projection.pixel_angle
    sigma = np.where(seen.valid, seen.sigma, 0.0)
    faces = mesh_range_image(seen.points, seen.valid, 6 * footprint + 6 * sigma, seen.scan.origin)
    used = np.flatnonzero(seen.valid.ravel())
    number = np.full(seen.valid.size, -1, np.int32)
    number[used] = np.arange(len(used), dtype=np.int32)
    colour = np.full((len(used), 3), 160, np.uint8)
    if seen.scan.colour is not None:
        colour = to_8_bits(seen.scan.colour.reshape(-1, 3)[used])
    return LabelledPoints(
        vertices=seen.points.reshape(-1, 3)[used],
        faces=number[faces],
        surface=owner.ravel()[used],
        provenance=np.full(len(used), Provenance.MEASURED, np.int32),
        sd=sigma.ravel()[used],
        confidence=np.ones(len(used)),
        colour=colour,
    )


def _joined(parts: Sequence[LabelledPoints]) -> LabelledPoints:
    if not parts:
        empty = np.zeros(0, np.int32)
        triangle = np.zeros((0, 3), np.int32)
        return LabelledPoints(
            vertices=np.zeros((0, 3)),
            faces=triangle,
            surface=empty,
            provenance=empty,
            sd=np.zeros(0),
            confidence=np.zeros(0),
            colour=np.zeros((0, 3), np.uint8),
        )
    start = np.cumsum([0, *(len(part.vertices) for part in parts)])[:-1]
    return LabelledPoints(
        vertices=np.concatenate([part.vertices for part in parts]),
        faces=np.concatenate([part.faces + offset for part, offset in zip(parts, start, strict=True)]).astype(
            np.int32
        ),
        surface=np.concatenate([part.surface for part in parts]),
        provenance=np.concatenate([part.provenance for part in parts]),
        sd=np.concatenate([part.sd for part in parts]),
        confidence=np.concatenate([part.confidence for part in parts]),
        colour=np.concatenate([part.colour for part in parts]),
    )
