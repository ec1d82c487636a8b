# SPDX-License-Identifier: MIT
"""E57 scans: structured terrestrial laser scans, read and written with pye57."""

from __future__ import annotations

import hashlib
import uuid
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from scenes.checks import InputError
from scenes.formats.documents import parse_json
from scenes.formats.e57.e57_grid import Survey, gridded
from scenes.formats.e57.e57_inferred import INFERRED
from scenes.formats.e57.e57_points import point_chunks
from scenes.formats.e57.e57_structure import check_e57
from scenes.formats.guard import import_extra
from scenes.formats.header import (
    FORMAT,
    not_finite_warnings,
)
from scenes.formats.scans.cloud import RawPoints
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
        name = name or (f"{self._stem}#{index + 1}" if len(self) > 1 else self._stem)
        chunks, ours = (
            partial(point_chunks, self._file, self._own[index]),
            _ours(_text(header, "description")),
        )
        return gridded(chunks, _announced(header), _read_pose(header), name, ours)

    def points(self, index: int) -> RawPoints:
        """Return all valid points of scan `index` (from 0) in the world, and where the scanner stood.

        Structured or not; a scan without pose and grid may have been merged from several, so that its place
        is None.

        Raises InputError: damaged, or without coordinates.
        """
        header = self._file.get_header(self._own[index])
        pose, is_one_scan = _read_pose(header), header.has_pose() or "rowIndex" in header.point_fields
        world, colour = np.empty((header.point_count, 3)), np.empty((header.point_count, 3), np.uint8)
        n_kept = n_read = n_bad = 0
        has_colour = True
        for chunk in point_chunks(self._file, self._own[index]):
            part = slice(n_kept, n_kept + len(chunk.points))
            world[part] = pose.apply(chunk.points)
            if chunk.colour is None:
                has_colour = False
            else:
                colour[part] = chunk.colour
            n_kept, n_read, n_bad = part.stop, n_read + chunk.n_read, n_bad + chunk.n_bad
        return RawPoints(
            world[:n_kept],
            origins=pose.translation if is_one_scan else None,
            colour=colour[:n_kept] if has_colour else None,
            warnings=not_finite_warnings(n_bad, n_read),
        )


def _projected(cloud: RawPoints, name: str) -> RangeImage:
    """An unstructured scan as the image that a scanner at its pose's place would have taken."""
    scan = scan_from_station(cloud.points, cloud.origins, name, cloud.colour)
    return scan.restated(warnings=cloud.warnings)


def _announced(header: Any) -> Survey:
    """Rows and columns as the file's header tells them; none where it does not."""
    found = Survey(header.point_count)
    if "indexBounds" in header.scan_fields:
        bounds = header["indexBounds"]
        names = [[f"{axis}{end}" for axis in ("row", "column")] for end in ("Minimum", "Maximum")]
        if all(bounds.isDefined(name) for pair in names for name in pair):
            low, high = ([int(bounds[name].value()) for name in pair] for pair in names)
            found.low, found.high = np.array(low), np.array(high)
    return found


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


def content_guid(*parts: bytes) -> str:
    """Return an E57 guid that depends on the content alone, so that the same scan gives the same bytes."""
    return "{" + str(uuid.UUID(bytes=hashlib.sha256(b"".join(parts)).digest()[:16])) + "}"
