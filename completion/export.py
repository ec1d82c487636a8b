# SPDX-License-Identifier: MIT
"""Export: a completion as textured GLB, PLY with provenance, and JSON; every file whole or not at all."""

from __future__ import annotations

import json
import struct
from collections.abc import Sequence
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray
from PIL import Image
from trimesh.visual.material import PBRMaterial
from trimesh.visual.texture import TextureVisuals

from completion.extension import Patch
from completion.meshing import ChartMesh, mesh_cells
from completion.model import CompletedModel, LabelledPoints
from completion.provenance import Provenance
from completion.record import completion_record, provenance_word
from completion.texturing.atlas import Atlas, make_atlas
from completion.verification import Verification
from scenes.atomic import write_bytes, write_json
from scenes.checks import InputError
from scenes.formats.ply import write_mesh_ply
from scenes.mesh import Appearance, LabelledMesh
from scenes.pose import Pose

_Y_UP = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])  # z up to glTF's y up
_OBSERVED_GREY, _HYPOTHESISED_BLUE = (0.72, 0.72, 0.70), (0.35, 0.55, 0.85)


def save_completion(
    completion: CompletedModel, folder: str | PathLike[str], verification: Verification | None = None
) -> None:
    """Write completed.glb, observed.ply, hypothesised.ply and completion.json to an existing or new folder.

    With `verification`, completion.json also says what later scans say of what the first one alone inferred.

    Raises
    ------
    InputError
        The folder cannot be made or written.
    """
    target = Path(folder)
    try:
        target.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{target}: cannot make this folder: {error.strerror}") from error
    legend = [f"provenance {member.value} {provenance_word(member)}" for member in Provenance]
    world = completion.world_from_reference
    _write_points(target / "observed.ply", completion.observed_mesh(), world, legend)
    _write_points(target / "hypothesised.ply", completion.hypothesised, world, legend)
    write_bytes(target / "completed.glb", completed_glb(completion))
    write_json(target / "completion.json", completion_record(completion, verification))


def completed_glb(completion: CompletedModel) -> bytes:
    """The completed model as binary glTF, y up by its root node; one node for each surface and state.

    Nodes are called `observed ...` and `hypothesised ...`: a hypothesis can never pass for a measurement.
    Their textures lie on the pages of one atlas.
    """
    scene = trimesh.Scene(base_frame="world")
    atlas = _atlas(completion)
    pages = [Image.fromarray(page) for page in atlas.pages]
    for index, patch in enumerate(completion.patches):
        for state, cells in (("observed", patch.observed), ("hypothesised", patch.hypothesised)):
            mesh = _state_mesh(patch, cells, state == "hypothesised")
            if len(mesh.faces):
                name = f"{state} {index + 1} {patch.grid.surface.kind}"
                uv = atlas.coordinates(index, _chart_coordinates(mesh, patch))
                page = pages[atlas.page[index]] if atlas.page[index] >= 0 else None
                vertices = completion.world_from_reference.apply(mesh.vertices)
                visual = TextureVisuals(uv=uv, material=_material(state, page))
                _add(scene, name, trimesh.Trimesh(vertices, mesh.faces, visual=visual, process=False))
    rest = remainder_mesh(completion)
    if len(rest.faces):
        model = trimesh.Trimesh(
            completion.world_from_reference.apply(rest.vertices),
            rest.faces,
            vertex_colors=rest.colour,
            process=False,
        )
        _add(scene, "observed remainder", model)
    if not scene.geometry:
        return _empty_glb()
    data: bytes = scene.export(file_type="glb")
    return data


def _state_mesh(patch: Patch, cells: NDArray[np.bool_], is_hypothesised: bool) -> ChartMesh:
    """Cells as few triangles, inferred ones cut where the surface ends."""
    cuts, trims = (patch.limits.cuts, patch.trims) if is_hypothesised else ((), ())
    return mesh_cells(patch.grid, cells, cuts, trims, merged=True)


def _empty_glb() -> bytes:
    """A binary glTF with a scene in which nothing stands (trimesh writes none)."""
    text = json.dumps({"asset": {"version": "2.0"}, "scene": 0, "scenes": [{}]}).encode()
    text += b" " * (-len(text) % 4)
    chunk = struct.pack("<I4s", len(text), b"JSON") + text
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunk)) + chunk


def remainder_mesh(completion: CompletedModel) -> LabelledPoints:
    """Measured points of all scans that belong to no completed surface, as one mesh, working frame."""
    points = completion.observed_mesh()
    free = (points.surface == 0)[points.faces].any(axis=1)
    used, index = np.unique(points.faces[free], return_inverse=True)
    return LabelledPoints(
        points.vertices[used],
        index.reshape(-1, 3).astype(np.int32),
        points.surface[used],
        points.provenance[used],
        points.sd[used],
        points.confidence[used],
        points.colour[used],
    )


def display_mesh(
    completion: CompletedModel, *, hypothesised: bool = True, mark: bool = False
) -> LabelledMesh:
    """The model as one textured mesh in world coordinates, for pictures: surface 0 observed, 1 not.

    Parameters
    ----------
    completion : CompletedModel
        What to show.
    hypothesised : bool
        Whether inferred area is shown.
    mark : bool
        Paint inferred area in one colour instead of its texture.
    """
    corners, colours, labels, face_image, corner_uv = [], [], [], [], []
    atlas = _atlas(completion)
    for index, patch in enumerate(completion.patches):
        for state, cells in enumerate((patch.observed, patch.hypothesised)):
            if state == 1 and not hypothesised:
                continue
            mesh = _state_mesh(patch, cells, state == 1)
            page = -1 if mark and state == 1 else int(atlas.page[index])
            corners.append(mesh.vertices[mesh.faces])
            tint = np.array(
                (_OBSERVED_GREY, _HYPOTHESISED_BLUE)[state] if page < 0 else (1.0, 1.0, 1.0), np.float32
            )
            colours.append(np.broadcast_to(tint, (len(mesh.faces), 3, 3)))
            labels.append(np.full(len(mesh.faces), state, np.int32))
            face_image.append(np.full(len(mesh.faces), page, np.int32))
            corner_uv.append(atlas.coordinates(index, _chart_coordinates(mesh, patch))[mesh.faces])
    rest = remainder_mesh(completion)
    corners.append(rest.vertices[rest.faces])
    colours.append((rest.colour[rest.faces] / 255.0).astype(np.float32))
    labels.append(np.zeros(len(rest.faces), np.int32))
    face_image.append(np.full(len(rest.faces), -1, np.int32))
    corner_uv.append(np.zeros((len(rest.faces), 3, 2)))
    vertices = completion.world_from_reference.apply(np.concatenate(corners).reshape(-1, 3))
    appearance = Appearance(
        np.concatenate(colours).astype(np.float32),
        atlas.pages,
        np.concatenate(face_image),
        np.concatenate(corner_uv).astype(np.float32),
    )
    faces = np.arange(len(vertices), dtype=np.int32).reshape(-1, 3)
    return LabelledMesh(vertices, faces, np.concatenate(labels), appearance)


def _atlas(completion: CompletedModel) -> Atlas:
    """The atlas of a completion; without pages when texture was not asked for."""
    return make_atlas(completion.textures or (None,) * len(completion.patches))


def _material(state: str, page: Image.Image | None) -> PBRMaterial:
    """Measured or inferred surface with its page of the atlas, or with the state's colour."""
    colour = _OBSERVED_GREY if state == "observed" else _HYPOTHESISED_BLUE
    return PBRMaterial(
        name=state,
        baseColorTexture=page,
        baseColorFactor=None if page is not None else [*(int(c * 255) for c in colour), 255],
        metallicFactor=0.0,
        roughnessFactor=1.0,
        doubleSided=True,
    )


def _chart_coordinates(mesh: ChartMesh, patch: Patch) -> NDArray[np.float64]:
    """Chart coordinates (n, 2) of the vertices, going on where the chart closes."""
    return patch.grid.uv_of(mesh.cells[:, 0], mesh.cells[:, 1])


def _add(scene: trimesh.Scene, name: str, mesh: trimesh.Trimesh) -> None:
    scene.add_geometry(mesh, node_name=name, geom_name=name, transform=_Y_UP)


def _write_points(path: Path, points: LabelledPoints, world: Pose, comments: Sequence[str]) -> None:
    properties: dict[str, NDArray[Any]] = {
        "red": points.colour[:, 0],
        "green": points.colour[:, 1],
        "blue": points.colour[:, 2],
        "surface": points.surface,
        "provenance": points.provenance,
        "sd": points.sd.astype(np.float32),
        "confidence": points.confidence.astype(np.float32),
    }
    write_mesh_ply(path, world.apply(points.vertices), points.faces, properties, comments)
