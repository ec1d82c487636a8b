# SPDX-License-Identifier: MIT
"""Outcomes: what each case of a study found, in numbers, and what groups of cases found."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from nbv.study.case import Case
from scenes.checks import FloatArray

SHARES = (0.90, 0.95, 0.99)  # of the reachable area, at which views are counted
COLUMNS = {
    "case": str, "scene": str, "sensor": str, "requirement": str, "planner": str, "seed": int,
    "max_incidence_deg": float, "max_range_m": float, "min_density_per_m2": float, "max_sd_m": float,
    "k": int, "target": float, "spacing_m": float,
    "n_candidates": int, "n_samples": int, "total_m2": float, "reachable": float, "met": float,
    "met_standard_error": float, "met_of_reachable": float, "modelled": float, "inferred": float,
    "unknown": float, "views": int, **{f"views_to_{100 * share:.0f}": int for share in SHARES},
    "lower_bound": int, "tour_m": float, "legs_without_way": int, "stopped_because": str, "error": str,
}  # fmt: skip
_ROUNDING = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """Result of one case.

    Attributes
    ----------
    case : Case
        What was planned.
    met : (n_views,) float
        Share of the area that is measured as required after each view.
    gain_m2 : (n_views,) float
        Area that each view adds to it, square metres.
    total_m2, reachable : float
        Area, and the share of it that any candidate could measure as required.
    n_candidates, n_samples : int
        Poses that could be chosen, and samples on which coverage is measured.
    modelled, inferred, unknown : float
        Shares of the area; 0 where completion did not stand in for views (unknown: all that is not met).
    lower_bound : int or None
        Views that any plan needs, where certified.
    tour_m : float or None
        Length of the tour of the stations (online: of the way from scan to scan), metres.
    legs_without_way : int or None
        How many of its legs have no way, which the length leaves out.
    met_standard_error : float
        Of the last of `met`.
    times : mapping
        "seconds" by the clock and "cpu_seconds" that planning took, where this run planned it; in the
        manifest, not in the results, whose bytes do not depend on the run.
    stopped_because : str
        Why there are no more views.
    error : str
        Why the case could not be planned; "" where it could.
    """

    case: Case
    met: FloatArray
    gain_m2: FloatArray
    total_m2: float = float("nan")
    reachable: float = float("nan")
    n_candidates: int = 0
    n_samples: int = 0
    modelled: float = 0.0
    inferred: float = 0.0
    unknown: float = float("nan")
    lower_bound: int | None = None
    tour_m: float | None = None
    legs_without_way: int | None = None
    met_standard_error: float = float("nan")
    times: Mapping[str, float] = field(default_factory=dict)
    stopped_because: str = ""
    error: str = ""

    @property
    def n_views(self) -> int:
        """How many views were planned."""
        return len(self.met)

    @property
    def of_reachable(self) -> FloatArray:
        """Share (n_views + 1,) of the reachable area that is met before the first view and after each."""
        whole = np.concatenate([[0.0], self.met])
        return whole / self.reachable if self.reachable > 0 else np.zeros(len(whole))

    def views_to(self, share: float) -> int | None:
        """Views until `share` of the reachable area is measured as required; None where it never is."""
        enough = np.flatnonzero(self.of_reachable[1:] >= share - _ROUNDING)
        return int(enough[0]) + 1 if len(enough) else None

    def row(self) -> dict[str, Any]:
        """Return the row of the results, by `COLUMNS`."""
        figures = {
            "total_m2": self.total_m2,
            "reachable": self.reachable,
            "met": float(self.met[-1]) if self.n_views else 0.0,
            "met_standard_error": self.met_standard_error,
            "met_of_reachable": float(self.of_reachable[-1]),
            "modelled": self.modelled,
            "inferred": self.inferred,
            "unknown": self.unknown,
            "views": self.n_views,
        }
        return {
            "case": self.case.name,
            **self.case.labels(),
            **self.case.settings(),
            "n_candidates": self.n_candidates,
            "n_samples": self.n_samples,
            **(dict.fromkeys(figures) if self.error else figures),
            **{f"views_to_{100 * share:.0f}": self.views_to(share) for share in SHARES},
            "lower_bound": self.lower_bound,
            "tour_m": self.tour_m,
            "legs_without_way": self.legs_without_way,
            "stopped_because": self.stopped_because,
            "error": self.error,
        }


def outcome_of(case: Case, record: Mapping[str, Any], times: Mapping[str, float] | None = None) -> Outcome:
    """Return the outcome of a case's record, and what planning it took, seconds."""
    if record.get("error"):
        return Outcome(case, np.zeros(0), np.zeros(0), error=str(record["error"]))
    views, coverage, bound = record["views"], record["coverage"], record["lower_bound"]
    shares = record["inference"][-1] if record["inference"] else None
    return Outcome(
        case,
        np.array([view["met_fraction"] for view in views], dtype=np.float64),
        np.array([view["gain_m2"] for view in views], dtype=np.float64),
        total_m2=float(coverage["total_m2"]),
        reachable=float(coverage["reachable"]),
        n_candidates=int(record["n_candidates"]),
        n_samples=int(record["n_samples"]),
        modelled=float(shares["modelled"]) if shares else 0.0,
        inferred=float(shares["inferred"]) if shares else 0.0,
        unknown=float(shares["unknown"]) if shares else 1.0 - float(coverage["met"]),
        lower_bound=int(bound["views"]) if bound else None,
        tour_m=record["tour_m"],
        legs_without_way=record.get("legs_without_way"),
        met_standard_error=float(coverage.get("standard_error", {}).get("met", np.nan)),
        times=times or {},
        stopped_because=str(record["stopped_because"]),
    )


@dataclass(frozen=True, slots=True, eq=False)
class Group:
    """Outcomes of one scene, sensor, requirement and planner.

    Attributes
    ----------
    scene, sensor, requirement, planner : str
        Labels.
    outcomes : tuple of Outcome
        One a seed, those that could be planned.
    n_failed : int
        How many could not.
    """

    scene: str
    sensor: str
    requirement: str
    planner: str
    outcomes: tuple[Outcome, ...]
    n_failed: int

    @property
    def setting(self) -> tuple[str, str, str]:
        """Scene, sensor and requirement."""
        return self.scene, self.sensor, self.requirement

    def views_to(self, share: float) -> FloatArray:
        """Views (n,) of each outcome until `share` of the reachable area is measured; inf for never."""
        numbers = [outcome.views_to(share) for outcome in self.outcomes]
        return np.array([np.inf if views is None else views for views in numbers], dtype=np.float64)

    def values(self, name: str) -> FloatArray:
        """Values (n,) of a column of the results; nan for none."""
        column = [outcome.row()[name] for outcome in self.outcomes]
        return np.array([np.nan if value is None else value for value in column], dtype=np.float64)

    def curves(self) -> FloatArray:
        """Share of the reachable area (n, n_most + 1) measured before the first and after each view.

        A plan that has ended stays where it was.
        """
        curves = [outcome.of_reachable for outcome in self.outcomes]
        n_most = max((len(curve) for curve in curves), default=1)
        padded = [np.concatenate([curve, np.full(n_most - len(curve), curve[-1])]) for curve in curves]
        return np.array(padded).reshape(len(curves), n_most)


def groups_of(outcomes: Sequence[Outcome]) -> tuple[Group, ...]:
    """Return the outcomes in groups, in the order of the study file."""
    members: dict[tuple[str, str, str, str], list[Outcome]] = {}
    for outcome in outcomes:
        labels = outcome.case.labels()
        key = (labels["scene"], labels["sensor"], labels["requirement"], labels["planner"])
        members.setdefault(key, []).append(outcome)
    return tuple(
        Group(
            *key,
            outcomes=tuple(outcome for outcome in member if not outcome.error),
            n_failed=sum(bool(outcome.error) for outcome in member),
        )
        for key, member in members.items()
    )
