# SPDX-License-Identifier: MIT
"""Findings: the parts of a plan's report that depend on whether completion stood in for views."""

from __future__ import annotations

from dataclasses import dataclass

from nbv.coverage.coverage import Coverage
from nbv.plan.plan import Plan
from nbv.report.page.page import Bar, Headline, Section, Table
from nbv.report.pictures.picture import Picture
from nbv.run.wording import count, percent, square_metres


@dataclass(frozen=True, slots=True, eq=False)
class Findings:
    """What a plan achieves, in words, figures and pictures.

    Attributes
    ----------
    summary : str
        Plain sentences.
    headlines : tuple of Headline
        The large figures beside the number of views.
    bar : Bar
        The whole area in its parts.
    meanings : tuple of Section
        What the parts mean, where that needs telling.
    curve : Picture
        The parts by number of views.
    overview : str
        Title above where they are.
    pictures : tuple of Picture
        Where they are, for those who cannot see it in three dimensions.
    note : str
        What the colours mean.
    surfaces : Table
        The parts of each surface.
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
    return (
        f"{count(len(plan.views), 'view')} with {plan.sensor.name}, planned {how},{_after(plan)} "
        f"{'measures' if len(plan.views) == 1 else 'measure'} "
        f"{percent(coverage.met)} % of {square_metres(coverage.total_m2)} m\u00b2{where} at "
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
