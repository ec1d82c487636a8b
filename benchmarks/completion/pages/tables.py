# SPDX-License-Identifier: MIT
"""Tables: a summary of outcomes as Markdown."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from benchmarks.completion.truth.tally import HEADLINE


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
