# SPDX-License-Identifier: MIT
"""Sweep page: a sweep's record, its table and its plot."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from completion.evaluation.tally import HEADLINE
from nbv.evaluation.outcome import Outcome
from nbv.evaluation.plots import COLOURS, STRATA_ROWS
from nbv.evaluation.summary import WHOLE, summarise
from nbv.evaluation.sweeps import Sweep
from nbv.evaluation.tables import errors_text, interval_text, plain_text, share_text
from nbv.plots import Plot, Theme, drawn_plot

_FIGURES = {"recall": "recall", "precision": "precision", "iou": "IoU"}


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
    strata = [name for name in STRATA_ROWS if any(row["rows"][name]["hidden_m2"] > 0 for row in rows)]
    head = [record["axis"]]
    head += [f"measured: {record['measured']}"] if record["measured"] else []
    head += ["cases", "recall", "precision", "IoU", *(f"IoU {STRATA_ROWS[name]}" for name in strata)]
    head += ["radius: median mm (missed of all)", "within 2 sd", "calibration error", "violation, ppm"]
    lines = [_cells(row, strata, measured=bool(record["measured"])) for row in rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in [head, ["---"] * len(head), *lines])


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
        for index, (label, curve) in enumerate(curves.items()):
            x, value, low, high = np.array(curve, dtype=np.float64).T
            bars = np.clip([value - low, high - value], 0, None)
            axes.errorbar(
                x, value, bars, fmt="o-", color=COLOURS[index % len(COLOURS)], label=label, linewidth=1.6,
                elinewidth=0.9, capsize=2.5, markersize=4,
            )  # fmt: skip
        axes.set_ylim(0, 1.03)
        axes.set_xlabel(axis)
        axes.set_ylabel("at 2 cm")
        axes.legend(frameon=False, fontsize=8)

    return drawn_plot(draw, (5.6, 4.0))


def _curves(record: Mapping[str, Any]) -> dict[str, list[list[float]]]:
    """Curves of (place, value, low, high): IoU by stratum of rooms, the three figures of other scenes."""
    curves: dict[str, list[list[float]]] = {}
    for part, rows in record["parts"].items():
        for row in rows:
            place = row["measured"][0] if row["measured"] else row["level"]
            if part == "rooms":
                read = {f"IoU {label}": (row["rows"][name], "iou") for name, label in STRATA_ROWS.items()}
            else:
                before = f"{part}: " if len(record["parts"]) > 1 else ""
                read = {f"{before}{_FIGURES[name]}": (row["rows"][WHOLE], name) for name in _FIGURES}
            for label, (figures, name) in read.items():
                value, bounds = figures[name][HEADLINE], figures[f"{name}_interval"]
                if value is not None and None not in bounds:
                    curves.setdefault(label, []).append([place, value, *bounds])
    return curves
