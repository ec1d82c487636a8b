# SPDX-License-Identifier: MIT
"""Hold the window that the self-check chooses against the window that fills best, where the truth is known.

The textures of `plot_textures.py`, square tiles, and two photographs in colour where the data are; each with
two holes of a fifth of its side, two seeds, window order. The cost of a window is the distance to what was
cut out, relative to other pieces, times 1 + 5 phase errors (mean over holes and seeds). A row of the table
says the best of 7, 11, 15, 23, 31, the chosen one, the cost of that over the best's (between windows by
interpolation), that of each of the five, and the processor's seconds that the choice took.

    python examples/score_windows.py
"""

import os
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from plot_textures import ROOT, Case, build_wall, cut, list_photographs, read_tiles

from texture import fill, find_lattice, measure_distance, measure_phase_error

WINDOWS = (7, 11, 15, 23, 31)


def build_tiles(size: int = 256, period: int = 28) -> Case:
    """Build square tiles with dark joints, no two of one tone."""
    rng = np.random.default_rng(0)
    rows, columns = np.indices((size, size))
    tones = rng.normal(180, 8, (size // period + 1,) * 2)[rows // period, columns // period]
    values = np.where((rows % period < 3) | (columns % period < 3), 60, tones) + rng.normal(0, 12, rows.shape)
    return cut("tiles", np.clip(values, 0, 255).astype(np.uint8), size // 5)


def read_photographs() -> list[Case]:
    """Read two photographs in colour; none where they are absent."""
    folder = Path(os.environ.get("UNSEEN_DATA", ROOT.parent / "shared/data")) / "textures"
    names = [name for name in ("pebbles", "woodenFloor") if (folder / f"sh3d_{name}.jpg").exists()]
    images = [np.array(Image.open(folder / f"sh3d_{name}.jpg").convert("RGB")) for name in names]
    return [cut(name, image, len(image) // 5) for name, image in zip(names, images, strict=True)]


def list_holes(case: Case) -> list[NDArray[np.bool_]]:
    """List two holes of a fifth of the side: in the middle, and above it to the right."""
    side = len(case.hole) // 5
    middle = cut(case.name, case.image, side).hole
    return [middle, np.roll(middle, (-(len(middle) // 4), len(middle) // 5), axis=(0, 1))]


def measure_costs(case: Case) -> list[float]:
    """Return the mean cost of each window."""
    lattice = find_lattice(case.image)
    costs = np.zeros(len(WINDOWS))
    for hole in list_holes(case):
        rows, columns = np.nonzero(hole)
        side = int(np.ptp(rows)) + 1
        here = np.s_[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1]
        corners = range(0, len(hole) - side + 1, side)
        pieces = [np.s_[top : top + side, left : left + side] for top in corners for left in corners]
        others = [case.image[piece] for piece in pieces if not hole[piece].any()]
        scale = np.mean([measure_distance(other, case.image[here]) for other in others])
        for place, window in enumerate(WINDOWS):
            for seed in (0, 1):
                made = fill(case.image, hole, window=window, order="window", rng=seed).image
                phase = float(np.nan_to_num(measure_phase_error(made, hole, lattice=lattice)))
                costs[place] += measure_distance(made[here], case.image[here]) / scale * (1 + 5 * phase) / 4
    return costs.tolist()


def main() -> None:
    """Print the table."""
    fill(np.eye(20), np.eye(20) > 0, window=3, rng=0)  # compiled once
    ratios = []
    print(f"| texture | best | chosen | cost | of {' | '.join(map(str, WINDOWS))} | seconds |")
    print(f"|---|---|---|---|{len(WINDOWS) * '---|'}---|")
    cases = [*list_photographs(256), build_wall(256), build_tiles(), *read_tiles(), *read_photographs()]
    for case in cases:
        costs = measure_costs(case)
        start = time.process_time()
        hole = list_holes(case)[0]
        chosen = fill(case.image, hole, order="window", rng=0, n_threads=1, time_budget_s=1e-9).window
        seconds = time.process_time() - start
        relative = np.array(costs) / min(costs)
        ratios.append([float(np.interp(chosen, WINDOWS, relative)), *relative])
        best = WINDOWS[int(np.argmin(costs))]
        print(f"| {case.name} | {best} | {chosen} | {tell(ratios[-1])} | {seconds:.1f} |", flush=True)
    print(f"| mean of {len(ratios)} | | | {tell(np.mean(ratios, axis=0))} | |")


def tell(numbers: Sequence[float] | NDArray[np.float64]) -> str:
    """Return numbers as cells of a table."""
    return " | ".join(f"{number:.2f}" for number in numbers)


if __name__ == "__main__":
    main()
