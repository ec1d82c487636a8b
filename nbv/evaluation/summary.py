# SPDX-License-Identifier: MIT
"""Summary: outcomes of many cases as one record, by stratum, with bootstrap intervals over the cases."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from completion.evaluation.calibration import deviation_bins, no_reliability, summary
from completion.evaluation.splits import PairCounts
from completion.evaluation.strata import Stratum
from completion.evaluation.tally import HEADLINE, TOLERANCES_M, Tally, total
from nbv.evaluation.study import Outcome
from scenes.checks import FloatArray

STRATA = {
    "S1 surface-preserving": Stratum.INTERIOR,
    "S2 surface-breaking": Stratum.BREAKING,
    "S3 boundary-breaking": Stratum.BOUNDARY,
    "S4 self-occluded cylinder": Stratum.SELF,
    "S6 opening cut": Stratum.OPENING,
    "on nothing hidden": Stratum.NONE,
}
_N_RESAMPLES = 1000
KINDS = ("table", "column", "wall", "floor")


def summarise(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """Return all figures of one method's outcomes as a JSON record, in metres and square metres.

    Strata are taken over the scenes that keep to the prior; "S7 breaks the prior" is everything in the
    others, and "S7 where it breaks" the places where they do.
    """
    usual = [outcome for outcome in outcomes if not outcome.breaks_prior]
    broken = [outcome for outcome in outcomes if outcome.breaks_prior]
    rows = {
        name: _row([outcome.score.areas.pooled(strata=[stratum]) for outcome in usual])
        for name, stratum in STRATA.items()
    }
    for name, stratum in STRATA.items():
        rows[name]["boundary_iou"] = _boundary_iou(usual, stratum)
    rows["whole, without S7"] = _row([outcome.score.areas.pooled() for outcome in usual])
    rows["S7 breaks the prior"] = _row([outcome.score.areas.pooled() for outcome in broken])
    rows["S7 where it breaks"] = _row([outcome.score.in_breaks for outcome in broken])
    for kind in KINDS:
        rows[f"surfaces: {kind}"] = _row([_of_kind(outcome, kind) for outcome in usual])
    return {"n_cases": len(outcomes), "n_breaking": len(broken), "rows": rows, **_other_figures(outcomes)}


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
        "iou_interval": interval(tallies, lambda tally: float(tally.iou[HEADLINE])),
    }


def interval(tallies: Sequence[Tally], figure: Callable[[Tally], float]) -> list[float | None]:
    """Return the 2.5 % and 97.5 % quantiles of a figure when the cases are drawn anew with replacement."""
    if not tallies:
        return [None, None]
    rng = np.random.default_rng(0)
    drawn = rng.integers(0, len(tallies), (_N_RESAMPLES, len(tallies)))
    stacked = Tally(*(np.stack([getattr(t, name) for t in tallies]) for name in Tally.__slots__))
    values = []
    for pick in drawn:
        parts = (getattr(stacked, name)[pick].sum(axis=0) for name in Tally.__slots__)
        values.append(figure(Tally(*parts)))
    finite = np.array(values)[np.isfinite(values)]
    return _numbers(np.quantile(finite, [0.025, 0.975])) if len(finite) else [None, None]


def _other_figures(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    claims = [outcome.score.claims for outcome in outcomes]
    findings = [outcome.score.findings for outcome in outcomes]
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
        "rms_normal_m": _number(math.sqrt(sum(c.squared_m4 for c in claims) / right) if right else math.nan),
        "contour_m": _errors(np.concatenate([np.zeros(0), *(f.contour_m for f in findings)])),
        "corner_m": _errors(np.concatenate([np.zeros(0), *(f.corner_m for f in findings)])),
        "deviation": [_bin(row) for row in [*deviation_bins(surfaces), summary(surfaces)]],
        "confidence": _confidence(outcomes, in_breaks=False),
        "confidence_where_it_breaks": _confidence(outcomes, in_breaks=True),
        "merges": _pairs([outcome.merges for outcome in outcomes]),
        "openings": {
            **_pairs([outcome.score.openings.counts for outcome in outcomes]),
            "edge_m": _errors(np.concatenate([np.zeros(0), *(o.score.openings.edge_m for o in outcomes)])),
        },
    }


def _confidence(outcomes: Sequence[Outcome], *, in_breaks: bool) -> dict[str, Any]:
    parts = (
        outcome.score.claims.in_breaks_reliability if in_breaks else outcome.score.claims.reliability
        for outcome in outcomes
    )
    pooled = sum(parts, no_reliability())
    area = np.where(pooled.area > 0, pooled.area, np.nan)
    return {
        "brier": _number(pooled.brier),
        "calibration_error": _number(pooled.error),
        "area_m2": _numbers(pooled.area),
        "predicted": _numbers(pooled.predicted / area),
        "came_true": _numbers(pooled.right / area),
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
        "precision": _number(pooled.precision),
        "recall": _number(pooled.recall),
        "f1": _number(pooled.f1),
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
        "median": _number(float(median)),
        "mean": _number(float(finite.mean()) if len(finite) else math.nan),
        "p95": _number(float(high)),
    }


def _bin(row: Any) -> dict[str, Any]:
    return {
        "n_surfaces": row.n_surfaces,
        "median_sd_m": _number(row.sd_m),
        "within_2_sd": _number(row.within),
        "within_2_sd_of_its_own": _number(row.within_own),
    }


def _ppm(part: float, whole: float) -> float | None:
    return 1e6 * part / whole if whole > 0 else None


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _numbers(values: FloatArray) -> list[float | None]:
    return [_number(float(value)) for value in np.atleast_1d(values)]
