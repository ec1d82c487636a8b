# SPDX-License-Identifier: MIT
"""Files of timed points, written part by part as they are measured: LAS, LAZ and text."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from scenes.checks import FloatArray, InputError
from scenes.run.atomic import atomic_path
from scenes.run.libraries import import_extra
from scenes.scan.timed_points import TimedPoints

SUFFIXES = (".las", ".laz", ".csv")
_STEP_M = 1e-4  # of coordinates: 32 bits reach 200 km
_MOST_LIGHT = 65535
_COLUMNS = "gps_time,x,y,z,intensity,return_number,number_of_returns,surface"


def write_timed(parts: Iterable[TimedPoints], path: Path, *, about: FloatArray, full_light: float) -> int:
    """Write points with times as LAS 1.4, LAZ or CSV by the suffix; return how many.

    LAS: steps of 0.1 mm from `about` (3,), metres, and intensities in 16 bits, `full_light` being the most;
    GPS time is the track's. CSV names its columns in the first line.

    Raises InputError: another suffix, points more than 200 km away, no points; laspy is not installed.
    """
    suffix = check_timed(path)
    with atomic_path(path) as target:
        n = _write_text(parts, target) if suffix == ".csv" else _write_las(parts, target, about, full_light)
        if not n:
            raise InputError(
                "nothing was measured along the track; does it lead through the scene, in metres?"
            )
    return n


def check_timed(path: Path) -> str:
    """Return the suffix of a file for points with times. Raises InputError: another one."""
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        wrong = suffix or "a name without suffix"
        raise InputError(f"{path}: cannot write points with times to {wrong}; known: {', '.join(SUFFIXES)}")
    return suffix


def _write_text(parts: Iterable[TimedPoints], path: Path) -> int:
    n = 0
    with path.open("w", encoding="utf-8", newline="\n") as file:
        file.write(_COLUMNS + "\n")
        for part in parts:
            n += len(part)
            ones, none = np.ones(len(part)), np.full(len(part), -1)
            table = np.column_stack([
                part.times, part.points, ones if part.intensity is None else part.intensity,
                ones if part.number is None else part.number, ones if part.count is None else part.count,
                none if part.surface is None else part.surface,
            ])  # fmt: skip
            np.savetxt(file, table, fmt=["%.6f", "%.4f", "%.4f", "%.4f", "%.5g", "%d", "%d", "%d"],
                       delimiter=",")  # fmt: skip
    return n


def _write_las(parts: Iterable[TimedPoints], path: Path, about: FloatArray, full_light: float) -> int:
    laspy: Any = import_extra("laspy", "las")
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.creation_date = None  # the same points give the same bytes
    header.system_identifier, header.generating_software = "", "unseen"
    header.offsets, header.scales = np.floor(about), np.full(3, _STEP_M)
    header.add_extra_dim(laspy.ExtraBytesParams(name="surface", type=np.int32))
    n = 0
    with path.open("wb") as raw, laspy.open(
        raw, mode="w", header=header, closefd=False, do_compress=path.suffix == ".laz",
        laz_backend=laspy.LazBackend.Lazrs,
    ) as file:  # fmt: skip
        for part in parts:
            if not len(part):
                continue
            if float(np.abs(part.points - header.offsets).max()) >= _STEP_M * (2**31 - 1):
                raise InputError(f"points lie more than {_STEP_M * 2**31 / 1000:.0f} km from the track")
            record = laspy.ScaleAwarePointRecord.zeros(len(part), header=header)
            record.x, record.y, record.z = part.points.T
            record.gps_time = part.times
            ones = np.ones(len(part), np.uint8)
            record.return_number = ones if part.number is None else part.number.astype(np.uint8)
            record.number_of_returns = ones if part.count is None else part.count.astype(np.uint8)
            if part.intensity is not None:
                share = np.clip(part.intensity / full_light, 0, 1)
                record.intensity = np.rint(share * _MOST_LIGHT).astype(np.uint16)
            if part.surface is not None:
                record.surface = part.surface
            file.write_points(record)
            n += len(part)
    return n
