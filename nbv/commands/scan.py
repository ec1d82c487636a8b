# SPDX-License-Identifier: MIT
"""`unseen scan`: one simulated scan of a scene."""

from __future__ import annotations

import numpy as np

from nbv.commands.run import Shared, running
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor_profile import load_profile
from scenes.checks import InputError
from scenes.files import Units, write_scan
from scenes.loading import open_scene
from scenes.orientation import Axis
from scenes.pose import Pose


def run_scan(
    shared: Shared,
    scene: str,
    *,
    eye: tuple[float, ...],
    target: tuple[float, ...],
    sensor: str,
    noise: str,
    truth: bool,
    up: Axis,
    units: Units,
) -> None:
    """Scan `scene` from `eye` (metres) towards `target` and write the file."""
    with running("scan", shared, default="scan.npz", is_folder=False) as run:
        run.watch.enter("load")
        world = open_scene(scene, up=up, units=units)
        run.warn(world.warnings)
        profile = load_profile(sensor)
        if np.allclose(eye, target):
            raise InputError(f"--at and --look are the same point {list(eye)}; a direction needs two")
        run.watch.enter("scan")
        pose = Pose.looking_at(eye, target)
        taken = scan_scene(
            world, pose, profile.sensor, noise=noise, truth=truth, rng=shared.seed, n_threads=shared.threads
        )
        write_scan(taken, run.out)
        run.outputs.append(run.out)
        returned = taken.ranges[taken.valid]
        summary = {
            "scene": world.name,
            "sensor": profile.sensor.name,
            "noise": taken.noise,
            "sigma_m": taken.sigma_m,
            "rows": taken.shape[0],
            "columns": taken.shape[1],
            "valid_share": float(taken.valid.mean()),
            "range_m": [float(returned.min()), float(returned.max())] if len(returned) else None,
            "warnings": world.warnings,
        }
        line = f"{taken.shape[0]} x {taken.shape[1]} pixels, {taken.valid.mean():.1%} came back"
        if len(returned):
            line += f", {returned.min():.2f} to {returned.max():.2f} m"
        options = {
            "at": eye, "look": target, "sensor": profile.sensor.to_json(), "sources": dict(profile.sources),
            "noise": noise, "effects": taken.noise, "truth": truth, "up": up, "units": units,
        }  # fmt: skip
        errs = "exact ranges" if taken.noise == "none" else f"errs by {taken.noise}"
        run.finish([scene, sensor], options, summary, [line, f"{profile.sensor.name}: {errs}"])
