# SPDX-License-Identifier: MIT
"""GLB writer: parts of a mesh as binary glTF, y up and moved to their place by the nodes' transforms."""

from __future__ import annotations

import json
import struct
from collections.abc import Sequence
from typing import Any

import numpy as np
from PIL import Image

from scenes.checks import FloatArray
from scenes.mesh.appearance import linear_from_srgb
from scenes.mesh.mesh_parts import MeshPart, local_origin

_Y_UP = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])  # z up to glTF's y up


def glb_of(parts: Sequence[MeshPart]) -> bytes:
    """Return parts as binary glTF, a node for each, y up and moved to its place by the node's transform.

    Parts that name a block of space hang from the node of that block.
    """
    if not any(len(part.faces) for part in parts):
        return empty_glb()
    import trimesh  # slow to load: only where a mesh is written

    scene = trimesh.Scene(base_frame="world")
    transform = node_transform(np.vstack([part.vertices for part in parts]))
    origin = (np.linalg.inv(_Y_UP) @ transform)[:3, 3]
    for block in dict.fromkeys(part.block for part in parts if part.block):
        scene.graph.update(frame_to=block, frame_from="world", matrix=np.eye(4))
    pages: dict[int, tuple[str, Image.Image]] = {}
    for part in parts:
        mesh = trimesh.Trimesh(part.vertices - origin, part.faces, process=False)
        if part.image is not None:
            if id(part.image) not in pages:
                pages[id(part.image)] = f"texture {len(pages) + 1}", Image.fromarray(part.image)
            material = _material(part, *pages[id(part.image)])
            mesh.visual = trimesh.visual.TextureVisuals(uv=part.uv, material=material)
        elif part.colour is not None:
            mesh.visual.vertex_colors = part.colour
        scene.add_geometry(
            mesh,
            node_name=part.name,
            geom_name=part.name,
            parent_node_name=part.block or None,
            transform=transform,
        )
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
