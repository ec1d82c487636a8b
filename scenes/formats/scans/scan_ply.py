# SPDX-License-Identifier: MIT
"""Organised PLY scans: world points row by row, with the grid, pose and projection in comment lines."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from scenes.checks import InputError
from scenes.formats.header import (
    colour_bytes,
    colour_from_bytes,
    from_comments,
    projection_from_dict,
    scan_from_header,
    scan_header,
    to_comments,
)
from scenes.formats.meshes.ply import read_mesh_ply, write_mesh_ply
from scenes.scan.range_image import RangeImage

_SENSOR_AXES = ("sensor_x", "sensor_y", "sensor_z")


def write_scan_ply(scan: RangeImage, path: Path) -> None:
    """Write `scan` as a point cloud that any PLY viewer shows in world coordinates.

    One vertex a pixel, row by row, NaN where nothing came back; properties x y z (double, world, metres),
    red green blue, intensity, range (double), and sensor_x sensor_y sensor_z where measured points lie off
    the ideal rays. Comment lines keep the rest, so that `read_scan_ply` returns the same scan.
    """
    properties: dict[str, Any] = {}
    colour = colour_bytes(scan)
    if colour is not None:
        channels = colour.reshape(-1, 3).T
        properties |= dict(zip(("red", "green", "blue"), channels, strict=True))
    if scan.intensity is not None:
        properties["intensity"] = scan.intensity.ravel()
    properties["range"] = np.where(scan.valid, scan.ranges, np.nan).ravel()
    if scan.sensor_points is not None:
        properties |= dict(zip(_SENSOR_AXES, scan.sensor_points.reshape(-1, 3).T, strict=True))
    write_mesh_ply(path, scan.points().reshape(-1, 3), None, properties, to_comments(scan_header(scan)))


def is_scan_ply(path: Path) -> bool:
    """Tell whether a PLY file keeps a scan's grid and pose in its comments."""
    with path.open("rb") as file:
        return b"comment unseen " in file.read(4096)


def read_scan_ply(path: Path) -> RangeImage:
    """Return the scan that `write_scan_ply` wrote.

    Raises
    ------
    InputError
        Any other PLY file: it does not say where the sensor stood.
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
        colour = colour_from_bytes(channels).reshape(rows, columns, 3)
    if _SENSOR_AXES[0] in values:
        sensor_points = np.stack([values[name] for name in _SENSOR_AXES], axis=-1).reshape(rows, columns, 3)
    ranges = values["range"].reshape(rows, columns)
    light = values["intensity"].reshape(rows, columns) if "intensity" in values else None
    return scan_from_header(header, ranges, colour=colour, sensor_points=sensor_points, intensity=light)
