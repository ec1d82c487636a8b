# SPDX-License-Identifier: MIT
"""Report of a plan in which completion stood in for views: surface measured, modelled, inferred, unknown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from completion.options import CompletionOptions
from nbv.coverage.coverage import Coverage
from nbv.coverage.surface_classes import INFERRED, MET, MODELLED, UNKNOWN, ClassShares
from nbv.plan.baselines import PLAN, Baseline
from nbv.plan.plan import Plan
from nbv.report.blocks.page import (
    Bar,
    Block,
    Cell,
    Headline,
    PageSection,
    State,
    Table,
    Text,
    headline_of,
    shares_bar,
)
from nbv.report.figures import picture
from nbv.report.figures.picture import Picture
from nbv.report.figures.plots import class_curve
from nbv.report.figures.surface_values import StateMarks, state_pictures
from nbv.run.plan_options import ONLINE_METHODS
from nbv.run.wording import count, percent, percent_within, square_metres
from nbv.visibility.limits import CLOSE_M
from nbv.visibility.zones import EVERYWHERE, Zones
from scenes.checks import FloatArray
from scenes.world.scene import Scene


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
    meanings: tuple[PageSection, ...]
    curve: Picture
    overview: str
    pictures: tuple[Picture, ...]
    note: str
    surfaces: Table


def measured_sentence(plan: Plan, coverage: Coverage) -> str:
    """How much the views of a plan measure as required, in a sentence."""
    where = " in the region" if plan.zones.region else ""
    how = "without knowing the scene" if plan.method in ONLINE_METHODS else "knowing the scene"
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


def baselines_section(plan: Plan, baselines: Sequence[Baseline]) -> tuple[PageSection, ...]:
    """Return the plan beside simple planners; nothing where none were tried."""
    if not baselines:
        return ()
    share = 0.95 * float(baselines[0].met[0, -1])
    rows = tuple(_baseline_row(baseline, plan.method == "cover", share) for baseline in baselines)
    n_views = baselines[0].met.shape[1]
    columns = (
        "Planner",
        "knows the scene",
        f"#measured by {count(n_views, 'view')}, %",
        "#10-90 % of runs, %",
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
    return (PageSection("Beside other planners", (Table(columns, rows), Text(note, is_note=True))),)


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


_COLOURS = {
    MET: picture.MEASURED,
    MODELLED: picture.MODELLED,
    INFERRED: picture.INFERRED,
    UNKNOWN: picture.UNKNOWN,
}
_STATES: tuple[State, ...] = ("measured", "modelled", "inferred", "unknown")
_KNOWS = {
    "nbv": "knows neither the truth nor these figures",
    "cover": "knows the scene, but not beforehand what completion makes of its scans",
}
_SWATCHES = {
    "measured": "var(--measured)",
    "modelled": "var(--dots)",
    "inferred": "var(--inferred)",
    "unknown": "var(--hatch)",
}


def with_inference(
    scene: Scene, plan: Plan, coverage: Coverage, n_threads: int | None, _baselines: Sequence[Baseline] = ()
) -> PlanFindings:
    """Return what views and the completion of their scans achieve together."""
    shares, errors = plan.shares[-1], coverage.standard_errors()
    modelled = percent_within(shares.modelled, errors["modelled"])
    inferred = percent_within(shares.inferred, errors["inferred"])
    unknown = percent_within(shares.unknown, errors["unknown"])
    summary = (
        f"{measured_sentence(plan, coverage)} Completion of the scans models {modelled} % more, which they "
        f"saw but not as required, and infers {inferred} % more where they saw too little or nothing; "
        f"{unknown} % stays unknown. {_right(shares)}"
    )
    return PlanFindings(
        summary=summary,
        headlines=class_headlines(shares, errors),
        bar=class_bar(shares, coverage.total_m2),
        meanings=(PageSection("What counts as what", meanings(plan, coverage)),),
        curve=curve_of_classes(plan, coverage),
        overview="Where the surface is measured, and where inferred",
        pictures=class_pictures(
            scene, coverage, n_threads, zones=plan.zones, cut_m=plan.site.cut_m if plan.site else None
        ),
        note="The true scene from outside; surfaces that face away from the eye are left out. What is "
        "modelled and inferred is known after the last view alone.",
        surfaces=class_table(coverage),
    )


def class_headlines(shares: ClassShares, errors: Mapping[str, float]) -> tuple[Headline, ...]:
    """The share of each class, and how much of what was inferred is right."""
    figures = (
        headline_of(shares.met, errors["met"], "measured as required", "measured"),
        headline_of(shares.modelled, errors["modelled"], "modelled: seen, but not as required", "modelled"),
        headline_of(shares.inferred, errors["inferred"], "inferred where too little was seen", "inferred"),
        headline_of(shares.unknown, errors["unknown"], "unknown", "unknown"),
    )
    if not shares.inferred_m2:
        return figures
    right = percent(shares.right_m2 / shares.inferred_m2)
    return (*figures, Headline(right, "%", "of inferred area is right within 2 cm", "inferred"))


def class_bar(shares: ClassShares, total_m2: float) -> Bar:
    """The whole area by class."""
    labels = ("measured as required", "modelled", "inferred", "unknown")
    return shares_bar(zip(labels, _STATES, _amounts(shares), strict=True), total_m2)


def meanings(plan: Plan, coverage: Coverage) -> tuple[Block, ...]:
    """What each class means and how much there is of it; what the truth says of what was inferred."""
    shares, known = plan.shares[-1], coverage.standard_errors()
    errors = [known[name] for name in ("met", "modelled", "inferred", "unknown")]
    rows = tuple(
        (
            Cell(name, swatch=_SWATCHES[state]),
            Cell(text),
            Cell(percent_within(amount, error), share=amount, state=state),
            Cell(square_metres(amount * coverage.total_m2)),
        )
        for (name, text), state, amount, error in zip(
            _class_texts(plan), _STATES, _amounts(shares), errors, strict=True
        )
    )
    note = (
        f"Each place of the true surface has the first class that holds. The planner {_KNOWS[plan.method]}: "
        "the study counts a place that some candidate could measure towards the target once it is measured, "
        "modelled or inferred. "
    )
    note += _held_against_truth(shares, in_region=plan.zones.region is not None)
    columns = ("Class", "What it means", "#% of the area", "#area, m\u00b2")
    return Table(columns, rows), Text(note, is_note=True)


def _class_texts(plan: Plan) -> tuple[tuple[str, str], ...]:
    """Name and meaning of each class."""
    close = f"within {100 * CLOSE_M:g} cm of"
    sd = 1000 * (plan.requirement.max_sd_m or CompletionOptions().max_sd_m)
    return (
        ("measured as required", f"A view measured it at {plan.requirement.describe()}."),
        (
            "modelled",
            f"Seen, but not as required; it lies {close} a surface fitted to all that was measured of it, "
            f"whose standard deviation there is {sd:g} mm or less.",
        ),
        (
            "inferred",
            f"Seen too little or not at all; it lies {close} where completion continues a surface behind "
            "what hides it.",
        ),
        ("unknown", "None of these."),
    )


def _right(shares: ClassShares) -> str:
    """How much of what completion infers lies where the true surface is."""
    if not shares.inferred_m2:
        return "Nothing was inferred."
    claimed, right = square_metres(shares.inferred_m2), percent(shares.right_m2 / shares.inferred_m2)
    return f"Of {claimed} m\u00b2 that it infers in all, {right} % lies within 2 cm of the true surface."


def _held_against_truth(shares: ClassShares, *, in_region: bool) -> str:
    """How much of what was inferred is right and wrong, and why its area is not that of its class."""
    if not shares.inferred_m2:
        return _right(shares)
    wrong = square_metres(shares.inferred_m2 - shares.right_m2)
    right, claimed = percent(shares.right_m2 / shares.inferred_m2), square_metres(shares.inferred_m2)
    where = ", in the region and beyond it," if in_region else ","
    return (
        f"Compared with the truth: completion infers {claimed} m\u00b2 of surface{where} of which {right} % "
        f"lies within 2 cm of the true surface and {wrong} m\u00b2 elsewhere. (It need not be as much as the "
        "area of its class: one inferred surface stands for both where a box's bottom lies on the floor.)"
    )


def _amounts(shares: ClassShares) -> tuple[float, float, float, float]:
    return shares.met, shares.modelled, shares.inferred, shares.unknown


def layers(plan: Plan) -> FloatArray:
    """Return the shares of the area, one on top of the other, before the first view and after each.

    Returns
    -------
    tops : (3, n + 1) float
        What is measured as required; that and what is modelled; these and what is inferred. Between
        completions the two last are at least what they were at the one before.
    """
    tops = np.zeros((3, len(plan.views) + 1))
    tops[:] = [met_before(plan), *(view.met_fraction or 0.0 for view in plan.views)]
    for shares in plan.shares:
        known = np.cumsum([shares.met, shares.modelled, shares.inferred])[1:, None]
        tops[1:, shares.views :] = np.maximum(known, tops[0, shares.views :])
    return tops


def curve_of_classes(plan: Plan, coverage: Coverage) -> Picture:
    """The classes by number of views."""
    plot = class_curve(layers(plan), coverage.reachable, plan.target)
    caption = (
        "Share of all surface area. Grey: measured as required; dotted: modelled; blue: inferred. "
        "The target asks for a share of what views can reach; some of what is inferred lies beyond that."
    )
    return plot.picture("What is known by number of views.", caption)


def class_pictures(
    scene: Scene,
    coverage: Coverage,
    n_threads: int | None,
    *,
    zones: Zones = EVERYWHERE,
    cut_m: float | None = None,
) -> tuple[Picture, ...]:
    """The scene from two opposite sides, by class."""
    if coverage.classes is None:
        raise TypeError("coverage by views alone has no classes")
    return state_pictures(
        scene,
        coverage.samples,
        state=coverage.classes,
        marks=StateMarks(colours=_COLOURS, hatched=UNKNOWN, dotted=MODELLED),
        title="Measured, modelled, inferred, unknown",
        n_threads=n_threads,
        zones=zones,
        cut_m=cut_m,
    )


def class_table(coverage: Coverage) -> Table:
    """A row for each surface."""
    rows = tuple(
        (
            Cell(row.name),
            Cell(square_metres(row.area_m2)),
            *(
                Cell(percent(share), share=share, state=state)
                for state, share in zip(
                    _STATES, (row.met, row.modelled, row.inferred, row.unknown), strict=True
                )
            ),
        )
        for row in coverage.by_surface()
    )
    columns = ("Surface", "#area, m\u00b2", *(f"#{state}, %" for state in _STATES))
    return Table(columns, rows)
