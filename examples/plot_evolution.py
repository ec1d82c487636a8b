# SPDX-License-Identifier: MIT
"""Evolution, least squares from many starts, and the exact solver: error against evaluations.

Run it with `python examples/plot_evolution.py [--seeds N] [-o FOLDER]`: it writes evolution.png and prints
its medians over N seeds.
"""

import argparse
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from benchmarks.suites.evolution import AT, CASES, ENGINES, PartCase, measured

ROOT = Path(__file__).resolve().parents[1]
SHOWN = {
    "smooth": ("smooth residuals", 0, "error of R60, mm"),
    "30 % outliers, truncated": ("30 % outliers, truncated", 0, "error of R60, mm"),
    "30 % outliers, gated": ("30 % outliers, angles gated", 0, "error of R60, mm"),
    "beams that flip": ("an opening in beams", 0, "error of a side, mm"),
}
COLOURS = ("#1f6fb4", "#7a3fa0", "#d9772b")


def main(arguments: list[str] | None = None) -> None:
    """Measure and draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=12)
    parser.add_argument("-o", "--out", type=Path, default=ROOT / "docs/pictures")
    asked = parser.parse_args(arguments)
    asked.out.mkdir(parents=True, exist_ok=True)
    seeds = range(2000, 2000 + asked.seeds)
    figure, every = plt.subplots(1, len(SHOWN), figsize=(14, 3.8), dpi=110)
    for axes, (name, (title, column, label)) in zip(every, SHOWN.items(), strict=True):
        for engine, colour in zip(ENGINES, COLOURS, strict=True):
            errors = measured(name, engine, seeds)[0][:, :, column]
            low, middle, high = np.nanpercentile(errors, [25, 50, 75], axis=0)
            print(f"{name}, {engine}: {', '.join(f'{one:.3g}' for one in middle)}", flush=True)
            axes.plot(AT, middle, color=colour, marker="o", markersize=3, label=engine)
            axes.fill_between(AT, low, high, color=colour, alpha=0.15, linewidth=0)
        exact = [case.exact() for case in (CASES[name](seed) for seed in seeds) if isinstance(case, PartCase)]
        if exact:
            axes.axhline(
                np.nanmedian(exact, axis=0)[column], color="0.3", linestyle="--", label="exact solver"
            )
        axes.set(xscale="log", yscale="log", title=title, xlabel="evaluations", ylabel=label)
        axes.set_xticks(AT, [str(one) for one in AT], fontsize=7)
        axes.minorticks_off()
        axes.grid(color="0.9")
    every[0].legend(fontsize=7, loc="upper right")
    figure.tight_layout()
    figure.savefig(asked.out / "evolution.png")
    plt.close(figure)
    print(f"{asked.out / 'evolution.png'}: medians and quartiles of {asked.seeds} seeds")


if __name__ == "__main__":
    main()
