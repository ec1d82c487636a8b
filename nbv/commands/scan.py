# SPDX-License-Identifier: MIT
"""`unseen scan`: simulated scans of a scene, from one place or from each pose of a file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from nbv.commands.process.run import Shared, running
from nbv.run.wording import count
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor_profile import load_profile
from scenes.checks import InputError
from scenes.io.format import Units
from scenes.io.rgbd_writer import check_no_other_frames
from scenes.io.scan_files import split_index, write_scan, write_scans
from scenes.io.scene_files import open_scene
from scenes.io.trajectory import read_poses
from scenes.mesh.orientation import Axis
from scenes.pose import Pose
from scenes.scan.range_image import RangeImage

_EMPTY = "is it looking away from the scene, from within something, or beyond the range of the sensor?"


@dataclass(frozen=True, slots=True)
class Stand:
    """Where the sensor stands: at `eye` looking at `target`, metres; or a file of poses, `FILE#k` for one."""

    eye: tuple[float, ...] | None
    target: tuple[float, ...] | None
    file: str | None = None

    def poses(self) -> dict[int, Pose]:
        """Return the poses by their numbers, from 1.

        Raises
        ------
        InputError
            Unusable file or number, or a place that looks at itself.
        """
        if self.file is None:
            if self.eye is None or self.target is None or np.allclose(self.eye, self.target):
                raise InputError(
                    f"--at and --look are the same point {list(self.eye or ())}; a direction needs two"
                )
            return {1: Pose.looking_at(self.eye, self.target)}
        path, number = split_index(self.file)
        found = dict(enumerate(read_poses(path), start=1))
        if number is None:
            return found
        if number not in found:
            raise InputError(f"{self.file}: there are {len(found)} poses, counted from 1")
        return {number: found[number]}


def run_scan(
    shared: Shared, scene: str, stand: Stand, sensor: str, noise: str, *, truth: bool, up: Axis, units: Units
) -> None:
    """Scan `scene` from where the sensor stands and write the scans."""
    default = Path("scan.npz")
    is_folder = stand.file is not None and not (shared.out or default).suffix
    with running("scan", shared, default=str(default), is_folder=is_folder) as run:
        run.watch.enter("load")
        run.read([scene, sensor, *([stand.file] if stand.file else [])])
        poses = stand.poses()
        world = open_scene(scene, up=up, units=units)
        run.warn(world.warnings)
        profile = load_profile(sensor)
        run.watch.enter("scan")
        caster = world.ray_caster(shared.threads)
        taken = []
        for number, pose in poses.items():
            seed = shared.seed if stand.file is None else np.random.default_rng([shared.seed, number])
            name = "scan" if stand.file is None else f"view {number}"
            taken.append(
                scan_scene(
                    world, pose, profile.sensor, noise=noise, truth=truth, rng=seed, caster=caster,
                    n_threads=shared.threads, name=name,
                )
            )  # fmt: skip
        run.warn(f"{scan.name} met nothing: {_EMPTY}" for scan in taken if not scan.valid.any())
        if is_folder:
            check_no_other_frames(run.out, len(taken))
            write_scans(taken, run.stage.folder)
        elif len(taken) > 1:
            write_scans(taken, run.path())
        else:
            write_scan(taken[0], run.path())
        summary = {"scene": world.name, "sensor": profile.sensor.name, **_summary(taken)}
        options = {
            "at": stand.eye, "look": stand.target, "poses": stand.file and Path(stand.file).name,
            "sensor": profile.sensor.to_json(), "sources": dict(profile.sources),
            "noise": noise, "effects": taken[0].noise, "truth": truth, "up": up, "units": units,
        }  # fmt: skip
        errs = "exact ranges" if taken[0].noise == "none" else f"errs by {taken[0].noise}"
        lines = [_line(taken), f"{profile.sensor.name}: {errs}"]
        run.finish(options, {**summary, "warnings": world.warnings}, lines)


def _summary(taken: Sequence[RangeImage]) -> dict[str, Any]:
    """Headline numbers of all scans together."""
    returned = np.concatenate([scan.ranges[scan.valid] for scan in taken])
    rows, columns = taken[0].shape
    return {
        "scans": len(taken),
        "noise": taken[0].noise,
        "sigma_m": taken[0].sigma_m,
        "rows": rows,
        "columns": columns,
        "valid_share": float(np.mean([scan.valid.mean() for scan in taken])),
        "range_m": [float(returned.min()), float(returned.max())] if len(returned) else None,
    }


def _line(taken: Sequence[RangeImage]) -> str:
    """The headline numbers for people."""
    found = _summary(taken)
    scans = "" if len(taken) == 1 else f"{count(len(taken), 'scan')} of "
    line = f"{scans}{found['rows']} x {found['columns']} pixels, {found['valid_share']:.1%} came back"
    if found["range_m"] is None:
        return line
    return f"{line}, {found['range_m'][0]:.2f} to {found['range_m'][1]:.2f} m"
