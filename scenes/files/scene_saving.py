# SPDX-License-Identifier: MIT
"""Scene saving: meshes as GLB, OBJ + MTL, PLY, STL and OFF, exact at any distance from the origin."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from scenes.checks import ColourArray, FloatArray, InputError
from scenes.formats.meshes.glb import glb_of
from scenes.formats.meshes.obj_writer import write_obj
from scenes.formats.meshes.off import write_off
from scenes.formats.meshes.ply import write_mesh_ply
from scenes.formats.meshes.stl import write_stl
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.mesh.mesh_parts import parts_of
from scenes.run.atomic import write_bytes
from scenes.world.scene import Scene


def save_scene(scene: Scene, path: str | os.PathLike[str]) -> list[Path]:
    """Write a scene by suffix, atomically; return the files that were written.

    `.glb` is y up by its nodes' transforms, as glTF asks (read it with `up="y"`), textured, a node a surface.
    `.obj` has an object a surface, materials and textures beside it. `.ply` and `.off` hold colours at the
    vertices, textures sampled there. `.stl` holds the geometry alone. All but GLB and STL are in double
    precision; these two are in single precision about an origin near the geometry (`local_origin`).

    Raises
    ------
    InputError
        Another suffix, or a folder that does not exist.
    """
    target = Path(path)
    mesh, names = scene.mesh, scene.surface_names
    writers: dict[str, Callable[[], list[Path] | None]] = {
        ".glb": lambda: write_bytes(target, glb_of(parts_of(mesh, names))),
        ".obj": lambda: write_obj(parts_of(mesh, names), target),
        ".ply": lambda: _write_ply(mesh, names, target),
        ".stl": lambda: write_stl(mesh, target),
        ".off": lambda: write_off(target, *_painted(mesh)),
    }
    writer = writers.get(target.suffix.lower())
    if writer is None:
        suffix = target.suffix or "a name without suffix"
        raise InputError(f"{target}: cannot write scenes to {suffix}; known: {', '.join(writers)}")
    return writer() or [target]


def _painted(mesh: LabelledMesh) -> tuple[FloatArray, Any, ColourArray | None]:
    """Vertices, faces and colours (n, 3) at the vertices; corners that differ in colour are parted."""
    if mesh.appearance is None:
        return mesh.vertices, mesh.faces, None
    faces = np.repeat(np.arange(len(mesh.faces), dtype=np.int32), 3)
    looked_up = mesh.appearance.colour(faces, np.tile(np.eye(3), (len(mesh.faces), 1)))
    colour = np.rint(looked_up * 255).clip(0, 255).astype(np.uint8)
    corner = mesh.faces.ravel()
    key = np.column_stack([corner, colour]).astype(np.int64)
    _, first, index = np.unique(key, axis=0, return_index=True, return_inverse=True)
    return mesh.vertices[corner[first]], index.reshape(-1, 3), colour[first]


def _write_ply(mesh: LabelledMesh, names: Sequence[str], path: Path) -> None:
    """PLY in double precision; the surfaces' names are in comments."""
    vertices, faces, colour = _painted(mesh)
    properties = {} if colour is None else dict(zip(("red", "green", "blue"), colour.T, strict=True))
    lines = [f"surface {number} {' '.join(name.split())}" for number, name in enumerate(names)]
    write_mesh_ply(path, vertices, faces, properties, lines)
