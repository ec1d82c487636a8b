# SPDX-License-Identifier: MIT
"""Scene saving: meshes as GLB, OBJ + MTL, PLY, STL and OFF, exact at any distance from the origin."""

from __future__ import annotations

import json
import os
import struct
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from PIL import Image
from trimesh.visual.material import PBRMaterial
from trimesh.visual.texture import TextureVisuals

from scenes.appearance import linear_from_srgb
from scenes.atomic import write_bytes
from scenes.checks import ColourArray, FloatArray, InputError
from scenes.formats.obj_writer import write_obj
from scenes.formats.off import write_off
from scenes.formats.ply import write_mesh_ply
from scenes.formats.stl import write_stl
from scenes.local_frame import local_origin
from scenes.mesh import LabelledMesh
from scenes.mesh_parts import MeshPart, parts_of
from scenes.scene import Scene

_Y_UP = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])  # z up to glTF's y up


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


def glb_of(parts: Sequence[MeshPart]) -> bytes:
    """Return parts as binary glTF, a node for each, y up and moved to its place by the node's transform."""
    if not any(len(part.faces) for part in parts):
        return empty_glb()
    scene = trimesh.Scene(base_frame="world")
    transform = node_transform(np.vstack([part.vertices for part in parts]))
    origin = (np.linalg.inv(_Y_UP) @ transform)[:3, 3]
    pages: dict[int, tuple[str, Image.Image]] = {}
    for part in parts:
        mesh = trimesh.Trimesh(part.vertices - origin, part.faces, process=False)
        if part.image is not None:
            if id(part.image) not in pages:
                pages[id(part.image)] = f"texture {len(pages) + 1}", Image.fromarray(part.image)
            mesh.visual = TextureVisuals(uv=part.uv, material=_material(part, *pages[id(part.image)]))
        elif part.colour is not None:
            mesh.visual.vertex_colors = part.colour
        scene.add_geometry(mesh, node_name=part.name, geom_name=part.name, transform=transform)
    data: bytes = scene.export(file_type="glb")
    return data


def node_transform(vertices: FloatArray) -> FloatArray:
    """Return the (4, 4) transform to glTF's y up of vertices written less `local_origin(vertices)`."""
    placed = np.eye(4)
    placed[:3, 3] = local_origin(vertices)
    transform: FloatArray = _Y_UP @ placed
    return transform


def empty_glb() -> bytes:
    """A binary glTF with a scene in which nothing stands (trimesh writes none)."""
    text = json.dumps({"asset": {"version": "2.0"}, "scene": 0, "scenes": [{}]}).encode()
    text += b" " * (-len(text) % 4)
    chunk = struct.pack("<I4s", len(text), b"JSON") + text
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunk)) + chunk


def _material(part: MeshPart, name: str, page: Image.Image) -> PBRMaterial:
    """A texture with its mean tint, which glTF holds in linear light; parts that look alike share it."""
    tint = np.full(3, 1.0) if part.colour is None else linear_from_srgb(part.colour.mean(axis=0) / 255)
    factor = None if (tint > 0.999).all() else [*(round(float(c) * 255) for c in tint), 255]
    return PBRMaterial(
        name=name,
        baseColorTexture=page,
        baseColorFactor=factor,
        metallicFactor=0.0,
        roughnessFactor=1.0,
        doubleSided=True,
    )


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
