# SPDX-License-Identifier: MIT
"""PLY: organised scans with grid, pose and projection in comment lines, and the vertices of any file."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from scenes.checks import ColourArray, FloatArray, InputError
from scenes.io.format import Format, RawPoints, check_single, one_scan, points_of, write_single
from scenes.io.header import (
    checked_bytes,
    from_comments,
    projection_from_dict,
    scan_from_header,
    scan_header,
    to_comments,
)
from scenes.io.ply import TYPES, header_lines, read_mesh_ply, write_mesh_ply
from scenes.scan.colour import colour_bytes
from scenes.scan.range_image import RangeImage, without_saturated

_SENSOR_AXES = ("sensor_x", "sensor_y", "sensor_z")


def write_scan_ply(scan: RangeImage, path: Path) -> None:
    """Write `scan` as a point cloud that any PLY viewer shows in world coordinates.

    One vertex a pixel, row by row, NaN where nothing came back; properties x y z (double, world, metres),
    red green blue, intensity, range (double), and sensor_x sensor_y sensor_z where measured points lie off
    the ideal rays. Comment lines keep the rest, so that `read_scan_ply` returns the same scan.
    """
    properties: dict[str, Any] = {}
    if scan.colour is not None:
        channels = colour_bytes(scan.colour).reshape(-1, 3).T
        properties |= dict(zip(("red", "green", "blue"), channels, strict=True))
    if scan.intensity is not None:
        properties["intensity"] = scan.intensity.ravel()
    properties["range"] = np.where(scan.valid, scan.ranges, np.nan).ravel()
    if scan.sensor_points is not None:
        properties |= dict(zip(_SENSOR_AXES, scan.points_in_sensor().reshape(-1, 3).T, strict=True))
    write_mesh_ply(path, scan.points().reshape(-1, 3), None, properties, to_comments(scan_header(scan)))


def is_scan_ply(path: Path) -> bool:
    """Tell whether a PLY file keeps a scan's grid and pose in its comments."""
    with path.open("rb") as file:
        return b"comment unseen " in file.read(4096)


def read_scan_ply(path: Path) -> RangeImage:
    """Return the scan that `write_scan_ply` wrote.

    Raises InputError: any other PLY file: it does not say where the sensor stood.
    """
    cure = (
        "; a scan needs its grid and sensor pose: use .e57, .pcd (organised), .npz or an RGB-D folder, or "
        "say where the scanner stood (unseen complete --origin X,Y,Z)"
    )
    if not is_scan_ply(path):
        raise InputError("is a PLY without sensor position and pixel grid" + cure)
    cloud = read_mesh_ply(path)
    header = from_comments(cloud.comments)
    if header is None or "range" not in cloud.vertex_properties:
        raise InputError("is a PLY without sensor position and pixel grid" + cure)
    values = cloud.vertex_properties
    rows, columns = projection_from_dict(header["projection"]).shape
    if len(cloud.vertices) != rows * columns:
        raise InputError(f"holds {len(cloud.vertices)} points, its comments describe {rows} x {columns}")
    colour = sensor_points = None
    if "red" in values:
        channels = np.stack([values[name] for name in ("red", "green", "blue")], axis=-1)
        colour = checked_bytes(channels).reshape(rows, columns, 3)
    if _SENSOR_AXES[0] in values:
        sensor_points = np.stack([values[name] for name in _SENSOR_AXES], axis=-1).reshape(rows, columns, 3)
    ranges = values["range"].reshape(rows, columns)
    light = values["intensity"].reshape(rows, columns) if "intensity" in values else None
    return scan_from_header(header, ranges, colour=colour, sensor_points=sensor_points, intensity=light)


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
    """Return points, and normals, colours and labels (property `label`) where the file has some.

    Raises InputError: no PLY, truncated, vertices without x, y, z, or behind another element in a binary
    file.
    """
    data = path.read_bytes()
    lines, start = header_lines(data)
    vertices = _parse_header(lines)
    missing = {"x", "y", "z"} - set(vertices.names)
    if vertices.n < 0 or missing:
        raise InputError(f"its vertices have the properties {vertices.names}; x, y, z are needed")
    if vertices.encoding == "ascii":
        column = _read_ascii(data[start:], vertices)
    else:
        column = _read_binary(data, start, vertices)
    points = np.stack([column[axis] for axis in "xyz"], axis=-1)
    normals, colour = (
        np.stack([column[name] for name in names], axis=-1) if set(names) <= set(vertices.names) else None
        for names in (("nx", "ny", "nz"), ("red", "green", "blue"))
    )
    painted = None if colour is None else _bytes(colour, vertices)
    return RawPoints(points, normals, colour=painted, label=column.get("label"))


def _bytes(colour: FloatArray, vertices: _Vertices) -> ColourArray:
    """Colours as 0..255; those of real type are 0..1."""
    is_real = vertices.types[vertices.names.index("red")].startswith("f")
    return np.asarray(np.rint(np.clip(colour * 255 if is_real else colour, 0, 255)), dtype=np.uint8)


def _parse_header(lines: list[str]) -> _Vertices:
    """Return the vertex element; what stands before it is only counted."""
    vertices, element, skipped = _Vertices(), "", 0
    for line in lines:
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
            vertices.types.append(TYPES[words[1]])
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


def _points(path: Path, number: int | None) -> RawPoints:
    check_single(number)
    return points_of([without_saturated(read_scan_ply(path))]) if is_scan_ply(path) else read_ply_points(path)


FORMAT = Format(
    suffixes=(".ply",), points=_points, scans=one_scan(read_scan_ply), write=write_single(write_scan_ply)
)
