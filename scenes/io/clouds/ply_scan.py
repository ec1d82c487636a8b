# SPDX-License-Identifier: MIT
"""PLY: organised scans with grid, pose and projection in comment lines, and the vertices of any file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from scenes.checks import FloatArray, InputError
from scenes.io.formats.columns import AXES, COLOURS, NORMALS, columns_of, times_among, unit_of_comment
from scenes.io.formats.facts import FormatFacts
from scenes.io.formats.format import Format, RawPoints, check_single, one_scan, points_of, write_single
from scenes.io.formats.header import (
    checked_bytes,
    from_comments,
    projection_from_dict,
    scan_from_header,
    scan_header,
    to_comments,
)
from scenes.io.meshes.ply import PlyElement, header_lines, parse_header, plain_ply, read_mesh_ply
from scenes.io.meshes.ply_writer import write_mesh_ply
from scenes.scan.colour import colour_bytes, scaled_bytes
from scenes.scan.range_image import RangeImage, without_saturated

_SENSOR_AXES = ("sensor_x", "sensor_y", "sensor_z")
_SPLAT, _SPLAT_STEP = ("f_dc_0", "f_dc_1", "f_dc_2"), 0.5 / np.sqrt(np.pi)  # spherical harmonic of degree 0
_SPLATS = (
    "its points are the centres of Gaussians of a splat model: fitted to images, not measured, and in the "
    "unit of that model"
)


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
        "say where the scanner stood (--origin X,Y,Z)"
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


def read_ply_points(path: Path) -> RawPoints:
    """Return points, and normals, colours, labels (property `label`) and times where the file has some.

    Lists of vertices are skipped. Models of 3-D Gaussian splatting give their centres, in the colour of
    degree 0 of their spherical harmonics (Kerbl et al., 3D Gaussian splatting, 2023).

    Raises InputError: no PLY, truncated, vertices without x, y, z, or behind
    another element in a binary file.
    """
    data = plain_ply(path.read_bytes())
    order, elements, start = parse_header(data)
    names = [element.name for element in elements]
    vertex = elements[names.index("vertex")] if "vertex" in names else PlyElement("vertex", 0)
    types = {name: kind for name, _, kind in vertex.properties}
    held = {role: list(types)[k] for role, k in columns_of(list(types)).items()}
    if "x" not in held:
        raise InputError(f"its vertices have the properties {list(types)}; x, y, z are needed")
    column = _read_binary(data, start, elements, order) if order else _read_text(data[start:], elements)
    points = np.stack([column[held[axis]] for axis in AXES], axis=-1)
    normals = np.stack([column[held[axis]] for axis in NORMALS], axis=-1) if "nx" in held else None
    colour, warnings = None, tuple[str, ...]()
    if "red" in held:
        channels = np.stack([column[held[name]] for name in COLOURS], axis=-1)
        colour = scaled_bytes(channels if types[held["red"]].startswith("f") else channels.astype(np.int32))
    elif types.keys() >= set(_SPLAT):
        colour = colour_bytes(0.5 + _SPLAT_STEP * np.stack([column[name] for name in _SPLAT], axis=-1))
        warnings = (_SPLATS,)
    label, times = column.get(held.get("label", "")), times_among(column)
    unit = unit_of_comment("\n".join(line for line in header_lines(data)[0] if line.startswith("comment")))
    return RawPoints(points, normals, colour=colour, label=label, warnings=warnings, times=times, unit=unit)


def _read_text(data: bytes, elements: Sequence[PlyElement]) -> dict[str, FloatArray]:
    """Columns of the vertices by name."""
    present, announced = data.decode("ascii", errors="replace").rstrip().splitlines(), 0
    lines, vertex = list[str](), elements[0]
    for element in elements:
        if element.name == "vertex":
            lines, vertex = present[announced:][: element.count], element
        announced += element.count
    if len(present) != announced:
        raise InputError(
            f"truncated or edited: {announced} rows announced ({vertex.count} of vertices), "
            f"{len(present)} present"
        )
    names = [name for name, _, _ in vertex.properties]
    if not lines:
        return {name: np.zeros(0) for name in names}
    table = np.loadtxt(lines, ndmin=2, usecols=range(len(names)))
    return {name: np.ascontiguousarray(table[:, k]) for k, name in enumerate(names)}


def _read_binary(
    data: bytes, start: int, elements: Sequence[PlyElement], order: str
) -> dict[str, FloatArray]:
    """Columns of the vertices by name."""
    vertex = elements[0]
    if vertex.name != "vertex":
        raise InputError("its vertices are not its first element; save it with vertices first")
    dtype = np.dtype([(name, order + kind) for name, _, kind in vertex.properties])
    needed, held = vertex.count * dtype.itemsize, len(data) - start
    if needed > held:
        raise InputError(f"truncated: {vertex.count} vertices take {needed} bytes, {held} left")
    if not any(element.count for element in elements[1:]) and needed < held:
        raise InputError(f"has {held} bytes for {vertex.count} vertices of {dtype.itemsize} bytes")
    table = np.frombuffer(data, dtype, vertex.count, start)
    return {name: table[name].astype(np.float64) for name in dtype.names or ()}


def _points(path: Path, number: int | None) -> RawPoints:
    check_single(number)
    return points_of([without_saturated(read_scan_ply(path))]) if is_scan_ply(path) else read_ply_points(path)


FORMAT = Format(
    suffixes=(".ply",),
    points=_points,
    scans=one_scan(read_scan_ply),
    write=write_single(write_scan_ply),
    facts=FormatFacts(
        title="`.ply` of points",
        read=(
            "scans of ours; vertices of any other file as points: coordinates, normals, colours, times "
            "(`time`, `gps_time`), `label`, also of splat models (their centres, with a warning)"
        ),
        lost="other properties, lists of vertices, vertices behind other elements of binary files",
        written="scans, exactly, row by row in world coordinates",
        poses="in files of ours; `--origin`, `--trajectory`",
        units="comments such as `units: mm`, else `--units`",
        colours="bytes, 16 bits, or 0 to 1; red, r or diffuse_red and so on",
    ),
)
