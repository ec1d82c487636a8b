# SPDX-License-Identifier: MIT
"""Export: a completion as textured GLB or OBJ, PLY with provenance, E57 and JSON; whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from completion.extension.patch import Provenance
from completion.result.completed_model import CompletedModel, LabelledPoints
from completion.result.model_parts import (
    HYPOTHESISED_BLUE,
    OBSERVED_GREY,
    atlas_of,
    chart_coordinates,
    model_parts,
    remainder_mesh,
    state_mesh,
)
from completion.result.polygons import polygons_record
from completion.result.record import completion_record, provenance_word
from completion.result.verification import Verification
from scenes.checks import InputError
from scenes.formats.e57.e57_inferred import InferredPoints
from scenes.formats.e57.e57_writer import write_e57
from scenes.formats.meshes.glb import glb_of
from scenes.formats.meshes.obj_writer import write_obj
from scenes.formats.meshes.ply import write_mesh_ply
from scenes.mesh.labelled_mesh import Appearance, LabelledMesh
from scenes.pose import Pose
from scenes.run.atomic import make_folder, write_bytes, write_json
from scenes.run.lock import locked
from scenes.run.staged_outputs import Stage


def save_completion(
    completion: CompletedModel, folder: str | os.PathLike[str], verification: Verification | None = None
) -> None:
    """Write completed.glb, observed.ply, hypothesised.ply, polygons.json and completion.json to a folder.

    All appear together once all are written; until then those of an earlier run stay. With
    `verification`, completion.json also says what later scans say of what the first one alone inferred.

    Raises
    ------
    InputError
        The folder cannot be made or written, or another run writes there.
    """
    target = make_folder(folder)
    legend = [f"provenance {member.value} {provenance_word(member)}" for member in Provenance]
    world = completion.world_from_reference
    with locked(target), Stage(target) as stage:
        _write_points(stage.path("observed.ply"), completion.observed_mesh(), world, legend)
        _write_points(stage.path("hypothesised.ply"), completion.hypothesised, world, legend)
        write_bytes(stage.path("completed.glb"), completed_glb(completion))
        write_json(stage.path("polygons.json"), polygons_record(completion))
        write_json(stage.path("completion.json"), completion_record(completion, verification))
        stage.commit()


def export_completion(completion: CompletedModel, path: str | os.PathLike[str]) -> list[Path]:
    """Write the whole model to one file by suffix; return all files that were written.

    `.glb` and `.obj` (with `.mtl` and textures) are meshes whose objects are called `observed ...` and
    `hypothesised ...`. `.e57` holds the scans as they are, with their poses, and a cloud `inferred ...` for
    each surface, whose points say surface, provenance, confidence and deviation. `.json` holds the polygons.

    Raises
    ------
    InputError
        Another suffix, a folder that does not exist, or pye57 is not installed.
    """
    target = Path(path)
    suffix = target.suffix.lower()
    if suffix == ".obj":
        comments = ["unseen: objects called hypothesised were inferred, nobody measured them"]
        return write_obj(model_parts(completion), target, comments)
    if suffix == ".glb":
        write_bytes(target, completed_glb(completion))
    elif suffix == ".e57":
        world = completion.world_from_reference
        scans = [seen.scan.transformed(world) for seen in completion.observations if seen.valid.any()]
        write_e57(scans, target, inferred_points(completion))
    elif suffix == ".json":
        write_json(target, polygons_record(completion))
    else:
        raise InputError(
            f"{target}: cannot export a completion to {suffix or 'a name without suffix'}; known: .glb, "
            ".obj, .e57, .json (polygons); observed and inferred .ply are written by save"
        )
    return [target]


def inferred_points(completion: CompletedModel) -> list[InferredPoints]:
    """Return the vertices of what is inferred, surface by surface, in the world."""
    points, clouds = completion.hypothesised, []
    legend = {str(member.value): provenance_word(member) for member in Provenance}
    for number in np.unique(points.surface):
        chosen = points.surface == number
        clouds.append(
            InferredPoints(
                name=f"inferred {number} {completion.patches[number - 1].grid.surface.kind}",
                points=completion.world_from_reference.apply(points.vertices[chosen]),
                colour=points.colour[chosen],
                surface=points.surface[chosen],
                provenance=points.provenance[chosen],
                confidence=points.confidence[chosen],
                sd=points.sd[chosen],
                legend=legend,
            )
        )
    return clouds


def completed_glb(completion: CompletedModel) -> bytes:
    """The completed model as binary glTF, y up by its nodes; one node for each part of `model_parts`."""
    return glb_of(model_parts(completion))


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
    atlas = atlas_of(completion)
    for index, patch in enumerate(completion.patches):
        for state, cells in enumerate((patch.observed, patch.hypothesised)):
            if state == 1 and not hypothesised:
                continue
            mesh = state_mesh(patch, cells, is_hypothesised=state == 1)
            page = -1 if mark and state == 1 else int(atlas.page[index])
            corners.append(mesh.vertices[mesh.faces])
            tint = np.array(
                (OBSERVED_GREY, HYPOTHESISED_BLUE)[state] if page < 0 else (1.0, 1.0, 1.0), np.float32
            )
            colours.append(np.broadcast_to(tint, (len(mesh.faces), 3, 3)))
            labels.append(np.full(len(mesh.faces), state, np.int32))
            face_image.append(np.full(len(mesh.faces), page, np.int32))
            corner_uv.append(atlas.coordinates(index, chart_coordinates(mesh, patch))[mesh.faces])
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
