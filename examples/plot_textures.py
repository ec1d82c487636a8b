# SPDX-License-Identifier: MIT
"""Pictures of docs/results/texture.md: before, hole, fill, source of each pixel; and its table.

    python examples/plot_textures.py [--docs docs] [--quick]

scikit-image's brick, grass and gravel and a wall of running bond need nothing else; ambientCG's bricks and
carpets (CC0) are read from the data that CONTRIBUTING.md speaks of, and left out, saying so, where these are
absent. For each fill a row says the window that the self-check chose, the processor's seconds with it,
distance and seam relative to what was cut out, phase error, confidence and alarms. `--quick` takes small
pieces.
"""

import argparse
import os
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import matplotlib as mpl
import numpy as np
from numpy.typing import NDArray
from PIL import Image
from skimage import data

mpl.use("Agg")
from matplotlib import pyplot as plt

from texture import Synthesis, examine, fill, measure_distance, measure_phase_error, measure_seam

ROOT = Path(__file__).resolve().parents[1]
SHEETS = {"Bricks": ((8, 1), (10, 0), (14, 4)), "Carpet": ((0, 1), (0, 4), (1, 1))}  # row, column of a tile
TILES = ("Bricks058", "Bricks071", "Bricks092", "Carpet002", "Carpet005", "Carpet009")
PICTURES = ("texture_fills.jpg", "texture_windows.jpg", "texture_fills_data.jpg")


class Case(NamedTuple):
    """An image and the hole that is cut into it."""

    name: str
    image: NDArray[np.uint8]
    hole: NDArray[np.bool_]


def cut(name: str, image: NDArray[np.uint8], side: int) -> Case:
    """Cut a square hole into the middle of an image."""
    hole = np.zeros(image.shape[:2], dtype=np.bool_)
    first = [(size - side) // 2 for size in hole.shape]
    hole[first[0] : first[0] + side, first[1] : first[1] + side] = True
    return Case(name, image, hole)


def list_photographs(size: int) -> list[Case]:
    """List scikit-image's textures, cut to a square."""
    middle = np.s_[256 - size // 2 : 256 + size // 2]
    return [
        cut(name, getattr(data, name)()[middle, middle], size // 4) for name in ("brick", "grass", "gravel")
    ]


def build_wall(size: int) -> Case:
    """Build a wall of running bond: courses of 16 pixels, bricks of 40, no two of one tone."""
    rng = np.random.default_rng(0)
    rows, columns = np.indices((size, size))
    course = rows // 16
    along = columns + course % 2 * 20
    tones = rng.normal(110, 10, (size // 16 + 1, size // 40 + 2))[course, along // 40]
    values = np.where((rows % 16 < 3) | (along % 40 < 3), 210, tones) + rng.normal(0, 12, rows.shape)
    return cut("running bond", np.clip(values, 0, 255).astype(np.uint8), size // 4)


def read_tiles() -> list[Case]:
    """Read ambientCG's tiles, 128 x 128 pixels each, from the contact sheets; none where these are absent."""
    folder = Path(os.environ.get("UNSEEN_DATA", ROOT.parent / "shared/data")) / "textures"
    tiles = []
    for sheet, places in SHEETS.items():
        path = folder / f"ambientcg_{sheet}.webp"
        if not path.exists():
            print(f"no {path}: its tiles are left out (set UNSEEN_DATA)")
            return []
        with Image.open(path) as opened:
            pixels = np.array(opened.convert("RGB"))
        for row, column in places:
            tiles.append(pixels[16 + 176 * row : 144 + 176 * row, 16 + 144 * column : 144 + 144 * column])
    return [cut(name, tile, 36) for name, tile in zip(TILES, tiles, strict=True)]


def colour_sources(made: Synthesis, hole: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return a picture of where pixels came from: red by row, green by column; the known part paler."""
    height, width = hole.shape
    colours = np.stack(
        [made.source_rows / height, made.source_cols / width, np.full(hole.shape, 0.5)], axis=2
    )
    return np.where(hole[..., None], colours, 0.6 + 0.4 * colours).clip(0, 1)


def describe(case: Case, made: Synthesis, seconds: float) -> str:
    """Return a row of the table."""
    rows, columns = np.nonzero(case.hole)
    here = np.s_[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1]
    side = here[0].stop - here[0].start
    pieces = [
        (top, left)
        for top in range(0, len(case.hole) - side + 1, side)
        for left in (0, len(case.hole) - side)
    ]
    others = [case.image[top : top + side, left : left + side] for top, left in pieces]
    scale = np.mean([measure_distance(other, case.image[here]) for other in others])
    distance = measure_distance(made.image[here], case.image[here]) / scale
    found = examine(made, case.hole)
    phase = "-" if np.isnan(found.phase_error) else f"{found.phase_error:.2f}"
    seam = measure_seam(made.image, case.hole, case.image)
    cells = [case.name, made.window, f"{seconds:.1f}", f"{distance:.2f}", f"{seam:.2f}", phase,
             f"{found.confidence:.2f}", ", ".join(found.alarms) or "none"]  # fmt: skip
    return f"| {' | '.join(map(str, cells))} |"


def draw(panels: Sequence[tuple[str, NDArray[np.generic]]], n_columns: int, path: Path) -> None:
    """Write titled panels as one picture."""
    n_rows = -(-len(panels) // n_columns)
    figure, axes = plt.subplots(
        n_rows, n_columns, figsize=(2.1 * n_columns, 2.35 * n_rows), layout="constrained", squeeze=False
    )
    for ax in axes.flat:
        ax.axis("off")
    for ax, (title, image) in zip(axes.flat, panels, strict=False):
        ax.imshow(image, cmap="gray", vmin=0, vmax=255, interpolation="nearest")
        ax.set_title(title, fontsize=9)
    figure.savefig(path, dpi=100, pil_kwargs={"quality": 75})
    plt.close(figure)
    print(path.name)


def show_fills(cases: Sequence[Case], n_columns: int, path: Path) -> list[str]:
    """Fill each case with the window that the self-check chooses; write the picture, return rows."""
    panels, rows = [], []
    for case in cases:
        start = time.process_time()
        made = fill(case.image, case.hole, order="window", rng=0, n_threads=1)
        rows.append(describe(case, made, time.process_time() - start))
        blank = np.where(case.hole if case.image.ndim == 2 else case.hole[..., None], 0, case.image)
        panels += [(case.name, case.image), ("hole", blank.astype(np.uint8))]
        panels += [
            (f"filled, window {made.window}", made.image),
            ("where from", colour_sources(made, case.hole)),
        ]
    draw(panels, n_columns, path)
    return rows


def show_windows(case: Case, windows: Sequence[int], path: Path) -> None:
    """Fill with one window after the other; write the picture, with phase errors."""
    blank = np.where(case.hole, 0, case.image).astype(np.uint8)
    panels: list[tuple[str, NDArray[np.generic]]] = [("hole", blank)]
    for window in windows:
        made = fill(case.image, case.hole, window=window, order="window", rng=0)
        error = measure_phase_error(made.image, case.hole)
        panels.append((f"window {window}: {error:.2f} out of step", made.image))
    draw(panels, len(panels), path)


def main(argv: Sequence[str] | None = None) -> None:
    """Write the pictures and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--docs", type=Path, default=ROOT / "docs")
    parser.add_argument("--quick", action="store_true")
    arguments = parser.parse_args(argv)
    size = 96 if arguments.quick else 256
    fill(np.eye(20), np.eye(20) > 0, window=3, rng=0)  # compiled once
    fills, windows, tiles = (arguments.docs / "pictures" / name for name in PICTURES)
    fills.parent.mkdir(parents=True, exist_ok=True)
    wall = build_wall(160 if arguments.quick else 256)
    rows = show_fills(list_photographs(size), 4, fills)
    show_windows(wall, (7, 23) if arguments.quick else (7, 15, 23, 31), windows)
    read = read_tiles()[: 1 if arguments.quick else None]
    rows += show_fills(read, 4 if arguments.quick else 8, tiles) if read else []
    print("| texture | window | seconds | distance | seam | phase error | confidence | alarms |")
    print("\n".join(["|---|---|---|---|---|---|---|---|", *rows]))


if __name__ == "__main__":
    main()
