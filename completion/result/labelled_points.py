# SPDX-License-Identifier: MIT
"""Labelled points: measured or inferred area as a mesh whose every vertex says where it comes from."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from completion.boundary.meshing import ChartMesh
from completion.extension.patch import Patch, Provenance
from completion.texturing.chart_texture import ChartTexture
from scenes.checks import ColourArray, FloatArray
from scenes.mesh.labelled_mesh import triangle_areas
from scenes.run.mapping import trim

PROVENANCE_NAMES = {str(member.value): member.name.lower().replace("_", "-") for member in Provenance}
"""Names of the provenances in files, by their numbers as text."""
GREY = 160
"""sRGB of what has no colour."""
_OF_VERTICES = ("vertices", "surface", "provenance", "sd", "confidence", "colour")


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
    colour: ColourArray

    @property
    def of_vertices(self) -> tuple[str, ...]:
        """What is told of each vertex."""
        return _OF_VERTICES

    @property
    def area_m2(self) -> float:
        """Area of the triangles, square metres."""
        return mesh_area(self.vertices, self.faces)

    def part(self, kept: NDArray[np.bool_]) -> LabelledPoints:
        """Return some of the faces (m,) with the vertices that they use, in their order."""
        faces, is_used = self.faces[kept], np.zeros(len(self.vertices), np.bool_)
        is_used[faces] = True
        number = np.cumsum(is_used, dtype=np.int32) - 1
        columns = {name: getattr(self, name)[is_used] for name in _OF_VERTICES}
        return LabelledPoints(faces=number[faces], **columns)


def mesh_area(vertices: FloatArray, faces: NDArray[np.integer[Any]]) -> float:
    """Area in square metres of triangles (m, 3) of vertices (n, 3) in metres."""
    return float(triangle_areas(vertices[faces]).sum())


def hypothesised_parts(
    patches: Sequence[Patch], meshes: Sequence[ChartMesh], textures: Sequence[ChartTexture | None]
) -> Iterator[LabelledPoints]:
    """Yield the inferred cells of each surface, working frame, in the colours of its texture.

    `meshes` are the inferred cells of each patch, every cell by itself; `textures` may be fewer. Surfaces of
    which nothing was inferred are left out.
    """
    for index, (patch, mesh) in enumerate(zip(patches, meshes, strict=True)):
        if len(mesh.faces):
            texture = textures[index] if index < len(textures) else None
            yield _labelled(patch, index + 1, mesh, texture)
            trim()


def _labelled(patch: Patch, number: int, mesh: ChartMesh, texture: ChartTexture | None) -> LabelledPoints:
    """Inferred cells of one surface; where faces meet in a vertex, the largest value counts."""
    n = len(mesh.vertices)
    provenance, confidence = np.zeros(n, np.int32), np.zeros(n)
    of_face = patch.provenance.ravel()[mesh.face_cell].astype(np.int32)
    np.maximum.at(provenance, mesh.faces.ravel(), np.repeat(of_face, 3))
    np.maximum.at(confidence, mesh.faces.ravel(), np.repeat(patch.confidence.ravel()[mesh.face_cell], 3))
    colour = np.full((n, 3), GREY, np.uint8)
    if texture is not None:
        colour = texture.colour_at(patch.grid.uv_of(*mesh.cells.T))
    return LabelledPoints(
        vertices=mesh.vertices,
        faces=mesh.faces,
        surface=np.full(n, number, np.int32),
        provenance=provenance,
        sd=patch.stated.standard_deviation(mesh.vertices),
        confidence=confidence,
        colour=colour,
    )


def joined(parts: Sequence[LabelledPoints]) -> LabelledPoints:
    """Return all parts as one mesh, in their order."""
    if len(parts) == 1:
        return parts[0]
    none, real, places = np.zeros(0, np.int32), np.zeros(0), np.zeros((0, 3))
    colour, faces = places.astype(np.uint8), places.astype(np.int32)
    nothing = LabelledPoints(places, faces, none, none, real, confidence=real, colour=colour)
    every, start = (nothing, *parts), np.cumsum([0, 0, *(len(part.vertices) for part in parts)])
    shifted = [part.faces + offset for part, offset in zip(every, start, strict=False)]
    columns: dict[str, Any] = {n: np.concatenate([getattr(one, n) for one in every]) for n in _OF_VERTICES}
    return LabelledPoints(faces=np.concatenate(shifted).astype(np.int32), **columns)
