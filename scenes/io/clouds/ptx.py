# SPDX-License-Identifier: MIT
"""PTX scans: the text format of terrestrial scanners, column by column, several scans a file."""

from __future__ import annotations

import re
import weakref
from collections.abc import Iterator
from contextlib import suppress
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from scenes.checks import ColourArray, FloatArray, InputError
from scenes.io.checks.guard import check_size
from scenes.io.formats.facts import FormatFacts
from scenes.io.formats.format import Format, RawPoints, each_cloud, each_scan, write_single
from scenes.io.formats.grid_fit import SCANNER_FROM_SENSOR, fit_grid, fitted_scan
from scenes.io.formats.header import checked_bytes, not_finite_warnings
from scenes.io.poses.trajectory import rounded_pose
from scenes.pose import Pose
from scenes.run.atomic import atomic_path
from scenes.run.mapping import allocate, release
from scenes.scan.colour import colour_bytes
from scenes.scan.pixels import finite_points, move_points
from scenes.scan.range_image import RangeImage

_NO_INTENSITY = 0.5  # what stands for an intensity that is not known
_WITHOUT_COLOUR, _WITH_COLOUR = 4, 7  # numbers of a point
_CHUNK = 100_000  # points that are parsed at a time
_SENSOR_FROM_SCANNER = SCANNER_FROM_SENSOR.inverse()
_HEADER_LINES = 10  # columns, rows, 4 lines of scanner position and axes, 4 of the transform


class _Header(NamedTuple):
    """Rows and columns of a scan, its transform (4, 4) as it stands in the file, and where it may stand too.

    `stated` are the poses that the scanner's position and axes give, where the transform says nothing.
    """

    shape: tuple[int, int]
    transform: FloatArray
    stated: tuple[Pose, ...]


class PtxFile:
    """The scans of a PTX file, walked through once to count them; each is parsed when asked for.

    The file stays open as long as this. Raises InputError: a header that is none, or a scan that is cut
    short.
    """

    def __init__(self, path: Path) -> None:
        self._stem, self._starts = path.stem, list[int]()
        self._file = path.open(encoding="utf-8", errors="replace")
        weakref.finalize(self, self._file.close)
        start = self._file.tell()
        while (header := self._header()) is not None:
            self._starts.append(start)
            rows, columns = header.shape
            n_present = sum(1 for _ in self._lines(rows * columns))
            if n_present < rows * columns:
                raise InputError(f"truncated: {rows * columns} points announced, {n_present} present")
            start = self._file.tell()

    def __len__(self) -> int:
        return len(self._starts)

    def is_empty(self, index: int) -> bool:
        """Tell whether scan `index` (from 0) has no rows and columns."""
        return self._begin(index)[1].shape == (0, 0)

    def scan(self, index: int) -> RangeImage:
        """Return scan `index` (from 0).

        Points are in the scanner's frame (z up) and run column by column; pixel (row, column) keeps the
        file's order, so rows usually run upwards. The translation of the transform is its last line. The
        projection is estimated from the points. Where none explains them and the transform is the identity,
        points are taken as world coordinates around the scanner's position in the header, with a warning.
        Lines shorter than others are beams without return.

        Raises InputError: without points, not rigid, or no projection explains the grid.
        """
        pose, header = self._begin(index)
        rows, columns = header.shape
        organised = allocate((rows, columns, 3), np.float64)
        points, light = organised.reshape(-1, 3), allocate((rows, columns), np.float32)
        colour: ColourArray | None = None
        n_bad, n_returns, has_light = 0, 0, False
        for start, table in self._tables(rows * columns):
            column, row = np.divmod(np.arange(start, start + len(table)), rows)
            pixel, local, finite = row * columns + column, table[:, :3], finite_points(table[:, :3])
            is_return = finite & (local != 0).any(axis=1)
            points[pixel] = _SENSOR_FROM_SCANNER.apply(np.where(is_return[:, None], local, np.nan))
            light.ravel()[pixel] = table[:, 3]
            if table.shape[1] == _WITH_COLOUR:
                colour = allocate((rows, columns, 3), np.uint8) if colour is None else colour
                colour.reshape(-1, 3)[pixel] = checked_bytes(
                    np.where(is_return[:, None], table[:, 4:], np.clip(np.nan_to_num(table[:, 4:]), 0, 255))
                )
            release(points, light, colour)
            n_bad, n_returns = n_bad + int((~finite).sum()), n_returns + int(is_return.sum())
            has_light |= bool((table[:, 3] != _NO_INTENSITY).any())
        if not n_returns:
            raise InputError(f"scan {index + 1} has no return")
        for image in (points, organised, light, colour):
            if image is not None:
                image.setflags(write=False)
        placed = _place(organised, header.stated)
        scan = fitted_scan(
            placed.points,
            world_from_sensor=pose @ placed.world_from_scanner @ SCANNER_FROM_SENSOR,
            colour=colour,
            name=f"{self._stem}#{index + 1}" if len(self) > 1 else self._stem,
            intensity=light if has_light else None,
        )
        return scan.add_warnings((*placed.warnings, *not_finite_warnings(n_bad, rows * columns)))

    def points(self, index: int) -> RawPoints:
        """Return all points of scan `index` (from 0) in the world, and where the scanner stood.

        No projection is needed, but to tell whether the scanner stood in the header's position.

        Raises InputError: there is no such scan, or its pose is not rigid.
        """
        origin = self._origin(index)
        pose, header = self._begin(index)
        rows, columns = header.shape
        world, kept = np.empty((rows * columns, 3)), np.zeros(rows * columns, np.bool_)
        colour: ColourArray | None = None
        for start, table in self._tables(rows * columns):
            column, row = np.divmod(np.arange(start, start + len(table)), rows)
            is_point = (table[:, :3] != 0).any(axis=1)
            pixel, known = (row * columns + column)[is_point], table[is_point]
            world[pixel], kept[pixel] = pose.apply(known[:, :3]), True
            if table.shape[1] == _WITH_COLOUR:
                colour = np.empty((rows * columns, 3), np.uint8) if colour is None else colour
                colour[pixel] = checked_bytes(known[:, 4:])
        colour = None if colour is None else colour[kept]
        return RawPoints(world[kept], origins=origin, colour=colour)

    def _origin(self, index: int) -> FloatArray:
        """Where the scanner stood: by the transform, or where that says nothing as the points show."""
        pose, header = self._begin(index)
        if not header.stated:
            return pose.translation
        try:
            return self.scan(index).origin
        except InputError:
            return pose.translation

    def _begin(self, index: int) -> tuple[Pose, _Header]:
        """World from scanner, and the header, of scan `index`, whose numbers come next."""
        if not 0 <= index < len(self):
            raise InputError(f"there is no scan {index + 1}: there are {len(self)}")
        self._file.seek(self._starts[index])
        header = self._header()
        if header is None:
            raise InputError(f"scan {index + 1} is gone: was the file changed?")
        return rounded_pose(header.transform.T), header  # for row vectors: translation is the last line

    def _tables(self, n: int) -> Iterator[tuple[int, FloatArray]]:
        """Numbers (m, 4 or 7) of the next n points, at most `_CHUNK` at a time, and the first one's index."""
        n_numbers, has_return = 0, False
        for start in range(0, n, _CHUNK):
            n_lines = min(_CHUNK, n - start)
            try:
                table = _table(
                    _with_points(list(self._lines(n_lines))), max(n_numbers, _WITHOUT_COLOUR), start
                )
            except InputError:
                raise
            except ValueError as error:  # numpy counts from the chunk's first line
                row = re.search(r"(?<=at row )\d+", str(error))
                text = (
                    str(error).replace(f"row {row[0]}", f"row {start + int(row[0])}") if row else str(error)
                )
                raise ValueError(text) from error
            n_numbers = table.shape[1] if not has_return else n_numbers
            has_return |= bool(np.nan_to_num(table[:, :3]).any())
            if table.shape[1] not in (_WITHOUT_COLOUR, _WITH_COLOUR):
                raise InputError(f"points have {table.shape[1]} numbers; expected x y z intensity [r g b]")
            if table.shape != (n_lines, n_numbers):
                raise InputError(
                    f"points {start + 1} to {start + n_lines} are {len(table)} lines of {table.shape[1]} "
                    f"numbers; expected {n_lines} of {n_numbers}"
                )
            yield start, table

    def _lines(self, n: int) -> Iterator[str]:
        """The next n lines that are not blank; readline can tell its place."""
        return islice(filter(str.strip, iter(self._file.readline, "")), n)

    def _header(self) -> _Header | None:
        """The header of the next scan, None at the end of the file."""
        lines = _with_points(list(self._lines(_HEADER_LINES)))
        if not lines:
            return None
        if len(lines) < _HEADER_LINES:
            raise InputError(f"truncated: a scan's header has {_HEADER_LINES} lines, {len(lines)} present")
        numbers = [[float(word) for word in line.split()] for line in lines]
        if [len(row) for row in numbers] != [1, 1, 3, 3, 3, 3, 4, 4, 4, 4]:
            raise InputError("not a PTX file: expected columns, rows, 4 lines of 3 numbers and 4 of 4")
        columns, rows = int(numbers[0][0]), int(numbers[1][0])
        if (rows, columns) != (0, 0):
            check_size(rows, columns)
        transform = np.array(numbers[6:])
        stated = _stated(np.array(numbers[2:6])) if np.allclose(transform, np.eye(4)) else ()
        return _Header((rows, columns), transform, stated)


def _with_points(lines: list[str]) -> list[str]:
    """Lines with decimal points instead of commas."""
    return [line.replace(",", ".") for line in lines] if "," in "".join(lines) else lines


def _stated(rows: FloatArray) -> tuple[Pose, ...]:
    """World from scanner by its position and three axes, a row each, and upright; none in the origin."""
    if not (np.isfinite(rows).all() and rows[0].any()):
        return ()
    upright = Pose.from_parts(np.eye(3), rows[0])
    try:
        return Pose.from_parts(rows[1:].T, rows[0]), upright
    except InputError:
        return (upright,)


class _Placed(NamedTuple):
    """A grid of points in the sensor's frame, and where the scanner stood."""

    points: FloatArray
    world_from_scanner: Pose
    warnings: tuple[str, ...] = ()


def _place(points: FloatArray, stated: tuple[Pose, ...]) -> _Placed:
    """Points (rows, columns, 3) as they are; where nothing fits them, around the pose that is stated."""
    as_they_are = _Placed(points, Pose.identity())
    if not stated or _fits(points):
        return as_they_are
    for pose in stated:
        local = move_points(points, _SENSOR_FROM_SCANNER @ pose.inverse() @ SCANNER_FROM_SENSOR)
        if _fits(local):
            x, y, z = pose.translation
            sentence = (
                "its points are world coordinates and its transform is the identity: the scanner's "
                f"position in the header, ({x:.10g}, {y:.10g}, {z:.10g}), was used"
            )
            return _Placed(local, pose, (sentence,))
    return as_they_are


def _fits(points: FloatArray) -> bool:
    """Whether some projection explains points (rows, columns, 3)."""
    with suppress(InputError):
        fit_grid(points)
        return True
    return False


def _table(lines: list[str], n_numbers: int, start: int) -> FloatArray:
    """Numbers of lines of points, the first of which is point `start`, at least `n_numbers` a line.

    Shorter lines are beams without return. Raises ValueError or InputError: a line that is neither.
    """
    with suppress(ValueError):
        table = np.loadtxt(lines, dtype=np.float64, ndmin=2)
        if table.shape[1] >= n_numbers:
            return table
    words = [line.split() for line in lines]
    most = max(n_numbers, *map(len, words))
    for number, row in enumerate(words, start=start + 1):
        if len(row) < most and np.nan_to_num([float(word) for word in row[:3]]).any():
            raise InputError(
                f"point {number} has {len(row)} numbers, {most} are needed; only beams without return "
                "(0 0 0) may have fewer: save all points with colour, or none"
            )
    return np.loadtxt([" ".join([*row, *["0"] * (most - len(row))]) for row in words], ndmin=2)


def write_ptx(scan: RangeImage, path: Path) -> None:
    """Write `scan` as PTX: points in the scanner's frame to the nanometre, 0 0 0 where nothing came back.

    An intensity that is not known is written as 0.5. Sigma, noise and truth are lost.
    """
    rows, columns = scan.shape
    pose = scan.world_from_sensor @ SCANNER_FROM_SENSOR.inverse()
    header = [[float(value) for value in row] for row in [pose.translation, *pose.rotation.T]]
    transform = [[float(value) for value in row] for row in pose.matrix.T]
    local = SCANNER_FROM_SENSOR.apply(np.nan_to_num(scan.points_in_sensor(), nan=0.0))
    light = np.full(scan.shape, _NO_INTENSITY) if scan.intensity is None else scan.intensity
    table: list[Any] = [local.swapaxes(0, 1).reshape(-1, 3), np.asarray(light, np.float64).T.reshape(-1, 1)]
    form = ["%.9f"] * 3 + ["%.6f" if scan.intensity is None else "%.9g"]
    if scan.colour is not None:
        table.append(colour_bytes(scan.colour).swapaxes(0, 1).reshape(-1, 3))
        form += ["%d"] * 3
    with atomic_path(path) as temporary, temporary.open("w", encoding="ascii", newline="\n") as file:
        file.write(f"{columns}\n{rows}\n")
        file.writelines(" ".join(map(repr, row)) + "\n" for row in [*header, *transform])
        np.savetxt(file, np.hstack(table), fmt=form)


FORMAT = Format(
    suffixes=(".ptx",),
    points=each_cloud(PtxFile),
    scans=each_scan(PtxFile),
    write=write_single(write_ptx),
    facts=FormatFacts(
        title="`.ptx`",
        read="each station as a scan, columns and rows kept; blank lines, short misses; 0 0 0 is no return",
        lost="transforms that scale are refused",
        written="one scan: 2e-9 m",
        poses=(
            "the transform, whose last *line* is the translation; world coordinates under an identity are "
            "taken from the position in the header"
        ),
        colours="bytes; intensity, where 0.5 everywhere is none",
    ),
)
