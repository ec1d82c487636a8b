# SPDX-License-Identifier: MIT
"""Report of a study: which planner needs how many views, where, and for which requirement."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Patch

from nbv.report.blocks.page import Block, Cell, Gallery, Headline, Page, PageSection, Table, Text
from nbv.report.figures.plots import Plot, Theme, drawn_plot, label_views
from nbv.run.wording import count, percent
from nbv.study.pipeline import Outcome, OutcomeGroup, groups_of
from nbv.study.spec import StudySpec, common_share
from scenes.checks import FloatArray

# Okabe and Ito's palette without the two that vanish on white or on black, and three more; the dashes tell
# lines apart where colours do not.
_COLOURS = (
    "#0072b2", "#e69f00", "#009e73", "#cc79a7", "#d55e00", "#56b4e9", "#8c6bb1", "#a6761d", "#7f7f7f",
)  # fmt: skip
_DASHES = ("-", (0, (5, 1.5)), (0, (1.5, 1.2)), (0, (6, 1.5, 1.5, 1.5)), (0, (3, 1, 1, 1, 1, 1)), (0, (8, 3)))
_WIDTH = 5.4
_LEGEND_CHARACTERS, _SWATCH_CHARACTERS = 115, 7  # that fit over a plot of the views needed, and of a swatch


def colour_of(planner: int) -> str:
    """Return the CSS colour of the planner of this number, from 0."""
    return _COLOURS[planner % len(_COLOURS)]


def coverage_curves(groups: Sequence[OutcomeGroup], planners: Sequence[str]) -> Plot:
    """Plot the share of the reachable area against views: medians over seeds, and from least to most.

    The groups are of one setting; each of all `planners` of the study has its colour in all plots.
    """

    def draw(axes: Axes, theme: Theme) -> None:
        for group in (group for group in groups if group.outcomes):
            number = planners.index(group.planner)
            colour = colour_of(number)
            curves = 100 * group.curves()
            views = np.arange(curves.shape[1])
            axes.fill_between(views, curves.min(axis=0), curves.max(axis=0), step="post", color=colour,
                              alpha=0.16, linewidth=0)  # fmt: skip
            axes.step(views, np.median(curves, axis=0), where="post", color=colour, linewidth=1.9,
                      linestyle=_DASHES[number % len(_DASHES)], label=group.planner)  # fmt: skip
        bounds = [
            outcome.lower_bound for group in groups for outcome in group.outcomes if outcome.lower_bound
        ]
        if bounds:
            axes.axvline(min(bounds), color=theme.faint, linewidth=1, linestyle=":")
            right = min(bounds) > 0.5 * axes.get_xlim()[1]
            axes.annotate(
                f"certified: at least {min(bounds)}", (min(bounds), 3), xytext=(-4 if right else 4, 0),
                ha="right" if right else "left", textcoords="offset points", color=theme.faint, fontsize=8,
            )  # fmt: skip
        axes.set_xlim(left=0)
        label_views(axes, "measured as required, % of what can be", 103)
        axes.legend(
            loc="lower left", bbox_to_anchor=(0, 1), ncols=3, frameon=False, fontsize=8, borderaxespad=0.2
        )

    return drawn_plot(draw, (_WIDTH, 3.9))


def views_needed(groups: Sequence[OutcomeGroup], share: float, planners: Sequence[str]) -> Plot:
    """Plot the views until `share` of the reachable area is measured: seeds and median, by setting."""
    settings = list(dict.fromkeys(group.setting for group in groups))
    texts = [", ".join(_distinct_parts(setting, settings)) for setting in settings]

    def draw(axes: Axes, theme: Theme) -> None:
        step = 0.8 / max(len(planners), 1)
        most = max((float(v) for g in groups for v in g.views_to(share) if np.isfinite(v)), default=1.0)
        for group in groups:
            number = planners.index(group.planner)
            colour = colour_of(number)
            y = settings.index(group.setting) + step * (number - (len(planners) - 1) / 2)
            views = group.views_to(share)
            shown = np.where(np.isfinite(views), views, 1.12 * most)
            axes.plot(shown, np.full(len(shown), y), "o", color=colour, markersize=3, alpha=0.5)
            middle = float(np.median(views)) if len(views) else np.inf
            if np.isfinite(middle):
                axes.barh(y, middle, height=0.8 * step, color=colour, alpha=0.75)
            text = f"{middle:g}" if np.isfinite(middle) else "not reached"
            at = max(float(shown.max(initial=0.0)), 0.0)
            axes.annotate(text, (at, y), xytext=(5, 0), textcoords="offset points", va="center",
                          fontsize=7.5, color=theme.ink)  # fmt: skip
        axes.set_yticks(range(len(settings)), texts)
        axes.invert_yaxis()
        axes.set_xlim(0, 1.22 * most)
        axes.set_xlabel(f"views until {100 * share:g} % of what can be is measured as required")
        axes.grid(visible=False, axis="y")
        handles = [Patch(color=colour_of(k), alpha=0.75, label=name) for k, name in enumerate(planners)]
        axes.legend(handles=handles, loc="lower right", bbox_to_anchor=(1, 1), frameon=False, fontsize=8,
                    ncols=_fitting_columns(planners), borderaxespad=0.2)  # fmt: skip

    height = 1.2 + len(settings) * (0.25 + 0.19 * len(planners))
    return drawn_plot(draw, (1.5 * _WIDTH, height))


def _fitting_columns(names: Sequence[str]) -> int:
    """Return how many columns of names, at most six, fit side by side in a legend."""
    for n_columns in range(min(6, len(names)), 1, -1):
        columns = np.array_split([len(name) + _SWATCH_CHARACTERS for name in names], n_columns)
        if sum(int(column.max()) for column in columns) <= _LEGEND_CHARACTERS:
            return n_columns
    return 1


def _distinct_parts(setting: tuple[str, str, str], all_of_them: Sequence[tuple[str, str, str]]) -> list[str]:
    """Return the parts of a setting that are not the same in all, or the scene where all are."""
    parts = [part for k, part in enumerate(setting) if len({names[k] for names in all_of_them}) > 1]
    return parts or [setting[0]]


_MOST_PICTURES = 24


def study_page(
    spec: StudySpec, outcomes: Sequence[Outcome], fallback_title: str
) -> tuple[Page, dict[str, Plot]]:
    """Return the report, and its plots by name; `fallback_title` is for a study without title and name."""
    groups = groups_of(outcomes)
    planners = [planner.label for planner in spec.planners]
    share = common_share(spec)
    plots = plots_of(groups, planners, share)
    failed = [outcome for outcome in outcomes if outcome.error]
    page = Page(
        title=spec.title or spec.name or fallback_title,
        kicker="Study",
        summary=" ".join(part for part in (spec.description.strip(), _summary(groups, share)) if part),
        headlines=_headlines(outcomes, groups),
        bar=None,
        sections=(
            PageSection(
                "Views that are needed", (_gallery(plots, share), *_views_needed(groups, planners, share))
            ),
            PageSection("Coverage by number of views", _curves(groups, plots)),
            PageSection("Every case", (_cases_table(outcomes),)),
            *_failures(failed),
        ),
        warnings=(f"{count(len(failed), 'case')} could not be planned; see below.",) if failed else (),
    )
    return page, plots


def plots_of(groups: Sequence[OutcomeGroup], planners: Sequence[str], share: float) -> dict[str, Plot]:
    """Return the plots of a study by name: "views", and "coverage-1" and so on, one a setting."""
    plots = {"views": views_needed(groups, share, planners)}
    for number, setting in enumerate(drawn_settings(groups)[:_MOST_PICTURES], start=1):
        plots[f"coverage-{number}"] = coverage_curves([g for g in groups if g.setting == setting], planners)
    return plots


def drawn_settings(groups: Sequence[OutcomeGroup]) -> list[tuple[str, str, str]]:
    """Return the settings in which anything could be planned."""
    return list(dict.fromkeys(group.setting for group in groups if group.outcomes))


def spread(values: FloatArray) -> str:
    """Return the median of numbers (n,), with the least and the most where they differ.

    Examples
    --------
    >>> spread(np.array([3.0, 5.0, 4.0])), spread(np.array([3.0, np.inf])), spread(np.array([2.0, 2.0]))
    ('4 (3 to 5)', '3 to never', '2')
    """
    if not len(values) or np.isnan(values).all():
        return ""
    low, middle, high = float(values.min()), float(np.median(values)), float(values.max())
    if np.isinf(low):
        return "never"
    most = f"{high:g}" if np.isfinite(high) else "never"
    if not np.isfinite(middle):
        return f"{low:g} to {most}"
    return f"{middle:g}" if low == high else f"{middle:g} ({low:g} to {most})"


def _summary(groups: Sequence[OutcomeGroup], share: float) -> str:
    """Tell for each planner the median of views over all that it planned."""
    parts = []
    for planner in dict.fromkeys(group.planner for group in groups):
        view_counts = [group.views_to(share) for group in groups if group.planner == planner]
        views = np.concatenate(view_counts) if view_counts else np.zeros(0)
        if len(views):
            middle = float(np.median(views))
            is_known = np.isfinite(middle)
            parts.append(f"{planner} {f'{middle:g}' if is_known else 'not reached in half of its plans'}")
    if not parts:
        return "No case could be planned."
    return (
        f"Median number of views until {100 * share:g} % of what can be measured is measured as required: "
        f"{', '.join(parts)}."
    )


def _headlines(outcomes: Sequence[Outcome], groups: Sequence[OutcomeGroup]) -> tuple[Headline, ...]:
    planned = [outcome for outcome in outcomes if not outcome.error]
    figures = [
        Headline(str(len(outcomes)), "", "plans, one for each scene, sensor, requirement, planner and seed"),
        Headline(str(sum(outcome.n_views for outcome in planned)), "", "views in all of them"),
    ]
    bounds = [outcome for outcome in planned if outcome.lower_bound]
    if bounds:
        excess = [bound.n_views / bound.lower_bound for bound in bounds if bound.lower_bound]
        figures.append(
            Headline(f"{float(np.median(excess)):.2f}", "\u00d7", "views of cover beside its certified bound")
        )
    reach = np.array([float(np.median(group.values("reachable"))) for group in groups if group.outcomes])
    if len(reach):
        low, high = percent(float(reach.min())), percent(float(reach.max()))
        figures.append(
            Headline(low if low == high else f"{low}\u2013{high}", "%", "of the area can be measured at all")
        )
    return tuple(figures)


def _views_needed(groups: Sequence[OutcomeGroup], planners: Sequence[str], share: float) -> tuple[Block, ...]:
    """A row for each planner in each setting."""
    rows = []
    for group in groups:
        met = group.values("met_of_reachable")
        bound, added = group.values("lower_bound"), group.values("inferred")
        tour, lost = group.values("tour_m"), group.values("legs_without_way")
        middle = float(np.median(met)) if len(met) else 0.0
        rows.append(
            (
                *(Cell(text) for text in group.setting),
                Cell(group.planner, swatch=colour_of(planners.index(group.planner))),
                Cell(spread(group.views_to(share))),
                Cell(percent(middle) if len(met) else "", share=middle, state="measured"),
                Cell(spread(group.values("views"))),
                Cell(spread(bound[np.isfinite(bound)])),
                Cell(f"{float(np.median(tour)):.1f}" if len(tour) and np.isfinite(tour).all() else ""),
                Cell(f"{float(np.median(lost)):.0f}" if np.any(lost > 0) else ""),
                Cell(percent(float(np.median(added))) if len(met) and added.any() else ""),
            )
        )
    columns = (
        "Scene", "Sensor", "Requirement", "Planner", f"#views to {100 * share:g} %", "#reached, %",
        "#views planned", "#at least, views", "#tour, m", "#legs without a way", "#inferred, %",
    )  # fmt: skip
    note = (
        "Medians over the seeds; in brackets the least and the most. Shares are of the area that any "
        'candidate could measure as required. "At least" is certified: no plan for the planner\'s target has '
        "fewer views. The tour visits all stations by a short way; of online plans it is the way from scan "
        "to scan, and legs without a way are not in it. All planners of a scene and sensor choose from the "
        "same poses and are measured on the same samples."
    )
    return drop_constant_columns(columns, rows, n_fixed=3), Text(note, is_note=True)


def drop_constant_columns(columns: Sequence[str], rows: Sequence[Sequence[Cell]], n_fixed: int) -> Table:
    """Return the table without columns that are empty, and of the first ones those that never change."""
    kept = [
        k
        for k in range(len(columns))
        if len({row[k].text for row in rows} - {""}) > (1 if k < n_fixed else 0)
    ]
    return Table(tuple(columns[k] for k in kept), tuple(tuple(row[k] for k in kept) for row in rows))


def _curves(groups: Sequence[OutcomeGroup], plots: Mapping[str, Plot]) -> tuple[Block, ...]:
    settings = drawn_settings(groups)
    pictures = tuple(
        plots[f"coverage-{number}"].picture(", ".join(setting))
        for number, setting in enumerate(settings[:_MOST_PICTURES], start=1)
    )
    note = "Lines are medians over the seeds; bands reach from the least to the most."
    if len(settings) > len(pictures):
        note += f" The first {len(pictures)} of {len(settings)} settings are drawn; all are in the tables."
    return Gallery(pictures, 2), Text(note, is_note=True)


def _gallery(plots: Mapping[str, Plot], share: float) -> Gallery:
    title = f"Views until {100 * share:g} % of what can be is measured."
    caption = "Dots are seeds, bars medians; of a plan that never got there the dot is at the far right."
    return Gallery((plots["views"].picture(title, caption),), 1)


def _cases_table(outcomes: Sequence[Outcome]) -> Table:
    """A row for each plan."""
    rows = []
    for outcome in outcomes:
        labels, share = outcome.case.labels(), float(outcome.of_reachable[-1]) if not outcome.error else 0.0
        rows.append(
            (
                *(Cell(str(labels[name])) for name in ("scene", "sensor", "requirement", "planner", "seed")),
                Cell("" if outcome.error else str(outcome.n_views)),
                Cell("" if outcome.error else percent(share), share=share, state="measured"),
                Cell("could not be planned" if outcome.error else outcome.stopped_because),
                Cell(f"plans/{outcome.case.name}.json"),
            )
        )
    columns = (
        "Scene", "Sensor", "Requirement", "Planner", "#Seed", "#views", "#measured of reachable, %",
        "Ended because", "Plan",
    )  # fmt: skip
    return Table(columns, tuple(rows))


def _failures(failed: Sequence[Outcome]) -> tuple[PageSection, ...]:
    if not failed:
        return ()
    rows = tuple((Cell(outcome.case.name), Cell(outcome.error)) for outcome in failed)
    return (PageSection("What could not be planned", (Table(("Case", "Why"), rows),)),)
