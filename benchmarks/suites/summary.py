# SPDX-License-Identifier: MIT
"""Outcomes of many cases as one record, by stratum, with bootstrap intervals over the cases; its tables."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from benchmarks.metrics.bootstrap import difference_interval, interval, number
from benchmarks.metrics.completion import Outcome
from benchmarks.metrics.inferred import (
    HEADLINE,
    TOLERANCES_M,
    PairCounts,
    Tally,
    deviation_bins,
    no_reliability,
    summary,
    total,
)
from benchmarks.metrics.truth import Stratum
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


def strata_table(record: Mapping[str, Any]) -> str:
    """Return the table by stratum of one method's record."""
    head = (
        "| area | hidden m2 | claimed m2 | recall 1 / 2 / 5 cm | precision 1 / 2 / 5 cm | F1 at 2 cm "
        "| IoU 1 / 2 / 5 cm | 95 % interval of IoU at 2 cm | boundary IoU |\n"
        "|---|---|---|---|---|---|---|---|---|"
    )
    lines = [
        f"| {name} | {row['hidden_m2']:.2f} | {row['claimed_m2']:.2f} | {_shares(row['recall'])} "
        f"| {_shares(row['precision'])} | {share_text(row['f1'][HEADLINE])} | {_shares(row['iou'])} "
        f"| {_shares(row['iou_interval'])} | {share_text(row.get('boundary_iou'))} |"
        for name, row in record["rows"].items()
        if row["hidden_m2"] > 0 or row["claimed_m2"] > 0
    ]
    return "\n".join([head, *lines])


def figures_table(records: Mapping[str, Mapping[str, Any]]) -> str:
    """Return the figures besides the strata, a column for each method."""
    figures: list[tuple[str, Callable[[Mapping[str, Any]], str]]] = [
        ("IoU at 2 cm, without S7", lambda r: _iou(r, "whole, without S7")),
        ("IoU at 2 cm, S7", lambda r: _iou(r, "S7 breaks the prior")),
        ("free-space violation, audited, ppm", lambda r: plain_text(r["violation_audited_ppm"])),
        ("the same by true beams, ppm", lambda r: plain_text(r["violation_by_true_beams_ppm"])),
        ("RMS along the normal, mm", lambda r: _mm(r["rms_normal_m"])),
        ("hidden outline: mean / 95 %, mm", lambda r: _pair(r["contour_m"], "mean", "p95")),
        ("hidden corners: median mm (missed of all)", lambda r: errors_text(r["corner_m"])),
        ("within 2 sd / of its own surface (surfaces)", lambda r: _deviation(r["deviation"][-1])),
        ("radii of cylinders: median mm (missed of all)", lambda r: errors_text(r["radius_m"])),
        ("confidence: calibration error / Brier", lambda r: _calibration(r["confidence"])),
        ("the same where the prior breaks", lambda r: _calibration(r["confidence_where_it_breaks"])),
        ("merge precision / recall / F1", lambda r: _counts(r["merges"])),
        ("openings precision / recall / F1", lambda r: _counts(r["openings"])),
        ("opening edges: mean, mm", lambda r: _mm(r["openings"]["edge_m"]["mean"])),
        ("their hidden part: mean, mm", lambda r: _mm(r["openings"]["hidden_edge_m"]["mean"])),
    ]
    head = "| | " + " | ".join(records) + " |\n" + "|---" * (len(records) + 1) + "|"
    lines = (f"| {name} | " + " | ".join(map(text, records.values())) + " |" for name, text in figures)
    return "\n".join([head, *lines])


def confidence_table(confidence: Mapping[str, Any]) -> str:
    """Return the reliability of confidences bin by bin, and below it error and Brier score with intervals."""
    head = "| predicted confidence | area, m2 | mean confidence | share right |\n|---|---|---|---|"
    names = ("area_m2", "predicted", "came_true")
    tenths = [
        (f"{k / 10:.1f} to {(k + 1) / 10:.1f}", *(confidence[name][k] for name in names)) for k in range(10)
    ]
    lines = [
        f"| {bounds} | {area:.2f} | {share_text(predicted)} | {share_text(right)} |"
        for bounds, area, predicted, right in tenths
        if area > 0
    ]
    error, brier = (
        interval_text(confidence[name], confidence[f"{name}_interval"])
        for name in ("calibration_error", "brier")
    )
    return (
        "\n".join([head, *lines])
        + f"\n\nCalibration error {error}, Brier score {brier}, 95 % over the cases."
    )


def deviation_table(bins: Sequence[Mapping[str, Any]]) -> str:
    """Return the share within two predicted deviations, by the size of the deviation; all in the last row."""
    head = (
        "| surfaces | median predicted sd, mm | within 2 sd of a true surface | of its own surface |\n"
        "|---|---|---|---|"
    )
    lines = [
        f"| {row['n_surfaces']}{' (all)' * (row is bins[-1])} | {_mm(row['median_sd_m'])} "
        f"| {share_text(row['within_2_sd'])} | {share_text(row['within_2_sd_of_its_own'])} |"
        for row in bins
    ]
    return "\n".join([head, *lines])


def reasons_table(reasons: Mapping[str, Mapping[str, float]]) -> str:
    """Return what was claimed for each reason, which share of it is right, and the mean confidence."""
    head = "| inferred because of | claimed m2 | share right at 2 cm | mean confidence |\n|---|---|---|---|"
    lines = [
        f"| {reason} | {row['claimed_m2']:.2f} | {row['right']:.3f} | {row['confidence']:.3f} |"
        for reason, row in reasons.items()
    ]
    return "\n".join([head, *lines])


def ablation_table(ablations: Mapping[str, Mapping[str, Any]], full: Mapping[str, Any]) -> str:
    """Return IoU at 2 cm by stratum with all cues and without one, each difference with its interval."""
    rows = list(next(iter(ablations.values())))
    head = "| left out | " + " | ".join(rows) + " |\n" + "|---" * (len(rows) + 1) + "|"
    lines = ["| nothing | " + " | ".join(_iou(full, row) for row in rows) + " |"]
    for cue, by_row in ablations.items():
        cells = (
            f"{share_text(r['iou'])} ({_signed(r['difference'], r['interval'])})" for r in by_row.values()
        )
        lines.append(f"| {cue} | " + " | ".join(cells) + " |")
    return "\n".join([head, *lines])


def _signed(value: float | None, bounds: Sequence[float | None]) -> str:
    if value is None or bounds[0] is None or bounds[1] is None:
        return "-"
    return f"{value:+.3f} [{bounds[0]:+.3f}, {bounds[1]:+.3f}]"


def _iou(record: Mapping[str, Any], row: str) -> str:
    return share_text(record["rows"][row]["iou"][HEADLINE])


def outside_table(records: Mapping[str, Mapping[str, Any]]) -> str:
    """Return the area outside the claim, a column for each method, square metres."""
    names: Sequence[str] = list(next(iter(records.values()))["outside_the_claim_m2"])
    head = "| outside the claim, m2 | " + " | ".join(records) + " |\n" + "|---" * (len(records) + 1) + "|"
    lines = (
        f"| {name} | " + " | ".join(f"{r['outside_the_claim_m2'][name]:.2f}" for r in records.values()) + " |"
        for name in names
    )
    return "\n".join([head, *lines])


def share_text(value: float | None) -> str:
    """Return a share with three digits, "-" for none."""
    return "-" if value is None else f"{value:.3f}"


def interval_text(value: float | None, bounds: Sequence[float | None]) -> str:
    """Return a share with its interval."""
    low, high = bounds
    return "-" if value is None else f"{value:.3f} [{share_text(low)}, {share_text(high)}]"


def _shares(values: Sequence[float | None]) -> str:
    return " / ".join(share_text(value) for value in values)


def plain_text(value: float | None) -> str:
    """Return a whole number, "-" for none."""
    return "-" if value is None else f"{value:.0f}"


def _mm(value: float | None) -> str:
    return "-" if value is None else f"{1000 * value:.2f}"


def _pair(errors: Mapping[str, Any], one: str, other: str) -> str:
    return f"{_mm(errors[one])} / {_mm(errors[other])}"


def errors_text(errors: Mapping[str, Any]) -> str:
    """Return the median of errors in millimetres, and how many of how many were missed."""
    return f"{_mm(errors['median'])} ({errors['missed']} of {errors['n']})"


def _deviation(row: Mapping[str, Any]) -> str:
    within, own = share_text(row["within_2_sd"]), share_text(row["within_2_sd_of_its_own"])
    return f"{within} / {own} ({row['n_surfaces']})"


def _calibration(record: Mapping[str, Any]) -> str:
    return f"{share_text(record['calibration_error'])} / {share_text(record['brier'])}"


def _counts(record: Mapping[str, Any]) -> str:
    return f"{share_text(record['precision'])} / {share_text(record['recall'])} / {share_text(record['f1'])}"


STRATA_ROWS = {
    "S1 surface-preserving": "S1", "S2 surface-breaking": "S2", "S3 boundary-breaking": "S3",
    "S4 self-occluded cylinder": "S4", "S6 opening cut": "S6", "S7 breaks the prior": "S7",
}  # fmt: skip
_FIGURES = {"recall": "recall", "precision": "precision", "iou": "IoU"}
_SLIVERS = 0.05  # of the hidden area; a stratum that holds less is not shown


def sweep_record(sweep: Any, results: Sequence[tuple[str, float, Outcome]]) -> dict[str, Any]:
    """Return for each kind of scenes and each level what was measured, and the summary of its cases."""
    parts: dict[str, list[dict[str, Any]]] = {}
    for part in dict.fromkeys(kind for kind, _, _ in results):
        parts[part] = [
            {"level": level, "measured": _spread(outcomes), **summarise(outcomes)}
            for level in sweep.levels
            if (outcomes := [o for kind, at, o in results if (kind, at) == (part, level)])
        ]
    return {"axis": sweep.axis, "measured": sweep.measured, "parts": parts}


def _spread(outcomes: Sequence[Outcome]) -> list[float] | None:
    """Mean, least and largest of what was measured; None where nothing was."""
    values = np.array([outcome.measured for outcome in outcomes])
    if not np.isfinite(values).all():
        return None
    return [float(values.mean()), float(values.min()), float(values.max())]


def sweep_table(record: Mapping[str, Any], part: str) -> str:
    """Return the table of one kind of scenes: figures at 2 cm, with 95 % intervals."""
    rows = record["parts"][part]
    strata = [name for name in STRATA_ROWS if any(_matters(row["rows"], name) for row in rows)]
    head = [record["axis"]]
    head += [f"measured: {record['measured']}"] if record["measured"] else []
    head += ["cases", "recall", "precision", "IoU", *(f"IoU {STRATA_ROWS[name]}" for name in strata)]
    head += ["radius: median mm (missed of all)", "within 2 sd", "calibration error", "violation, ppm"]
    lines = [_cells(row, strata, measured=bool(record["measured"])) for row in rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in [head, ["---"] * len(head), *lines])


def _matters(rows: Mapping[str, Any], stratum: str) -> bool:
    """Whether more than slivers of what is hidden are of a stratum."""
    hidden = max(rows[WHOLE]["hidden_m2"], rows[S7]["hidden_m2"])
    return bool(rows[stratum]["hidden_m2"] > _SLIVERS * hidden)


def _cells(row: Mapping[str, Any], strata: Sequence[str], *, measured: bool) -> list[str]:
    cells = [f"{row['level']:g}"]
    if measured:
        cells.append("{:.1f} ({:.1f}..{:.1f})".format(*row["measured"]) if row["measured"] else "-")
    whole = row["rows"][WHOLE]
    cells += [
        str(row["n_cases"]),
        *(interval_text(whole[name][HEADLINE], whole[f"{name}_interval"]) for name in _FIGURES),
        *(interval_text(row["rows"][s]["iou"][HEADLINE], row["rows"][s]["iou_interval"]) for s in strata),
        errors_text(row["radius_m"]),
        share_text(row["deviation"][-1]["within_2_sd"]),
        share_text(row["confidence"]["calibration_error"]),
        plain_text(row["violation_audited_ppm"]),
    ]
    return cells
