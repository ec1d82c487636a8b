# SPDX-License-Identifier: MIT
"""Plots of a study: coverage by view, and views to a share, planner beside planner."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Patch

from nbv.report.figures.plots import Plot, Theme, drawn_plot, label_views
from nbv.study.outcome import Group

# Okabe and Ito's palette without the two that vanish on white or on black; the dashes tell lines apart
# where colours do not.
_COLOURS = ("#0072b2", "#e69f00", "#009e73", "#cc79a7", "#d55e00", "#56b4e9")
_DASHES = ("-", (0, (5, 1.5)), (0, (1.5, 1.2)), (0, (6, 1.5, 1.5, 1.5)), (0, (3, 1, 1, 1, 1, 1)), (0, (8, 3)))
_WIDTH = 5.4


def colour_of(planner: int) -> str:
    """Return the CSS colour of the planner of this number, from 0."""
    return _COLOURS[planner % len(_COLOURS)]


def coverage_curves(groups: Sequence[Group], planners: Sequence[str]) -> Plot:
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
        bounds = [one.lower_bound for group in groups for one in group.outcomes if one.lower_bound]
        if bounds:
            axes.axvline(min(bounds), color=theme.faint, linewidth=1, linestyle=":")
            axes.annotate(
                f"certified: at least {min(bounds)}", (min(bounds), 3), xytext=(4, 0),
                textcoords="offset points", color=theme.faint, fontsize=8,
            )  # fmt: skip
        axes.set_xlim(left=0)
        label_views(axes, "measured as required, % of what can be", 103)
        axes.legend(loc="lower right", frameon=False, fontsize=8)

    return drawn_plot(draw, (_WIDTH, 3.9))


def views_needed(groups: Sequence[Group], share: float, planners: Sequence[str]) -> Plot:
    """Plot the views until `share` of the reachable area is measured: seeds and median, by setting."""
    settings = list(dict.fromkeys(group.setting for group in groups))
    texts = [", ".join(_telling(setting, settings)) for setting in settings]

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
        axes.legend(handles=handles, loc="lower right", bbox_to_anchor=(1, 1), ncols=6, frameon=False,
                    fontsize=8, borderaxespad=0.2)  # fmt: skip

    height = 1.2 + len(settings) * (0.25 + 0.19 * len(planners))
    return drawn_plot(draw, (1.5 * _WIDTH, height))


def _telling(setting: tuple[str, str, str], all_of_them: Sequence[tuple[str, str, str]]) -> list[str]:
    """Return the parts of a setting that are not the same in all, or the scene where all are."""
    parts = [part for k, part in enumerate(setting) if len({one[k] for one in all_of_them}) > 1]
    return parts or [setting[0]]
