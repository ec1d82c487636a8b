# SPDX-License-Identifier: MIT
"""GLB, written y up."""

from __future__ import annotations

import json
import struct
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from PIL import Image

from scenes.checks import FloatArray
from scenes.io.meshes.gltf import BINARY_CHUNK, JSON_CHUNK, Content
from scenes.mesh.appearance import linear_from_srgb
from scenes.mesh.mesh_parts import MeshPart, local_origin
from scenes.pose import Pose

if TYPE_CHECKING:
    from trimesh import Scene as TrimeshScene
    from trimesh import Trimesh

_Y_UP = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])  # z up to glTF's y up


def glb_of(parts: Sequence[MeshPart], z_up: Pose | None = None) -> bytes:
    """Return parts as binary glTF, a node for each, y up and moved to its place by the node's transform.

    `z_up` turns their coordinates to z up. Parts that name a block of space hang from the node of that block.
    """
    if not any(len(part.faces) for part in parts):
        return empty_glb()
    import trimesh  # slow to load: only where a mesh is written

    scene = trimesh.Scene(base_frame="world")
    origin = local_origin(np.vstack([part.vertices for part in parts]))
    transform = _Y_UP @ (np.eye(4) if z_up is None else z_up.matrix) @ _moved_by(origin)
    for block in dict.fromkeys(part.block for part in parts if part.block):
        scene.graph.update(frame_to=block, frame_from="world", matrix=np.eye(4))
    pages: dict[int, tuple[str, Image.Image]] = {}
    for part in parts:
        scene.add_geometry(
            _mesh_of(part, origin, pages),
            node_name=part.name,
            geom_name=part.name,
            parent_node_name=part.block or None,
            transform=transform,
        )
    data: bytes = scene.export(file_type="glb")
    return data


def scene_of_parts(parts: Sequence[MeshPart]) -> TrimeshScene:
    """Return the parts as a `trimesh.Scene` in the world, each a geometry of its name."""
    import trimesh  # slow to load

    scene, pages = trimesh.Scene(base_frame="world"), dict[int, tuple[str, Image.Image]]()
    for part in parts:
        scene.add_geometry(_mesh_of(part, np.zeros(3), pages), node_name=part.name, geom_name=part.name)
    return scene


def _mesh_of(part: MeshPart, origin: FloatArray, pages: dict[int, tuple[str, Image.Image]]) -> Trimesh:
    """A part from an origin (3,), with its colours or a page; pages are named as they come."""
    import trimesh

    mesh = trimesh.Trimesh(part.vertices - origin, part.faces, process=False)
    if part.image is not None:
        if id(part.image) not in pages:
            pages[id(part.image)] = f"texture {len(pages) + 1}", Image.fromarray(part.image)
        material = _material(part, *pages[id(part.image)])
        mesh.visual = trimesh.visual.TextureVisuals(uv=part.uv, material=material)
    elif part.colour is not None:
        mesh.visual.vertex_colors = part.colour
    return mesh


def _moved_by(shift: FloatArray) -> FloatArray:
    placed = np.eye(4)
    placed[:3, 3] = shift
    return placed


def empty_glb() -> bytes:
    """A binary glTF with a scene in which nothing stands (trimesh writes none)."""
    return glb_bytes({"asset": {"version": "2.0"}, "scene": 0, "scenes": [{}]})


def glb_bytes(content: Content, binary: bytes | bytearray = b"") -> bytes:
    """The file of a JSON and the bytes of its one buffer."""
    text = json.dumps(content).encode()
    chunks = b""
    for kind, held, fill in ((JSON_CHUNK, text, b" "), (BINARY_CHUNK, binary, b"\0")):
        if held:
            padded = held + fill * (-len(held) % 4)
            chunks += struct.pack("<II", len(padded), kind) + padded
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def _material(part: MeshPart, name: str, page: Image.Image) -> Any:
    """A texture with its mean tint, which glTF holds in linear light; parts that look alike share it."""
    tint = np.full(3, 1.0) if part.colour is None else linear_from_srgb(part.colour.mean(axis=0) / 255)
    factor = None if (tint > 0.999).all() else [*(round(float(c) * 255) for c in tint), 255]
    from trimesh.visual.material import PBRMaterial  # slow to load: only where a mesh is written

    return PBRMaterial(
        name=name,
        baseColorTexture=page,
        baseColorFactor=factor,
        metallicFactor=0.0,
        roughnessFactor=1.0,
        doubleSided=True,
    )
