# SPDX-License-Identifier: MIT
"""A bracket with rounded corners and a pipe with an elbow, and what is found of them.

Run it with `python examples/plot_junctions.py [--docs FOLDER]`: it writes junctions.png into FOLDER/pictures
(default: docs) and prints what was found; millimetres.
"""

import argparse
from pathlib import Path

import matplotlib as mpl
import numpy as np

from completion.features.engine.template import FeatureStatus, Measurements, TemplateFit
from completion.features.junctions.pipeline import find_junctions

mpl.use("Agg")
import matplotlib.pyplot as plt

ROOT = Path(__file__).resolve().parents[1]
_COLOURS = np.array(["#c8c8c8", "#c05621", "#2b6cb0", "#2f855a"])


def bracket(rng: np.random.Generator) -> np.ndarray:
    """A plate and two walls, corners rounded by 6 and 9; a twentieth of the points anywhere."""
    pieces = []
    for length, start, way in (
        (40.0, (6.0, 0.0), (1.0, 0.0)),
        (30.0, (0.0, 36.0), (0.0, -1.0)),
        (35.0, (55.0, 9.0), (0.0, 1.0)),
    ):
        pieces.append(np.array(start) + rng.uniform(0, length, 900)[:, None] * np.array(way))
    for radius, middle, first in ((6.0, (6.0, 6.0), np.pi), (9.0, (46.0, 9.0), 1.5 * np.pi)):
        turn = first + rng.uniform(0, np.pi / 2, 400)
        pieces.append(np.array(middle) + radius * np.column_stack([np.cos(turn), np.sin(turn)]))
    flat = np.concatenate(pieces)
    points = np.column_stack([flat, rng.uniform(0, 30, len(flat))]) + rng.normal(0, 0.05, (len(flat), 3))
    points[::20] = rng.uniform(points.min(axis=0), points.max(axis=0), points[::20].shape)
    return points


def pipe(rng: np.random.Generator, n: int = 3_000) -> np.ndarray:
    """A pipe of radius 25 that turns by 90 degrees about 60; a tenth of the points anywhere."""
    along = rng.uniform(-1, 1, n) * (60 * np.pi / 4 + 70)
    around = rng.uniform(-0.2, 2.6, n)
    turn = np.clip(along / 60, -np.pi / 4, np.pi / 4)
    beyond, out = along - 60 * turn, 60 + 25 * np.cos(around)
    x, y = out * np.cos(turn) - beyond * np.sin(turn), out * np.sin(turn) + beyond * np.cos(turn)
    points = np.column_stack([x, y, 25 * np.sin(around)]) + rng.normal(0, 0.5, (n, 3))
    points[::10] = rng.uniform(points.min(axis=0), points.max(axis=0), points[::10].shape)
    return points


def told(fit: TemplateFit) -> str:
    """A fit in one line."""
    if fit.kind == "elbow":
        names = ("bend_radius", "tube_radius")
        turn, sd = np.degrees(fit.value("angle")), np.degrees(fit.deviation("angle"))
        first = f"angle {turn:.1f} ± {sd:.1f} deg, "
    else:
        names, first = ("radius_1",), ""
    return first + ", ".join(
        f"{name.split('_')[0]} {fit.value(name):.2f} ± {fit.deviation(name):.2f}" for name in names
    )


def draw(axes: plt.Axes, points: np.ndarray, fits: list[TemplateFit]) -> None:
    """Draw points in the colours of their faces, and where these touch."""
    seen = points @ np.array([[0.9, 0.1], [0.1, 0.9], [-0.45, 0.35]])
    face = np.max([fit.assignment for fit in fits], axis=0)
    axes.scatter(*seen.T, s=2, c=_COLOURS[face])
    for fit in fits:
        ends = np.asarray(fit.geometry["joint"]) @ np.array([[0.9, 0.1], [0.1, 0.9], [-0.45, 0.35]])
        axes.plot(*ends.T, "k-" if fit.kind == "junction" else "k.", lw=1.5)
    lines = [told(fit) for fit in fits]
    axes.set_title("\n".join(", ".join(lines[k : k + 2]) for k in range(0, len(lines), 2)), fontsize=9)
    axes.set_aspect("equal")
    axes.set_axis_off()


def main(arguments: list[str] | None = None) -> None:
    """Find them, and write the picture."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--docs", type=Path, default=ROOT / "docs")
    folder = parser.parse_args(arguments).docs / "pictures"
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(1)
    figure, sides = plt.subplots(1, 2, figsize=(11, 5))
    for axes, kind, points, noise in (
        (sides[0], "junction", bracket(rng), 0.05),
        (sides[1], "elbow", pipe(np.random.default_rng(0)), 0.5),
    ):
        found = find_junctions(Measurements(points, noise, 1.5), [kind], rng=np.random.default_rng(0))
        found = [fit for fit in found if fit.status is FeatureStatus.FOUND]
        for fit in found:
            print(f"{fit.kind}: {told(fit)}, {fit.evidence:.0f} nats")
        draw(axes, points, found)
    figure.tight_layout()
    figure.savefig(folder / "junctions.png", dpi=90)
    plt.close(figure)


if __name__ == "__main__":
    main()
