# SPDX-License-Identifier: MIT
"""STL: binary triangles in single precision, about an origin in the header where they are far away."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from scenes.checks import FloatArray, InputError
from scenes.io.documents import as_utf8
from scenes.io.limits import check_limit
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.mesh.mesh_parts import local_origin
from scenes.run.atomic import write_bytes

_HEADER = 80  # bytes
_CORNER = re.compile(rb"(?m)^[ \t]*vertex[ \t]+(\S+)[ \t]+(\S+)[ \t]+(\S+)[ \t\r]*$")
_TAG = b"unseen origin_m "
_TRIANGLE = np.dtype([("normal", "<f4", (3,)), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def write_stl(mesh: LabelledMesh, path: Path) -> None:
    """Write binary STL; coordinates are relative to the origin that the header names, world axes, metres.

    STL knows neither unit nor offset: other software shows a far mesh near its own origin, true to size.
    """
    origin = local_origin(mesh.vertices)
    table = np.zeros(len(mesh.faces), _TRIANGLE)
    table["normal"], table["corners"] = mesh.face_normals(), mesh.corners - origin
    words = " ".join(repr(float(value)) for value in origin).encode()
    header = (_TAG + words if origin.any() else b"unseen").ljust(_HEADER)
    write_bytes(path, header + np.uint32(len(table)).astype("<u4").tobytes() + table.tobytes())


def plain_stl(data: bytes) -> bytes:
    """Return the bytes of an STL file; text in UTF-8, binary without zeros and blanks after the triangles."""
    if _is_text(data):
        return as_utf8(data)
    end = _HEADER + 4 + _TRIANGLE.itemsize * int.from_bytes(data[80:84], "little")
    return data if data[end:].strip(b"\0 \r\n") else data[:end]


def _is_text(data: bytes) -> bool:
    start = data[:1024].lower()
    return start.lstrip()[:5] == b"solid" and b"facet" in start


def check_stl(data: bytes) -> int:
    """Return how many triangles the bytes of an STL file hold, text or binary.

    Raises InputError: a binary file that is not as long as its count of triangles says, a text that is cut
    short or has corners that are not three numbers.
    """
    if _is_text(data):
        return _check_text(data.lower())
    announced = int.from_bytes(data[80:84], "little")
    expected = _HEADER + 4 + _TRIANGLE.itemsize * announced
    if len(data) < expected or len(data) < _HEADER + 4:
        raise InputError(f"truncated STL: {announced} triangles need {expected} bytes, {len(data)} present")
    if len(data) > expected:
        raise InputError(f"damaged STL: {announced} triangles need {expected} bytes, {len(data)} present")
    check_limit("faces", announced, "its faces")
    return announced


def _check_text(text: bytes) -> int:
    begun, ended = text.count(b"outer loop"), text.count(b"endloop")
    if begun != ended or b"endsolid" not in text[-1024:]:
        raise InputError(f"truncated STL: {begun} facets begin, {ended} end, then the text stops")
    corners = _CORNER.findall(text)
    if len(corners) != 3 * begun:
        raise InputError(f"damaged STL: {begun} facets with {len(corners)} corners of three numbers")
    check_limit("faces", begun, "its faces")
    np.array(corners).astype(np.float64)  # raises where one is no number
    return begun


def stl_origin(path: Path) -> FloatArray:
    """Return the origin (3,) that the header of a file of ours names, zero in others.

    Raises InputError: a header of ours that is damaged.
    """
    with path.open("rb") as file:
        header = file.read(_HEADER)
    if not header.startswith(_TAG):
        return np.zeros(3)
    try:
        origin = np.array([float(word) for word in header[len(_TAG) :].split()])
    except ValueError:
        origin = np.zeros(0)
    if origin.shape != (3,) or not np.isfinite(origin).all():
        raise InputError(f"its header names the origin {header[len(_TAG) :].strip()!r}, which is no place")
    return origin
