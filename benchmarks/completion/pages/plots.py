# SPDX-License-Identifier: MIT
"""Plots of the evaluation: reliability, recall against precision, sweeps over noise and hidden share."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from benchmarks.completion.truth.tally import HEADLINE
from nbv.report.figures.plots import Plot, Theme, drawn_plot

STRATA_ROWS = {
    "S1 surface-preserving": "S1", "S2 surface-breaking": "S2", "S3 boundary-breaking": "S3",
    "S4 self-occluded cylinder": "S4", "S6 opening cut": "S6", "S7 breaks the prior": "S7",
}  # fmt: skip
COLOURS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#D55E00", "#7f7f7f")  # Okabe and Ito


def reliability_plot(confidence: Mapping[str, Any]) -> Plot:
    """Plot how often area of each predicted confidence is right; dots grow with the area."""

    def draw(axes: Axes, theme: Theme) -> None:
        axes.plot([0, 1], [0, 1], color=theme.faint, linewidth=1, linestyle="--")
        area = np.array(confidence["area_m2"])
        for predicted, true, size in zip(
            confidence["predicted"], confidence["came_true"], area / max(area.max(), 1e-9), strict=True
        ):
            if predicted is not None:
                axes.scatter([predicted], [true], s=20 + 160 * size, color=theme.inferred, zorder=3)
        axes.set_xlim(0, 1.02)
        axes.set_ylim(0, 1.04)
        axes.set_xlabel("predicted confidence")
        axes.set_ylabel("share of the area that is right (2 cm)")

    return drawn_plot(draw, (4.2, 4.0))


def tradeoff_plot(methods: Mapping[str, Mapping[str, Any]]) -> Plot:
    """Plot recall against precision of every method, at 2 cm, on the scenes that keep to the prior."""

    def draw(axes: Axes, theme: Theme) -> None:
        for index, (name, record) in enumerate(methods.items()):
            row = record["rows"]["whole, without S7"]
            recall, precision = row["recall"][HEADLINE], row["precision"][HEADLINE]
            if recall is None or precision is None:
                continue
            axes.scatter([recall], [precision], s=46, color=COLOURS[index % len(COLOURS)], zorder=3)
            axes.annotate(name, (recall, precision), xytext=(5, 4), textcoords="offset points", fontsize=7.5)
        axes.set_xlim(0, 1.04)
        axes.set_ylim(0, 1.04)
        axes.set_xlabel("recall at 2 cm")
        axes.set_ylabel("precision at 2 cm")
        axes.tick_params(colors=theme.ink)

    return drawn_plot(draw, (5.4, 4.2))


def by_noise_plot(records: Mapping[str, Mapping[str, Any]]) -> Plot:
    """Plot the IoU at 2 cm of every stratum against the noise along the ray."""

    def draw(axes: Axes, _theme: Theme) -> None:
        sigma = [_sigma_mm(name) for name in records]
        order = np.argsort(sigma)
        for (row, label), colour in zip(STRATA_ROWS.items(), COLOURS, strict=True):
            iou = [record["rows"][row]["iou"][HEADLINE] for record in records.values()]
            values = np.array([np.nan if value is None else value for value in iou])
            if np.isfinite(values).any():
                axes.plot(
                    np.array(sigma)[order], values[order], "o-", color=colour, label=label, linewidth=1.6
                )
        axes.set_ylim(0, 1.03)
        axes.set_xlabel("noise along the ray, mm")
        axes.set_ylabel("IoU at 2 cm")
        axes.legend(frameon=False, fontsize=8)

    return drawn_plot(draw, (5.4, 4.0))


def by_share_plot(pairs: Sequence[tuple[float, float]]) -> Plot:
    """Plot the IoU at 2 cm of every case against the share of its surfaces in view that is hidden."""

    def draw(axes: Axes, theme: Theme) -> None:
        share, iou = np.array(pairs).reshape(-1, 2).T
        axes.scatter(100 * share, iou, s=26, color=theme.inferred, zorder=3)
        axes.set_ylim(0, 1.03)
        axes.set_xlim(0, None)
        axes.set_xlabel("hidden share of the surfaces in view, %")
        axes.set_ylabel("IoU at 2 cm, all strata")

    return drawn_plot(draw, (5.0, 3.6))


def _sigma_mm(noise: str) -> float:
    """Millimetres in the name of a noise model, 0 where there are none."""
    found = re.search(r"(\d+(?:\.\d+)?)mm", noise)
    return float(found[1]) if found else 0.0
