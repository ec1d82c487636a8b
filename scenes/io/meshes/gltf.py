# SPDX-License-Identifier: MIT
"""glTF: read within its folder and checked against its bytes.

Structure of glTF: what its JSON says of buffers, arrays and nodes, held against the bytes that are there.
A decoder that believes these numbers makes room for what is not there, follows nodes in a circle, or places
one mesh a million times; the specification's own rules (glTF 2.0, sections 3.5 to 3.7) are checked first.
"""

from __future__ import annotations

import base64
import binascii
import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from scenes.checks import InputError
from scenes.io.checks.documents import parse_json, within_folder
from scenes.io.checks.guard import check_file
from scenes.io.checks.image import check_image
from scenes.io.checks.limits import check_limit, check_unpacked

JSON_CHUNK, BINARY_CHUNK = 0x4E4F534A, 0x004E4942  # what a chunk of a GLB holds
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
    chunks: dict[int, memoryview] = {}
    at = 12
    while at + 8 <= length:
        size, kind = struct.unpack_from("<II", data, at)
        if at + 8 + size > length:
            raise InputError(
                f"truncated or damaged GLB: a chunk of {size:,} bytes at byte {at} of {length:,}"
            )
        chunks.setdefault(kind, data[at + 8 : at + 8 + size])
        at += 8 + size
    if JSON_CHUNK not in chunks:
        raise InputError("is a GLB file without JSON")
    return chunks[JSON_CHUNK], chunks.get(BINARY_CHUNK)


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
                raise InputError(f"node {number} has two parents, or is its own ancestor")
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
    return [entry_number({name: number}, name, what, most=most) for number in held]


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


_TYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
_TRIANGLES, _STRIP, _FAN = 4, 5, 6
INSTANCING = "EXT_mesh_gpu_instancing"
_HARMLESS = (
    "KHR_materials_",
    "KHR_lights_",
    "KHR_texture_",
    "EXT_texture_webp",
    "KHR_mesh_quantization",
    INSTANCING,
)


@dataclass(frozen=True, slots=True)
class Contents:
    """What a mesh file holds when all goes well: faces as they are placed, and pixels of textures in it."""

    faces: int
    texels: int = 0


def check_gltf(content: Content, buffers: Sequence[memoryview]) -> Contents:
    """Check a glTF's JSON against the bytes of its buffers.

    Raises InputError: another version, a required extension that is not known, a number that lies, a face
    with a corner that is not there, nodes in a circle or in two places, or more than the limits allow.
    """
    _check_version(content)
    views, arrays = accessors_of(content, buffers)
    held = sum(len(buffer) for buffer in buffers)
    check_unpacked(sum(array.n_bytes for array in arrays), held, "its accessors")
    for array in arrays:
        array.check()
    faces, points = _meshes(content, arrays)
    placed = placed_meshes(content, len(faces))
    check_limit("points", sum(times * points[k] for k, times in placed.items()), "its vertices as placed")
    n_faces = sum(times * faces[k] for k, times in placed.items())
    check_limit("faces", n_faces, "its faces as placed")
    return Contents(n_faces, sum(_embedded_images(content, views)))


def accessors_of(
    content: Content, buffers: Sequence[memoryview]
) -> tuple[list[tuple[memoryview, int]], list[Accessor]]:
    """Buffer views with their strides, and accessors."""
    views = [_view(entry, k, buffers) for k, entry in enumerate(entry_list(content, "bufferViews"))]
    return views, [Accessor(entry, k, views) for k, entry in enumerate(entry_list(content, "accessors"))]


def _check_version(content: Content) -> None:
    version = content.get("asset", {}).get("version") if isinstance(content.get("asset"), dict) else None
    if not isinstance(version, str) or not version.startswith("2."):
        raise InputError(f"is glTF of version {version!r}; 2.0 is known")
    for name in entry_list(content, "extensionsRequired"):
        if not str(name).startswith(_HARMLESS):
            raise InputError(f"needs the extension {str(name)[:60]}, which is not known; save it without")


def _view(entry: Any, number: int, buffers: Sequence[memoryview]) -> tuple[memoryview, int]:
    """Bytes of a buffer view, and its stride, 0 where it has none."""
    what = f"bufferView {number}"
    buffer = buffers[entry_number(entry, "buffer", what, most=len(buffers))]
    start, length = entry_number(entry, "byteOffset", what, 0), entry_number(entry, "byteLength", what)
    if start + length > len(buffer):
        raise InputError(f"{what} ends at byte {start + length}, its buffer has {len(buffer)}")
    return buffer[start : start + length], entry_number(entry, "byteStride", what, 0)


class Accessor:
    """An accessor: an array within a buffer view."""

    def __init__(self, entry: Any, number: int, views: Sequence[tuple[memoryview, int]]) -> None:
        self.what = f"accessor {number}"
        self.count = entry_number(entry, "count", self.what)
        if entry.get("type") not in _WIDTHS or entry.get("componentType") not in _TYPES:
            kind = f"{entry.get('componentType')!r} {entry.get('type')!r}"
            raise InputError(f"{self.what} has the unknown type {kind}")
        if "sparse" in entry or "bufferView" not in entry:
            cause = "is sparse" if "sparse" in entry else "has no bytes (no bufferView)"
            raise InputError(f"{self.what} {cause}, which is not known; save it without")
        self.width, self.dtype = _WIDTHS[entry["type"]], np.dtype(_TYPES[entry["componentType"]])
        self._bytes, stride = views[entry_number(entry, "bufferView", self.what, most=len(views))]
        self._start = entry_number(entry, "byteOffset", self.what, 0)
        self._stride = stride or self.width * self.dtype.itemsize
        self.is_normalised = entry.get("normalized") is True and self.dtype.kind != "f"

    @property
    def n_bytes(self) -> int:
        """What it unpacks to."""
        return self.count * self.width * self.dtype.itemsize

    def check(self) -> None:
        """Raise where it ends beyond its view."""
        number = self.width * self.dtype.itemsize
        end = self._start + max(self.count - 1, 0) * self._stride + number * (self.count > 0)
        if end > len(self._bytes) or self._stride < number:
            raise InputError(
                f"{self.what} of {self.count:,} entries ends at byte {end:,} of {len(self._bytes):,}"
            )

    def numbers(self) -> np.ndarray[Any, Any]:
        """Its numbers (count, width) as they are stored."""
        packed = np.frombuffer(self._bytes, np.uint8)[self._start :]
        n_bytes = self.width * self.dtype.itemsize
        rows = np.lib.stride_tricks.as_strided(packed, (self.count, n_bytes), (self._stride, 1))
        return np.ascontiguousarray(rows).view(self.dtype).reshape(self.count, self.width)

    def values(self) -> np.ndarray[Any, Any]:
        """Its values (count, width): normalised integers are fractions (glTF 2.0, section 3.11)."""
        numbers = self.numbers()
        if not self.is_normalised:
            return numbers
        return np.maximum(numbers.astype(np.float64) / np.iinfo(self.dtype).max, -1.0)


def _meshes(content: Content, arrays: Sequence[Accessor]) -> tuple[list[int], list[int]]:
    """Faces and vertices of each mesh."""
    faces, points = [], []
    for number, mesh in enumerate(entry_list(content, "meshes")):
        what = f"mesh {number}"
        if not isinstance(mesh, dict) or not isinstance(mesh.get("primitives"), list):
            raise InputError(f"{what} has no list of primitives")
        held = [
            _primitive(primitive, f"{what}, primitive {k}", arrays)
            for k, primitive in enumerate(mesh["primitives"])
        ]
        faces.append(sum(numbers[0] for numbers in held))
        points.append(sum(numbers[1] for numbers in held))
    return faces, points


def _primitive(entry: Any, what: str, arrays: Sequence[Accessor]) -> tuple[int, int]:
    """Faces and vertices of one primitive."""
    attributes = entry.get("attributes") if isinstance(entry, dict) else None
    if not isinstance(attributes, dict):
        raise InputError(f"{what} has no attributes")
    named = {name: arrays[entry_number(attributes, name, what, most=len(arrays))] for name in attributes}
    if "POSITION" not in named or named["POSITION"].width != 3:
        raise InputError(f"{what} has no POSITION of three coordinates")
    n_points, mode = named["POSITION"].count, entry_number(entry, "mode", what, _TRIANGLES)
    for name, array in named.items():
        if array.count != n_points:
            raise InputError(f"{what} has {n_points} positions and {array.count} of {name}")
    if mode == _FAN:
        raise InputError(f"{what} is a fan of triangles, which is not known; save it as plain triangles")
    n_corners = n_points
    if "indices" in entry:
        array = arrays[entry_number(entry, "indices", what, most=len(arrays))]
        if array.width != 1 or array.dtype.kind != "u":
            raise InputError(f"{what} has indices that are no list of unsigned integers")
        n_corners = _check_corners(array, n_points, what)
    if mode not in (_TRIANGLES, _STRIP):
        return 0, n_points
    if mode == _TRIANGLES and n_corners % 3:
        raise InputError(f"{what} has {n_corners} corners, which make no whole number of triangles")
    return (n_corners // 3 if mode == _TRIANGLES else max(n_corners - 2, 0)), n_points


def _check_corners(array: Accessor, n_points: int, what: str) -> int:
    corners = array.numbers().reshape(-1)
    bad = np.flatnonzero(corners >= n_points)
    if len(bad):
        raise InputError(
            f"{what}: face {bad[0] // 3} names vertex {corners[bad[0]]}, but there are {n_points} vertices "
            f"({len(np.unique(bad // 3))} such faces)"
        )
    return array.count


def _embedded_images(content: Content, views: Sequence[tuple[memoryview, int]]) -> list[int]:
    """Pixels of the images that are within the file."""
    numbers = []
    for number, image in enumerate(entry_list(content, "images")):
        what = f"image {number}"
        uri = image.get("uri")
        if isinstance(uri, str) and uri.startswith("data:"):
            numbers.append(_pixels(lambda text=uri: data_bytes(text), what))  # type: ignore[misc]  # defaults have no type
        elif "bufferView" in image:
            view = views[entry_number(image, "bufferView", what, most=len(views))][0]
            numbers.append(_pixels(lambda held=view: bytes(held), what))  # type: ignore[misc]  # defaults have no type
    return numbers


def _pixels(data: Callable[[], bytes], what: str) -> int:
    try:
        return check_image(data())
    except InputError as error:
        raise InputError(f"{what} {error}") from error
