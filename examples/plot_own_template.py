# SPDX-License-Identifier: MIT
"""The flight of stairs of docs/guides/own-templates.md: its points, coloured by fitted face.

Run it with `python examples/plot_own_template.py [--docs FOLDER]`: it runs the page's own code and writes
own_template.png into FOLDER/pictures (default: docs).
"""

import argparse
import re
from pathlib import Path

import matplotlib as mpl
import numpy as np

mpl.use("Agg")
import matplotlib.pyplot as plt

ROOT = Path(__file__).resolve().parents[1]
_COLOURS = {0: ("#c8c8c8", "no face"), 1: ("#2b6cb0", "treads"), 2: ("#c05621", "risers")}


def page_names() -> dict[str, object]:
    """What the Python blocks of the page define, after they ran."""
    text = (ROOT / "docs/guides/own-templates.md").read_text("utf-8")
    names: dict[str, object] = {}
    for block in re.findall(r"^```python\n(.*?)^```", text, re.MULTILINE | re.DOTALL):
        exec(compile(block, "own-templates.md", "exec"), names)
    return names


def plot(path: Path) -> None:
    """Draw the points aslant and from beside."""
    names = page_names()
    fit, points = names["fit"], names["measured"].points
    figure, (space, section) = plt.subplots(1, 2, figsize=(11, 4.2), width_ratios=(1.1, 1))
    heading = fit.value("heading")
    along = points[:, :2] @ [np.cos(heading), np.sin(heading)]
    across = points[:, :2] @ [-np.sin(heading), np.cos(heading)]
    for number, (colour, name) in _COLOURS.items():
        on = fit.assignment == number
        size = 1.5 if number == 0 else 5
        space.scatter(
            0.85 * along[on] - 0.6 * across[on], points[on, 2] + 0.35 * across[on], s=size, c=colour
        )
        section.scatter(along[on], points[on, 2], s=size, c=colour, label=name)
    going, rise = fit.value("going"), fit.value("rise")
    steps = np.arange(7)
    nose = np.column_stack([fit.value("forward") + steps * going, fit.value("height") + steps * rise])
    line = np.repeat(nose, 2, axis=0)
    line[1:-1:2, 0], line[1:-1:2, 1] = nose[1:, 0], nose[:-1, 1]
    section.plot(line[:-1, 0], line[:-1, 1], c="k", lw=1, label="fit")
    section.legend(loc="upper left", fontsize=8, markerscale=2)
    text = (
        f"going {going:.4f} ± {fit.deviation('going'):.4f} m, rise {rise:.4f} ± {fit.deviation('rise'):.4f} m"
    )
    section.set_title(text, fontsize=9)
    space.set_title(f"{len(points)} points, a third of them anywhere", fontsize=9)
    for axes in (space, section):
        axes.set_aspect("equal")
        axes.set_axis_off()
    figure.tight_layout()
    figure.savefig(path, dpi=90)
    plt.close(figure)


def main(arguments: list[str] | None = None) -> None:
    """Write the picture."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--docs", type=Path, default=ROOT / "docs")
    folder = parser.parse_args(arguments).docs / "pictures"
    folder.mkdir(parents=True, exist_ok=True)
    plot(folder / "own_template.png")


if __name__ == "__main__":
    main()
