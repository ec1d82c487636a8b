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

from completion.boundary import trace_boundary
from completion.extension import Patch
from completion.fitting.result import surface_parameters
from completion.meshing import ChartMesh, mesh_cells
from completion.model import CompletedModel, LabelledPoints, to_8_bits
from completion.openings import find_openings
from completion.provenance import Provenance
from completion.texturing import ChartTexture
from scenes.atomic import write_bytes, write_json
from scenes.checks import InputError
from scenes.formats.ply import write_mesh_ply
from scenes.mesh import Appearance, LabelledMesh
from scenes.pose import Pose

_Y_UP = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])  # z up to glTF's y up
_OBSERVED_GREY, _HYPOTHESISED_BLUE = (0.72, 0.72, 0.70), (0.35, 0.55, 0.85)


def save_completion(completion: CompletedModel, folder: str | PathLike[str]) -> None:
    """Write completed.glb, observed.ply, hypothesised.ply and completion.json to an existing or new folder.

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
    legend = [f"provenance {member.value} {_word(member)}" for member in Provenance]
    world = completion.world_from_reference
    _write_points(target / "observed.ply", completion.observed_mesh(), world, legend)
    _write_points(target / "hypothesised.ply", completion.hypothesised, world, legend)
    write_bytes(target / "completed.glb", completed_glb(completion))
    write_json(target / "completion.json", completion_record(completion))


def completion_record(completion: CompletedModel) -> dict[str, Any]:
    """What `completion.json` holds; lengths in metres, areas in square metres, world coordinates."""
    return {
        "surfaces": [
            _surface_record(index, patch, completion.world_from_reference)
            for index, patch in enumerate(completion.patches, start=1)
        ],
        "observed_m2": completion.observed_m2,
        "hypothesised_m2": completion.hypothesised_m2,
        "free_space_violation_m2": completion.free_space_violation_m2,
        "mode": completion.mode,
        "n_scans": len(completion.observations),
        "range_noise": [
            {"constant_m": seen.noise.constant_m, "quadratic_per_m": seen.noise.quadratic_per_m}
            for seen in completion.observations
        ],
        "provenance": {str(member.value): {"name": _word(member)} for member in Provenance},
    }


def _surface_record(index: int, patch: Patch, world: Pose) -> dict[str, Any]:
    fit = patch.source.fit
    return {
        "id": index,
        "kind": fit.surface.kind,
        "parameters": surface_parameters(fit.surface.transformed(world)),
        "standard_deviation": fit.parameter_deviations(),
        "rms": fit.rms,
        "n": fit.n,
        "n_parts": patch.source.n_parts,
        "observed_m2": patch.observed_m2,
        "hypothesised_m2": patch.hypothesised_m2,
        "encloses": patch.limits.encloses,
        "openings": [
            {
                "area_m2": opening.area_m2,
                "seen_share": opening.seen_share,
                "points": world.apply(opening.points).tolist(),
            }
            for opening in find_openings(patch)
        ],
        "boundary": [
            {
                "kind": segment.kind,
                "provenance": segment.provenance,
                "confidence": segment.confidence,
                "points": world.apply(segment.points).tolist(),
            }
            for segment in trace_boundary(patch)
        ],
    }


def completed_glb(completion: CompletedModel) -> bytes:
    """The completed model as binary glTF, y up by its root node; one node for each surface and state.

    Nodes are called `observed ...` and `hypothesised ...`: a hypothesis can never pass for a measurement.
    """
    scene = trimesh.Scene(base_frame="world")
    for index, patch in enumerate(completion.patches):
        texture = completion.textures[index] if index < len(completion.textures) else None
        for state, cells in (("observed", patch.observed), ("hypothesised", patch.hypothesised)):
            mesh = _state_mesh(patch, cells, state == "hypothesised")
            if len(mesh.faces):
                name = f"{state} {index + 1} {patch.grid.surface.kind}"
                _add(scene, name, _trimesh(mesh, patch, texture, state, completion.world_from_reference))
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
    images: list[NDArray[np.uint8]] = []
    for index, patch in enumerate(completion.patches):
        texture = completion.textures[index] if index < len(completion.textures) else None
        for state, cells in enumerate((patch.observed, patch.hypothesised)):
            if state == 1 and not hypothesised:
                continue
            mesh = _state_mesh(patch, cells, state == 1)
            plain = texture is None or (mark and state == 1)
            corners.append(mesh.vertices[mesh.faces])
            tint = np.array(
                (_OBSERVED_GREY, _HYPOTHESISED_BLUE)[state] if plain else (1.0, 1.0, 1.0), np.float32
            )
            colours.append(np.broadcast_to(tint, (len(mesh.faces), 3, 3)))
            labels.append(np.full(len(mesh.faces), state, np.int32))
            face_image.append(np.full(len(mesh.faces), -1 if plain else len(images), np.int32))
            corner_uv.append(_texture_coordinates(mesh, patch)[mesh.faces])
            if not plain and texture is not None:
                images.append(to_8_bits(texture.image[::-1]))
    rest = remainder_mesh(completion)
    corners.append(rest.vertices[rest.faces])
    colours.append((rest.colour[rest.faces] / 255.0).astype(np.float32))
    labels.append(np.zeros(len(rest.faces), np.int32))
    face_image.append(np.full(len(rest.faces), -1, np.int32))
    corner_uv.append(np.zeros((len(rest.faces), 3, 2)))
    vertices = completion.world_from_reference.apply(np.concatenate(corners).reshape(-1, 3))
    appearance = Appearance(
        np.concatenate(colours).astype(np.float32),
        tuple(images),
        np.concatenate(face_image),
        np.concatenate(corner_uv).astype(np.float32),
    )
    faces = np.arange(len(vertices), dtype=np.int32).reshape(-1, 3)
    return LabelledMesh(vertices, faces, np.concatenate(labels), appearance)


def _trimesh(
    mesh: ChartMesh, patch: Patch, texture: ChartTexture | None, state: str, world: Pose
) -> trimesh.Trimesh:
    colour = _OBSERVED_GREY if state == "observed" else _HYPOTHESISED_BLUE
    material = PBRMaterial(
        name=f"{state} {patch.grid.surface.kind}",
        baseColorTexture=None if texture is None else Image.fromarray(to_8_bits(texture.image[::-1])),
        baseColorFactor=None if texture is not None else [*(int(c * 255) for c in colour), 255],
        metallicFactor=0.0,
        roughnessFactor=1.0,
        doubleSided=True,
    )
    visual = TextureVisuals(uv=_texture_coordinates(mesh, patch), material=material)
    return trimesh.Trimesh(world.apply(mesh.vertices), mesh.faces, visual=visual, process=False)


def _texture_coordinates(mesh: ChartMesh, patch: Patch) -> NDArray[np.float64]:
    """Texture coordinates (n, 2) of the vertices, v upwards, in an image whose last row is the lowest v."""
    rows, columns = patch.grid.shape
    return np.column_stack([mesh.cells[:, 1] / columns, mesh.cells[:, 0] / rows])


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


def _word(provenance: Provenance) -> str:
    return provenance.name.lower().replace("_", "-")
