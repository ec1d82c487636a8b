# SPDX-License-Identifier: MIT
"""LAS and LAZ: point clouds of airborne and terrestrial scanning, read and written with laspy."""

from __future__ import annotations

import io
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from scenes.checks import ColourArray, FloatArray, InputError
from scenes.formats.documents import parse_json
from scenes.formats.format import Format, one_cloud, one_scan, write_single
from scenes.formats.guard import import_extra
from scenes.formats.header import scan_header
from scenes.formats.las.las_header import check_las
from scenes.formats.scans.cloud import NO_RAYS, Cloud, RawPoints, cloud_of, scan_of
from scenes.run.atomic import json_text, write_bytes
from scenes.run.standard_error import libraries_muted
from scenes.scan.range_image import RangeImage

_STEPS_M = (1e-5, 1e-4, 1e-3, 1e-2)  # coordinates are 32-bit counts of such a step, from an offset
_USER, _RECORD_BYTES = "unseen", 65_000  # our header goes in records of at most so many bytes
_MOST = 65_535
_CHUNK = 100_000  # points that are read at a time
_COLOURS = ("red", "green", "blue")
_FORMAT_WITH_COLOUR, _FORMAT_WITHOUT = 7, 6
_SCALE = "intensity_per_count"
_PANIC = "PanicException"  # what Rust's lazrs raises when it stumbles, which is no Exception


def read_las_points(path: Path) -> RawPoints:
    """Return the points of a LAS or LAZ file, without those marked as withheld.

    Raises InputError: more points announced than can be held; laspy is not installed.
    """
    with _opened(path) as file:
        n_points, n_kept = file.header.point_count, 0
        has_colour, largest = "red" in file.header.point_format.dimension_names, 0
        points, wide = np.empty((n_points, 3)), np.empty((n_points if has_colour else 0, 3), np.uint16)
        for part in _chunks(file):
            kept = ~np.asarray(part.withheld, dtype=np.bool_)
            held = slice(n_kept, n_kept + int(kept.sum()))
            points[held] = _columns(part, "xyz", np.float64)[kept]
            if has_colour:
                colours = _columns(part, _COLOURS, np.uint16)
                wide[held], largest = colours[kept], max(largest, int(colours.max()))
            n_kept = held.stop
    n_left = n_points - n_kept
    warnings = (f"{n_left} points are marked withheld and were left out",) if n_left else ()
    colour = _narrow(wide[:n_kept], largest) if largest else None
    return RawPoints(points[:n_kept], colour=colour, warnings=warnings)


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """A reader of the file; what its decoder raises inside is an InputError."""
    laspy = import_extra("laspy", "las")
    try:
        check_las(path)
        with libraries_muted():
            opened = laspy.open(path, laz_backend=laspy.LazBackend.Lazrs)
        with opened:
            yield opened
    except BaseException as error:
        if type(error).__name__ != _PANIC:
            raise
        raise InputError(f"damaged: its packed points cannot be unpacked: {error}") from error


def _chunks(opened: Any) -> Iterator[Any]:
    """The points of a file that was just opened, some at a time."""
    while True:
        with libraries_muted():
            part = opened.read_points(_CHUNK)
        if not len(part):
            return
        yield part


def _columns(part: Any, names: Iterable[str], kind: Any) -> Any:
    """Some numbers (n, k) of a chunk of points."""
    return np.stack([np.asarray(part[name], kind) for name in names], axis=-1)


def _narrow(wide: Any, largest: int) -> ColourArray:
    """8-bit colours of 16-bit ones, of which the largest of all tells whether they use more than 8."""
    return np.asarray(wide if largest < 256 else wide >> 8, dtype=np.uint8)


def read_las_scan(path: Path) -> RangeImage:
    """Return the scan of a file that `write_las` wrote.

    Raises InputError: any other file: it does not say where the scanner stood, nor which ray saw which point.
    """
    with _opened(path) as file:
        header = _read_header(file.header)
        if header is None:
            raise InputError(NO_RAYS)
        largest = 0
        if _COLOURS[0] in file.header.point_format.dimension_names:
            largest = max(
                (int(_columns(part, _COLOURS, np.uint16).max()) for part in _chunks(file)), default=0
            )
    with _opened(path) as file:
        parts = (_part(part, header, largest) for part in _chunks(file))
        return scan_of(header, file.header.point_count, parts)


def _part(part: Any, header: Mapping[str, Any], largest: int) -> Cloud:
    """A chunk of points whose largest colour is `largest`."""
    row, column = (np.asarray(part[name], dtype=np.int64) for name in ("row", "column"))
    light = None
    if _SCALE in header:
        light = (np.asarray(part["intensity"], np.float64) * header[_SCALE]).astype(np.float32)
    colour = _narrow(_columns(part, _COLOURS, np.uint16), largest) if largest else None
    return Cloud(_columns(part, "xyz", np.float64), row, column, colour, light)


def _read_header(held: Any) -> Mapping[str, Any] | None:
    """The header that we wrote, None in files of others."""
    parts = [vlr for vlr in held.vlrs if vlr.user_id == _USER]
    names = set(held.point_format.dimension_names)
    if not parts or not {"row", "column"} <= names:
        return None
    text = b"".join(vlr.record_data_bytes() for vlr in sorted(parts, key=lambda vlr: int(vlr.record_id)))
    return parse_json(text, dict)


def write_las(scan: RangeImage, path: Path) -> None:
    """Write the returns of `scan` as LAS 1.4, or as LAZ by the suffix, in world coordinates.

    Coordinates are rounded to the finest step of 0.01 mm to 1 cm that holds them, from an offset beside
    their middle; colours are exact; intensities are scaled to 16 bits. Each point has its `row` and `column`,
    and records of the user "unseen" hold pose and projection, so that the scan can be read back.

    Raises InputError: a scan without returns, or of more than 20,000 km.
    """
    laspy = import_extra("laspy", "las")
    cloud = cloud_of(scan)
    header = laspy.LasHeader(
        point_format=_FORMAT_WITHOUT if cloud.colour is None else _FORMAT_WITH_COLOUR, version="1.4"
    )
    header.creation_date = None  # the same scan gives the same bytes
    header.system_identifier, header.generating_software = "", _USER
    header.offsets = np.floor(cloud.points.mean(axis=0))
    header.scales = np.full(3, _step(cloud.points - header.offsets))
    for name in ("row", "column"):
        header.add_extra_dim(laspy.ExtraBytesParams(name=name, type=np.uint32))
    told = scan_header(scan)
    if cloud.intensity is not None:
        told[_SCALE] = max(float(cloud.intensity.max()), 1e-30) / _MOST
    _add_records(laspy, header, json_text(told, indent=None).encode())
    data = laspy.LasData(header)
    data.x, data.y, data.z = cloud.points.T
    data.row, data.column = cloud.row, cloud.column
    data.return_number = data.number_of_returns = np.ones(len(cloud.points), np.uint8)
    if cloud.intensity is not None:
        data.intensity = np.rint(np.clip(cloud.intensity / told[_SCALE], 0, _MOST)).astype(np.uint16)
    if cloud.colour is not None:
        data.red, data.green, data.blue = cloud.colour.astype(np.uint16).T * 257
    packed = path.suffix.lower() == ".laz"
    whole = io.BytesIO()
    data.write(whole, do_compress=packed, laz_backend=laspy.LazBackend.Lazrs)
    write_bytes(path, whole.getvalue())


def _step(offsets: FloatArray) -> float:
    """The finest step that holds the coordinates in 32 bits."""
    largest = float(np.abs(offsets).max())
    for step in _STEPS_M:
        if largest < step * (2**31 - 1):
            return step
    raise InputError(f"points up to {largest:.3g} m apart do not fit into LAS; use .npz")


def _add_records(laspy: Any, header: Any, text: bytes) -> None:
    """Put our header into variable length records, which are limited in size."""
    for number, start in enumerate(range(0, len(text), _RECORD_BYTES), start=1):
        part = text[start : start + _RECORD_BYTES]
        header.vlrs.append(laspy.VLR(_USER, number, "pose and projection", part))


FORMAT = Format(
    suffixes=(".las", ".laz"),
    points=one_cloud(read_las_points),
    scans=one_scan(read_las_scan),
    write=write_single(write_las),
)
