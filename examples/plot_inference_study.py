# SPDX-License-Identifier: MIT
"""The page docs/results/inference-study.md: how many views completion saves.

Run it with `python examples/plot_inference_study.py [--docs FOLDER] [--starts N] [--cases NAME ...]`: it
measures all anew, draws FOLDER/pictures/inference_study.png and puts its tables between the marks of
FOLDER/results/inference-study.md (default: docs), whose text a person writes.
"""

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
from plot_paper_study import DOCS, GREY, INK, put

from benchmarks.suites.aware_views import TARGETS, Run, reached, study

mpl.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from nbv.coverage.surface_classes import ClassShares
from nbv.scanning.sensor_profile import load_sensor
from scenes import builtin_scene

PAGE, PICTURE = "results/inference-study.md", "inference_study.png"
CASES = {
    "two_occluders": ("two_occluders", "generic60"),
    "office": ("office", "generic60"),
    "two_occluders, panorama": ("two_occluders", "panorama"),
}
MOST_VIEWS = 80
MEASURED, MODELLED, INFERRED = "#4A5A63", "#9AA7AD", "#2E7ACC"


def table(runs: Sequence[Run]) -> str:
    """A row for each target: medians over the starts, and of the classes when (c) is there."""
    rows = [
        "| of the reachable area | (a) plain | (b) plain, completed | (c) aware | (c) against (a), (b) | "
        "(c): met / modelled / inferred / unknown | of it inferred, right |",
        "|---|---|---|---|---|---|---|",
    ]
    for target in TARGETS:
        plain = np.array([run.plain_views(target) for run in runs])
        after = [reached(run.after, target) for run in runs]
        aware = [reached(run.aware, target) for run in runs]
        views = [
            np.array([np.inf if one is None else one.views for one in found]) for found in (after, aware)
        ]
        ratios = [np.median(views[1] / plain), np.median(views[1] / views[0])]
        there = [one for one in aware if one is not None]
        parts = " / ".join(
            f"{100 * np.median([getattr(one, kind) for one in there]):.1f}"
            for kind in ("met", "modelled", "inferred", "unknown")
        )
        right = [one.right_m2 / one.inferred_m2 for one in there if one.inferred_m2 > 0]
        spread = [f"{np.median(v):g} ({v.min():g}-{v.max():g})" for v in (plain, *views)]
        rows.append(
            f"| {100 * target:g} % | {' | '.join(spread)} | {ratios[0]:.2f}, {ratios[1]:.2f} | {parts} % | "
            f"{100 * np.median(right):.1f} % (least {100 * min(right):.1f}) |"
        )
    return "\n".join(rows)


def draw(results: Mapping[str, Sequence[Run]], path: Path) -> None:
    """Draw shares against views, a panel for each scene, of the first start."""
    figure, panels = plt.subplots(1, len(results), figsize=(6.6 * len(results), 5.2), layout="constrained")
    for axes, (name, runs) in zip(np.atleast_1d(panels), results.items(), strict=True):
        draw_run(axes, runs[0], name)
    figure.savefig(path, dpi=150, metadata={"Software": None})
    plt.close(figure)


def draw_run(axes: Axes, run: Run, name: str) -> None:
    """Draw one start: the three ways to know, and what (c) claims and what of it is right."""
    known = [[one.reached * run.reachable for one in shares] for shares in (run.after, run.aware)]
    lines: tuple[tuple[Sequence[float], Sequence[float], str, str, str], ...] = (
        (range(1, len(run.plain) + 1), run.plain, MEASURED, "-", "(a) measured as required"),
        (_views(run.after), known[0], INK, "--", "(b) plain, completed afterwards"),
        (_views(run.aware), known[1], INFERRED, "-", "(c) planned with completion"),
        (_views(run.aware), [one.met for one in run.aware], INFERRED, ":", "(c) of it measured as required"),
    )
    for views, shares, colour, style, label in lines:
        axes.plot([0, *views], 100 * np.array([0.0, *shares]), style, color=colour, linewidth=2, label=label)
    wrong = [one.inferred_m2 - one.right_m2 for one in run.aware]
    axes.bar(_views(run.aware), wrong, color="#C64F00", width=0.5, label="(c) inferred and wrong, m\u00b2")
    for target in TARGETS:
        axes.axhline(100 * target * run.reachable, color=GREY, linewidth=0.8)
        axes.annotate(
            f"{100 * target:g} % of the reachable", (0, 100 * target * run.reachable), xytext=(4, 2),
            textcoords="offset points", va="bottom" if target == max(TARGETS) else "top", fontsize=8,
            color=GREY,
        )  # fmt: skip
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set(xlabel="views", ylabel="% of the area", title=name, xlim=(0, len(run.plain)), ylim=(0, 103))
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 0.08), frameon=False, fontsize=9)
    axes.spines[["top", "right"]].set_visible(False)


def _views(shares: Sequence[ClassShares]) -> list[int]:
    return [one.views for one in shares]


def main(arguments: list[str] | None = None) -> None:
    """Measure, draw, and fill the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--docs", type=Path, default=DOCS)
    parser.add_argument("--starts", type=int, default=3)
    parser.add_argument("--cases", nargs="+", choices=CASES, default=list(CASES))
    options = parser.parse_args(arguments)
    results = {}
    for name in options.cases:
        scene, sensor = CASES[name]
        results[name] = [
            study(builtin_scene(scene), load_sensor(sensor), seed, most=MOST_VIEWS, every=True)
            for seed in range(options.starts)
        ]
        print(f"{name}\n{table(results[name])}", flush=True)
    (options.docs / "pictures").mkdir(parents=True, exist_ok=True)
    draw(results, options.docs / "pictures" / PICTURE)
    page = options.docs / PAGE
    if page.exists():
        text = page.read_text("utf-8")
        for name, runs in results.items():
            text = put(text, name, table(runs))
        page.write_text(text, "utf-8")


if __name__ == "__main__":
    main()
