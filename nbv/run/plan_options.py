# SPDX-License-Identifier: MIT
"""Plan options: what counts as measured and when a plan ends, declared once.

The command line, study files (`nbv.study.spec`) and `nbv.visibility.requirement.Requirement` are made of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from scenes.card import Value
from scenes.run.option import NOT_NEGATIVE, POSITIVE, NumberRange, minutes, option

LiteratureMethod = Literal[
    "online:frontier",
    "online:entropy",
    "online:rear-side",
    "online:proximity",
    "online:surface-edge",
    "online:set-cover",
]
"""Online planners by a criterion of the literature (`nbv.online.literature`)."""
ONLINE_METHODS: tuple[str, ...] = ("nbv", *get_args(LiteratureMethod))
"""Planners that know the scene by their scans alone."""
Method = Literal[
    "nbv",
    "cover",
    LiteratureMethod,
    "greedy",
    "visibility",
    "farthest",
    "random",
    "rule:grid5m",
    "rule:rooms-and-doorways",
]
"""All planners; those after "cover" are baselines (the others in `nbv.plan.offline_plan`)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RequirementOptions(Value):
    """The numbers of a requirement; `nbv.visibility.requirement.Requirement` explains them."""

    max_incidence_deg: float = option(
        "--max-incidence",
        "Largest angle between ray and surface normal.",
        60.0,
        metavar="DEG",
        limits=NumberRange(above=0, most=90),
    )
    max_range_m: float | None = option(
        "--max-range", "Largest range.", None, metavar="M", shown="the sensor's", limits=POSITIVE
    )
    min_density_per_m2: float | None = option(
        "--min-density", "Fewest points per square metre.", None, metavar="N", shown=False, limits=POSITIVE
    )
    max_sd_m: float | None = option(
        "--max-sd",
        "Largest predicted standard deviation of a surface point.",
        None,
        metavar="M",
        shown=False,
        limits=POSITIVE,
    )
    registration_sd_m: float = option(
        "--registration-sd",
        "Standard deviation of a pose: of a station's position, for --max-sd.",
        0.0,
        metavar="M",
        limits=NOT_NEGATIVE,
    )
    averaging_radius_m: float = option(
        "--averaging-radius",
        "Radius of the disc over which a surface point is averaged, for --max-sd.",
        0.0,
        metavar="M",
        limits=NOT_NEGATIVE,
    )
    k: int = option(
        "--k", "Number of views that must each measure a point well enough.", 1, limits=NumberRange(least=1)
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchOptions(Value):
    """The planner, and when a plan ends: see `nbv.plan.planning.plan_views`."""

    method: Literal["nbv", "cover", LiteratureMethod] = option(
        "--method",
        "Plan online without knowing the scene (nbv; online:NAME by a criterion of the literature), or "
        "offline with it (cover).",
        "nbv",
    )
    target: float = option(
        "--target", "Fraction of the reachable area to measure.", 0.99, limits=NumberRange(above=0, most=1)
    )
    views: int | None = option(
        "--views", "Largest number of views; --method cover chooses the ones that measure most.", None,
        limits=NumberRange(least=1),
    )  # fmt: skip
    infer: bool = option(
        "--infer",
        "Also complete the scans and use the inferred surface: it counts towards the target.",
        False,
    )
    overlap: float | None = option(
        "--overlap",
        "Smallest overlap of linked scans, so that all can be registered; with --method cover.",
        None,
        metavar="FRACTION",
        shown="none",
        limits=NumberRange(least=0.0, most=1.0),
    )
    polish_steps: int = option(
        "--polish-steps",
        "Largest number of swaps tried to save views, with --method cover; the search ends earlier if 1,500 "
        "swaps per view find no smaller plan.",
        100_000,
        limits=NOT_NEGATIVE,
    )
    time_budget_s: float | None = option(
        "--time-budget",
        "Seconds after which the search ends, with --method cover; results are then not repeatable.",
        None,
        metavar="S",
        shown="none",
        limits=NOT_NEGATIVE,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class PaceOptions(Value):
    """The numbers of time on site; `nbv.plan.site_time.SitePace` explains them."""

    budget_min: float | None = option(
        "--budget", "Largest time on site, like 2h; --method cover then finds the plan that measures most.",
        None, metavar="TIME", shown="none", limits=POSITIVE, parse=minutes,
    )  # fmt: skip
    set_up_min: float = option(
        "--set-up", "Minutes to set up the instrument at a station.", 3.0, metavar="MIN", limits=NOT_NEGATIVE
    )
    scan_min: float | None = option(
        "--scan-time", "Minutes that a scan takes.", None, metavar="MIN", shown="by the sensor's speed",
        limits=POSITIVE,
    )  # fmt: skip
    walk_m_s: float = option(
        "--walking-speed", "Speed between places, metres a second.", 1.0, metavar="M/S", limits=POSITIVE
    )
