# SPDX-License-Identifier: MIT
"""PLY points: the vertices of any PLY file, ASCII or binary of either byte order, mesh or cloud."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from scenes.checks import ColourArray, FloatArray, InputError
from scenes.formats.raw_points import RawPoints

_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2",
    "ushort": "u2", "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4",
    "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}  # fmt: skip
_MAX_HEADER = 1 << 22  # bytes


@dataclass(slots=True)
class _Vertices:
    """Where the vertices stand, from the header."""

    encoding: str = ""
    n: int = -1
    names: list[str] = field(default_factory=list)
    types: list[str] = field(default_factory=list)
    lines_before: int = 0
    rows: int = 0  # of all elements


def read_ply_points(path: Path) -> RawPoints:
    """Return points, and normals and colours where the file has some.

    Raises
    ------
    InputError
        No PLY, truncated, vertices without x, y, z, or behind another element in a binary file.
    """
    data = path.read_bytes()
    end = data.find(b"end_header", 0, _MAX_HEADER)
    if not data.startswith(b"ply") or end < 0:
        raise InputError("not a PLY file: no header from 'ply' to 'end_header'")
    vertices = _parse_header(data[:end].decode("utf-8", errors="replace"))
    missing = {"x", "y", "z"} - set(vertices.names)
    if vertices.n < 0 or missing:
        raise InputError(f"its vertices have the properties {vertices.names}; x, y, z are needed")
    start = data.find(b"\n", end) + 1
    if vertices.encoding == "ascii":
        column = _read_ascii(data[start:], vertices)
    else:
        column = _read_binary(data, start, vertices)
    points = np.stack([column[axis] for axis in "xyz"], axis=-1)
    normals, colour = (
        np.stack([column[name] for name in names], axis=-1) if set(names) <= set(vertices.names) else None
        for names in (("nx", "ny", "nz"), ("red", "green", "blue"))
    )
    return RawPoints(points, normals, colour=None if colour is None else _bytes(colour, vertices))


def _bytes(colour: FloatArray, vertices: _Vertices) -> ColourArray:
    """Colours as 0..255; those of real type are 0..1."""
    is_real = vertices.types[vertices.names.index("red")].startswith("f")
    return np.asarray(np.rint(np.clip(colour * 255 if is_real else colour, 0, 255)), dtype=np.uint8)


def _parse_header(text: str) -> _Vertices:
    """Return the vertex element; what stands before it is only counted."""
    vertices, element, skipped = _Vertices(), "", 0
    for line in text.splitlines()[1:]:
        words = line.split()
        if words[:1] == ["format"]:
            vertices.encoding = words[1]
        elif words[:1] == ["element"]:
            element = words[1]
            if element == "vertex":
                vertices.n, vertices.lines_before = int(words[2]), skipped
            skipped += int(words[2])
            vertices.rows = skipped
        elif words[:1] == ["property"] and element == "vertex":
            if words[1] == "list":
                raise InputError("its vertices have a list property, which cannot be read")
            vertices.types.append(_TYPES[words[1]])
            vertices.names.append(words[2])
    if vertices.encoding not in ("ascii", "binary_little_endian", "binary_big_endian"):
        raise InputError(f"has the unknown format {vertices.encoding!r}")
    return vertices


def _read_ascii(data: bytes, vertices: _Vertices) -> dict[str, FloatArray]:
    present = data.decode("ascii", errors="replace").rstrip().splitlines()
    if len(present) != vertices.rows:
        raise InputError(
            f"truncated or edited: {vertices.rows} rows announced ({vertices.n} of vertices), "
            f"{len(present)} present"
        )
    lines = present[vertices.lines_before :][: vertices.n]
    if not lines:
        return {name: np.zeros(0) for name in vertices.names}
    table = np.loadtxt(lines, ndmin=2, usecols=range(len(vertices.names)))
    return {name: np.ascontiguousarray(table[:, k]) for k, name in enumerate(vertices.names)}


def _read_binary(data: bytes, start: int, vertices: _Vertices) -> dict[str, FloatArray]:
    if vertices.lines_before:
        raise InputError("its vertices are not its first element; save it with vertices first")
    order = "<" if vertices.encoding == "binary_little_endian" else ">"
    dtype = np.dtype(
        [(name, order + kind) for name, kind in zip(vertices.names, vertices.types, strict=True)]
    )
    if start + vertices.n * dtype.itemsize > len(data):
        raise InputError(
            f"truncated: {vertices.n} vertices take {vertices.n * dtype.itemsize} bytes, "
            f"{len(data) - start} left"
        )
    if vertices.rows == vertices.n and start + vertices.n * dtype.itemsize < len(data):
        raise InputError(f"has {len(data) - start} bytes for {vertices.n} vertices of {dtype.itemsize} bytes")
    table = np.frombuffer(data, dtype, vertices.n, start)
    return {name: table[name].astype(np.float64) for name in vertices.names}
