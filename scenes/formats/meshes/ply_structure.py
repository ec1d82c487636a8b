# SPDX-License-Identifier: MIT
"""Structure of PLY meshes: what the header announces, held against the rows that follow."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from scenes.checks import InputError
from scenes.run.file_limits import check_limit

TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2",
    "ushort": "u2", "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4",
    "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}  # fmt: skip
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_MAX_HEADER = 1 << 22  # bytes
_NO_HEADER = "not a PLY file: no header from 'ply' to 'end_header'"


@dataclass(slots=True)
class _Element:
    """An element: its rows, and its properties as (name, type of a list's length or "", type)."""

    name: str
    count: int
    properties: list[tuple[str, str, str]] = field(default_factory=list)

    @property
    def lists(self) -> int:
        return sum(bool(length) for _, length, _ in self.properties)


def check_ply(data: bytes) -> int:
    """Return how many triangles the bytes of a PLY mesh hold, its polygons cut into fans.

    Raises InputError: no PLY; another number of rows, bytes or numbers than announced; polygons with
    different numbers of corners in a binary file.
    """
    order, elements, start = _parse_header(data)
    for element in elements:
        check_limit(
            "faces" if element.name == "face" else "points", element.count, f"its {element.name} rows"
        )
    names = {element.name for element in elements}
    if "vertex" not in names:
        raise InputError("has no vertices")
    vertex = next(element for element in elements if element.name == "vertex")
    if not {"x", "y", "z"} <= {name for name, _, _ in vertex.properties} or vertex.lists:
        raise InputError("its vertices need x, y, z, and no lists")
    return _check_text(data[start:], elements) if order == "" else _check_binary(data, start, elements, order)


def has_faces(path: Path) -> bool:
    """Tell whether a file is PLY whose header announces faces; organised scans and clouds have none."""
    try:
        with path.open("rb") as file:
            lines, _ = header_lines(file.read(_MAX_HEADER))
    except (OSError, InputError):
        return False
    rows = [line.split() for line in lines if line.startswith("element")]
    return any(row[1:2] == ["face"] and row[2:3] not in ([], ["0"]) for row in rows)


def header_lines(data: bytes) -> tuple[list[str], int]:
    """Return a PLY's header lines but the first, and where rows begin.

    Raises InputError: there is no header, or no line end after it.
    """
    end = data.find(b"end_header", 0, _MAX_HEADER)
    start = data.find(b"\n", end) + 1
    if not data.startswith(b"ply") or end < 0 or start == 0:
        raise InputError(_NO_HEADER)
    return data[:end].decode("utf-8", errors="replace").splitlines()[1:], start


def _parse_header(data: bytes) -> tuple[str, list[_Element], int]:
    lines, stop = header_lines(data)
    encoding, elements = "", []
    for line in lines:
        words = line.split()
        if words[:1] == ["format"] and len(words) > 1:
            encoding = words[1]
        elif words[:1] == ["element"]:
            if len(words) != 3 or not (words[2].isascii() and words[2].isdigit()):
                raise InputError(f"its header has the line {line.strip()[:60]!r}, which announces no element")
            elements.append(_Element(words[1], int(words[2])))
        elif words[:1] == ["property"]:
            if not elements:
                raise InputError(f"its header has the line {line.strip()[:60]!r} before any element")
            elements[-1].properties.append(_property(words, line))
    if encoding not in _ORDERS:
        raise InputError(f"has the unknown format {encoding[:40]!r}; known: {', '.join(_ORDERS)}")
    return _ORDERS[encoding], elements, stop


def _property(words: list[str], line: str) -> tuple[str, str, str]:
    if len(words) == 5 and words[1] == "list" and {words[2], words[3]} <= TYPES.keys():
        return words[4], TYPES[words[2]], TYPES[words[3]]
    if len(words) == 3 and words[1] in TYPES:
        return words[2], "", TYPES[words[1]]
    raise InputError(f"its header has the line {line.strip()[:60]!r}, which is no property")


def _check_text(body: bytes, elements: list[_Element]) -> int:
    """Check a text file, a row a line."""
    lines = body.decode("ascii", errors="replace").rstrip().splitlines()
    announced = sum(element.count for element in elements)
    if len(lines) != announced:
        said = ", ".join(f"{element.count} of {element.name}" for element in elements)
        raise InputError(f"announces {announced} rows ({said}), {len(lines)} follow: is it cut, or edited?")
    at = n_faces = 0
    for element in elements:
        rows = lines[at : at + element.count]
        if element.lists:
            n_faces += _check_lists(element, rows, at)
        elif rows:
            _check_numbers(element, rows, at)
        at += element.count
    return n_faces


def _check_numbers(element: _Element, rows: list[str], at: int) -> None:
    needed = len(element.properties)
    try:
        width = np.loadtxt(rows, ndmin=2, comments=None).shape[1]
    except ValueError as error:
        raise InputError(f"{element.name} rows cannot be read: {error}") from error
    if width != needed:
        raise InputError(f"row {at + 1} after the header has {width} numbers, a {element.name} has {needed}")


def _check_lists(element: _Element, rows: list[str], at: int) -> int:
    """Check rows with lists, and return the triangles where they are faces."""
    n_faces = 0
    for number, row in enumerate(rows, start=at + 1):
        words, place, corners = row.split(), 0, 0
        try:
            for name, length, _ in element.properties:
                held = int(words[place]) if length else 1
                if held < 0 or place + held + bool(length) > len(words):
                    raise IndexError
                if length and name.startswith("vertex_ind"):
                    corners = held
                    list(map(int, words[place + 1 : place + 1 + held]))
                place += held + bool(length)
        except (ValueError, IndexError) as error:
            raise InputError(f"row {number} after the header, {row[:60]!r}, is no {element.name}") from error
        if place != len(words):
            raise InputError(
                f"row {number} after the header has {len(words)} numbers, {place} were announced"
            )
        n_faces += _triangles(element, corners, number)
    return n_faces


def _triangles(element: _Element, corners: int, number: int) -> int:
    if element.name != "face":
        return 0
    if corners < 3:
        raise InputError(f"row {number} after the header is a face of {corners} corners; three are needed")
    return corners - 2


def _check_binary(data: bytes, start: int, elements: list[_Element], order: str) -> int:
    """Check a binary file, in which all lists of one property have one length."""
    n_faces, at = 0, start
    for element in elements:
        dtype, lengths = _row(data, at, element, order)
        end = at + element.count * dtype.itemsize
        if end > len(data):
            raise InputError(
                f"truncated: {element.count:,} of {element.name} take {end - at:,} bytes, "
                f"{len(data) - at:,} present"
            )
        rows = np.frombuffer(data, dtype, element.count, at)
        for name, length in lengths.items():
            if (rows[f"{name} length"] != length).any():
                raise InputError(
                    f"its {element.name} rows have lists of different lengths (polygons of different numbers "
                    "of corners), or it is damaged; save it with triangles alone, or as text"
                )
            if name.startswith("vertex_ind") and element.count:
                n_faces += element.count * _triangles(element, length, 1)
        at = end
    if at != len(data):
        raise InputError(f"has {len(data) - at:,} bytes more than it announces: is its header damaged?")
    return n_faces


def _row(data: bytes, at: int, element: _Element, order: str) -> tuple[np.dtype[np.void], dict[str, int]]:
    """The type of a row, the lengths of its lists as they stand in the first one."""
    fields: list[tuple[str, str] | tuple[str, str, tuple[int, ...]]] = []
    lengths: dict[str, int] = {}
    for name, length, kind in element.properties:
        if length:
            place = at + np.dtype(fields).itemsize
            end = place + np.dtype(length).itemsize
            held = np.frombuffer(data[place:end], order + length)
            lengths[name] = int(held[0]) if len(held) and element.count else 0
            if not 0 <= lengths[name] <= len(data):
                raise InputError(f"its first {element.name} has a list of {lengths[name]} entries")
            fields += [(f"{name} length", order + length), (name, order + kind, (lengths[name],))]
        else:
            fields.append((name, order + kind))
    try:
        return np.dtype(fields), lengths
    except ValueError as error:
        raise InputError(f"its {element.name} rows cannot be laid out: {error}") from error
