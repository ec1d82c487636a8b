# SPDX-License-Identifier: MIT
"""STL: binary triangles in single precision, about an origin in the header where they are far away."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from scenes.atomic import write_bytes
from scenes.checks import FloatArray, InputError
from scenes.local_frame import local_origin
from scenes.mesh import LabelledMesh

_HEADER = 80  # bytes
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


def stl_origin(path: Path) -> FloatArray:
    """Return the origin (3,) that the header of a file of ours names, zero in others.

    Raises
    ------
    InputError
        A header of ours that is damaged.
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
