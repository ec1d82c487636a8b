# SPDX-License-Identifier: MIT
"""Sweeps of spinning lidars as bare numbers: KITTI's `.bin` and nuScenes' `.pcd.bin`.

Little-endian float32, point by point, without a header: x y z reflectance in KITTI (README of its raw data),
x y z intensity ring in nuScenes (nuscenes-devkit, nuscenes/utils/data_classes.py). Coordinates are metres
about the lidar, so that each file is a scan from 0, 0, 0.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from scenes import limits
from scenes.checks import FloatArray, InputError
from scenes.io.checks.limits import check_limit
from scenes.io.formats.facts import FormatFacts
from scenes.io.formats.format import Format, RawPoints, one_cloud
from scenes.io.formats.station import scan_from_station
from scenes.scan.range_image import RangeImage

_COLUMNS = {"nuScenes": 5, "KITTI": 4}
_MOST_M = 1000.0  # beyond it no such lidar measures
_LEAST_M = 0.1  # median range
_MOST_INTENSITY = 255.0


def read_sweep(path: Path) -> RangeImage:
    """Return the sweep of a file as a scan, with a row for each beam; see `scan_from_station`.

    Raises InputError: something else than a sweep, or too few points.
    """
    points, ring, doubts = _read(path)
    scan = scan_from_station(points, np.zeros(3), path.stem, beam=ring)
    pole = np.abs(scan.world_from_sensor.rotation[:, 1])
    if pole[2] < pole.max():
        axis = "xyz"[int(np.argmax(pole))]
        doubts += (
            f"its beams turn about {axis}, a lidar's about z: are these the axes of a camera (x right, "
            "y down, z forward)? write z, -x, -y as x, y, z",
        )
    return scan.add_warnings(doubts)


def _read(path: Path) -> tuple[FloatArray, NDArray[np.int64] | None, tuple[str, ...]]:
    """Points (n, 3), the ring of each (n,) where the file tells, and a warning where some are no points."""
    n_bytes = path.stat().st_size
    check_limit("points", n_bytes // 16, "its points")
    values = np.fromfile(path, "<f4")
    for columns in _COLUMNS.values():
        if n_bytes % (4 * columns):
            continue
        table = values.reshape(-1, columns).astype(np.float64)
        usable = _are_points(table)
        if (
            usable.mean() < limits.NEARLY_ALL
            or np.median(np.linalg.norm(table[usable, :3], axis=1)) < _LEAST_M
        ):
            continue
        n_left = int((~usable).sum())
        doubt = f"{n_left} of {len(table)} points are not finite or beyond {_MOST_M:g} m and were left out"
        ring = table[usable, 4].astype(np.int64) if columns == _COLUMNS["nuScenes"] else None
        return table[usable, :3], ring, (doubt,) if n_left else ()
    raise InputError(
        f"its {n_bytes} bytes are no sweep of KITTI (x y z reflectance) or nuScenes (x y z intensity ring, "
        "float32 each); export the points as .pcd, .ply or .las"
    )


def _are_points(table: FloatArray) -> NDArray[np.bool_]:
    """Tell which rows (n, 4 or 5) may be points of a lidar."""
    usable = (np.abs(table[:, :3]) < _MOST_M).all(axis=1)  # NaN is not
    usable &= (table[:, 3] >= 0) & (table[:, 3] <= _MOST_INTENSITY)
    for ring in table[:, 4:].T:
        usable &= (ring >= 0) & (ring < limits.MOST_BEAMS) & (ring == np.rint(ring))
    return usable


def _points(path: Path) -> RawPoints:
    points, _, doubts = _read(path)
    return RawPoints(points, origins=np.zeros(3), warnings=doubts)


FORMAT = Format(
    name="KITTI or nuScenes sweep",
    suffixes=(".bin",),
    points=one_cloud(_points),
    scans=lambda path, _: [partial(read_sweep, path)],
    unit="m",
    is_local=True,
    facts=FormatFacts(
        title="`.bin`: KITTI, nuScenes",
        read="a sweep as a scan, a row a beam",
        lost="intensity; returns of the carrier, with a count",
        poses="the sensor stands at 0 0 0; `--poses` moves it",
        units="metres",
    ),
)
