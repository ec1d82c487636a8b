# SPDX-License-Identifier: MIT
"""A part's points and its STEP file: a shaft with a fillet and a chamfer, or the files that you give.

Run it with `python examples/plot_step.py [POINTS|MESH...] [-o FOLDER] [--units mm]`: it writes a STEP file
and a picture a part, and prints what became of it. Without files it makes points of a shaft, .02 mm off at
random.
Without the optional kernel (`pip install "unseen[step]"`) it says so and makes nothing.
"""

import argparse
import importlib.util
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection
from plot_parts import shaft

from completion import Part, model_part
from completion.export.step.faces import edges_of, triangles_of
from completion.parts.step_export import outcome_lines, step_model
from scenes.io.point_files import read_part_file
from scenes.scan.colour import surface_rgb

ROOT = Path(__file__).resolve().parents[1]
LIGHT = np.array([0.4, -0.5, 0.77])


def show(name: str, part: Part, out: Path) -> None:
    """Write a part's STEP file and a picture, and print what it came to."""
    model = step_model(part, name)
    (out / f"{name}.step").write_bytes(model.data)
    print(f"{name}: {part!r}")
    print("\n".join(outcome_lines(model)))
    points = 1000 * part.points
    figure = plt.figure(figsize=(10, 4.6), dpi=110)
    cloud, solid = (figure.add_subplot(1, 2, k, projection="3d") for k in (1, 2))
    some = np.random.default_rng(0).permutation(len(points))[:9000]
    colours = np.array([surface_rgb(int(np.searchsorted(part.labels, k)) + 1) for k in part.surface[some]])
    cloud.scatter(*points[some].T, c=colours, s=1.5, linewidths=0)
    corners, triangles = triangles_of(model.shape, 0.002 * float(np.ptp(points)))
    across = np.cross(*(corners[triangles[:, k]] - corners[triangles[:, 0]] for k in (1, 2)))
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-12)
    shade = 0.35 + 0.65 * np.abs(across @ LIGHT / np.linalg.norm(LIGHT))
    solid.add_collection3d(Poly3DCollection(corners[triangles], facecolors=shade[:, None] * [0.7, 0.8, 0.95]))
    solid.add_collection3d(Line3DCollection(edges_of(model.shape), colors="black", linewidths=0.8))
    middle, half = (points.min(axis=0) + points.max(axis=0)) / 2, float(np.ptp(points, axis=0).max()) / 2
    for axes, title in ((cloud, "points, coloured by surface"), (solid, "the STEP file, read as CAD does")):
        axes.set(xlim=middle[0] + np.array([-half, half]), ylim=middle[1] + np.array([-half, half]))
        axes.set(zlim=middle[2] + np.array([-half, half]), title=title)
        axes.set_axis_off()
        axes.view_init(25, -55)
        axes.set_box_aspect((1, 1, 1), zoom=1.35)
    figure.subplots_adjust(0, 0, 1, 0.93, 0, 0)
    figure.savefig(out / f"step_{name}.png")
    plt.close(figure)


def main(arguments: list[str] | None = None) -> None:
    """Show the parts that are named, or the shaft."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("files", nargs="*", metavar="POINTS|MESH")
    parser.add_argument("-o", "--out", type=Path, default=ROOT / "out/step")
    parser.add_argument("--units", choices=("mm", "cm", "m", "in"), default="m")
    asked = parser.parse_args(arguments)
    if importlib.util.find_spec("OCP") is None:
        print('the geometry kernel is not installed, nothing is drawn: pip install "unseen[step]"')
        return
    asked.out.mkdir(parents=True, exist_ok=True)
    if not asked.files:
        show("shaft", model_part(shaft(np.random.default_rng(0))), asked.out)
    for file in asked.files:
        held = read_part_file(file, asked.units)
        show(Path(file).stem, model_part(held.points if held.mesh is None else held.mesh), asked.out)


if __name__ == "__main__":
    main()
