# SPDX-License-Identifier: MIT
"""Meshes of a completed model in world coordinates: for files, for pictures, and as the light model."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import NDArray

from completion.export.panels.model import PanelPart
from completion.extension.patch import Provenance
from completion.result.completed_model import CompletedModel
from completion.result.labelled_points import PROVENANCE_NAMES
from scenes.checks import ColourArray
from scenes.io.clouds.e57_writer import InferredPoints
from scenes.io.meshes.ply_writer import write_mesh_ply
from scenes.mesh.blocks import in_blocks
from scenes.mesh.labelled_mesh import Appearance, LabelledMesh
from scenes.mesh.mesh_parts import MeshPart
from scenes.run.mapping import trim

OBSERVED_GREY, HYPOTHESISED_BLUE = (0.72, 0.72, 0.70), (0.35, 0.55, 0.85)
"""Colours of surface without texture, sRGB in 0..1."""


def model_parts(completion: CompletedModel) -> list[MeshPart]:
    """Return the model in world coordinates; a part for each surface and state, and one for the rest.

    They are called `observed 1 plane`, `hypothesised 1 plane` and so on, and `observed remainder`: a
    hypothesis can never pass for a measurement. Their textures lie on the pages of one atlas; without
    texture, parts have the colour of their state. Those of large models are in blocks of space.
    """
    parts, panels = [], completion.panels()
    for index, surface in enumerate(completion.surfaces):
        trim()
        is_facet = panels.face_surface == index + 1
        for state, kept in (
            ("observed", is_facet & panels.is_measured),
            ("hypothesised", is_facet & ~panels.is_measured),
        ):
            if kept.any():
                name = f"{state} {index + 1} {surface.patch.grid.surface.kind}"
                parts.append(_surface_part(completion, index, panels.part(kept), name))
    remainder = completion.light_remainder
    if len(remainder.faces):
        vertices = completion.world_from_reference.apply(remainder.vertices)
        faces = remainder.faces.astype(np.int64)
        parts.append(MeshPart("observed remainder", vertices, faces, 0, remainder.colour))
    return in_blocks(parts)


def _surface_part(completion: CompletedModel, index: int, mesh: PanelPart, name: str) -> MeshPart:
    """One state of a surface, with its page of the atlas or the state's colour."""
    atlas = completion.atlas
    page = int(atlas.page[index])
    vertices = completion.world_from_reference.apply(mesh.vertices)
    faces = mesh.faces
    if page < 0:
        tint = OBSERVED_GREY if name.startswith("observed") else HYPOTHESISED_BLUE
        return MeshPart(name, vertices, faces, index + 1, _plain(tint, len(vertices)))
    uv = atlas.coordinates(index, mesh.uv).astype(np.float32)
    white = _plain((1.0, 1.0, 1.0), len(vertices))
    return MeshPart(name, vertices, faces, index + 1, white, image=atlas.pages[page], uv=uv)


def _plain(tint: tuple[float, float, float], n: int) -> ColourArray:
    return np.tile(np.rint(np.array(tint) * 255).astype(np.uint8), (n, 1))


def display_mesh(
    completion: CompletedModel, *, hypothesised: bool = True, mark: bool = False
) -> LabelledMesh:
    """The model as one textured mesh, for pictures, z up: surface 0 observed, 1 not.

    Inferred area is shown if `hypothesised`; `mark` paints it in one colour instead of its texture.
    """
    places, corners, colours, labels, face_image, corner_uv = [], [], [], [], [], []
    atlas, n_places = completion.atlas, 0
    for piece in completion.textured:
        trim()
        state = int(piece.provenance != Provenance.MEASURED)
        if state and not hypothesised:
            continue
        page, faces = -1 if mark and state else piece.page, piece.part.faces
        places.append(piece.part.vertices)
        corners.append(faces.astype(np.int32) + np.int32(n_places))
        n_places += len(piece.part.vertices)
        tint = (OBSERVED_GREY, HYPOTHESISED_BLUE)[state] if page < 0 else (1.0, 1.0, 1.0)
        colours.append(np.broadcast_to(np.array(tint, np.float32), (len(faces), 3, 3)))
        labels.append(np.full(len(faces), state, np.int32))
        face_image.append(np.full(len(faces), page, np.int32))
        corner_uv.append(piece.uv[faces])
    remainder = completion.light_remainder
    places.append(remainder.vertices)
    corners.append(remainder.faces.astype(np.int32) + np.int32(n_places))
    colours.append(remainder.colour[remainder.faces].astype(np.float32) / np.float32(255))
    labels.append(np.zeros(len(remainder.faces), np.int32))
    face_image.append(np.full(len(remainder.faces), -1, np.int32))
    corner_uv.append(np.zeros((len(remainder.faces), 3, 2)))
    has_pages = bool(len(atlas.pages))
    look = Appearance(
        np.concatenate(colours),
        atlas.pages,
        np.concatenate(face_image) if has_pages else None,
        np.concatenate(corner_uv).astype(np.float32) if has_pages else None,
    )
    vertices = completion.drawing_from_reference.apply(np.concatenate(places))
    return LabelledMesh(vertices, np.concatenate(corners), np.concatenate(labels), look)


def inferred_points(completion: CompletedModel) -> Iterator[InferredPoints]:
    """Yield the vertices of what is inferred, surface by surface, in the world."""
    for points in completion.hypothesised_parts():
        number = int(points.surface[0])
        yield InferredPoints(
            name=f"inferred {number} {completion.patches[number - 1].grid.surface.kind}",
            points=completion.world_from_reference.apply(points.vertices),
            colour=points.colour,
            surface=points.surface,
            provenance=points.provenance,
            confidence=points.confidence,
            sd=points.sd,
            legend=dict(PROVENANCE_NAMES),
        )


def write_panels_ply(path: str | PathLike[str], completion: CompletedModel, legend: Sequence[str]) -> None:
    """Write the light model in world coordinates, each facet with `surface`, `state` and `provenance`.

    Surface 0 is what no surface explains.

    Raises InputError: the file cannot be written.
    """
    panels = completion.panels()
    n_rest = len(panels.remainder.faces)
    write_mesh_ply(
        path,
        completion.world_from_reference.apply(panels.vertices),
        np.concatenate([panels.faces, panels.remainder.faces]).astype(np.int32),
        comments=("state 0 measured 1 inferred", *legend),
        face_properties={
            "surface": _pad(panels.face_surface, n_rest),
            "state": _pad((~panels.is_measured).astype(np.uint8), n_rest),
            "provenance": _pad(panels.face_provenance.astype(np.uint8), n_rest),
        },
    )


def _pad(values: NDArray[Any], n: int) -> NDArray[Any]:
    """Values of facets, with 0 for n more."""
    return np.pad(values, (0, n))
