# SPDX-License-Identifier: MIT
"""PLY: point clouds and triangle meshes with any properties; what a header announces is checked first."""

from __future__ import annotations

from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from struct import Struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scenes.checks import FloatArray, InputError, check_faces
from scenes.io.checks.documents import as_utf8, decode_text
from scenes.io.checks.guard import check_file, guard_reading
from scenes.io.checks.limits import check_limit

TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2",
    "ushort": "u2", "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4",
    "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}  # fmt: skip
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_MAX_HEADER = 1 << 22  # bytes
_NO_HEADER = "not a PLY file: no header from 'ply' to 'end_header'"


@dataclass(slots=True)
class PlyElement:
    """An element of a PLY.

    Attributes
    ----------
    name : str
        "vertex", "face" and others.
    count : int
        Its rows.
    properties : list of (str, str, str)
        Name, type of a list's length or "", and type, as numpy calls types.
    """

    name: str
    count: int
    properties: list[tuple[str, str, str]] = field(default_factory=list)

    @property
    def lists(self) -> int:
        """How many of the properties are lists."""
        return sum(bool(length) for _, length, _ in self.properties)


def check_ply(data: bytes) -> int:
    """Return how many triangles the bytes of a PLY mesh hold, its polygons cut into fans.

    Raises InputError: no PLY; another number of rows, bytes or numbers than announced; polygons with
    different numbers of corners in a binary file.
    """
    order, elements, start = parse_header(data)
    for element in elements:
        check_limit(
            "faces" if element.name == "face" else "points", element.count, f"its {element.name} rows"
        )
    names = {element.name for element in elements}
    if "vertex" not in names:
        raise InputError("has no vertices")
    if "tristrips" in names:
        raise InputError(
            "its faces are strips of triangles (tristrips), which are not read; save it as triangles"
        )
    vertex = next(element for element in elements if element.name == "vertex")
    if not {"x", "y", "z"} <= {name for name, _, _ in vertex.properties} or vertex.lists:
        raise InputError("its vertices need x, y, z, and no lists")
    return _check_text(data[start:], elements) if order == "" else _check_binary(data, start, elements, order)


def plain_ply(data: bytes) -> bytes:
    """Return the bytes of a PLY with its header in UTF-8, its vertices without lists; as they are where so.

    Raises InputError: as `parse_header`; lists of vertices that are cut short, or, in a binary file, of
    vertices behind another element.
    """
    order, elements, start = parse_header(data)
    number = next((k for k, element in enumerate(elements) if element.name == "vertex"), None)
    head = as_utf8(data[:start])
    if b"\n" not in head:
        data = head.replace(b"\r", b"\n") + (data[start:] if order else data[start:].replace(b"\r", b"\n"))
        head = data[: len(head)]
        start = len(head)
    if number is None or not elements[number].lists:
        return data if head == data[:start] else head + data[start:]
    vertex = elements[number]
    check_limit("points", vertex.count, "its vertex rows")
    if order:
        if number:
            raise InputError("its vertices are not its first element; save it with vertices first")
        rows, end = _scalars_of_rows(data, start, vertex, order)
        return _without_lists(head) + rows + data[end:]
    lines = data[start:].decode("ascii", errors="replace").splitlines()
    first = sum(element.count for element in elements[:number])
    stretch = slice(first, first + vertex.count)
    _check_lists(vertex, lines[stretch], first)
    lines[stretch] = [_scalars_of_line(line, vertex) for line in lines[stretch]]
    return _without_lists(head) + "\n".join(lines).encode()


def _without_lists(head: bytes) -> bytes:
    """A header whose vertices have no lists."""
    kept, element = list[str](), ""
    for line in head.decode("utf-8").splitlines():
        words = line.split()
        element = words[1] if words[:1] == ["element"] else element
        if element != "vertex" or words[:2] != ["property", "list"]:
            kept.append(line)
    return "\n".join([*kept, ""]).encode()


def _scalars_of_line(line: str, element: PlyElement) -> str:
    """A checked row of text without its lists."""
    words, kept, place = line.split(), list[str](), 0
    for _, length, _ in element.properties:
        if not length:
            kept.append(words[place])
        place += 1 + (int(words[place]) if length else 0)
    return " ".join(kept)


def _scalars_of_rows(data: bytes, at: int, element: PlyElement, order: str) -> tuple[bytes, int]:
    """Binary rows without their lists, which may differ in length, and where they end."""
    steps = [
        (Struct(order + np.dtype(length).char) if length else None, np.dtype(kind).itemsize)
        for _, length, kind in element.properties
    ]
    kept = bytearray()
    for row in range(element.count):
        for length, size in steps:
            if length is None:
                kept += data[at : at + size]
                at += size
            elif at + length.size <= len(data):
                held = int(length.unpack_from(data, at)[0])
                if held < 0:
                    raise InputError(f"row {row + 1} of {element.name} has a list of {held} entries")
                at += length.size + held * size
            if at > len(data):
                raise InputError(f"truncated: {element.count:,} of {element.name} announced, {row:,} present")
    return bytes(kept), at


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
    line_end = b"\n" if b"\n" in data[:end] else b"\r"  # of Macintoshes before OS X
    start = data.find(line_end, end) + 1
    if not data.startswith(b"ply") or end < 0 or start == 0:
        raise InputError(_NO_HEADER)
    return decode_text(data[:end]).splitlines()[1:], start


def parse_header(data: bytes) -> tuple[str, list[PlyElement], int]:
    """Return the byte order ("" for text), the elements of a PLY, and where its rows begin.

    Raises InputError: no PLY, or a header with a line that is none.
    """
    lines, stop = header_lines(data)
    encoding, elements = "", []
    for line in lines:
        words = line.split()
        if words[:1] == ["format"] and len(words) > 1:
            encoding = words[1]
        elif words[:1] == ["element"]:
            if len(words) != 3 or not (words[2].isascii() and words[2].isdigit()):
                raise InputError(f"its header has the line {line.strip()[:60]!r}, which announces no element")
            elements.append(PlyElement(words[1], int(words[2])))
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


def _check_text(body: bytes, elements: list[PlyElement]) -> int:
    """Check a text file, a row a line."""
    lines = body.decode("ascii", errors="replace").rstrip().splitlines()
    announced = sum(element.count for element in elements)
    if len(lines) != announced:
        sentence = ", ".join(f"{element.count} of {element.name}" for element in elements)
        raise InputError(
            f"announces {announced} rows ({sentence}), {len(lines)} follow: is it cut, or edited?"
        )
    at = n_faces = 0
    for element in elements:
        rows = lines[at : at + element.count]
        if element.lists:
            n_faces += _check_lists(element, rows, at)
        elif rows:
            _check_numbers(element, rows, at)
        at += element.count
    return n_faces


def _check_numbers(element: PlyElement, rows: list[str], at: int) -> None:
    needed = len(element.properties)
    try:
        width = np.loadtxt(rows, ndmin=2, comments=None).shape[1]
    except ValueError as error:
        raise InputError(f"{element.name} rows cannot be read: {error}") from error
    if width != needed:
        raise InputError(f"row {at + 1} after the header has {width} numbers, a {element.name} has {needed}")


def _check_lists(element: PlyElement, rows: list[str], at: int) -> int:
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


def _triangles(element: PlyElement, corners: int, number: int) -> int:
    if element.name != "face":
        return 0
    if corners < 3:
        raise InputError(f"row {number} after the header is a face of {corners} corners; three are needed")
    return corners - 2


def _check_binary(data: bytes, start: int, elements: list[PlyElement], order: str) -> int:
    """Check a binary file, in which all lists of one property have one length."""
    n_faces, at = 0, start
    for element in elements:
        dtype, lengths = row_type(data, at, element, order)
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


def row_type(
    data: bytes, at: int, element: PlyElement, order: str
) -> tuple[np.dtype[np.void], dict[str, int]]:
    """Return the type of a binary row, and the lengths of its lists as they stand in the first one."""
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


COUNT, CORNERS = "#", "#corners"  # of a face, in tables: no property can have such a name


@dataclass(frozen=True, slots=True, eq=False)
class PlyMesh:
    """A PLY file's vertices, triangles and the rest.

    Attributes
    ----------
    vertices : (n, 3) float
        As in the file; for files of ours world coordinates in metres.
    faces : (m, 3) int32
        Empty for a point cloud.
    vertex_properties : dict of (n,) arrays
        Everything but x, y, z, by name, in the file's order.
    face_properties : dict of (m,) arrays
        Everything but the corners, by name, in the file's order.
    comments : tuple of str
        Texts of the `comment` and `obj_info` lines.
    """

    vertices: FloatArray
    faces: NDArray[np.int32]
    vertex_properties: dict[str, NDArray[Any]] = field(default_factory=dict)
    face_properties: dict[str, NDArray[Any]] = field(default_factory=dict)
    comments: tuple[str, ...] = ()


def read_mesh_ply(path: str | PathLike[str]) -> PlyMesh:
    """Read a binary little-endian PLY of points or triangles with any scalar vertex properties.

    This reads what `write_mesh_ply` writes, all properties included; foreign meshes, ASCII and big-endian
    files are opened with `scenes.io.scene_files.load_scene`.

    Raises InputError: not such a file, truncated, or faces that are no triangles.
    """
    file = check_file(Path(path))
    with guard_reading(file, "a binary PLY file"):
        return _read(file)


@dataclass(slots=True)
class _Rows:
    name: str
    count: int
    properties: list[str] = field(default_factory=list)  # names of the scalar ones
    fields: list[Any] = field(default_factory=list)  # of a row, as numpy has them


def _read(path: Path) -> PlyMesh:
    data = path.read_bytes()
    elements, comments, offset = _table_header(data)
    vertices, of_vertices, of_faces = np.zeros((0, 3)), {}, {}
    faces = np.zeros((0, 3), np.int32)
    for element in elements:
        dtype = np.dtype(element.fields)
        needed = element.count * dtype.itemsize
        if offset + needed > len(data):
            raise InputError(
                f"truncated: {element.count} of {element.name} take {needed} bytes, {len(data) - offset} left"
            )
        table = np.frombuffer(data, dtype, element.count, offset)
        offset += needed
        if element.name == "vertex":
            vertices = np.stack([table[axis].astype(np.float64) for axis in "xyz"], axis=-1)
            of_vertices = {name: table[name].copy() for name in element.properties if name not in "xyz"}
        elif element.name == "face":
            if (table[COUNT] != 3).any():
                raise InputError("has faces that are no triangles")
            faces = table[CORNERS].astype(np.int32)
            of_faces = {name: table[name].copy() for name in element.properties}
    return PlyMesh(vertices, check_faces(faces, len(vertices)), of_vertices, of_faces, comments)


def _table_header(data: bytes) -> tuple[list[_Rows], tuple[str, ...], int]:
    """Elements, comments and where the data begin."""
    lines, start = header_lines(data)
    elements: list[_Rows] = []
    comments: list[str] = []
    for line in lines:
        words = line.split()
        if line.startswith(("comment ", "obj_info ")):
            comments.append(line.split(" ", 1)[1])
        elif words[:1] == ["format"] and words[1] != "binary_little_endian":
            raise InputError(f"is in {words[1]} format; binary_little_endian was expected")
        elif words[:1] == ["element"]:
            if int(words[2]) < 0:
                raise InputError(f"announces {words[2]} of {words[1]}")
            elements.append(_Rows(words[1], int(words[2])))
        elif words[:2] == ["property", "list"]:
            count, index = _type_of(words[2]), _type_of(words[3])
            elements[-1].fields += [(COUNT, count), (CORNERS, index, (3,))]
        elif words[:1] == ["property"]:
            elements[-1].properties.append(words[2])
            elements[-1].fields.append((words[2], _type_of(words[1])))
    return elements, tuple(comments), start


def _type_of(word: str) -> str:
    """The type of a property, as numpy calls it."""
    if word not in TYPES:
        raise InputError(f"has a property of the unknown type {word[:40]!r}")
    return "<" + TYPES[word]
