# SPDX-License-Identifier: MIT
"""Export: a completion as textured GLB or OBJ, PLY with provenance, E57 and JSON; whole or not at all."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from completion.result.completed_model import CompletedModel
from completion.result.labelled_points import PROVENANCE_NAMES, LabelledPoints
from completion.result.model_parts import inferred_points, model_parts
from completion.result.polygons import polygons_record
from completion.result.record import completion_record
from completion.result.verification import Verification
from scenes.checks import InputError
from scenes.formats.e57.e57_writer import write_e57
from scenes.formats.meshes.glb import glb_of
from scenes.formats.meshes.obj_writer import write_obj
from scenes.formats.meshes.ply import write_mesh_ply
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
    meshes = {"observed": completion.derived.observed, "hypothesised": completion.hypothesised}
    vertices = {name: completion.world_from_reference.apply(mesh.vertices) for name, mesh in meshes.items()}
    model, polygons = glb_of(model_parts(completion)), polygons_record(completion)
    record = completion_record(completion, verification)
    legend = [f"provenance {number} {name}" for number, name in PROVENANCE_NAMES.items()]
    target = make_folder(folder)
    with locked(target), Stage(target) as stage:
        for name, mesh in meshes.items():
            path = stage.path(f"{name}.ply")
            write_mesh_ply(path, vertices[name], mesh.faces, _properties(mesh), legend)
        write_bytes(stage.path("completed.glb"), model)
        write_json(stage.path("polygons.json"), polygons)
        write_json(stage.path("completion.json"), record)
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
        write_bytes(target, glb_of(model_parts(completion)))
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


def _properties(points: LabelledPoints) -> dict[str, NDArray[Any]]:
    """What the PLY files tell of each vertex."""
    return {
        "red": points.colour[:, 0],
        "green": points.colour[:, 1],
        "blue": points.colour[:, 2],
        "surface": points.surface,
        "provenance": points.provenance,
        "sd": points.sd.astype(np.float32),
        "confidence": points.confidence.astype(np.float32),
    }
