# SPDX-License-Identifier: MIT
"""The picture of docs/guides/mobile-scans.md: stretches of a walk, and how far they move the ways of beams.

Run it with `python examples/plot_walk.py [--docs FOLDER] [--seconds S]`: it carries a simulated lidar of 16
beams through the built-in office and writes FOLDER/pictures/walk.png (default: docs).
"""

import argparse
from pathlib import Path

import matplotlib as mpl
import numpy as np

mpl.use("Agg")
from matplotlib import pyplot as plt

from benchmarks.cases.spinning import SpinningLidar, carry
from scenes import PointCloud, builtin_scene
from scenes.io.track import Trajectory
from scenes.io.walk import walk_of

ROOT = Path(__file__).resolve().parents[1]
WAY = np.array([[0.6, 0.7, 1.4], [3.3, 0.7, 1.4], [3.4, 2.2, 1.4], [2.4, 2.0, 1.4]])
SPEED_M_S = 1.2


def main(arguments: list[str] | None = None) -> None:
    """Walk, cut and draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--docs", type=Path, default=ROOT / "docs")
    parser.add_argument("--seconds", type=float, default=4.0, help="of the walk")
    asked = parser.parse_args(arguments)
    caster, lidar = builtin_scene("office").ray_caster(), SpinningLidar(n_firings=900)
    beams = carry(
        lidar, lambda origins, rays: caster.first_hit(origins, rays).ranges, WAY,
        speed_m_s=SPEED_M_S, seconds=asked.seconds, rng=np.random.default_rng(0),
    )  # fmt: skip
    moments = np.unique(beams.times)[:: lidar.n_firings // 10]
    first = np.searchsorted(beams.times, moments)
    cloud = PointCloud(beams.points, times=beams.times, name="walk")
    walk, sentences = walk_of(cloud, Trajectory(moments, beams.origins[first]))
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


def _ranges(walk: object) -> np.ndarray:
    """Ranges of some points of a walk, metres."""
    return np.linalg.norm(walk.points[::50] - walk.track.at(walk.times[::50]), axis=1)


if __name__ == "__main__":
    main()
