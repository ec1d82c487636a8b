# SPDX-License-Identifier: MIT
"""Bulk: scans from many poses, each simulated and written by a worker that then holds it no more.

A scan is a pure function of what its key names, and its file is written whole or not at all, before its
record. So a run that was killed goes on where it stopped, and ends with the same bytes, whoever does the
work. Formats that hold several scans in one file get them one after the other from files that are kept until
then.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, overload

import numpy as np

from nbv.scanning.beam import Returns
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import Sensor
from nbv.scanning.sensor_profile import load_sensor
from scenes.io.clouds.npz import read_npz, write_npz
from scenes.io.formats.format import Units
from scenes.io.scan_files import write_scan
from scenes.io.scene_files import open_scene
from scenes.mesh.orientation import Axis
from scenes.pose import Pose
from scenes.run.mapping import trim
from scenes.scan.range_image import RangeImage
from scenes.world.scene import Scene

KEPT = ".raw.npz"
"""Ending of a scan that is kept to be joined with others: lossless and not packed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ScanTask:
    """What all scans of a run have in common: scene and sensor by name or path, and how they are scanned.

    `content` stands for the bytes that the paths hold, so that no worker takes those of an earlier run.
    """

    scene: str
    sensor: str
    content: str
    up: Axis | None = None
    units: Units = "m"
    noise: str = "none"
    returns: Returns | None = None
    truth: bool = True

    def open(self) -> tuple[Scene, Sensor]:
        """Return scene and sensor; those of the last task are kept.

        Raises
        ------
        InputError
            A scene or sensor that cannot be used.
        """
        return _open(self)


@lru_cache(maxsize=1)
def _open(task: ScanTask) -> tuple[Scene, Sensor]:
    return open_scene(task.scene, up=task.up, units=task.units), load_sensor(task.sensor)


@dataclass(frozen=True, slots=True, kw_only=True)
class BulkScan:
    """One scan: its number among the poses, from 1, or 0 for one without others; where it is written.

    `pose` is world from sensor, rows of a 4 x 4 matrix. `name` and `key` are those of its record.
    """

    name: str
    key: str
    task: ScanTask
    number: int
    seed: int
    pose: tuple[tuple[float, ...], ...]
    file: Path


def take_scan(case: BulkScan, n_threads: int | None = None) -> RangeImage:
    """Return a scan; its errors are drawn by the seed and its number, that without others by the seed."""
    task = case.task
    scene, sensor = task.open()
    return scan_scene(
        scene, Pose(np.array(case.pose)), sensor, noise=task.noise, returns=task.returns, truth=task.truth,
        rng=np.random.default_rng([case.seed, case.number]) if case.number else case.seed,
        caster=scene.ray_caster(n_threads), n_threads=n_threads,
        name=f"view {case.number}" if case.number else "scan",
    )  # fmt: skip


def write_bulk_scan(case: BulkScan, n_threads: int | None = None) -> dict[str, Any]:
    """Take a scan, write it by its suffix, and return its record: what it is, and how much came back.

    Raises
    ------
    InputError
        A scene or sensor that cannot be used, or what the format cannot hold.
    """
    begin = time.perf_counter(), time.process_time()
    scan = take_scan(case, n_threads)
    if case.file.name.endswith(KEPT):
        write_npz(scan, case.file, level=0)
    else:
        write_scan(scan, case.file)
    returned, rows, columns = scan.ranges[scan.valid], *scan.shape
    record = {
        "case": case.name,
        "key": case.key,
        "name": scan.name,
        "noise": scan.noise,
        "sigma_m": scan.sigma_m,
        "rows": rows,
        "columns": columns,
        "returns": len(returned),
        "range_m": [float(returned.min()), float(returned.max())] if len(returned) else None,
        "further_returns": None if scan.echoes is None else len(scan.echoes),
        "times": {"seconds": time.perf_counter() - begin[0], "cpu_seconds": time.process_time() - begin[1]},
    }
    del scan
    trim()
    return record


class KeptScans(Sequence[RangeImage]):
    """Scans in files, read when they are asked for and held by nobody else."""

    def __init__(self, files: Sequence[Path]) -> None:
        self._files = files

    def __len__(self) -> int:
        return len(self._files)

    @overload
    def __getitem__(self, index: int) -> RangeImage: ...
    @overload
    def __getitem__(self, index: slice) -> KeptScans: ...
    def __getitem__(self, index: int | slice) -> RangeImage | KeptScans:
        if isinstance(index, slice):
            return KeptScans(self._files[index])
        return read_npz(self._files[index])[0]
