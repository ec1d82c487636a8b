# SPDX-License-Identifier: MIT
"""A row, a grid and a bolt circle in plates of which patches were lost: what is fitted, and what is seen.

Run it with `python examples/plot_holes.py [--docs FOLDER]`: it writes pictures/hole_patterns.png.
"""

import argparse
from pathlib import Path

import matplotlib as mpl
import numpy as np

mpl.use("Agg")
from matplotlib import pyplot as plt

from benchmarks.cases.plates import plate
from completion.features.engine.template import SideState
from completion.features.holes.patterns import KINDS
from completion.features.holes.pipeline import find_holes

ROOT = Path(__file__).resolve().parents[1]
COLOURS = {SideState.CONFIRMED: "#1b7837", SideState.UNSEEN: "#2166ac", SideState.CONTRADICTED: "#b2182b"}
SEEDS = (11, 1, 5)


def draw(kind: str, seed: int, axes: plt.Axes) -> None:
    """Draw one plate in its own plane with the fitted pattern."""
    rng = np.random.default_rng(seed)
    truth = plate(rng, kind)
    fit = find_holes(truth.measured, [kind], {}, rng=rng, budget=10**7)[0]
    centres = np.asarray(fit.geometry["centres"])
    normal = np.asarray(fit.geometry["axis"])
    along = np.linalg.svd(truth.measured.points - truth.measured.points.mean(axis=0), full_matrices=False)[2][
        0
    ]
    along -= (along @ normal) * normal
    frame = np.stack([along / np.linalg.norm(along), np.cross(normal, along) / np.linalg.norm(along)])
    near = np.abs((truth.measured.points - centres[0]) @ normal) < 4 * truth.measured.noise
    axes.scatter(*((truth.measured.points[near] - centres[0]) @ frame.T).T, s=0.5, c="0.6", linewidths=0)
    for number, (centre, side) in enumerate(zip((centres - centres[0]) @ frame.T, fit.sides, strict=True)):
        colour = COLOURS[side.state]
        axes.add_patch(plt.Circle(centre, fit.value("radius"), fill=False, color=colour, lw=1.4))
        axes.annotate(str(number + 1), centre, ha="center", va="center", color=colour, fontsize=8)
    axes.set_title(
        f"{kind}: {fit.status}, {fit.geometry['count']} holes\n{fit.reason or 'all seen'}", fontsize=8
    )
    axes.set_aspect("equal")
    axes.set_axis_off()


def main(arguments: list[str] | None = None) -> None:
    """Draw a plate a kind."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--docs", type=Path, default=ROOT / "docs")
    asked = parser.parse_args(arguments)
    figure, axes = plt.subplots(1, 3, figsize=(11, 3.2), layout="constrained")
    for kind, seed, one in zip(KINDS, SEEDS, axes, strict=True):
        draw(kind, seed, one)
    (asked.docs / "pictures").mkdir(parents=True, exist_ok=True)
    figure.savefig(asked.docs / "pictures/hole_patterns.png", dpi=110)
    plt.close(figure)


if __name__ == "__main__":
    main()
