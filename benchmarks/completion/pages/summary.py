# SPDX-License-Identifier: MIT
"""Summary: outcomes of many cases as one record, by stratum, with bootstrap intervals over the cases."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from benchmarks.completion.cases.outcome import Outcome
from benchmarks.completion.pages.bootstrap import difference_interval, interval, number
from benchmarks.completion.scores.calibration import deviation_bins, no_reliability, summary
from benchmarks.completion.scores.splits import PairCounts
from benchmarks.completion.truth.strata import Stratum
from benchmarks.completion.truth.tally import HEADLINE, TOLERANCES_M, Tally, total
from scenes.checks import FloatArray

STRATA = {
    "S1 surface-preserving": Stratum.INTERIOR,
    "S2 surface-breaking": Stratum.BREAKING,
    "S3 boundary-breaking": Stratum.BOUNDARY,
    "S4 self-occluded cylinder": Stratum.SELF,
    "S6 opening cut": Stratum.OPENING,
    "on nothing hidden": Stratum.NONE,
}
WHOLE, S7 = "whole, without S7", "S7 breaks the prior"
ABLATED = tuple(name for name, stratum in STRATA.items() if stratum != Stratum.NONE)
KINDS = ("table", "column", "wall", "floor")


def summarise(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """Return all figures of one method's outcomes as a JSON record, in metres and square metres.

    Strata are taken over the scenes that keep to the prior; "S7 breaks the prior" is everything in the
    others, and "S7 where it breaks" the places where they do.
    """
    usual = [outcome for outcome in outcomes if not outcome.breaks_prior]
    broken = [outcome for outcome in outcomes if outcome.breaks_prior]
    rows = {name: _row(tallies) for name, tallies in tallies_by_row(outcomes).items()}
    for name, stratum in STRATA.items():
        rows[name]["boundary_iou"] = _boundary_iou(usual, stratum)
    rows["S7 where it breaks"] = _row([outcome.score.in_breaks for outcome in broken])
    for kind in KINDS:
        rows[f"surfaces: {kind}"] = _row([_of_kind(outcome, kind) for outcome in usual])
    return {"n_cases": len(outcomes), "n_breaking": len(broken), "rows": rows, **_other_figures(outcomes)}


def tallies_by_row(outcomes: Sequence[Outcome]) -> dict[str, list[Tally]]:
    """Return for each stratum, for all of them and for S7 a tally for each case."""
    usual = [outcome.score.areas for outcome in outcomes if not outcome.breaks_prior]
    broken = [outcome.score.areas for outcome in outcomes if outcome.breaks_prior]
    return {
        **{name: [areas.pooled(strata=[stratum]) for areas in usual] for name, stratum in STRATA.items()},
        WHOLE: [areas.pooled() for areas in usual],
        S7: [areas.pooled() for areas in broken],
    }


def ablation_row(full: Sequence[Outcome], rest: Sequence[Outcome]) -> dict[str, Any]:
    """Return IoU at 2 cm by stratum without a cue, and how much it differs from that of the full method.

    Both are of the same cases; the intervals are of differences case by case.
    """
    figure, rows = headline("iou"), {}
    with_all, without = tallies_by_row(full), tallies_by_row(rest)
    for name in (*ABLATED, WHOLE, S7):
        before, after = (float(figure(total(tallies[name]))) for tallies in (with_all, without))
        rows[name] = {
            "iou": number(after),
            "difference": number(after - before),
            "interval": difference_interval(without[name], with_all[name], figure),
        }
    return rows


def _of_kind(outcome: Outcome, kind: str) -> Tally:
    return outcome.score.areas.pooled([number for name, number in outcome.kinds if name == kind])


def _row(tallies: Sequence[Tally]) -> dict[str, Any]:
    """Figures of some area, pooled over the cases, with the interval of its IoU at 2 cm over the cases."""
    pooled = total(tallies)
    return {
        "hidden_m2": float(pooled.hidden),
        "claimed_m2": float(pooled.claimed),
        "tolerances_m": list(TOLERANCES_M),
        **{name: _numbers(getattr(pooled, name)) for name in ("recall", "precision", "f1", "iou")},
        **{f"{name}_interval": interval(tallies, headline(name)) for name in ("recall", "precision", "iou")},
    }


def headline(name: str) -> Callable[[Tally], FloatArray]:
    """Return what reads a figure, by its name in `Tally`, at the headline's tolerance."""
    return lambda tally: np.asarray(getattr(tally, name)[..., HEADLINE], dtype=np.float64)


def _other_figures(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    claims = [outcome.score.claims for outcome in outcomes]
    findings = [outcome.score.findings for outcome in outcomes]
    openings = [outcome.score.openings for outcome in outcomes]
    right = sum(float(claim.right[..., HEADLINE].sum()) for claim in claims)
    hypothesised = sum(outcome.hypothesised_m2 for outcome in outcomes)
    violation = sum(outcome.violation_m2 for outcome in outcomes)
    seen_through = sum(claim.violation_m2 for claim in claims)
    surfaces = [surface for claim in claims for surface in claim.surfaces]
    return {
        "outside_the_claim_m2": {
            "S5 out of frame": sum(finding.out_of_frame_m2 for finding in findings),
            "hidden, apart from all that is seen": sum(finding.unreachable_m2 for finding in findings),
            "inferred where a surface is seen": sum(claim.seen_m2 for claim in claims),
            "inferred in no view": sum(claim.out_m2 for claim in claims),
            "inferred of surfaces not scored": sum(claim.unscored_m2 for claim in claims),
        },
        "violation_audited_ppm": _ppm(violation, hypothesised),
        "violation_by_true_beams_ppm": _ppm(seen_through, hypothesised),
        "rms_normal_m": number(math.sqrt(sum(c.squared_m4 for c in claims) / right) if right else math.nan),
        "contour_m": _errors(np.concatenate([np.zeros(0), *(f.contour_m for f in findings)])),
        "corner_m": _errors(np.concatenate([np.zeros(0), *(f.corner_m for f in findings)])),
        "deviation": [_bin(row) for row in [*deviation_bins(surfaces), summary(surfaces)]],
        "confidence": _confidence(outcomes, in_breaks=False),
        "confidence_where_it_breaks": _confidence(outcomes, in_breaks=True),
        "reasons": _reasons(outcomes),
        "radius_m": _errors(np.concatenate([np.zeros(0), *(outcome.radius_m for outcome in outcomes)])),
        "merges": _pairs([outcome.merges for outcome in outcomes]),
        "openings": {
            **_pairs([found.counts for found in openings]),
            **{
                name: _errors(np.concatenate([np.zeros(0), *(getattr(found, name) for found in openings)]))
                for name in ("edge_m", "hidden_edge_m")
            },
        },
    }


def _confidence(outcomes: Sequence[Outcome], *, in_breaks: bool) -> dict[str, Any]:
    parts = [
        outcome.score.claims.in_breaks_reliability if in_breaks else outcome.score.claims.reliability
        for outcome in outcomes
    ]
    pooled = sum(parts, no_reliability())
    area = np.where(pooled.area > 0, pooled.area, np.nan)
    return {
        "brier": number(float(pooled.brier)),
        "brier_interval": interval(parts, lambda pool: pool.brier),
        "calibration_error": number(float(pooled.error)),
        "calibration_error_interval": interval(parts, lambda pool: pool.error),
        "area_m2": _numbers(pooled.area),
        "predicted": _numbers(pooled.predicted / area),
        "came_true": _numbers(pooled.right / area),
    }


def _reasons(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """For each reason why area was inferred: how much, which share is right, and the mean confidence."""
    sums: dict[str, FloatArray] = {}
    for outcome in outcomes:
        for row in outcome.score.claims.by_reason:
            areas = np.array([row.claimed_m2, row.right_m2, row.predicted_m2])
            sums[row.reason] = sums.get(row.reason, np.zeros(3)) + areas
    return {
        reason: {
            "claimed_m2": float(claimed),
            "right": float(right / claimed),
            "confidence": float(predicted / claimed),
        }
        for reason, (claimed, right, predicted) in sums.items()
        if claimed > 0
    }


def _boundary_iou(outcomes: Sequence[Outcome], stratum: Stratum) -> float | None:
    both = sum(float(outcome.score.findings.band_in_both[stratum]) for outcome in outcomes)
    either = sum(float(outcome.score.findings.band_in_either[stratum]) for outcome in outcomes)
    return both / either if either > 0 else None


def _pairs(counts: Sequence[PairCounts]) -> dict[str, Any]:
    pooled = sum(counts, PairCounts())
    return {
        "right": pooled.right,
        "wrong": pooled.wrong,
        "missed": pooled.missed,
        "precision": number(pooled.precision),
        "recall": number(pooled.recall),
        "f1": number(pooled.f1),
    }


def _errors(values: FloatArray) -> dict[str, Any]:
    """Median, mean and 95 % of lengths; what was missed counts as infinite, and the mean leaves it out."""
    finite = values[np.isfinite(values)]
    if not len(values):
        return {"n": 0, "missed": 0, "median": None, "mean": None, "p95": None}
    median, high = np.quantile(values, [0.5, 0.95], method="lower")
    return {
        "n": len(values),
        "missed": len(values) - len(finite),
        "median": number(float(median)),
        "mean": number(float(finite.mean()) if len(finite) else math.nan),
        "p95": number(float(high)),
    }


def _bin(row: Any) -> dict[str, Any]:
    return {
        "n_surfaces": row.n_surfaces,
        "median_sd_m": number(row.sd_m),
        "within_2_sd": number(row.within),
        "within_2_sd_of_its_own": number(row.within_own),
    }


def _ppm(part: float, whole: float) -> float | None:
    return 1e6 * part / whole if whole > 0 else None


def _numbers(values: FloatArray) -> list[float | None]:
    return [number(float(value)) for value in np.atleast_1d(values)]
