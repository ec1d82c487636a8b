# SPDX-License-Identifier: MIT
"""PLY meshes, written with any properties."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import ExitStack
from os import PathLike
from pathlib import Path
from shutil import copyfileobj
from tempfile import SpooledTemporaryFile
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scenes.checks import FloatArray, InputError, check_faces, check_vectors
from scenes.io.meshes.ply import CORNERS, COUNT, TYPES, PlyMesh
from scenes.run.atomic import atomic_path

_HELD = 1 << 24  # bytes of a file that are in memory at a time
_NAME_OF_TYPE = {kind: name for name, kind in reversed(TYPES.items())}  # the older name of each


def write_mesh_ply(
    path: str | PathLike[str],
    vertices: FloatArray,
    faces: NDArray[Any] | None = None,
    vertex_properties: Mapping[str, NDArray[Any]] | None = None,
    comments: Sequence[str] = (),
    *,
    face_properties: Mapping[str, NDArray[Any]] | None = None,
) -> None:
    """Write a triangle mesh, or a point cloud, as binary little-endian PLY, atomically.

    Parameters
    ----------
    path : str or path
        The file.
    vertices : (n, 3) float
        Written as double, NaN allowed.
    faces : (m, 3) int, optional
        Without it, or with none, the file is a point cloud.
    vertex_properties : dict of (n,) arrays, optional
        Written after x, y, z in their order; the type follows the array: uint8 is uchar, int32 and int64
        int, float32 float, float64 double. Colours are `red`, `green`, `blue` as uint8.
    comments : sequence of str
        One `comment` line each.
    face_properties : dict of (m,) arrays, optional
        Written after the corners; types as for vertices.

    Raises
    ------
    InputError
        Wrong shapes or types, faces out of range, a comment with a line end.
    """
    whole = PlyMesh(
        np.asarray(vertices),
        np.zeros((0, 3), np.int32) if faces is None else np.asarray(faces),
        dict(vertex_properties or {}),
        dict(face_properties or {}),
    )
    write_meshes_ply(path, [whole], comments)


def write_meshes_ply(
    path: str | PathLike[str], parts: Iterable[PlyMesh], comments: Sequence[str] = ()
) -> None:
    """Write parts as one mesh, one after the other, none of which is held longer; see `write_mesh_ply`.

    All have the same properties. Triangles of a part are numbered from its first vertex on, and may have
    corners in later parts.

    Raises
    ------
    InputError
        Wrong shapes or types, faces out of range, a comment with a line end.
    """
    target, n_points, n_faces, most = Path(path), 0, 0, -1
    dtype, face_dtype = np.dtype([]), np.dtype([])
    with atomic_path(target) as temporary, ExitStack() as stack:
        folder = temporary.parent
        tables, corners = (
            stack.enter_context(SpooledTemporaryFile(max_size=_HELD, dir=str(folder))) for _ in range(2)
        )
        for part in parts:
            table, faces = _table(part), check_faces(part.faces, np.iinfo(np.int32).max)
            if n_points and len(table) and table.dtype != dtype:
                raise InputError(f"parts of a PLY file have properties {dtype.names}, {table.dtype.names}")
            dtype = table.dtype if len(table) or not dtype.names else dtype
            most = max(most, int(faces.max(initial=-1)) + n_points)
            tables.write(table.view(np.uint8).data)
            rows = _face_table(faces + np.int32(n_points), part.face_properties)
            face_dtype = rows.dtype if len(rows) or not face_dtype.names else face_dtype
            corners.write(rows.view(np.uint8).data)
            n_points, n_faces = n_points + len(table), n_faces + len(faces)
        if most >= n_points:
            raise InputError(f"a face has the corner {most}, but there are {n_points} vertices")
        with temporary.open("wb") as file:
            file.write(_header_text(dtype, n_points, face_dtype, n_faces, comments).encode("utf-8"))
            for spooled in (tables, corners):
                spooled.seek(0)
                copyfileobj(spooled, file, _HELD)


def _table(part: PlyMesh) -> NDArray[Any]:
    """The vertices with their properties, as the file holds them."""
    points = check_vectors("vertices", part.vertices)
    columns: dict[str, NDArray[Any]] = {axis: points[:, i] for i, axis in enumerate("xyz")}
    for name, values in part.vertex_properties.items():
        columns[name] = _as_column(f"vertex property {name}", name, values, len(points))
    dtype = np.dtype([(name, column.dtype.newbyteorder("<")) for name, column in columns.items()])
    table = np.empty(len(points), dtype)
    for name, column in columns.items():
        table[name] = column
    return table


def _as_column(what: str, name: str, values: NDArray[Any], n: int) -> NDArray[Any]:
    column = np.asarray(values)
    if column.shape != (n,):
        raise InputError(f"expected {what} with shape ({n},), got {column.shape}")
    if not name.isidentifier():
        raise InputError(f"{what.removesuffix(name)}name {name!r} has characters that PLY does not allow")
    if column.dtype == np.bool_:
        return column.astype(np.uint8)
    if column.dtype.kind in "iu" and column.dtype.itemsize == 8:
        if len(column) and not -(2**31) <= int(column.min()) <= int(column.max()) < 2**31:
            raise InputError(f"{what} exceeds 32 bits, the largest integer of PLY")
        return column.astype(np.int32)
    if column.dtype.str[1:] not in _NAME_OF_TYPE:
        raise InputError(f"{what} has type {column.dtype}, which PLY does not know")
    return column


def _header_text(
    dtype: np.dtype[Any], n_points: int, face_dtype: np.dtype[Any], n_faces: int, comments: Sequence[str]
) -> str:
    lines = ["ply", "format binary_little_endian 1.0"]
    for comment in comments:
        if "\n" in comment or "\r" in comment:
            raise InputError(f"a PLY comment is one line, got {comment!r}")
        lines.append(f"comment {comment}")
    lines.append(f"element vertex {n_points}")
    lines += _property_lines(dtype, dtype.names or ())
    members = (face_dtype.names or ())[2:]
    if n_faces or members:
        lines += [f"element face {n_faces}", "property list uchar int vertex_indices"]
        lines += _property_lines(face_dtype, members)
    return "\n".join([*lines, "end_header\n"])


def _property_lines(dtype: np.dtype[Any], names: Sequence[str]) -> list[str]:
    return [f"property {_NAME_OF_TYPE[dtype[name].str[1:]]} {name}" for name in names]


def _face_table(faces: NDArray[np.int32], properties: Mapping[str, NDArray[Any]]) -> NDArray[Any]:
    columns = {
        name: _as_column(f"face property {name}", name, values, len(faces))
        for name, values in properties.items()
    }
    pairs = [(name, column.dtype.newbyteorder("<")) for name, column in columns.items()]
    table = np.empty(len(faces), dtype=[(COUNT, "u1"), (CORNERS, "<i4", (3,)), *pairs])
    table[COUNT], table[CORNERS] = 3, faces
    for name, column in columns.items():
        table[name] = column
    return table
