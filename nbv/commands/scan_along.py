# SPDX-License-Identifier: MIT
"""`unseen scan --trajectory`: points of a sensor that moves, with times, and the track that it reports."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from nbv.commands.options.planning import ScanOptions
from nbv.commands.options.shared import Shared
from nbv.commands.process import Run, start_run
from nbv.run.wording import count, duration
from nbv.scanning.motion import TrackErrors, read_track
from nbv.scanning.moving import MovingScan, moving_scan, scan_along
from nbv.scanning.sensor import missing_errors
from nbv.scanning.sensor_profile import load_profile
from scenes.io.clouds.timed import check_timed, write_timed
from scenes.io.poses.trajectory import write_timed_poses
from scenes.io.scene_files import open_scene
from scenes.scan.timed_points import TimedPoints
from scenes.world.scene import Scene

_FULL_LIGHT = 1.0  # that a white surface sends back from 1 m, face on


def run_scan_along(shared: Shared, asked: ScanOptions) -> None:
    """Scan along a track; write the points and the track that the platform reports."""
    with start_run("scan", shared, default="walk.las", is_folder=False) as run:
        run.watch.enter("load")
        run.read([asked.scene, asked.sensor, str(asked.trajectory)])
        check_timed(run.out)
        track = read_track(Path(str(asked.trajectory)))
        profile = load_profile(asked.sensor)
        rng = np.random.default_rng(shared.seed)
        errors = TrackErrors(**asked.track_errors())
        scan = moving_scan(
            profile.sensor, track, rate_hz=asked.rate_hz, noise=asked.noise, returns=asked.returns,
            errors=errors, rng=rng.spawn(1)[0],
        )  # fmt: skip
        scene = open_scene(asked.scene, up=asked.up, units=asked.units)
        warnings = [*scene.warnings, *missing_errors(profile.sensor, asked.noise)]
        run.warn(warnings)
        run.watch.enter("scan")
        parts = _counted(run, scene, scan, rng.spawn(1)[0])
        about = track.positions.mean(axis=0)
        n = write_timed(parts, run.path(), about=about, full_light=_FULL_LIGHT)
        name = f"{run.out.stem}_trajectory.txt"
        write_timed_poses(run.path(name), scan.reported.times, scan.reported.poses())
        length = float(np.linalg.norm(np.diff(track.positions, axis=0), axis=1).sum())
        summary = {
            "scene": scene.name, "sensor": profile.sensor.name, "points": n, "turns": scan.n_turns,
            "rate_hz": scan.rate_hz, "seconds": track.seconds, "length_m": length, "trajectory": name,
        }  # fmt: skip
        options = {
            "trajectory": Path(str(asked.trajectory)).name, "sensor": profile.sensor.to_json(),
            "sources": dict(profile.sources), "noise": asked.noise, "effects": scan.effects.describe(),
            "returns": asked.returns, "track_errors": asked.track_errors(), "up": asked.up,
            "units": asked.units,
        }  # fmt: skip
        lines = [
            f"{count(n, 'point')} of {count(scan.n_turns, 'turn')} in {duration(track.seconds)} along "
            f"{length:.1f} m",
            f"the reported track is {name}: unseen info {run.out.name} --trajectory {name}",
        ]
        run.finish(options, {**summary, "warnings": warnings}, lines)


def _counted(run: Run, scene: Scene, scan: MovingScan, rng: np.random.Generator) -> Iterator[TimedPoints]:
    """The points turn by turn, with progress."""
    tell: Any = run.progress
    for number, part in enumerate(scan_along(scene, scan, rng=rng, n_threads=run.shared.threads), start=1):
        tell("scan", number, scan.n_turns)
        yield part
