# SPDX-License-Identifier: MIT
"""PTX scans: the text format of terrestrial scanners, column by column, several scans a file."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import count, islice
from pathlib import Path
from typing import TextIO

import numpy as np

from scenes.checks import FloatArray, InputError
from scenes.formats.guard import check_size
from scenes.formats.header import checked_bytes, colour_bytes, colour_from_bytes
from scenes.formats.raw_points import RawPoints
from scenes.formats.scans.grid_fit import SCANNER_FROM_SENSOR, fit_grid, organised_scan
from scenes.formats.trajectory import rounded_pose
from scenes.pose import Pose
from scenes.run.atomic import atomic_path
from scenes.scan.range_image import RangeImage

_NO_INTENSITY = 0.5  # what stands for an intensity that is not known
_HEADER_LINES = 10  # columns, rows, 4 lines of scanner position and axes, 4 of the transform


@dataclass(frozen=True, slots=True, eq=False)
class _PtxScan:
    """One scan as it stands in the file: world from scanner, and (rows, columns, 4 or 7) numbers."""

    pose: Pose
    table: FloatArray


def count_ptx(path: Path) -> int:
    """Return how many scans the file holds, checking that none is cut short."""
    with path.open(encoding="utf-8", errors="replace") as file:
        return sum(1 for _ in _scans(file))


def read_ptx(path: Path, index: int) -> RangeImage:
    """Return scan `index` (from 0) of a PTX file.

    Points are in the scanner's frame (z up) and run column by column; pixel (row, column) keeps the file's
    order, so rows usually run upwards. The translation of the transform is its last line. The projection is
    estimated from the points.

    Raises
    ------
    InputError
        Truncated, without points, not rigid, or no projection explains the grid.
    """
    found, n_scans = _scan(path, index)
    points = found.table[..., :3].copy()
    n_bad = int((~np.isfinite(points).all(axis=-1)).sum())
    left_out = (f"{n_bad} of {points[..., 0].size} points are not finite and were left out",) if n_bad else ()
    points[(points == 0).all(axis=-1)] = np.nan
    if not np.isfinite(points).any():
        raise InputError(f"scan {index + 1} has no return")
    points = SCANNER_FROM_SENSOR.inverse().apply(points)
    colour = colour_from_bytes(found.table[..., 4:7]) if found.table.shape[2] == 7 else None
    name = f"{path.stem}#{index + 1}" if n_scans > 1 else path.stem
    light = found.table[..., 3]
    known = None if (light == _NO_INTENSITY).all() else light
    pose = found.pose @ SCANNER_FROM_SENSOR
    return replace(
        organised_scan(
            points, fit_grid(points), world_from_sensor=pose, colour=colour, name=name, intensity=known
        ),
        warnings=left_out,
    )


def read_ptx_points(path: Path, index: int) -> RawPoints:
    """Return all points of scan `index` (from 0) in the world, and where the scanner stood.

    No projection is needed.
    """
    found, _ = _scan(path, index)
    table = found.table.reshape(-1, found.table.shape[2])
    table = table[(table[:, :3] != 0).any(axis=1)]
    colour = checked_bytes(table[:, 4:7]) if table.shape[1] == 7 else None
    return RawPoints(found.pose.apply(table[:, :3]), origins=found.pose.translation, colour=colour)


def _scan(path: Path, index: int) -> tuple[_PtxScan, int]:
    """Return scan `index` (from 0), and how many the file holds."""
    with path.open(encoding="utf-8", errors="replace") as file:
        scans = list(_scans(file, wanted=index))
    found = scans[index] if 0 <= index < len(scans) else None
    if found is None:
        raise InputError(f"there is no scan {index + 1}: there are {len(scans)}")
    return found, len(scans)


def _scans(file: TextIO, wanted: int | None = None) -> Iterator[_PtxScan | None]:
    """Walk through the scans of a file; the wanted one is parsed, for the others None is yielded."""
    for index in count():
        lines = [line for line in islice(file, _HEADER_LINES) if line.strip()]
        if not lines:
            return
        if len(lines) < _HEADER_LINES:
            raise InputError(f"truncated: a scan's header has {_HEADER_LINES} lines, {len(lines)} present")
        numbers = [[float(word) for word in line.split()] for line in lines]
        if [len(row) for row in numbers] != [1, 1, 3, 3, 3, 3, 4, 4, 4, 4]:
            raise InputError("not a PTX file: expected columns, rows, 4 lines of 3 numbers and 4 of 4")
        columns, rows = int(numbers[0][0]), int(numbers[1][0])
        check_size(rows, columns)
        points = list(islice(file, rows * columns))
        if len(points) < rows * columns:
            raise InputError(f"truncated: {rows * columns} points announced, {len(points)} present")
        if index != wanted:
            yield None
            continue
        pose = rounded_pose(np.array(numbers[6:]).T)  # for row vectors: the translation is the last line
        table = np.loadtxt(points, dtype=np.float64, ndmin=2)
        if table.shape[1] not in (4, 7):
            raise InputError(f"points have {table.shape[1]} numbers; expected x y z intensity [r g b]")
        yield _PtxScan(pose, table.reshape(columns, rows, -1).swapaxes(0, 1))


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
    table = [local.swapaxes(0, 1).reshape(-1, 3), np.asarray(light, np.float64).T.reshape(-1, 1)]
    form = ["%.9f"] * 3 + ["%.6f" if scan.intensity is None else "%.9g"]
    colour = colour_bytes(scan)
    if colour is not None:
        table.append(colour.swapaxes(0, 1).reshape(-1, 3))
        form += ["%d"] * 3
    with atomic_path(path) as temporary, temporary.open("w", encoding="ascii", newline="\n") as file:
        file.write(f"{columns}\n{rows}\n")
        file.writelines(" ".join(map(repr, row)) + "\n" for row in [*header, *transform])
        np.savetxt(file, np.hstack(table), fmt=form)
