# SPDX-License-Identifier: MIT
"""What to rely on in a scanned room: each dimension with its 95 % interval, by how wide that is.

Run it with `python examples/plot_decisions.py [SCAN...] [-o FOLDER]`: it completes the scans together, or a
scan all round the built-in office (2 mm of noise) when none is given, prints the decision sheet, and writes
`decisions.png` into FOLDER/pictures (default: docs).
"""

import argparse
from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from completion import CompletionOptions, complete
from nbv import View, load_sensor, scan_scene
from scenes import Pose, RangeImage, builtin_scene, read_scan

COLOURS = {"rely": "#5f6b6d", "check": "#d98a00", "do not build": "#2f6fc4"}


def office() -> RangeImage:
    """A scan all round the built-in office."""
    view = View(Pose.looking_at((2.0, 3.6, 1.5), (6.0, 2.5, 1.5)), load_sensor("panorama"))
    return scan_scene(builtin_scene("office"), view, noise="gaussian-2mm", rng=0)


def main(given: Sequence[str] | None = None) -> None:
    """Print the sheet and write the picture."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "scans", nargs="*", type=Path, help="scans; of the built-in office when none is given"
    )
    parser.add_argument("--tolerance", type=float, default=0.01, help="half an interval to rely on, metres")
    parser.add_argument("-o", "--out", type=Path, default=Path("docs"), help="folder of the pictures")
    asked = parser.parse_args(given)
    (asked.out / "pictures").mkdir(parents=True, exist_ok=True)
    mpl.use("Agg")
    scans = [read_scan(path) for path in asked.scans] or [office()]
    sheet = complete(scans, CompletionOptions(texture=False), rng=0).decisions(asked.tolerance)
    print(sheet.to_csv(), end="", flush=True)
    lengths = [
        (one, word) for one, word in zip(sheet.dimensions, sheet.advice, strict=True) if one.unit == "m"
    ]
    figure = Figure(figsize=(8, 0.9 + 0.32 * max(len(lengths), 1)))
    axes = figure.add_axes((0.36, 0.6 / figure.get_figheight(), 0.6, 1 - 1.0 / figure.get_figheight()))
    limit = 1000 * asked.tolerance
    axes.axvspan(-limit, limit, color="#eef1f3")
    for row, (one, word) in enumerate(lengths):
        low, high = (1000 * (end - one.value) for end in (one.low, one.high))
        reach = np.clip([low, high], -4 * limit, 4 * limit)
        axes.plot(reach, [row, row], color=COLOURS[word], linewidth=4, solid_capstyle="butt")
        axes.text(4.1 * limit, row, word, va="center", fontsize=8, color=COLOURS[word])
    axes.set_yticks(range(len(lengths)), [f"{one.name}: {one.value:.3f} m" for one, _ in lengths], fontsize=8)
    axes.set_ylim(len(lengths) - 0.5, -0.5)
    axes.set_xlim(-4 * limit, 5.2 * limit)
    axes.set_xlabel("95 % interval about the value, mm; the band is the tolerance", fontsize=8)
    axes.spines[["top", "right", "left"]].set_visible(False)
    figure.savefig(asked.out / "pictures" / "decisions.png", dpi=110, metadata={"Software": None})


if __name__ == "__main__":
    main()
