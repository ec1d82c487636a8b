# SPDX-License-Identifier: MIT
"""Exploration: the views of an online planner, what it knew after each, and its files."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from nbv.online.occupancy import OCCPLANE, UNSEEN, VoxelMap
from nbv.run.showing import show_report
from nbv.run.wording import count, square_metres
from nbv.scanning.sensor import Sensor
from nbv.visibility.requirement import Requirement
from scenes.checks import Value
from scenes.io.poses.trajectory import write_timed_poses
from scenes.io.scan_files import write_scan
from scenes.pose import Pose
from scenes.run.atomic import Stage, make_folder, write_json, write_text
from scenes.run.csv_table import csv_text
from scenes.run.libraries import table_of
from scenes.scan.range_image import RangeImage

CURVE = ("views", "expected_gain_m2", "measured_m2", "met_m2", "unknown_m2")


@dataclass(frozen=True, slots=True, eq=False)
class Step(Value):
    """One view of an exploration.

    Attributes
    ----------
    world_from_sensor : Pose
        Where the sensor stood.
    expected_gain_m2 : float or None
        What was expected of it; None for a start.
    scan : RangeImage
        What it measured.
    measured_m2, met_m2 : float
        Area of surface in the voxels that is measured after it, and measured as required.
    unknown_m2 : float
        Area of voxel faces between known empty space and the unknown: a boundary, not surface.
    """

    world_from_sensor: Pose
    expected_gain_m2: float | None
    scan: RangeImage
    measured_m2: float
    met_m2: float
    unknown_m2: float

    @classmethod
    def of(
        cls, pose: Pose, expected: float | None, scan: RangeImage, voxels: VoxelMap, min_cosine: float
    ) -> Step:
        """Return the step after which `voxels` are known; `min_cosine` is required."""
        surfels, faces = voxels.surfels, voxels.boundary()
        label = voxels.labels[faces.voxel]
        return cls(
            pose,
            expected,
            scan,
            measured_m2=float(surfels.areas.sum()),
            met_m2=float(surfels.areas[surfels.quality >= min_cosine].sum()),
            unknown_m2=float(np.isin(label, (OCCPLANE, UNSEEN)).sum()) * voxels.grid.voxel_m**2,
        )


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Exploration(Value):
    """What an online planner did: its steps, what it knows in the end, and why it stopped.

    Attributes
    ----------
    steps : tuple of Step
        Its views in order.
    voxels : VoxelMap
        What it knows.
    stopped_because : str
        Why there are no more views.
    sensor, requirement
        What scanned, and what counts as seen well.
    from_outside : bool
        Whether the sensor moved around the volume.
    given : tuple of RangeImage
        Scans that were taken before.
    """

    steps: tuple[Step, ...]
    voxels: VoxelMap
    stopped_because: str
    sensor: Sensor
    requirement: Requirement
    from_outside: bool = False
    given: tuple[RangeImage, ...] = ()

    @property
    def scans(self) -> tuple[RangeImage, ...]:
        """The scans of its views, in order."""
        return tuple(step.scan for step in self.steps)

    def curve(self) -> list[dict[str, float | None]]:
        """Return a row for each view, as of the table that `to_pandas` makes."""
        return [
            {"views": number, **{name: getattr(step, name) for name in CURVE[1:]}}
            for number, step in enumerate(self.steps, start=1)
        ]

    def to_pandas(self) -> Any:
        """Return the curve as a `pandas.DataFrame`; raises InputError without pandas."""
        return table_of(self.curve())

    def save(self, folder: str | os.PathLike[str], *, scans: bool = True) -> None:
        """Write `exploration.json`, `curve.csv`, `trajectory.txt` and, where asked, `scans/NNNN.npz`.

        All files appear together or not at all. Raises InputError: the folder cannot be written.
        """
        with Stage(make_folder(Path(folder))) as stage:
            write_json(stage.path("exploration.json"), self.to_json())
            rows = [list(row.values()) for row in self.curve()]
            write_text(stage.path("curve.csv"), csv_text(CURVE, rows))
            poses = [step.world_from_sensor for step in self.steps]
            write_timed_poses(stage.path("trajectory.txt"), np.arange(1.0, len(poses) + 1), poses)
            for number, scan in enumerate(self.scans if scans else (), start=1):
                write_scan(scan, stage.path(f"scans/{number:04d}.npz"))
            stage.commit(last="exploration.json")

    def to_json(self) -> dict[str, Any]:
        """Return the contents of `exploration.json`."""
        return {
            "sensor": self.sensor.to_json(),
            "requirement": self.requirement.to_json(),
            "from_outside": self.from_outside,
            "given": len(self.given),
            "steps": [
                {**row, "world_from_sensor": step.world_from_sensor.matrix.tolist()}
                for row, step in zip(self.curve(), self.steps, strict=True)
            ],
            "stopped_because": self.stopped_because,
        }

    def show(self, *, n_threads: int | None = None) -> Path:
        """Show the report of what its scans measured and where the unknown begins; see `nbv.show`."""
        return show_report(self, n_threads=n_threads)

    def _facts(self) -> list[tuple[str, str]]:
        """Views, what they measured, what stays unknown, and why there are no more."""
        last = (
            [
                ("measured", f"{square_metres(step.measured_m2)} m\u00b2"),
                ("as required", f"{square_metres(step.met_m2)} m\u00b2"),
                ("boundary of the unknown", f"{square_metres(step.unknown_m2)} m\u00b2"),
            ]
            if (step := self.steps[-1] if self.steps else None)
            else []
        )
        return [("views", str(len(self.steps))), *last, ("stopped because", self.stopped_because)]

    def __repr__(self) -> str:
        met = f", {square_metres(self.steps[-1].met_m2)} m2 measured as required" if self.steps else ""
        return f"Exploration({count(len(self.steps), 'view')}{met}; stopped because: {self.stopped_because})"
