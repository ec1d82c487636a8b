# SPDX-License-Identifier: MIT
"""`unseen scan`: simulated scans of a scene, from one place or from each pose of a file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from nbv.commands.options import ScanOptions, Shared
from nbv.commands.process import start_run
from nbv.run.wording import count
from nbv.scanning.beam import Returns
from nbv.scanning.effects import Effects
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import chosen_effects, missing_errors
from nbv.scanning.sensor_profile import load_profile
from scenes.checks import InputError
from scenes.io.formats.format import all_return_suffixes
from scenes.io.poses.trajectory import read_poses
from scenes.io.rgbd.writer import check_no_other_frames
from scenes.io.scan_files import split_index, write_scan, write_scans
from scenes.io.scene_files import open_scene
from scenes.pose import Pose
from scenes.scan.range_image import RangeImage

_EMPTY = "is it looking away from the scene, from within something, or beyond the range of the sensor?"


def poses_of(asked: ScanOptions) -> dict[int, Pose]:
    """Return the poses to scan from by their numbers, from 1.

    Raises
    ------
    InputError
        Unusable file or number, or a place that looks at itself.
    """
    if asked.poses is None:
        if asked.at is None or asked.look is None or np.allclose(asked.at, asked.look):
            raise InputError(
                f"--at and --look are the same point {list(asked.at or ())}; a direction needs two"
            )
        return {1: Pose.looking_at(asked.at, asked.look)}
    path, number = split_index(asked.poses)
    poses = dict(enumerate(read_poses(path), start=1))
    if number is None:
        return poses
    if number not in poses:
        raise InputError(f"{asked.poses}: there are {len(poses)} poses, counted from 1")
    return {number: poses[number]}


def run_scan(shared: Shared, asked: ScanOptions) -> None:
    """Scan a scene from where the sensor stands and write the scans."""
    default, file, noise = Path("scan.npz"), asked.poses, asked.noise
    is_folder = file is not None and not (shared.out or default).suffix
    with start_run("scan", shared, default=str(default), is_folder=is_folder) as run:
        run.watch.enter("load")
        run.read([asked.scene, asked.sensor, *([file] if file else [])])
        poses = poses_of(asked)
        world = open_scene(asked.scene, up=asked.up, units=asked.units)
        profile = load_profile(asked.sensor)
        warnings = [*world.warnings, *missing_errors(profile.sensor, noise)]
        _check_returns(run.out, chosen_effects(profile.sensor, noise), asked.returns)
        run.watch.enter("scan")
        caster = world.ray_caster(shared.threads)
        taken = []
        for number, pose in poses.items():
            seed = shared.seed if file is None else np.random.default_rng([shared.seed, number])
            name = "scan" if file is None else f"view {number}"
            taken.append(
                scan_scene(
                    world, pose, profile.sensor, noise=noise, returns=asked.returns, truth=asked.truth,
                    rng=seed, caster=caster, n_threads=shared.threads, name=name,
                )
            )  # fmt: skip
        run.warn(warnings)
        run.warn(f"{scan.name} has no returns: {_EMPTY}" for scan in taken if not scan.valid.any())
        if is_folder:
            check_no_other_frames(run.out, len(taken))
            write_scans(taken, run.stage.folder)
        elif len(taken) > 1:
            write_scans(taken, run.path())
        else:
            write_scan(taken[0], run.path())
        one = profile.sensor.scan_time_s
        time_s = None if one is None else one * len(taken)
        summary = {
            "scene": world.name, "sensor": profile.sensor.name, **_summary(taken), "scan_time_s": time_s
        }  # fmt: skip
        options = {
            "at": asked.at, "look": asked.look, "poses": file and Path(file).name,
            "sensor": profile.sensor.to_json(), "sources": dict(profile.sources), "noise": noise,
            "effects": taken[0].noise, "returns": asked.returns, "truth": asked.truth, "up": asked.up,
            "units": asked.units,
        }  # fmt: skip
        errors = "exact ranges" if taken[0].noise == "none" else f"range errors: {taken[0].noise}"
        speed = "" if time_s is None else f"; {time_s:.3g} s or more of measuring"
        lines = [_line(summary), f"{profile.sensor.name}: {errors}{speed}"]
        run.finish(options, {**summary, "warnings": warnings}, lines)


def _check_returns(out: Path, effects: Effects, returns: Returns | None) -> None:
    """Raise InputError where all returns are asked for, and the format of `out` holds the first alone."""
    held = all_return_suffixes()
    if (returns == "all" or effects.keeps_all_returns) and out.suffix.lower() not in held:
        kind = out.suffix or "a folder"
        raise InputError(f"{out}: {kind} holds one return a beam; write all returns to {', '.join(held)}")


def _summary(taken: Sequence[RangeImage]) -> dict[str, Any]:
    """Headline numbers of all scans together."""
    returned = np.concatenate([scan.ranges[scan.valid] for scan in taken])
    rows, columns = taken[0].shape
    lists = [scan.echoes for scan in taken if scan.echoes is not None]
    further = {"further_returns": sum(map(len, lists))} if lists else {}
    return {
        "scans": len(taken),
        "noise": taken[0].noise,
        "sigma_m": taken[0].sigma_m,
        "rows": rows,
        "columns": columns,
        "valid_share": float(np.mean([scan.valid.mean() for scan in taken])),
        "range_m": [float(returned.min()), float(returned.max())] if len(returned) else None,
        **further,
    }


def _line(summary: Mapping[str, Any]) -> str:
    """Return the summary in one line."""
    n_scans, span = summary["scans"], summary["range_m"]
    scans = "" if n_scans == 1 else f"{count(n_scans, 'scan')} of "
    line = (
        f"{scans}{summary['rows']} x {summary['columns']} pixels, {summary['valid_share']:.1%} with a return"
    )
    line = line if span is None else f"{line}, ranges {span[0]:.2f} to {span[1]:.2f} m"
    n_further = summary.get("further_returns")
    return line if n_further is None else f"{line}, {count(n_further, 'further return')}"
