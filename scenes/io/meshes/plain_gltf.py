# SPDX-License-Identifier: MIT
"""Plain glTF: fractions and instances written out, for decoders that know neither."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from scenes.checks import InputError
from scenes.io.checks.limits import check_limit
from scenes.io.meshes.glb_writer import glb_bytes
from scenes.io.meshes.gltf import INSTANCING, Accessor, Gltf, accessors_of, entry_list, entry_number

_TRANSFORMS = {"TRANSLATION": 3, "ROTATION": 4, "SCALE": 3}  # of an instance, as of a node


def plain_glb(gltf: Gltf) -> tuple[Gltf, bytes] | None:
    """Return a checked glTF without normalised attributes and instances, and as GLB; None if it has neither.

    Normalised integers become single precision, except for colours in bytes, which decoders know. A node with
    `EXT_mesh_gpu_instancing` gets a child node for each instance.

    Raises InputError: instances whose transforms differ in number, or are not of 3, 4 and 3 numbers.
    """
    _, arrays = accessors_of(gltf.content, gltf.buffers)
    added = bytearray()  # one more buffer
    content = dict(gltf.content)
    for name in ("bufferViews", "accessors"):
        content[name] = list(entry_list(content, name))
    content["meshes"] = _with_fractions(content, arrays, added, len(gltf.buffers))
    content["nodes"] = _with_instances(entry_list(content, "nodes"), arrays)
    if not added and len(content["nodes"]) == len(entry_list(gltf.content, "nodes")):
        return None
    data = bytearray()
    starts = [_append(data, buffer) for buffer in (*gltf.buffers, memoryview(added))]
    content["bufferViews"] = [
        {**view, "buffer": 0, "byteOffset": view.get("byteOffset", 0) + starts[view["buffer"]]}
        for view in content["bufferViews"]
    ]
    content["buffers"] = [{"byteLength": len(data)}]
    return Gltf(content, (memoryview(data),)), glb_bytes(content, data)


def _append(data: bytearray, more: memoryview | bytes) -> int:
    """Append bytes at a multiple of four; return where they begin."""
    data += bytes(-len(data) % 4)
    start = len(data)
    data += more
    return start


def _with_fractions(
    content: dict[str, Any], arrays: Sequence[Accessor], added: bytearray, buffer: int
) -> list[Any]:
    """The meshes, whose normalised attributes are new accessors of single precision in `added`."""
    new: dict[int, int] = {}

    def number_of(name: str, number: int) -> int:
        array = arrays[number]
        if not array.is_normalised or (name.startswith("COLOR_") and array.dtype == np.uint8):
            return number
        if number not in new:
            packed = array.values().astype("<f4").tobytes()
            view = {"buffer": buffer, "byteOffset": _append(added, packed), "byteLength": len(packed)}
            entry = {"bufferView": len(content["bufferViews"]), "componentType": 5126, "count": array.count}
            new[number] = len(content["accessors"])
            content["bufferViews"].append(view)
            content["accessors"].append(entry | {"type": content["accessors"][number]["type"]})
        return new[number]

    def primitive_of(primitive: dict[str, Any]) -> dict[str, Any]:
        attributes = {name: number_of(name, number) for name, number in primitive["attributes"].items()}
        return {**primitive, "attributes": attributes}

    return [
        {**mesh, "primitives": [primitive_of(primitive) for primitive in mesh["primitives"]]}
        for mesh in entry_list(content, "meshes")
    ]


def _with_instances(nodes: Sequence[dict[str, Any]], arrays: Sequence[Accessor]) -> list[Any]:
    """The nodes, those of instanced meshes with a child for each instance."""
    plain = list(nodes)
    for number, node in enumerate(nodes):
        extensions = node.get("extensions")
        instancing = extensions.get(INSTANCING) if isinstance(extensions, dict) else None
        if instancing is None or "mesh" not in node:
            continue
        places = _instances(instancing, f"node {number}", arrays)
        n_before = len(plain)
        check_limit("entries", n_before + len(places), "its nodes and instances")
        plain += [{"mesh": node["mesh"], **place} for place in places]
        children = [*node.get("children", []), *range(n_before, len(plain))]
        kept = {key: value for key, value in node.items() if key not in ("mesh", "extensions")}
        plain[number] = {**kept, "children": children}
    return plain


def _instances(entry: Any, what: str, arrays: Sequence[Accessor]) -> list[dict[str, Any]]:
    """Translation, rotation and scale of each instance, as nodes name them."""
    attributes = entry.get("attributes") if isinstance(entry, dict) else None
    if not isinstance(attributes, dict) or not attributes:
        raise InputError(f"{what} has instances without attributes; save the file without {INSTANCING}")
    named = {name: arrays[entry_number(attributes, name, what, most=len(arrays))] for name in attributes}
    if len({array.count for array in named.values()}) > 1:
        counts = ", ".join(f"{array.count} of {name}" for name, array in named.items())
        raise InputError(f"{what} has instances of different number: {counts}; save it again")
    known = {name: named[name] for name in _TRANSFORMS if name in named}
    for name, array in known.items():
        if array.width != _TRANSFORMS[name]:
            raise InputError(
                f"{what} has instances with {array.width} numbers of {name}; {_TRANSFORMS[name]} are needed"
            )
    columns = {name.lower(): array.values().tolist() for name, array in known.items()}
    n_instances = next(iter(named.values())).count
    return [{name: rows[k] for name, rows in columns.items()} for k in range(n_instances)]


_Y_UP = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])  # z up to glTF's y up
