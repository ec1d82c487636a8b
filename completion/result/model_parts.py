# SPDX-License-Identifier: MIT
"""Parts: a completed model as named, textured pieces, what was measured apart from what was inferred."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from completion.boundary.meshing import ChartMesh, mesh_cells
from completion.extension.patch import Patch
from completion.result.atlas import Atlas, make_atlas
from completion.result.completed_model import CompletedModel, LabelledPoints
from scenes.checks import ColourArray
from scenes.mesh.mesh_parts import MeshPart

OBSERVED_GREY, HYPOTHESISED_BLUE = (0.72, 0.72, 0.70), (0.35, 0.55, 0.85)
"""Colours of surface without texture, sRGB in 0..1."""


def model_parts(completion: CompletedModel) -> list[MeshPart]:
    """Return the model in world coordinates; a part for each surface and state, and one for the rest.

    They are called `observed 1 plane`, `hypothesised 1 plane` and so on, and `observed remainder`: a
    hypothesis can never pass for a measurement. Their textures lie on the pages of one atlas; without
    texture, parts have the colour of their state.
    """
    atlas, parts = atlas_of(completion), []
    for index, patch in enumerate(completion.patches):
        for state, cells in (("observed", patch.observed), ("hypothesised", patch.hypothesised)):
            mesh = state_mesh(patch, cells, is_hypothesised=state == "hypothesised")
            if len(mesh.faces):
                name = f"{state} {index + 1} {patch.grid.surface.kind}"
                parts.append(_surface_part(completion, atlas, index, mesh, name))
    rest = remainder_mesh(completion)
    if len(rest.faces):
        vertices = completion.world_from_reference.apply(rest.vertices)
        faces = rest.faces.astype(np.int64)
        parts.append(MeshPart("observed remainder", vertices, faces, 0, rest.colour))
    return parts


def _surface_part(
    completion: CompletedModel, atlas: Atlas, index: int, mesh: ChartMesh, name: str
) -> MeshPart:
    """One state of a surface, with its page of the atlas or the state's colour."""
    patch, page = completion.patches[index], int(atlas.page[index])
    vertices = completion.world_from_reference.apply(mesh.vertices)
    faces = mesh.faces.astype(np.int64)
    if page < 0:
        tint = OBSERVED_GREY if name.startswith("observed") else HYPOTHESISED_BLUE
        return MeshPart(name, vertices, faces, index + 1, _plain(tint, len(vertices)))
    uv = atlas.coordinates(index, chart_coordinates(mesh, patch)).astype(np.float32)
    white = _plain((1.0, 1.0, 1.0), len(vertices))
    return MeshPart(
        name=name,
        vertices=vertices,
        faces=faces,
        surface=index + 1,
        colour=white,
        image=atlas.pages[page],
        uv=uv,
    )


def _plain(tint: tuple[float, float, float], n: int) -> ColourArray:
    return np.tile(np.rint(np.array(tint) * 255).astype(np.uint8), (n, 1))


def state_mesh(
    patch: Patch, cells: NDArray[np.bool_], *, is_hypothesised: bool, merged: bool = True
) -> ChartMesh:
    """Cells as triangles, few when merged, inferred ones cut where the surface ends."""
    cuts, trims = (patch.limits.cuts, patch.trims) if is_hypothesised else ((), ())
    return mesh_cells(patch.grid, cells, cuts, trims, merged=merged)


def remainder_mesh(completion: CompletedModel) -> LabelledPoints:
    """Measured points of all scans that belong to no completed surface, as one mesh, working frame."""
    points = completion.observed_mesh()
    free = (points.surface == 0)[points.faces].any(axis=1)
    used, index = np.unique(points.faces[free], return_inverse=True)
    return LabelledPoints(
        vertices=points.vertices[used],
        faces=index.reshape(-1, 3).astype(np.int32),
        surface=points.surface[used],
        provenance=points.provenance[used],
        sd=points.sd[used],
        confidence=points.confidence[used],
        colour=points.colour[used],
    )


def atlas_of(completion: CompletedModel) -> Atlas:
    """The atlas of a completion; without pages when texture was not asked for."""
    return make_atlas(completion.textures or (None,) * len(completion.patches))


def chart_coordinates(mesh: ChartMesh, patch: Patch) -> NDArray[np.float64]:
    """Chart coordinates (n, 2) of the vertices, going on where the chart closes."""
    return patch.grid.uv_of(mesh.cells[:, 0], mesh.cells[:, 1])
