# SPDX-License-Identifier: MIT
"""Parts coloured by surface: a shaft with a fillet and a chamfer, or the points and meshes that you give.

Run it with `python examples/plot_parts.py [POINTS|MESH...] [-o FOLDER] [--units mm]`: it writes two pictures
a part and prints its surfaces and the relations that hold. Without files it makes points of a shaft, .02 mm
off at random. Pictures of others' data stay out of the docs.
"""

import argparse
from pathlib import Path

import numpy as np

from completion import Part, model_part
from nbv.report.figures.part_drawing import PartDrawing, part_pictures
from nbv.report.viewer.part_view import shown_part
from scenes.io.point_files import read_part_file

ROOT = Path(__file__).resolve().parents[1]
SPACING_M, SIGMA_M = 1.2e-3, 2e-5


def shaft(rng: np.random.Generator) -> np.ndarray:
    """Points (n, 3) of two diameters with a fillet between them, a chamfer, and three flat ends; metres."""
    bend = np.linspace(np.pi, 1.5 * np.pi, 12)
    profile = [  # radius and height, m, of what turns about the z axis
        [(0.0, 0.0), (0.03, 0.0)],
        [(0.03, 0.0), (0.03, 0.04)],
        [(0.03, 0.04), (0.021, 0.04)],
        [(0.021 + 0.006 * np.cos(t), 0.046 + 0.006 * np.sin(t)) for t in bend[::-1]],
        [(0.015, 0.046), (0.015, 0.08)],
        [(0.015, 0.08), (0.01, 0.085)],
        [(0.01, 0.085), (0.0, 0.085)],
    ]
    points = np.vstack([turned(np.array(line)) for line in profile])
    return points + rng.normal(0, SIGMA_M, points.shape)


def turned(line: np.ndarray) -> np.ndarray:
    """Points (n, 3), evenly spread, of what a line (k, 2) of radii and heights sweeps about the z axis."""
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    fine = np.linspace(0, along[-1], 400)
    radius = np.interp(fine, along, line[:, 0])
    area = np.concatenate([[0.0], np.cumsum((radius[1:] + radius[:-1]) * np.pi * np.diff(fine))])
    n = round(area[-1] / SPACING_M**2)
    place = np.interp((np.arange(n) + 0.5) / n * area[-1], area, fine)
    turn = np.arange(n) * np.pi * (3 - np.sqrt(5))  # golden angle
    if line.shape[0] > 2:  # round already: on its circle, not on the chords
        angle = 1.5 * np.pi - place / along[-1] * np.pi / 2
        r, z = 0.021 + 0.006 * np.cos(angle), 0.046 + 0.006 * np.sin(angle)
    else:
        r, z = np.interp(place, along, line[:, 0]), np.interp(place, along, line[:, 1])
    return np.column_stack([r * np.cos(turn), r * np.sin(turn), z])


def show(name: str, part: Part, out: Path) -> None:
    """Write two pictures of a part, and print what it is."""
    shown = shown_part(part)
    pictures, _ = part_pictures(PartDrawing(shown.mesh, shown.place))
    for picture, side in zip(pictures, ("above", "below"), strict=True):
        (out / f"part_{name}_{side}.png").write_bytes(picture.png)
    print(f"{name}: {part!r}")
    assert part.relations is not None
    for one in part.relations.relations:
        if one.holds:
            print(f"  {', '.join(str(part.labels[part.related[k]]) for k in one.surfaces)}: {one.kind}")


def main(arguments: list[str] | None = None) -> None:
    """Show the parts that are named, or the shaft."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("files", nargs="*", metavar="POINTS|MESH")
    parser.add_argument("-o", "--out", type=Path, default=ROOT / "out/parts")
    parser.add_argument("--units", choices=("mm", "cm", "m", "in"), default="m")
    asked = parser.parse_args(arguments)
    asked.out.mkdir(parents=True, exist_ok=True)
    if not asked.files:
        show("shaft", model_part(shaft(np.random.default_rng(0))), asked.out)
    for file in asked.files:
        held = read_part_file(file, asked.units)
        show(Path(file).stem, model_part(held.points if held.mesh is None else held.mesh), asked.out)


if __name__ == "__main__":
    main()
