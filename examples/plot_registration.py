# SPDX-License-Identifier: MIT
"""Scans without poses brought together: four views of the built-in office, or the scans that you give.

Run it with `python examples/plot_registration.py [SCAN...] [-o FOLDER]`: it writes a plan of each group as
registration_1.png and so on, and prints what is known of each pair. Without files a camera takes four scans
of the office, and each is put into a world of its own.
"""

import argparse
from pathlib import Path

import matplotlib as mpl
import numpy as np

from completion import register_scans
from nbv import PinholeSensor, scan_scene
from scenes import Pose, RangeImage, builtin_scene, read_scans

mpl.use("Agg")
from matplotlib import pyplot as plt

ROOT = Path(__file__).resolve().parents[1]
CAMERA = PinholeSensor(fov_deg=75, width=320, height=240, max_range_m=12.0)
LOOKS = (
    ((1.2, 2.9, 1.5), (3.5, 1.0, 0.9)),
    ((2.2, 3.1, 1.4), (3.2, 0.8, 0.9)),
    ((3.0, 2.8, 1.6), (1.8, 0.6, 0.8)),
    ((2.6, 1.9, 1.5), (0.6, 0.8, 0.8)),
)


def lost_scans() -> list[RangeImage]:
    """Take four scans of the office; each knows nothing of where it was taken."""
    scene = builtin_scene("office")
    return [
        scan_scene(
            scene, Pose.looking_at(eye, target), CAMERA, noise="gaussian-2mm", rng=k, truth=False
        ).with_facts(world_from_sensor=Pose.identity(), name=f"scan {k + 1}")
        for k, (eye, target) in enumerate(LOOKS)
    ]


def main() -> None:
    """Register the scans, draw each group and print what is known."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scans", nargs="*", type=Path)
    parser.add_argument("-o", "--out", type=Path, default=ROOT / "docs/pictures")
    given = parser.parse_args()
    scans = [scan for path in given.scans for scan in read_scans(path)] or lost_scans()
    found = register_scans(scans)
    given.out.mkdir(parents=True, exist_ok=True)
    for number, network in enumerate(found.groups, start=1):
        figure, panels = plt.subplots(1, 2, figsize=(9.6, 4.4), layout="constrained")
        for panel, title in zip(panels, ("as the scans came", "registered"), strict=True):
            for k, (scan, pose) in enumerate(network.group.poses.items()):
                held = pose if title == "registered" else np.eye(4)[:3]
                places = found.views[scan].facets.centre @ held[:, :3].T + held[:, 3]
                panel.plot(
                    places[:, 0], places[:, 2], ".", markersize=1.5, color=f"C{k}", label=str(scan + 1)
                )
                panel.plot(*held[[0, 2], 3], "o", color=f"C{k}", markeredgecolor="black")
            panel.set_aspect("equal")
            panel.set_title(title)
            panel.set_xlabel("m, right of the first scan")
            panel.set_ylabel("m, ahead of it")
        panels[1].legend(title="scan", markerscale=6)
        figure.savefig(given.out / f"registration_{number}.png", dpi=120, metadata={"Software": None})
        plt.close(figure)
    for pair in found.pairs:
        one, two = (number + 1 for number in pair.scans)
        share, against = 100 * pair.overlap, 100 * pair.violations
        print(f"{one} and {two}: {pair.verdict.value}, {share:.0f} % agrees, {against:.1f} % is contradicted")


if __name__ == "__main__":
    main()
