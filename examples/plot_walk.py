# SPDX-License-Identifier: MIT
"""The pictures of docs/guides/mobile-scans.md: stretches of a walk, and a walk whose track drifts.

Run it with `python examples/plot_walk.py [--docs FOLDER] [--seconds S]`: it carries a simulated lidar of 16
beams through the built-in office and writes walk.png and walk_drift.png to FOLDER/pictures (default: docs).
"""

import argparse
from dataclasses import replace
from pathlib import Path

import matplotlib as mpl
import numpy as np

mpl.use("Agg")
from matplotlib import pyplot as plt

from nbv import Track, TrackErrors, load_sensor, moving_scan, scan_along
from scenes import PointCloud, builtin_scene
from scenes.io.track import Trajectory
from scenes.io.walk import walk_of
from scenes.scan.timed_points import TimedPoints

ROOT = Path(__file__).resolve().parents[1]
WAY = np.array([[0.6, 0.7, 1.4], [3.3, 0.7, 1.4], [3.4, 2.2, 1.4], [2.4, 2.0, 1.4]])
SPEED_M_S, SIGMA_M, RATE_HZ = 1.2, 0.02, 10.0
DRIFT = TrackErrors(position_sd_m=0.06, angle_sd_deg=1.0, drift_s=1.0)
OFFICE = builtin_scene("office")


def main(arguments: list[str] | None = None) -> None:
    """Walk, cut and draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--docs", type=Path, default=ROOT / "docs")
    parser.add_argument("--seconds", type=float, default=4.0, help="of the walk")
    asked = parser.parse_args(arguments)
    exact, track = walked(asked.seconds, TrackErrors())
    noisy = exact.points + SIGMA_M * along(exact) * np.random.default_rng(0).normal(size=(len(exact), 1))
    cloud = PointCloud(noisy, times=exact.times, name="walk")
    walk, sentences = walk_of(cloud, Trajectory(track.times, track.positions))
    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4.2), layout="constrained")
    left.scatter(*walk.points[::50, :2].T, s=0.3, color="0.75", rasterized=True)
    for number, (start, end) in enumerate(walk.cuts.tolist()):
        origin = walk.track.at(walk.times[start:end]).mean(axis=0)
        if number in (1, len(walk.cuts) // 2):
            left.scatter(*walk.points[start:end:3, :2].T, s=0.6, color=f"C{int(number > 1)}", rasterized=True)
        left.plot(*origin[:2], "k.", ms=3)
    left.set(aspect="equal", xlabel="x, m", ylabel="y, m", title="places of the scans, and the points of two")
    share, (middle, step) = np.linspace(0, 1, 100), (np.median(_ranges(walk)), float(walk.steps.max()))
    for times in (0.5, 1, 2, 4):
        right.plot(share, 1000 * times * walk.reach_m * (1 - share), label=f"stretches x {times:g}")
    right.plot(share, 1000 * share * middle * step / 2, "k--", label="half the way to the next beam")
    right.set(xlabel="share of the beam's length", ylabel="largest displacement, mm", ylim=(0, 150))
    right.set_title("displacement of the median beam")
    right.legend(fontsize=8)
    folder = asked.docs / "pictures"
    folder.mkdir(parents=True, exist_ok=True)
    figure.savefig(folder / "walk.png", dpi=100, metadata={"Software": None})
    print(f"walk.png: {sentences[-1]}")
    draw_drift(asked.seconds, folder / "walk_drift.png")


def walked(seconds: float, errors: TrackErrors) -> tuple[TimedPoints, Track]:
    """What the lidar measures on the way, and the track that it reports."""
    corners = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(WAY, axis=0), axis=1)))
    times = np.arange(0.0, seconds + 0.05, 0.1)
    places = np.stack([np.interp(SPEED_M_S * times, corners, axis) for axis in WAY.T], axis=-1)
    lidar = replace(load_sensor("velodyne_vlp16"), width=900)
    scan = moving_scan(lidar, Track.level(times, places), rate_hz=RATE_HZ, errors=errors, rng=3)
    turns = list(scan_along(OFFICE, scan, rng=0))
    joined = {
        name: np.concatenate([getattr(turn, name) for turn in turns])
        for name in ("points", "times", "origins")
    }
    return TimedPoints(**joined), scan.reported


def along(points: TimedPoints) -> np.ndarray:
    """Unit directions (n, 3) of the beams."""
    rays = points.points - points.origins
    return rays / np.linalg.norm(rays, axis=1, keepdims=True)


def draw_drift(seconds: float, path: Path) -> None:
    """Draw a slice of the room by the true track, and by one that drifts."""
    figure, axes = plt.subplots(1, 2, figsize=(10, 4.2), layout="constrained", sharex=True, sharey=True)
    for axis, errors in zip(axes, (TrackErrors(), DRIFT), strict=True):
        points, track = walked(seconds, errors)
        slice_ = np.abs(points.points[:, 2] - 1.2) < 0.1
        drawn = axis.scatter(
            *points.points[slice_, :2].T, s=0.4, c=points.times[slice_], cmap="viridis", rasterized=True
        )
        axis.plot(*track.positions[:, :2].T, "k-", lw=1)
        axis.set(aspect="equal", xlabel="x, m")
    axes[0].set(ylabel="y, m", title="a track without errors")
    axes[1].set_title("a track that drifts: sd 6 cm, 1 deg")
    figure.colorbar(drawn, ax=axes, label="time, s")
    figure.savefig(path, dpi=100, metadata={"Software": None})


def _ranges(walk: object) -> np.ndarray:
    """Ranges of some points of a walk, metres."""
    return np.linalg.norm(walk.points[::50] - walk.track.at(walk.times[::50]), axis=1)


if __name__ == "__main__":
    main()
