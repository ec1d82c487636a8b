# SPDX-License-Identifier: MIT
"""Sweep page: a sweep's record, its table and its plot."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from benchmarks.completion.cases.outcome import Outcome
from benchmarks.completion.cases.sweeps import Sweep
from benchmarks.completion.pages.plots import COLOURS, STRATA_ROWS
from benchmarks.completion.pages.summary import S7, WHOLE, summarise
from benchmarks.completion.pages.tables import errors_text, interval_text, plain_text, share_text
from benchmarks.completion.truth.tally import HEADLINE
from nbv.report.figures.plots import Plot, Theme, drawn_plot

_FIGURES = {"recall": "recall", "precision": "precision", "iou": "IoU"}
_LINES = {"recall": "--", "precision": ":", "iou": "-"}
_SLIVERS = 0.05  # of the hidden area; a stratum that holds less is not shown


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """What came of one case of a sweep: kind of scene, level, outcome."""

    part: str
    level: float
    outcome: Outcome


def sweep_record(sweep: Sweep, results: Sequence[Found]) -> dict[str, Any]:
    """Return for each kind of scenes and each level what was measured, and the summary of its cases."""
    parts: dict[str, list[dict[str, Any]]] = {}
    for part in dict.fromkeys(found.part for found in results):
        parts[part] = [
            {"level": level, "measured": _spread(outcomes), **summarise(outcomes)}
            for level in sweep.levels
            if (outcomes := [f.outcome for f in results if (f.part, f.level) == (part, level)])
        ]
    return {"axis": sweep.axis, "measured": sweep.measured, "parts": parts}


def _spread(outcomes: Sequence[Outcome]) -> list[float] | None:
    """Mean, least and largest of what was measured; None where nothing was."""
    values = np.array([outcome.measured for outcome in outcomes])
    if not np.isfinite(values).all():
        return None
    return [float(values.mean()), float(values.min()), float(values.max())]


def sweep_table(record: Mapping[str, Any], part: str) -> str:
    """Return the table of one kind of scenes: figures at 2 cm, with 95 % intervals."""
    rows = record["parts"][part]
    strata = [name for name in STRATA_ROWS if any(_matters(row["rows"], name) for row in rows)]
    head = [record["axis"]]
    head += [f"measured: {record['measured']}"] if record["measured"] else []
    head += ["cases", "recall", "precision", "IoU", *(f"IoU {STRATA_ROWS[name]}" for name in strata)]
    head += ["radius: median mm (missed of all)", "within 2 sd", "calibration error", "violation, ppm"]
    lines = [_cells(row, strata, measured=bool(record["measured"])) for row in rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in [head, ["---"] * len(head), *lines])


def _matters(rows: Mapping[str, Any], stratum: str) -> bool:
    """Whether more than slivers of what is hidden are of a stratum."""
    hidden = max(rows[WHOLE]["hidden_m2"], rows[S7]["hidden_m2"])
    return bool(rows[stratum]["hidden_m2"] > _SLIVERS * hidden)


def _cells(row: Mapping[str, Any], strata: Sequence[str], *, measured: bool) -> list[str]:
    cells = [f"{row['level']:g}"]
    if measured:
        cells.append("{:.1f} ({:.1f}..{:.1f})".format(*row["measured"]) if row["measured"] else "-")
    whole = row["rows"][WHOLE]
    cells += [
        str(row["n_cases"]),
        *(interval_text(whole[name][HEADLINE], whole[f"{name}_interval"]) for name in _FIGURES),
        *(interval_text(row["rows"][s]["iou"][HEADLINE], row["rows"][s]["iou_interval"]) for s in strata),
        errors_text(row["radius_m"]),
        share_text(row["deviation"][-1]["within_2_sd"]),
        share_text(row["confidence"]["calibration_error"]),
        plain_text(row["violation_audited_ppm"]),
    ]
    return cells


def sweep_plot(record: Mapping[str, Any]) -> Plot:
    """Plot figures at 2 cm with 95 % intervals against what was measured, or the level where nothing was."""
    axis = record["measured"] or record["axis"]
    curves = _curves(record)

    def draw(axes: Axes, _theme: Theme) -> None:
        for curve in curves:
            x, value, low, high = np.array(curve.points, dtype=np.float64).T
            bars = np.clip([value - low, high - value], 0, None)
            axes.errorbar(
                x, value, bars, fmt=f"o{curve.line}", color=COLOURS[curve.colour % len(COLOURS)],
                label=curve.label, linewidth=1.5, elinewidth=0.9, capsize=2.5, markersize=3.5,
            )  # fmt: skip
        axes.set_ylim(0, 1.03)
        axes.set_xlabel(axis)
        axes.set_ylabel("at 2 cm")
        axes.legend(frameon=False, fontsize=8, loc="center left", bbox_to_anchor=(1.01, 0.5))

    return drawn_plot(draw, (7.2, 3.8))


@dataclass(frozen=True, slots=True)
class _Curve:
    """Places with value and both ends of its interval; drawn in a colour, by number, and a kind of line."""

    label: str
    colour: int
    line: str
    points: list[list[float]]


def _curves(record: Mapping[str, Any]) -> list[_Curve]:
    """IoU by stratum for rooms, recall, precision and IoU of all that is scored for other scenes."""
    curves = []
    for number, (part, rows) in enumerate(record["parts"].items()):
        if part == "rooms":
            strata = enumerate(STRATA_ROWS.items())
            curves += [_Curve(f"IoU {s}", k, "-", _points(rows, name, "iou")) for k, (name, s) in strata]
        else:
            names = _FIGURES.items()
            curves += [_Curve(f"{part}: {s}", number, _LINES[n], _points(rows, WHOLE, n)) for n, s in names]
    return [curve for curve in curves if curve.points]


def _points(rows: Sequence[Mapping[str, Any]], name: str, figure: str) -> list[list[float]]:
    """Place, value and interval of a figure at each level where it is known."""
    points = []
    for row in rows:
        figures = row["rows"][name]
        value, bounds = figures[figure][HEADLINE], figures[f"{figure}_interval"]
        if value is not None and None not in bounds:
            points.append([row["measured"][0] if row["measured"] else row["level"], value, *bounds])
    return points
