# SPDX-License-Identifier: MIT
"""E57 scans: structured terrestrial laser scans, read and written with pye57."""

from __future__ import annotations

import hashlib
import uuid
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from scenes.checks import BoolArray, FloatArray, InputError
from scenes.formats.documents import parse_json
from scenes.formats.e57.e57_inferred import INFERRED
from scenes.formats.e57.e57_structure import check_e57
from scenes.formats.guard import check_size, import_extra
from scenes.formats.header import (
    FORMAT,
    checked_bytes,
    colour_from_bytes,
    described,
    point_warnings,
    projection_from_dict,
)
from scenes.formats.scans.cloud import RawPoints
from scenes.formats.scans.grid_fit import SCANNER_FROM_SENSOR, fit_grid, organised_scan
from scenes.formats.scans.station import scan_from_station
from scenes.pose import Pose, rotation_of
from scenes.scan.range_image import RangeImage

_CURE = (
    "it is an unstructured cloud, so which ray saw which point is lost; "
    "export the scan as structured (gridded) E57, with rowIndex and columnIndex, or say where the scanner "
    "stood (--origin X,Y,Z)"
)


class E57File:
    """The scans of an E57 file, which stays open as long as this; clouds of inferred points are none.

    Raises InputError: no E57, damaged, or the extra is missing.
    """

    def __init__(self, path: Path) -> None:
        module = import_extra("pye57", "e57")
        check_e57(path)
        self._stem, self._file = path.stem, module.E57(str(path))
        headers = enumerate(map(self._file.get_header, range(self._file.scan_count)))
        self._own = [k for k, header in headers if INFERRED not in _text(header, "description")]

    def __len__(self) -> int:
        return len(self._own)

    def scan(self, index: int) -> RangeImage:
        """Return scan `index` (from 0).

        Pixel (row, column) of the image is the file's own rowIndex, columnIndex, less their minima; rows may
        run upwards. Azimuths of columns and elevations of rows are estimated from the points, unless a file
        of ours states them, and the measured points are kept. A scan without a pose stands at the origin,
        upright. An unstructured scan with a pose becomes the spherical image that `scan_from_station` makes
        of its points.

        Raises InputError: unstructured and without a pose, damaged (checksum), or a grid that no projection
        explains.
        """
        header = self._file.get_header(self._own[index])
        name = _text(header, "name")
        missing = {"rowIndex", "columnIndex"} - set(header.point_fields)
        if missing and header.has_pose():
            return _projected(self.points(index), name or self._stem)
        if missing:
            names = " and no ".join(sorted(missing, reverse=True))
            raise InputError(f"scan {index + 1} has no {names}: {_CURE}")
        data, pose = self._read(index), _read_pose(header)
        points, kept = _points(data)
        if not kept.any():
            raise InputError(f"scan {index + 1} has no valid point")
        name = name or (f"{self._stem}#{index + 1}" if len(self) > 1 else self._stem)
        scan = _gridded(data, points, kept, pose, name=name, ours=_ours(_text(header, "description")))
        return replace(scan, warnings=(*point_warnings(points), *scan.warnings))

    def points(self, index: int) -> RawPoints:
        """Return all valid points of scan `index` (from 0) in the world, and where the scanner stood.

        Structured or not; a scan without pose and grid may have been merged from several, so that its place
        is None.

        Raises InputError: damaged, or without coordinates.
        """
        header, data = self._file.get_header(self._own[index]), self._read(index)
        pose, is_one_scan = _read_pose(header), header.has_pose() or "rowIndex" in data
        points, kept = _points(data)
        world = pose.apply(np.asarray(points[kept], dtype=np.float64))
        colours = _colours(data, kept)
        return RawPoints(
            world,
            origins=pose.translation if is_one_scan else None,
            colour=None if colours is None else checked_bytes(np.rint(colours * 255)),
            warnings=point_warnings(points),
        )

    def _read(self, index: int) -> dict[str, Any]:
        data: dict[str, Any] = self._file.read_scan_raw(self._own[index], ignore_unsupported_fields=True)
        return data


def _projected(cloud: RawPoints, name: str) -> RangeImage:
    """An unstructured scan as the image that a scanner at its pose's place would have taken."""
    colour = None if cloud.colour is None else colour_from_bytes(cloud.colour)
    return replace(scan_from_station(cloud.points, cloud.origins, name, colour), warnings=cloud.warnings)


def _gridded(
    data: dict[str, Any],
    local: FloatArray,
    kept: BoolArray,
    pose: Pose,
    *,
    name: str,
    ours: dict[str, Any] | None,
) -> RangeImage:
    """Sort points (n, 3) of the scanner's frame into their pixels and find the projection."""
    points = SCANNER_FROM_SENSOR.inverse().apply(local)[kept]
    row, column = (data[key].astype(np.int64)[kept] for key in ("rowIndex", "columnIndex"))
    if ours is None:
        projection, row, column = None, row - row.min(), column - column.min()
        rows, columns = int(row.max()) + 1, int(column.max()) + 1
    else:
        projection = projection_from_dict(ours["projection"])
        rows, columns = projection.shape
    check_size(rows, columns)
    if rows * columns > 1000 * len(points) + 1_000_000:
        raise InputError(f"{len(points)} points in a grid of {rows} x {columns}: are its indices damaged?")

    def image(values: Any, empty: float) -> Any:
        """Values of the points in their pixels; of several returns the first is kept."""
        if values is None:
            return None
        pixels = np.full((rows, columns, *values.shape[1:]), empty, values.dtype)
        pixels[row[::-1], column[::-1]] = values[::-1]
        return pixels

    light = data.get("intensity")
    organised = image(points, np.nan)
    scan = organised_scan(
        organised,
        projection or fit_grid(organised).projection,
        world_from_sensor=pose @ SCANNER_FROM_SENSOR,
        colour=image(_colours(data, kept), 0),
        name=name,
        intensity=image(None if light is None else np.asarray(light, np.float32)[kept], 0),
    )
    n_more = len(points) - int(np.isfinite(organised).all(axis=-1).sum())
    several = (f"{n_more} further returns of pixels with several were left out",) if n_more else ()
    return replace(described(scan, ours), warnings=several)


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
