# SPDX-License-Identifier: MIT
"""glTF: JSON and buffers of a .gltf or .glb file within its folder, entries of the JSON, and its nodes."""

from __future__ import annotations

import base64
import binascii
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from scenes.checks import InputError
from scenes.formats.documents import parse_json
from scenes.formats.guard import check_file
from scenes.formats.references import within_folder
from scenes.run.file_limits import check_limit

_JSON, _BINARY = 0x4E4F534A, 0x004E4942  # what a chunk of a GLB holds
Content = Mapping[str, Any]
_DEEPEST = 256  # nodes within each other: a drawing program's own limit lies below
_PARTS = {"matrix": 16, "translation": 3, "rotation": 4, "scale": 3}


@dataclass(frozen=True, slots=True, eq=False)
class Gltf:
    """A file's JSON and its buffers' bytes."""

    content: dict[str, Any]
    buffers: tuple[memoryview, ...]


def read_gltf(file: Path) -> Gltf:
    """Return what a glTF file holds, not yet checked beyond its lengths.

    Raises InputError: truncated, not JSON, or a buffer that is missing, shorter than announced or outside the
    folder.
    """
    data = memoryview(file.read_bytes())
    binary: memoryview | None = None
    if file.suffix.lower() == ".glb":
        data, binary = _chunks(data)
    content = parse_json(bytes(data), dict)
    entries = content.get("buffers", [])
    if not isinstance(entries, list):
        raise InputError("its buffers are no list")
    return Gltf(content, tuple(_buffer(entry, k, file, binary) for k, entry in enumerate(entries)))


def _chunks(data: memoryview) -> tuple[memoryview, memoryview | None]:
    """JSON and binary chunk of a GLB."""
    if len(data) < 20 or bytes(data[:4]) != b"glTF":
        raise InputError("not a GLB file: it does not begin with glTF and a header")
    _, version, length = struct.unpack_from("<4sII", data)
    if version != 2:
        raise InputError(f"is GLB of version {version}; 2 is known")
    if length != len(data):
        raise InputError(f"truncated or damaged GLB: {length:,} bytes announced, {len(data):,} present")
    found: dict[int, memoryview] = {}
    at = 12
    while at + 8 <= length:
        size, kind = struct.unpack_from("<II", data, at)
        if at + 8 + size > length:
            raise InputError(
                f"truncated or damaged GLB: a chunk of {size:,} bytes at byte {at} of {length:,}"
            )
        found.setdefault(kind, data[at + 8 : at + 8 + size])
        at += 8 + size
    if _JSON not in found:
        raise InputError("is a GLB file without JSON")
    return found[_JSON], found.get(_BINARY)


def _buffer(entry: Any, number: int, file: Path, binary: memoryview | None) -> memoryview:
    length = entry.get("byteLength") if isinstance(entry, dict) else None
    if isinstance(length, bool) or not isinstance(length, int) or length < 0:
        raise InputError(f"buffer {number} has the byteLength {length!r}")
    uri = entry.get("uri")
    if uri is None:
        if number or binary is None:
            raise InputError(f"buffer {number} has no bytes: no uri, and no binary part")
        held = binary
    elif not isinstance(uri, str):
        raise InputError(f"buffer {number} has a uri that is no text")
    elif uri.startswith("data:"):
        held = memoryview(data_bytes(uri))
    else:
        path = within_folder(file.parent, uri)
        if not path.is_file():
            raise InputError(f"its buffer {uri!r} is missing; put it beside the file")
        held = memoryview(check_file(path).read_bytes())
    if length > len(held):
        raise InputError(f"buffer {number} is cut short: {length:,} bytes announced, {len(held):,} present")
    return held[:length]


def data_bytes(text: str) -> bytes:
    """Return the bytes of a `data:` address.

    Raises InputError: not in base 64.
    """
    head, _, body = text.partition(",")
    if not head.endswith(";base64"):
        raise InputError("holds a data: address that is not in base 64")
    try:
        return base64.b64decode(body, validate=True)
    except binascii.Error as error:
        raise InputError(f"holds a data: address that is damaged: {error}") from error


def placed_meshes(content: Content, n_meshes: int) -> dict[int, int]:
    """Return how often each of `n_meshes` meshes is placed in the scene that is shown.

    Raises InputError: a node that hangs on two others or in a circle, too deep, moved by what are no numbers,
    or with a mesh that is not there.
    """
    nodes, scenes = entry_list(content, "nodes"), entry_list(content, "scenes")
    if not scenes:
        return {}
    shown = scenes[entry_number(content, "scene", "it", 0, most=len(scenes))]
    times: dict[int, int] = {}
    seen: set[int] = set()
    level, depth = _numbers(shown, "nodes", "its scene", len(nodes)), 0
    while level:
        depth += 1
        if depth > _DEEPEST:
            raise InputError(f"its nodes lie within each other more than {_DEEPEST} deep")
        below: list[int] = []
        for number in level:
            if number in seen:
                raise InputError(f"node {number} hangs on two others, or in a circle")
            seen.add(number)
            _check_node(nodes[number], number)
            below += _numbers(nodes[number], "children", f"node {number}", len(nodes))
            if "mesh" in nodes[number]:
                mesh = entry_number(nodes[number], "mesh", f"node {number}", most=n_meshes)
                times[mesh] = times.get(mesh, 0) + 1
        level = below
    return times


def _numbers(entry: Any, name: str, what: str, most: int) -> list[int]:
    held = entry.get(name, []) if isinstance(entry, dict) else None
    if not isinstance(held, list):
        raise InputError(f"{what} has no list of {name}")
    return [entry_number({name: one}, name, what, most=most) for one in held]


def _check_node(node: Any, number: int) -> None:
    """Raise where what moves a node is no list of numbers of the right length."""
    if not isinstance(node, dict):
        raise InputError(f"node {number} is no object")
    for name, length in _PARTS.items():
        values = node.get(name, [0.0] * length)
        if not isinstance(values, list) or len(values) != length or not all(map(_is_number, values)):
            raise InputError(f"node {number} has a {name} that is not {length} numbers")


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def entry_list(content: Content, name: str) -> list[Any]:
    """Return a list of the JSON, empty where it has none; InputError for other things and long lists."""
    held = content.get(name, [])
    if not isinstance(held, list):
        raise InputError(f"its {name} are no list")
    check_limit("entries", len(held), f"its {name}")
    return held


def entry_number(
    entry: Any, name: str, what: str, default: int | None = None, most: int | None = None
) -> int:
    """Return an integer entry of 0 or more, and below `most` where that is given."""
    if not isinstance(entry, dict):
        raise InputError(f"{what} is no object")
    value = entry.get(name, default)
    if isinstance(value, bool) or not isinstance(value, int) or value < 0:
        raise InputError(f"{what} has the {name} {value!r}; an integer of 0 or more is needed")
    if most is not None and value >= most:
        raise InputError(f"{what} names {name} {value}, but there are {most}")
    return value
