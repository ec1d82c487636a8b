# SPDX-License-Identifier: MIT
"""Structure of glTF: what its JSON says of buffers, arrays and nodes, held against the bytes that are there.

A decoder that believes these numbers makes room for what is not there, follows nodes in a circle, or places
one mesh a million times; the specification's own rules (glTF 2.0, sections 3.5 to 3.7) are checked first.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from scenes.checks import InputError
from scenes.formats.image import check_image
from scenes.formats.meshes.gltf import Content, data_bytes, entry_list, entry_number, placed_meshes
from scenes.run.file_limits import check_limit, check_unpacked

_TYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
_TRIANGLES, _STRIP, _FAN = 4, 5, 6
_HARMLESS = ("KHR_materials_", "KHR_lights_", "KHR_texture_", "EXT_texture_webp", "KHR_mesh_quantization")


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
    views = [_view(entry, k, buffers) for k, entry in enumerate(entry_list(content, "bufferViews"))]
    arrays = [_Array(entry, k, views) for k, entry in enumerate(entry_list(content, "accessors"))]
    held = sum(len(buffer) for buffer in buffers)
    check_unpacked(sum(array.n_bytes for array in arrays), held, "its accessors")
    for array in arrays:
        array.check()
    faces, points = _meshes(content, arrays)
    placed = placed_meshes(content, len(faces))
    check_limit("points", sum(times * points[k] for k, times in placed.items()), "its vertices as placed")
    n_faces = sum(times * faces[k] for k, times in placed.items())
    check_limit("faces", n_faces, "its faces as placed")
    return Contents(n_faces, sum(_embedded(content, views)))


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


class _Array:
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

    @property
    def n_bytes(self) -> int:
        """What it unpacks to."""
        return self.count * self.width * self.dtype.itemsize

    def check(self) -> None:
        """Raise where it ends beyond its view."""
        own = self.width * self.dtype.itemsize
        end = self._start + max(self.count - 1, 0) * self._stride + own * (self.count > 0)
        if end > len(self._bytes) or self._stride < own:
            raise InputError(
                f"{self.what} of {self.count:,} entries ends at byte {end:,} of {len(self._bytes):,}"
            )

    def indices(self) -> np.ndarray[Any, Any]:
        """Its numbers, as corners of faces."""
        packed = np.frombuffer(self._bytes, np.uint8)[self._start :]
        rows = np.lib.stride_tricks.as_strided(packed, (self.count, self.dtype.itemsize), (self._stride, 1))
        return np.ascontiguousarray(rows).view(self.dtype).reshape(-1)


def _meshes(content: Content, arrays: Sequence[_Array]) -> tuple[list[int], list[int]]:
    """Faces and vertices of each mesh."""
    faces, points = [], []
    for number, mesh in enumerate(entry_list(content, "meshes")):
        what = f"mesh {number}"
        if not isinstance(mesh, dict) or not isinstance(mesh.get("primitives"), list):
            raise InputError(f"{what} has no list of primitives")
        held = [_primitive(one, f"{what}, primitive {k}", arrays) for k, one in enumerate(mesh["primitives"])]
        faces.append(sum(one[0] for one in held))
        points.append(sum(one[1] for one in held))
    return faces, points


def _primitive(entry: Any, what: str, arrays: Sequence[_Array]) -> tuple[int, int]:
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


def _check_corners(array: _Array, n_points: int, what: str) -> int:
    corners = array.indices()
    bad = np.flatnonzero(corners >= n_points)
    if len(bad):
        raise InputError(
            f"{what}: face {bad[0] // 3} names vertex {corners[bad[0]]}, but there are {n_points} vertices "
            f"({len(np.unique(bad // 3))} such faces)"
        )
    return array.count


def _embedded(content: Content, views: Sequence[tuple[memoryview, int]]) -> list[int]:
    """Pixels of the images that are within the file."""
    found = []
    for number, image in enumerate(entry_list(content, "images")):
        what = f"image {number}"
        uri = image.get("uri")
        if isinstance(uri, str) and uri.startswith("data:"):
            found.append(_pixels(lambda text=uri: data_bytes(text), what))  # type: ignore[misc]  # defaults have no type
        elif "bufferView" in image:
            view = views[entry_number(image, "bufferView", what, most=len(views))][0]
            found.append(_pixels(lambda held=view: bytes(held), what))  # type: ignore[misc]  # defaults have no type
    return found


def _pixels(data: Callable[[], bytes], what: str) -> int:
    try:
        return check_image(data())
    except InputError as error:
        raise InputError(f"{what} {error}") from error
