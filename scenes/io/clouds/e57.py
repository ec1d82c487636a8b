# SPDX-License-Identifier: MIT
"""E57: structured terrestrial laser scans, read with pye57 some points at a time.

The library expands whatever entities the XML defines and makes room for as many points as it announces, so
header and XML are checked first. ASTM E2807-11, sections 5 and 8: a file is pages of 1020 bytes and a
checksum, its XML stands at an offset.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, NamedTuple, NoReturn
from xml.parsers import expat

import numpy as np
from numpy.typing import NDArray

from scenes.checks import InputError
from scenes.io.checks.documents import parse_json
from scenes.io.checks.guard import check_size
from scenes.io.checks.limits import check_limit, check_unpacked
from scenes.io.clouds.e57_points import (
    GridExtent,
    PointChunk,
    announced_size,
    coordinate_step,
    point_chunks,
    read_pose,
    times_of,
)
from scenes.io.formats.format import RawPoints, step_warnings
from scenes.io.formats.grid_fit import SCANNER_FROM_SENSOR, fitted_scan, lie_on_rays, organised_scan
from scenes.io.formats.grid_order import line_steps
from scenes.io.formats.header import FORMAT, apply_header, not_finite_warnings, projection_from_dict
from scenes.io.formats.returns import FurtherReturns
from scenes.io.formats.station import scan_from_station
from scenes.limits import SPARSE, SPARSE_PIXELS
from scenes.pose import Pose
from scenes.run.libraries import import_extra
from scenes.run.mapping import allocate, release
from scenes.scan.colour import colour_pixels, colour_points, colour_warnings
from scenes.scan.pixels import crop_pixels, ranges_of, row_blocks
from scenes.scan.range_image import RangeImage

_HEADER = struct.Struct("<8sIIQQQQ")
_PAGE, _CHECKSUM = 1024, 4
_DEEPEST = 64  # elements within each other; the standard's own are 8
_FIELD_BYTES = 8  # that each field of a point takes once it is read


def check_e57(path: Path) -> None:
    """Raise InputError where an E57 file announces more than it can hold, or its XML defines entities.

    Raises InputError: no E57, cut short, XML that is damaged, too large, too deep or with definitions of its
    own, more points or unpacked bytes than the limits allow.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        start = file.read(_HEADER.size)
        if len(start) < _HEADER.size or start[:8] != b"ASTM-E57":
            raise InputError("not an E57 file: it does not begin with ASTM-E57 and a header")
        _, _, _, length, offset, xml_length, page = _HEADER.unpack(start)
        if length != size or page != _PAGE:
            raise InputError(
                f"truncated or damaged E57: {length:,} bytes in pages of {page} announced, {size:,} present"
            )
        if offset >= size or xml_length > size:
            raise InputError(f"damaged E57: {xml_length:,} bytes of XML from byte {offset:,} of {size:,}")
        check_limit("json_bytes", xml_length, "bytes of its XML")
        xml = _logical(file, offset, xml_length)
    counts = _Counts()
    counts.read(xml)
    check_limit("points", sum(counts.points), "its points")
    check_unpacked(sum(counts.points) * counts.fields * _FIELD_BYTES, size, "it")


def _logical(file: BinaryIO, offset: int, length: int) -> bytes:
    """Return bytes from a physical offset on, the pages' checksums left out."""
    file.seek(offset)
    first = _PAGE - _CHECKSUM - offset % _PAGE
    if first <= 0:
        raise InputError(f"damaged E57: its XML begins within a checksum, at byte {offset:,}")
    n_pages = max(length - first, 0) // (_PAGE - _CHECKSUM) + 2
    raw = file.read(n_pages * _PAGE)
    parts = [raw[:first]]
    parts += [raw[at : at + _PAGE - _CHECKSUM] for at in range(first + _CHECKSUM, len(raw), _PAGE)]
    xml = b"".join(parts)[:length]
    if len(xml) < length:
        raise InputError(f"truncated E57: {length:,} bytes of XML announced, {len(xml):,} present")
    return xml


class _Counts:
    """Points of each scan, and fields of a point, as the XML announces them."""

    def __init__(self) -> None:
        self.points: list[int] = []
        self.fields = 1
        self._open: list[str] = []
        self._fields_here = 0

    def read(self, xml: bytes) -> None:
        parser = expat.ParserCreate()
        parser.StartElementHandler, parser.EndElementHandler = self._begin, self._end
        parser.StartDoctypeDeclHandler = _refuse
        try:
            parser.Parse(xml, True)
        except expat.ExpatError as error:
            raise InputError(f"its XML is damaged: {error}") from error

    def _begin(self, name: str, attributes: dict[str, str]) -> None:
        if self._open[-1:] == ["prototype"]:
            self._fields_here += 1
        self._open.append(name)
        if len(self._open) > _DEEPEST:
            raise InputError(f"its XML is nested more than {_DEEPEST} deep")
        if name == "points":
            self._fields_here = 0
            text = attributes.get("recordCount", "0")
            if not (text.isascii() and text.isdigit() and len(text) < 19):
                raise InputError(f"announces {text[:40]!r} points")
            self.points.append(int(text))
            check_limit("entries", len(self.points), "its scans")

    def _end(self, name: str) -> None:
        self._open.pop()
        if name == "points":
            self.fields = max(self.fields, self._fields_here)


def _refuse(*_: object) -> NoReturn:
    raise InputError("its XML has definitions of its own (DOCTYPE), which E57 does not know")


if TYPE_CHECKING:
    from scenes.scan.projection import Projection
    from scenes.scan.ray_grid import RayGrid

_SENSOR_FROM_SCANNER = SCANNER_FROM_SENSOR.inverse()
_NO_RETURN = 255  # above the numbers of all returns
_CHUNKS_HELD = 10  # that memory holds pixels of: columns lie side by side in the same pages


class _BeyondError(Exception):
    """A point has a pixel beyond what was announced."""


def grid_scan(
    chunks: Callable[..., Iterable[PointChunk]],
    announced: GridExtent,
    pose: Pose,
    name: str,
    ours: dict[str, Any] | None,
) -> RangeImage:
    """Return the scan of the points that `chunks` gives, anew each time, from a scanner at `pose`.

    Pixels are the file's own indices where a header says that it is of ours, less their minima where none
    does. Of several returns of a pixel the first is kept, by its returnIndex or else in the file; of ours
    the others too, as echoes. Points on the rays of a known projection are held as ranges alone. The bounds
    that are `announced` save a look at the points; where they are none, or are wrong, that look is taken.

    Raises InputError: no valid point, indices that are damaged, no projection that explains the points.
    """
    projection = None if ours is None else projection_from_dict(ours["projection"])
    if projection is not None:
        announced.low, announced.high = np.zeros(2, np.int64), np.array(projection.shape) - 1
    size = [int(n) for n in announced.high - announced.low + 1]
    if min(size) > 0 and size[0] * size[1] <= SPARSE * announced.n_kept + SPARSE_PIXELS:
        try:
            return _fill_grid(chunks, announced, projection, pose, name=name, ours=ours)
        except _BeyondError:
            pass
    seen = GridExtent()
    for chunk in chunks(places_alone=True):
        seen.see(chunk)
    if not seen.n_kept:
        raise InputError(f"{name}: has no valid point")
    if projection is not None and (seen.high >= projection.shape).any():
        raise InputError(
            f"its rows and columns reach {seen.high.tolist()}, its header says {projection.shape}"
        )
    bounds = seen if projection is None else announced
    rows, columns = (int(n) for n in bounds.high - bounds.low + 1)
    check_size(rows, columns)
    if rows * columns > SPARSE * seen.n_kept + SPARSE_PIXELS:
        raise InputError(f"{seen.n_kept} points in a grid of {rows} x {columns}: are its indices damaged?")
    return _fill_grid(chunks, bounds, projection, pose, name=name, ours=ours)


def _fill_grid(
    chunks: Callable[..., Iterable[PointChunk]],
    bounds: GridExtent,
    projection: Projection | None,
    pose: Pose,
    name: str,
    ours: dict[str, Any] | None,
) -> RangeImage:
    """The scan of points whose pixels are within bounds, which are those of a projection that is known."""
    rays, further = None if projection is None else projection.ray_grid(), FurtherReturns()
    held = _images(chunks(), bounds, rays, further) if rays is not None else None
    is_on_rays = held is not None
    if held is None:
        further = FurtherReturns()
        held = _images(chunks(), bounds, None, None if projection is None else further)
    if held is None or not held.images:
        raise InputError(f"{name}: has no valid point")
    images, seen = dict[str, Any](held.images), held.seen
    if projection is None:
        first, last = seen.low - bounds.low, seen.high - bounds.low + 1
        steps = line_steps(images["place"][first[0] : last[0], first[1] : last[1]])
        rows, columns = (slice(*ends) for ends in zip(first, last, steps, strict=True))
        images = {key: crop_pixels(image, rows, columns) for key, image in images.items()}
    place, n_colourless = images["place"], 0
    if "is_coloured" in images:
        n_colourless = held.n_filled - int(np.count_nonzero(images["is_coloured"]))
        if n_colourless:
            images["colour"] = colour_pixels(images["colour"], images["is_coloured"])
    about: dict[str, Any] = {key: images.get(key) for key in ("colour", "intensity")} | {"name": name}
    about["world_from_sensor"] = pose @ SCANNER_FROM_SENSOR
    if projection is None:
        scan = fitted_scan(place, **about)
    elif is_on_rays:
        scan = RangeImage(place, projection, **about)
    else:
        scan = organised_scan(place, projection, **about)
    scan, _ = further.put_in(scan, has_light="intensity" in images)
    n_more = seen.n_kept - held.n_filled - (0 if scan.echoes is None else len(scan.echoes))
    several = (f"{n_more} further returns of pixels with several were left out",) if n_more else ()
    warnings = (
        *not_finite_warnings(seen.n_bad, seen.n_read),
        *several,
        *colour_warnings(n_colourless, held.n_filled),
    )
    return apply_header(scan, ours).add_warnings(warnings)


class _GridImages(NamedTuple):
    """Read-only images by name, what was seen of the points in them, and how many pixels have one."""

    images: dict[str, NDArray[Any]]
    seen: GridExtent
    n_filled: int


def _images(
    chunks: Iterable[PointChunk], bounds: GridExtent, rays: RayGrid | None, further: FurtherReturns | None
) -> _GridImages | None:
    """Sort points, and what else they have, into images of the pixels within bounds; gather later returns.

    "place" is the points of the sensor's frame, NaN for none; or with `rays` their ranges, inf for none, and
    nothing is returned when a point lies beside its ray. "colour", bytes, and "intensity" are black and 0
    for none; "is_coloured" is where the colour is one. Raises _BeyondError: a pixel is not within bounds.
    """
    images, seen, shape = dict[str, Any](), GridExtent(), tuple(int(n) for n in bounds.high - bounds.low + 1)
    check_size(*shape)
    lowest = np.full(shape[0] * shape[1], _NO_RETURN, np.uint8)
    for number, chunk in enumerate(chunks, start=1):
        seen.see(chunk)
        if seen.n_kept and ((seen.low < bounds.low).any() or (seen.high > bounds.high).any()):
            raise _BeyondError
        row, column = chunk.pixels - bounds.low[:, None]
        place: NDArray[Any] = _SENSOR_FROM_SCANNER.apply(chunk.points)
        if rays is not None:
            place, points = ranges_of(place), place
            if not (np.isfinite(place).all() and lie_on_rays(points, place, rays.at(row, column))):
                return None
        record = {"place": place, "colour": chunk.colour, "intensity": chunk.intensity}
        record["is_coloured"] = chunk.is_coloured
        known = {name: values for name, values in record.items() if values is not None}
        if not images:
            kinds = {"place": np.float64 if rays else chunk.points.dtype, "intensity": np.float32}
            images = {
                name: allocate((*shape, *channel.shape[1:]), kinds.get(name, channel.dtype))
                for name, channel in known.items()
            }
        pixel, order = row * shape[1] + column, np.arange(len(row))[::-1]
        number_of = np.zeros(len(row), np.uint8)
        if chunk.returns is not None:
            number_of = np.clip(chunk.returns, 0, _NO_RETURN - 1).astype(np.uint8)
            if further is not None and (later := np.flatnonzero(number_of)).size:
                light = None if chunk.intensity is None else chunk.intensity[later]
                places = _SENSOR_FROM_SCANNER.apply(chunk.points[later])
                further.gather(pixel[later], places, number_of[later], light)
            order = order[np.argsort(_NO_RETURN - number_of[order], kind="stable")]
        order = order[number_of[order] < lowest[pixel[order]]]
        lowest[pixel[order]] = number_of[order]
        for name, values in known.items():  # backwards: the first of several is written last
            images[name].reshape(-1, *values.shape[1:])[pixel[order]] = values[order]
        if number % _CHUNKS_HELD == 0:
            release(*images.values())
    if not seen.n_kept:
        return _GridImages({}, seen, 0)
    filled = lowest != _NO_RETURN
    for rows in row_blocks(shape, *images.values()):
        images["place"][rows][~filled.reshape(shape)[rows]] = np.nan if rays is None else np.inf
    for image in images.values():
        image.setflags(write=False)
    return _GridImages(images, seen, int(np.count_nonzero(filled)))


INFERRED = "unseen inferred points 1"
"""Format that the description of a cloud of inferred points names."""
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
        self._stem, self._file = path.stem, module.E57(os.fsencode(path))  # names may be of any encoding
        headers = enumerate(map(self._file.get_header, range(self._file.scan_count)))
        self._own = [k for k, header in headers if INFERRED not in _text(header, "description")]

    def __len__(self) -> int:
        return len(self._own)

    def is_empty(self, index: int) -> bool:
        """Tell whether scan `index` (from 0) has no record of a point."""
        return not self._file.get_header(self._own[index]).point_count

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
            cloud = self._points(index, first_returns=True)
            return _project_cloud(cloud, read_pose(header)[0], name or self._stem)
        if missing:
            names = " and no ".join(sorted(missing, reverse=True))
            raise InputError(f"scan {index + 1} has no {names}: {_CURE}")
        name = name or (f"{self._stem}#{index + 1}" if len(self) > 1 else self._stem)
        chunks = partial(point_chunks, self._file, self._own[index])
        ours = _ours(_text(header, "description"))
        pose, doubts = read_pose(header)
        scan = grid_scan(chunks, announced_size(header), pose, name, ours).add_warnings(doubts)
        step_m = 0.0 if ours else coordinate_step(header, scan.ranges)
        return scan if ours else scan.with_facts(step_m=step_m).add_warnings(step_warnings(step_m))

    def points(self, index: int) -> RawPoints:
        """Return all valid points of scan `index` (from 0) in the world, and where the scanner stood.

        Structured or not; a scan without pose and grid may have been merged from several, so that its place
        is None.

        Raises InputError: damaged, or without coordinates.
        """
        return self._points(index, first_returns=False)

    def _points(self, index: int, *, first_returns: bool) -> RawPoints:
        """The points of scan `index`, or those alone that came back first."""
        header = self._file.get_header(self._own[index])
        (pose, doubts), fields = read_pose(header), header.point_fields
        is_one_scan = header.has_pose() or "rowIndex" in fields
        world, colour = np.empty((header.point_count, 3)), np.empty((header.point_count, 3), np.uint8)
        is_coloured = np.ones(header.point_count, np.bool_)
        n_kept = n_read = n_bad = n_later = 0
        has_colour, times = True, np.full(header.point_count, np.nan)
        for chunk in point_chunks(self._file, self._own[index]):
            kept = np.ones(len(chunk.points), np.bool_)
            if first_returns and chunk.returns is not None:
                kept = chunk.returns == 0
            part = slice(n_kept, n_kept + int(kept.sum()))
            world[part] = pose.apply(chunk.points[kept])
            if chunk.colour is None:
                has_colour = False
            else:
                colour[part] = chunk.colour[kept]
                is_coloured[part] = True if chunk.is_coloured is None else chunk.is_coloured[kept]
            if chunk.times is not None:
                times[part] = chunk.times[kept]
            n_kept, n_read, n_bad = part.stop, n_read + chunk.n_read, n_bad + chunk.n_bad
            n_later += len(kept) - int(kept.sum())
        step = coordinate_step(header, ranges_of(world[:n_kept] - pose.translation))
        world, held, known = world[:n_kept], colour[:n_kept] if has_colour else None, is_coloured[:n_kept]
        if held is not None and not known.all():
            held = colour_points(held, known, world)
        warnings = (
            *doubts,
            *not_finite_warnings(n_bad, n_read),
            *((f"{n_later} later returns were left out",) if n_later else ()),
            *colour_warnings(int(n_kept - known.sum()), n_kept),
        )
        stood, times_s = pose.translation if is_one_scan else None, times_of(header, times[:n_kept])
        return RawPoints(world, origins=stood, colour=held, warnings=warnings, step=step, times=times_s)


def _project_cloud(cloud: RawPoints, pose: Pose, name: str) -> RangeImage:
    """An unstructured scan as the image that a scanner at its pose's place would have taken.

    Points that no one scan took from there, unless they are world coordinates already, are taken so.
    """
    texts = (*cloud.warnings, *step_warnings(cloud.step))
    try:
        scan = scan_from_station(cloud.points, cloud.origins, name, cloud.colour)
    except InputError as unfit:
        try:
            scan = scan_from_station(pose.inverse().apply(cloud.points), cloud.origins, name, cloud.colour)
        except InputError:
            raise unfit from None
        texts += ("its points fit its pose only as world coordinates: they were taken as such",)
    return scan.add_warnings(texts).with_facts(step_m=cloud.step)


def _ours(description: str) -> dict[str, Any] | None:
    """Return the header that `write_e57` put into the description, None for foreign files."""
    if FORMAT not in description:
        return None
    return parse_json(description, dict)


def _text(header: Any, field: str) -> str:
    return str(header[field].value()) if field in header.scan_fields else ""
