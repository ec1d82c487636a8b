# SPDX-License-Identifier: MIT
"""glTF: the JSON and the buffers of a .gltf or .glb file, as far as they are there and within its folder."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from scenes.checks import InputError
from scenes.formats.documents import parse_json
from scenes.formats.guard import check_file
from scenes.formats.meshes.gltf_structure import data_bytes
from scenes.formats.references import within_folder

_JSON, _BINARY = 0x4E4F534A, 0x004E4942  # what a chunk of a GLB holds


@dataclass(frozen=True, slots=True, eq=False)
class Gltf:
    """A file's JSON and its buffers' bytes."""

    content: dict[str, Any]
    buffers: tuple[memoryview, ...]


def read_gltf(file: Path) -> Gltf:
    """Return what a glTF file holds, not yet checked beyond its lengths.

    Raises
    ------
    InputError
        Truncated, not JSON, or a buffer that is missing, shorter than announced or outside the folder.
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
