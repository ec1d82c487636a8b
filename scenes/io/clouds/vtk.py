# SPDX-License-Identifier: MIT
"""VTK: the points of legacy `.vtk` files, text or binary (big-endian), with normals and colours.

Layout: VTK File Formats, "Simple Legacy Formats" (docs.vtk.org); libpointmatcher writes clouds so
(pointmatcher/IO.cpp).
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from scenes.checks import MOST_M, FloatArray, InputError
from scenes.io.checks.limits import check_limit
from scenes.io.formats.facts import FormatFacts
from scenes.io.formats.format import Format, RawPoints, one_cloud
from scenes.scan.colour import colour_bytes

_START = re.compile(
    rb"# vtk DataFile Version [^\n]*\n[^\n]*\n\s*(ASCII|BINARY)\s+DATASET\s+(\w+)", re.IGNORECASE
)
_DATASETS = ("POLYDATA", "UNSTRUCTURED_GRID", "STRUCTURED_GRID")
_POINTS = re.compile(rb"\n\s*POINTS\s+(\d+)\s+(\w+)[ \t]*\r?\n", re.IGNORECASE)
_FACES = re.compile(rb"\n\s*(?:POLYGONS|TRIANGLE_STRIPS|CELLS)\s+\d+", re.IGNORECASE)
_NEXT = re.compile(rb"[A-Z][A-Z_]{3,}")  # a keyword after numbers
_OF_POINTS = re.compile(rb"\n\s*POINT_DATA\s+(\d+)\s*?\r?\n", re.IGNORECASE)
_NORMALS = re.compile(rb"\n?\s*NORMALS\s+\S+\s+(\w+)[ \t]*\r?\n", re.IGNORECASE)
_COLOURS = re.compile(rb"\n?\s*COLOR_SCALARS\s+\S+\s+([34])[ \t]*\r?\n", re.IGNORECASE)
_TYPES = {
    "float": ">f4", "double": ">f8", "char": ">i1", "unsigned_char": ">u1", "short": ">i2",
    "unsigned_short": ">u2", "int": ">i4", "unsigned_int": ">u4", "long": ">i8", "unsigned_long": ">u8",
}  # fmt: skip


def read_vtk_points(path: Path) -> RawPoints:
    """Return the points of a file; its polygons are not read.

    Raises InputError: no legacy VTK file, a dataset without points of its own, an unknown type, or truncated.
    """
    data = path.read_bytes()
    start = _START.match(data)
    if start is None:
        raise InputError(
            "is no legacy VTK file: it does not begin with its version, ASCII or BINARY, DATASET"
        )
    is_text, dataset = start[1].upper() == b"ASCII", start[2].decode().upper()
    head = _POINTS.search(data, start.end())
    if dataset not in _DATASETS or head is None:
        raise InputError(f"holds {dataset} without points of its own; known: {', '.join(_DATASETS)}")
    n_points = int(head[1])
    check_limit("points", n_points, "its points")
    points = _numbers(data, head.end(), (n_points, 3), head[2].decode(), is_text=is_text)
    is_turned = not is_text and _are_strange(points) and not _are_strange(_turned(points, head[2].decode()))
    if is_turned:
        points = _turned(points, head[2].decode())
    normals = colour = None
    said = _OF_POINTS.search(data, head.end())
    if said is not None and int(said[1]) == n_points:
        if found := _NORMALS.search(data, said.end() - 1):
            normals = _numbers(data, found.end(), (n_points, 3), found[1].decode(), is_text=is_text)
            normals = _turned(normals, found[1].decode()) if is_turned else normals
        if found := _COLOURS.search(data, said.end() - 1):
            kind, shape = "float" if is_text else "unsigned_char", (n_points, int(found[1]))
            shade = _numbers(data, found.end(), shape, kind, is_text=is_text)[:, :3]
            colour = colour_bytes((shade if is_text else shade / 255).astype(np.float32))
    faces = _FACES.search(data, head.end())
    doubts: tuple[str, ...] = ("its polygons are not read: it is taken as points",) if faces else ()
    if is_turned:
        doubts += ("its numbers are little-endian, where legacy VTK has big-endian ones: they were read so",)
    return RawPoints(points, normals, colour=colour, warnings=doubts)


def _turned(numbers: FloatArray, kind: str) -> FloatArray:
    """Swap the bytes of numbers that were read as big-endian `kind` but are little-endian."""
    dtype = np.dtype(_TYPES[kind.lower()])
    with np.errstate(over="ignore", invalid="ignore"):
        return numbers.astype(dtype).view(dtype.newbyteorder("<")).astype(np.float64)


def _are_strange(points: FloatArray) -> bool:
    """Tell whether a tenth of the coordinates are none that anybody measures: not finite, huge or tiny."""
    size = np.abs(points)
    return bool(((size == 0) | ((size > 1e-9) & (size < MOST_M))).mean() < 0.9)


def _numbers(data: bytes, start: int, shape: tuple[int, int], kind: str, *, is_text: bool) -> FloatArray:
    """An array of the file that begins at a byte."""
    n_numbers = shape[0] * shape[1]
    if is_text:
        end = _NEXT.search(data, start)
        words = data[start : end.start() if end else len(data)].split()
        n_held = len(words)
    elif kind.lower() not in _TYPES:
        raise InputError(f"its numbers are of type {kind[:40]!r}; known: {', '.join(_TYPES)}")
    else:
        dtype = np.dtype(_TYPES[kind.lower()])
        n_held = (len(data) - start) // dtype.itemsize
    if n_held < n_numbers:
        raise InputError(f"truncated: {n_numbers} numbers announced at byte {start}, {n_held} present")
    if is_text:
        return np.array(words[:n_numbers], dtype=np.float64).reshape(shape)
    return np.frombuffer(data, dtype, n_numbers, start).astype(np.float64).reshape(shape)


FORMAT = Format(
    suffixes=(".vtk",),
    points=one_cloud(read_vtk_points),
    facts=FormatFacts(
        title="`.vtk`",
        read="points, normals and colours of legacy PolyData and UnstructuredGrid, ascii or binary",
        lost="cells and other attributes",
        poses="`--origin`",
        colours="COLOR_SCALARS",
    ),
)
