# SPDX-License-Identifier: MIT
"""Report of a plan: what simple planners reach beside it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nbv.plan.baselines import PLAN, Baseline
from nbv.plan.plan import Plan
from nbv.report.page.page import Cell, Section, Table, Text
from nbv.run.wording import count, percent


def baselines_section(plan: Plan, found: Sequence[Baseline]) -> tuple[Section, ...]:
    """Return the plan beside simple planners; nothing where none were tried."""
    if not found:
        return ()
    share = 0.95 * float(found[0].met[0, -1])
    rows = tuple(_baseline_row(baseline, plan.method == "cover", share) for baseline in found)
    n_views = found[0].met.shape[1]
    columns = (
        "Planner",
        "knows the scene",
        f"#measured by {count(n_views, 'view')}, %",
        "#10-90 % of runs",
        f"#views to {percent(share)} %",
    )
    note = (
        "On at most 4,000 of the samples, with the plan's candidates and sensor. "
        "Random and farthest-point are medians of 30 runs. Visibility-only takes what sees most new surface "
        "at any angle, greedy what measures most new surface as required."
    )
    if plan.shares:
        note += (
            " All are compared by what views measure as required alone: what completion models or infers "
            "counts for none of them, this plan included."
        )
    return (Section("Beside other planners", (Table(columns, rows), Text(note, is_note=True))),)


def _baseline_row(baseline: Baseline, plan_knows: bool, share: float) -> tuple[Cell, ...]:
    last = baseline.met[:, -1]
    low, middle, high = (float(value) for value in np.quantile(last, [0.1, 0.5, 0.9]))
    views = float(np.median(baseline.views_to(share)))
    knows = baseline.knows_scene or (plan_knows and baseline.name == PLAN)
    return (
        Cell(baseline.name),
        Cell("yes" if knows else "no"),
        Cell(percent(middle), share=middle, state="measured"),
        Cell(f"{percent(low)} to {percent(high)}" if len(last) > 1 else ""),
        Cell(f"{views:g}" if np.isfinite(views) else "not reached"),
    )
