# SPDX-License-Identifier: MIT
"""Findings of a plan's report: what completion stood in for, and what simple planners reach beside it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from nbv.coverage.coverage import Coverage
from nbv.plan.baselines import PLAN, Baseline
from nbv.plan.plan import Plan
from nbv.report.page.page import Bar, Cell, Headline, Section, Table, Text
from nbv.report.pictures.picture import Picture
from nbv.run.wording import count, percent, percent_within, square_metres


@dataclass(frozen=True, slots=True, eq=False)
class PlanFindings:
    """What a plan achieves, in words, figures and pictures.

    `headlines` stand beside the number of views, `bar` is the whole area in its parts, `meanings` say what
    these are where that needs telling, `curve` shows them by number of views, `surfaces` surface by surface.
    `pictures` under the title `overview` show where they are, `note` what their colours mean.
    """

    summary: str
    headlines: tuple[Headline, ...]
    bar: Bar
    meanings: tuple[Section, ...]
    curve: Picture
    overview: str
    pictures: tuple[Picture, ...]
    note: str
    surfaces: Table


def measured_sentence(plan: Plan, coverage: Coverage) -> str:
    """How much the views of a plan measure as required, in a sentence."""
    where = " in the region" if plan.zones.region else ""
    how = "without knowing the scene" if plan.method == "nbv" else "knowing the scene"
    met = percent_within(coverage.met, coverage.standard_errors()["met"])
    return (
        f"{count(len(plan.views), 'view')} with {plan.sensor.name}, planned {how},{_after(plan)} "
        f"{'measures' if len(plan.views) == 1 else 'measure'} "
        f"{met} % of {square_metres(coverage.total_m2)} m\u00b2{where} at "
        f"{plan.requirement.describe()}."
    )


def met_before(plan: Plan) -> float:
    """Share of the area that had been measured before the plan's views."""
    return (plan.resumed_from.met_fraction if plan.resumed_from else None) or 0.0


def _after(plan: Plan) -> str:
    """What had been measured before the plan's views."""
    if plan.resumed_from is None:
        return ""
    scans = count(len(plan.resumed_from.poses), "scan")
    return f" after {scans} that measured {percent(met_before(plan))} % of it,"


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
        "On the plan's own samples, with its candidates and sensor. "
        "Random and farthest-point are medians of 30 runs. Visibility-only takes what sees most new surface "
        "at any angle, greedy what measures most new surface as required. The last column counts the views "
        f"to 95 % of what this plan measures, {percent(share)} % of the area."
    )
    if plan.method == "cover":
        note += (
            " This plan seeks the fewest views that meet the target, greedy the most by each view: greedy "
            "may be ahead at fewer views."
        )
    if plan.stations is not None and plan.lower_bound and "registered" in plan.lower_bound.kind:
        note += " Their scans need not overlap as this plan's must: the lower bound does not hold for them."
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
