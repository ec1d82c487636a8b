# SPDX-License-Identifier: MIT
"""E57 scans: structured terrestrial laser scans, read and written with pye57."""

from __future__ import annotations

import hashlib
import uuid
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from scenes.checks import FloatArray, InputError
from scenes.formats.documents import parse_json
from scenes.formats.e57.e57_inferred import INFERRED
from scenes.formats.e57.e57_structure import check_e57
from scenes.formats.guard import check_size, import_extra
from scenes.formats.header import FORMAT, checked_bytes, colour_from_bytes, described, projection_from_dict
from scenes.formats.raw_points import RawPoints
from scenes.formats.scans.grid_fit import SCANNER_FROM_SENSOR, GridFit, fit_grid, organised_scan
from scenes.formats.scans.station import scan_from_station
from scenes.pose import Pose, rotation_of
from scenes.scan.range_image import RangeImage

_CURE = (
    "it is an unstructured cloud, so which ray saw which point is lost; "
    "export the scan as structured (gridded) E57, with rowIndex and columnIndex, or say where the scanner "
    "stood (--origin X,Y,Z)"
)


def _open(path: Path) -> Any:
    """Open a file whose structure was checked."""
    module = import_extra("pye57", "e57")
    check_e57(path)
    return module.E57(str(path))


def count_e57(path: Path) -> int:
    """Return how many scans the file holds; clouds of inferred points are none."""
    with _open(path) as file:
        return len(_measured(file))


def _measured(file: Any) -> list[int]:
    """The file's own numbers, from 0, of what was measured."""
    return [k for k in range(file.scan_count) if INFERRED not in _text(file.get_header(k), "description")]


def read_e57(path: Path, index: int) -> RangeImage:
    """Return scan `index` (from 0) of an E57 file.

    Pixel (row, column) of the image is the file's own rowIndex, columnIndex, less their minima; rows may
    run upwards. Azimuths of columns and elevations of rows are estimated from the points, unless a file of
    ours states them, and the measured points are kept. A scan without a pose stands at the origin, upright.
    An unstructured scan with a pose becomes the spherical image that `scan_from_station` makes of its points.

    Raises
    ------
    InputError
        Unstructured and without a pose, damaged (checksum), or a grid that no projection explains.
    """
    with _open(path) as file:
        scans = _measured(file)
        own = scans[index]
        header = file.get_header(own)
        missing = {"rowIndex", "columnIndex"} - set(header.point_fields)
        if missing and header.has_pose():
            return _projected(path, index, _text(header, "name") or path.stem)
        if missing:
            names = " and no ".join(sorted(missing, reverse=True))
            raise InputError(f"scan {index + 1} has no {names}: {_CURE}")
        data = file.read_scan_raw(own, ignore_unsupported_fields=True)
        pose = _read_pose(header) @ SCANNER_FROM_SENSOR
        description, name = _text(header, "description"), _text(header, "name")
        several = len(scans) > 1
    local, kept = _points(data)
    points = SCANNER_FROM_SENSOR.inverse().apply(local)[kept]
    row, column = (data[key].astype(np.int64)[kept] for key in ("rowIndex", "columnIndex"))
    if not len(row):
        raise InputError(f"scan {index + 1} has no valid point")
    name = name or (f"{path.stem}#{index + 1}" if several else path.stem)
    light = None if data.get("intensity") is None else np.asarray(data["intensity"], np.float32)[kept]
    left_out = _left_out(local)
    return _grid(
        points,
        row,
        column=column,
        colours=_colours(data, kept),
        light=light,
        pose=pose,
        description=description,
        name=name,
        left_out=left_out,
    )


def _projected(path: Path, index: int, name: str) -> RangeImage:
    """An unstructured scan as the image that a scanner at its pose's place would have taken."""
    cloud = read_e57_points(path, index)
    colour = None if cloud.colour is None else colour_from_bytes(cloud.colour)
    return replace(scan_from_station(cloud.points, cloud.origins, name, colour), warnings=cloud.warnings)


def read_e57_points(path: Path, index: int) -> RawPoints:
    """Return all valid points of scan `index` (from 0) in the world, and where the scanner stood.

    Structured or not; a scan without pose and grid may have been merged from several, so that its place is
    None.
    """
    with _open(path) as file:
        own = _measured(file)[index]
        header = file.get_header(own)
        data = file.read_scan_raw(own, ignore_unsupported_fields=True)
        pose = _read_pose(header)
        is_one_scan = header.has_pose() or "rowIndex" in data
    points, kept = _points(data)
    world = pose.apply(np.asarray(points[kept], dtype=np.float64))
    colours = _colours(data, kept)
    return RawPoints(
        world,
        origins=pose.translation if is_one_scan else None,
        colour=None if colours is None else checked_bytes(np.rint(colours * 255)),
        warnings=_left_out(points),
    )


def _left_out(points: FloatArray) -> tuple[str, ...]:
    """Say how many points are not finite."""
    n_bad = int((~np.isfinite(points).all(axis=1)).sum())
    return (f"{n_bad} of {len(points)} points are not finite and were left out",) if n_bad else ()


def _grid(
    points: FloatArray,
    row: Any,
    column: Any,
    colours: Any,
    light: Any,
    pose: Pose,
    description: str,
    name: str,
    left_out: tuple[str, ...],
) -> RangeImage:
    """Sort points into their pixels and find the projection; of several returns the first is kept."""
    ours = _ours(description)
    fit = None
    if ours is None:
        row, column = row - row.min(), column - column.min()
        rows, columns = int(row.max()) + 1, int(column.max()) + 1
    else:
        fit = GridFit(projection_from_dict(ours["projection"]), 0.0)
        rows, columns = fit.projection.shape
    check_size(rows, columns)
    if rows * columns > 1000 * len(points) + 1_000_000:
        raise InputError(f"{len(points)} points in a grid of {rows} x {columns}: are its indices damaged?")
    image = np.full((rows, columns, 3), np.nan)
    image[row[::-1], column[::-1]] = points[::-1]
    channels: list[Any] = [None, None]
    for k, (values, shape) in enumerate(((colours, (rows, columns, 3)), (light, (rows, columns)))):
        if values is not None:
            channels[k] = np.zeros(shape, np.float32)
            channels[k][row[::-1], column[::-1]] = values[::-1]
    scan = organised_scan(
        image,
        fit or fit_grid(image),
        world_from_sensor=pose,
        colour=channels[0],
        name=name,
        intensity=channels[1],
    )
    n_more = len(points) - int(np.isfinite(image).all(axis=-1).sum())
    several = (f"{n_more} further returns of pixels with several were left out",) if n_more else ()
    return replace(described(scan, ours), warnings=(*left_out, *several))


def _ours(description: str) -> dict[str, Any] | None:
    """Return the header that `write_e57` put into the description, None for foreign files."""
    if FORMAT not in description:
        return None
    return parse_json(description, dict)


def _text(header: Any, field: str) -> str:
    return str(header[field].value()) if field in header.scan_fields else ""


def _read_pose(header: Any) -> Pose:
    """World from scanner; identity where the file has none."""
    if not header.has_pose():
        return Pose.identity()
    node = header["pose"]
    rotation, translation = np.eye(3), np.zeros(3)
    if node.isDefined("rotation"):
        quaternion = np.array([node["rotation"][part].value() for part in "xyzw"], dtype=np.float64)
        rotation = rotation_of(quaternion, "its pose")
    if node.isDefined("translation"):
        translation = np.array([node["translation"][part].value() for part in "xyz"], dtype=np.float64)
    return Pose.from_parts(rotation, translation)


def _points(data: dict[str, Any]) -> tuple[FloatArray, Any]:
    """Points (n, 3) in the scanner's frame, and which of them are valid."""
    if "cartesianX" in data:
        points = np.stack([data[f"cartesian{axis}"] for axis in "XYZ"], axis=-1)
        state = data.get("cartesianInvalidState")
    elif "sphericalRange" in data:
        reach, azimuth, elevation = (data[f"spherical{part}"] for part in ("Range", "Azimuth", "Elevation"))
        across = reach * np.cos(elevation)
        points = np.stack(
            [across * np.cos(azimuth), across * np.sin(azimuth), reach * np.sin(elevation)], axis=-1
        )
        state = data.get("sphericalInvalidState")
    else:
        raise InputError("has neither cartesian nor spherical coordinates")
    kept = np.isfinite(points).all(axis=1) & (points != 0).any(axis=1)
    return points, kept if state is None else kept & (state == 0)


def _colours(data: dict[str, Any], kept: Any) -> Any:
    names = [f"color{name}" for name in ("Red", "Green", "Blue")]
    if any(data.get(name) is None for name in names):
        return None
    return colour_from_bytes(np.stack([data[name][kept] for name in names], axis=-1))


def content_guid(*parts: bytes) -> str:
    """Return an E57 guid that depends on the content alone, so that the same scan gives the same bytes."""
    return "{" + str(uuid.UUID(bytes=hashlib.sha256(b"".join(parts)).digest()[:16])) + "}"
