# SPDX-License-Identifier: MIT
"""LAS and LAZ: point clouds, read and written with laspy once their headers are checked."""

from __future__ import annotations

import io
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from scenes.checks import ColourArray, FloatArray, InputError
from scenes.io.checks.documents import parse_json
from scenes.io.clouds.las_header import check_las, libraries_muted
from scenes.io.formats.crs import LengthUnit, unit_of_geokeys, unit_of_wkt
from scenes.io.formats.facts import FormatFacts
from scenes.io.formats.format import (
    NO_RAYS,
    Format,
    RawPoints,
    one_cloud,
    one_scan,
    write_single,
)
from scenes.io.formats.header import scan_header
from scenes.io.formats.returns import ScanReturns, cloud_of, scan_of
from scenes.run.atomic import json_text, write_bytes
from scenes.run.libraries import import_extra
from scenes.scan.range_image import RangeImage

_STEPS_M = (1e-5, 1e-4, 1e-3, 1e-2)  # coordinates are 32-bit counts of such a step, from an offset
_USER, _RECORD_BYTES = "unseen", 65_000  # our header goes in records of at most so many bytes
_MOST, _MOST_RETURNS = 65_535, 15
_CHUNK = 100_000  # points that are read at a time
_COLOURS = ("red", "green", "blue")
_FORMAT_WITH_COLOUR, _FORMAT_WITHOUT = 7, 6
_SCALE = "intensity_per_count"
_TIME, _NOISE = "gps_time", (7, 18)
_PROJECTION, _WKT, _GEOKEYS = "LASF_Projection", 2112, 34735  # user and numbers of the records
_PANIC = "PanicException"  # what Rust's lazrs raises when it stumbles, which is no Exception


def read_las_points(path: Path) -> RawPoints:
    """Return the points of a LAS or LAZ file, without withheld ones and noise, and the unit that it states.

    Noise is what is classified so: 7 is low, 18 is high noise (LAS 1.4 R15, table 17). Synthetic points
    (table 16), which nothing measured, are left out unless all are. GPS times are given where they differ.

    Raises InputError: no points announced, or more than can be held; coordinates in degrees; laspy is not
    installed.
    """
    with _open_reader(path) as file:
        n_points, n_kept, n_noise, unit = file.header.point_count, 0, 0, _unit(file.header)
        step = float(np.abs(file.header.scales).max())
        has_colour, largest = "red" in file.header.point_format.dimension_names, 0
        points, wide = np.empty((n_points, 3)), np.empty((n_points if has_colour else 0, 3), np.uint16)
        has_times = _TIME in file.header.point_format.dimension_names
        times, synthetic = np.empty(n_points if has_times else 0), np.zeros(n_points, np.bool_)
        more = _points_behind(path, file.header)
        for part in _chunks(file):
            is_noise = np.isin(np.asarray(part.classification), _NOISE)
            n_noise += int(is_noise.sum())
            kept = ~np.asarray(part.withheld, dtype=np.bool_) & ~is_noise
            synthetic[n_kept : n_kept + int(kept.sum())] = np.asarray(part.synthetic, dtype=np.bool_)[kept]
            held = slice(n_kept, n_kept + int(kept.sum()))
            points[held] = _columns(part, "xyz", np.float64)[kept]
            if has_colour:
                colours = _columns(part, _COLOURS, np.uint16)
                wide[held], largest = colours[kept], max(largest, int(colours.max()))
            if has_times:
                times[held] = np.asarray(part[_TIME], np.float64)[kept]
            n_kept = held.stop
    n_left = n_points - n_kept - n_noise
    warnings: tuple[str, ...] = (f"{n_left} points are marked withheld and were left out",) if n_left else ()
    if more:
        warnings += (f"{more} points more than its header announces follow: did its writer close it?",)
    if n_noise:
        warnings += (f"{n_noise} of {n_points} points are classified as noise and were left out",)
    chosen: Any = slice(n_kept)
    if 0 < (n_synthetic := int(synthetic[:n_kept].sum())) < n_kept:
        warnings += (f"{n_synthetic} of {n_points} points are marked synthetic and were left out",)
        chosen = np.flatnonzero(~synthetic[:n_kept])
    colour = _narrow(wide[chosen], largest) if largest else None
    stamps = times[chosen] if has_times and n_kept and np.ptp(times[chosen]) > 0 else None
    return RawPoints(points[chosen], colour=colour, warnings=warnings, unit=unit, step=step, times=stamps)


def _points_behind(path: Path, header: Any) -> int:
    """How many plain points stand behind those that the header announces.

    Raises InputError: it announces none.
    """
    n_bytes = path.stat().st_size - header.offset_to_point_data
    waves = getattr(header, "start_of_waveform_data_packet_record", 0)
    if header.are_points_compressed or header.number_of_evlrs or waves:
        return 0
    more = int(n_bytes // header.point_format.size) - int(header.point_count)
    if more > 0 and not header.point_count:
        raise InputError(
            f"its header announces no points, {more} follow: its writer did not close it; repair it (lasinfo "
            "-repair of LAStools)"
        )
    return max(more, 0)


def _unit(header: Any) -> LengthUnit | None:
    """The unit that the WKT of a header states, or else its GeoKeys."""
    records = [*header.vlrs, *(header.evlrs or ())]
    for record in records:
        if record.user_id == _PROJECTION and record.record_id == _WKT:
            text = record.record_data_bytes().decode("utf-8", errors="replace").strip("\0 ")
            if text:
                return unit_of_wkt(text)
    for record in records:
        if record.user_id == _PROJECTION and record.record_id == _GEOKEYS:
            words = np.frombuffer(record.record_data_bytes(), "<u2")
            keys = words[4 : 4 * (len(words) // 4)].reshape(-1, 4)
            return unit_of_geokeys({int(key): int(value) for key, place, _, value in keys if place == 0})
    return None


@contextmanager
def _open_reader(path: Path) -> Iterator[Any]:
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
    with _open_reader(path) as file:
        header = _read_header(file.header)
        if header is None:
            raise InputError(NO_RAYS)
        largest = 0
        if _COLOURS[0] in file.header.point_format.dimension_names:
            largest = max(
                (int(_columns(part, _COLOURS, np.uint16).max()) for part in _chunks(file)), default=0
            )
    with _open_reader(path) as file:
        parts = (_part(part, header, largest) for part in _chunks(file))
        return scan_of(header, file.header.point_count, parts)


def _part(part: Any, header: Mapping[str, Any], largest: int) -> ScanReturns:
    """A chunk of points whose largest colour is `largest`."""
    row, column = (np.asarray(part[name], dtype=np.int64) for name in ("row", "column"))
    light = None
    if _SCALE in header:
        light = (np.asarray(part["intensity"], np.float64) * header[_SCALE]).astype(np.float32)
    colour = _narrow(_columns(part, _COLOURS, np.uint16), largest) if largest else None
    number = np.asarray(part["return_number"], np.int64)
    return ScanReturns(_columns(part, "xyz", np.float64), row, column, colour, light, number=number)


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
    its number among the returns of its beam and the number of these. Records of the user "unseen" hold pose
    and projection, so that the scan can be read back.

    Raises InputError: a scan without returns, or of more than 20,000 km, or more than 15 returns of a beam.
    """
    laspy = import_extra("laspy", "las")
    cloud = cloud_of(scan, all_returns=True)
    if cloud.count is not None and cloud.count.max() > _MOST_RETURNS:
        raise InputError(
            f"a beam has {cloud.count.max()} returns, LAS holds {_MOST_RETURNS}; use .e57 or .npz"
        )
    header = laspy.LasHeader(
        point_format=_FORMAT_WITHOUT if cloud.colour is None else _FORMAT_WITH_COLOUR, version="1.4"
    )
    header.creation_date = None  # the same scan gives the same bytes
    header.system_identifier, header.generating_software = "", _USER
    header.offsets = np.floor(cloud.points.mean(axis=0))
    header.scales = np.full(3, _step(cloud.points - header.offsets))
    for name in ("row", "column"):
        header.add_extra_dim(laspy.ExtraBytesParams(name=name, type=np.uint32))
    record = scan_header(scan)
    if cloud.intensity is not None:
        record[_SCALE] = max(float(cloud.intensity.max()), 1e-30) / _MOST
    _add_records(laspy, header, json_text(record, indent=None).encode())
    data = laspy.LasData(header)
    data.x, data.y, data.z = cloud.points.T
    data.row, data.column = cloud.row, cloud.column
    data.return_number = data.number_of_returns = np.ones(len(cloud.points), np.uint8)
    if cloud.number is not None:
        data.return_number, data.number_of_returns = cloud.number, cloud.count
    if cloud.intensity is not None:
        data.intensity = np.rint(np.clip(cloud.intensity / record[_SCALE], 0, _MOST)).astype(np.uint16)
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
    all_returns=True,
    facts=FormatFacts(
        title="`.las` `.laz`",
        read="points, scans of ours with all returns; GPS times",
        lost=(
            "withheld points and those classified as noise (7, 18), with a count; intensity, classes and "
            "extra bytes of files by others"
        ),
        written="LAS 1.4: 9e-6 m (steps of .01 mm; coarser beyond 21 km), intensity in 16 bits",
        poses="in files of ours; `--origin`, `--trajectory`",
        units=(
            "WKT or GeoKeys, heights apart; an EPSG code alone gives a warning; degrees are refused; steps "
            "are errors that all points share"
        ),
        colours="16 bits, or 8 in them",
    ),
)
