# SPDX-License-Identifier: MIT
"""Tables: a summary of outcomes as Markdown."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from completion.evaluation.tally import HEADLINE


def strata_table(record: Mapping[str, Any]) -> str:
    """Return the table by stratum of one method's record."""
    head = (
        "| area | hidden m2 | claimed m2 | recall 1 / 2 / 5 cm | precision 1 / 2 / 5 cm | F1 at 2 cm "
        "| IoU 1 / 2 / 5 cm | 95 % interval of IoU at 2 cm | boundary IoU |\n"
        "|---|---|---|---|---|---|---|---|---|"
    )
    lines = [
        f"| {name} | {row['hidden_m2']:.2f} | {row['claimed_m2']:.2f} | {_shares(row['recall'])} "
        f"| {_shares(row['precision'])} | {_share(row['f1'][HEADLINE])} | {_shares(row['iou'])} "
        f"| {_shares(row['iou_interval'])} | {_share(row.get('boundary_iou'))} |"
        for name, row in record["rows"].items()
        if row["hidden_m2"] > 0 or row["claimed_m2"] > 0
    ]
    return "\n".join([head, *lines])


def figures_table(records: Mapping[str, Mapping[str, Any]]) -> str:
    """Return the figures besides the strata, a column for each method."""
    figures: list[tuple[str, Callable[[Mapping[str, Any]], str]]] = [
        ("IoU at 2 cm, without S7", lambda r: _iou(r, "whole, without S7")),
        ("IoU at 2 cm, S7", lambda r: _iou(r, "S7 breaks the prior")),
        ("free-space violation, audited, ppm", lambda r: _plain(r["violation_audited_ppm"])),
        ("the same by true beams, ppm", lambda r: _plain(r["violation_by_true_beams_ppm"])),
        ("RMS along the normal, mm", lambda r: _mm(r["rms_normal_m"])),
        ("hidden outline: mean / 95 %, mm", lambda r: _pair(r["contour_m"], "mean", "p95")),
        ("hidden corners: median mm (missed of all)", lambda r: _corners(r["corner_m"])),
        ("within 2 sd / of its own surface (surfaces)", lambda r: _deviation(r["deviation"][-1])),
        ("confidence: calibration error / Brier", lambda r: _calibration(r["confidence"])),
        ("the same where the prior breaks", lambda r: _calibration(r["confidence_where_it_breaks"])),
        ("merge precision / recall / F1", lambda r: _counts(r["merges"])),
        ("openings precision / recall / F1", lambda r: _counts(r["openings"])),
        ("opening edges: mean, mm", lambda r: _mm(r["openings"]["edge_m"]["mean"])),
    ]
    head = "| | " + " | ".join(records) + " |\n" + "|---" * (len(records) + 1) + "|"
    lines = (f"| {name} | " + " | ".join(map(text, records.values())) + " |" for name, text in figures)
    return "\n".join([head, *lines])


def _iou(record: Mapping[str, Any], row: str) -> str:
    return _share(record["rows"][row]["iou"][HEADLINE])


def outside_table(records: Mapping[str, Mapping[str, Any]]) -> str:
    """Return the area outside the claim, a column for each method, square metres."""
    names: Sequence[str] = list(next(iter(records.values()))["outside_the_claim_m2"])
    head = "| outside the claim, m2 | " + " | ".join(records) + " |\n" + "|---" * (len(records) + 1) + "|"
    lines = (
        f"| {name} | " + " | ".join(f"{r['outside_the_claim_m2'][name]:.2f}" for r in records.values()) + " |"
        for name in names
    )
    return "\n".join([head, *lines])


def _share(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"


def _shares(values: Sequence[float | None]) -> str:
    return " / ".join(_share(value) for value in values)


def _plain(value: float | None) -> str:
    return "-" if value is None else f"{value:.0f}"


def _mm(value: float | None) -> str:
    return "-" if value is None else f"{1000 * value:.2f}"


def _pair(errors: Mapping[str, Any], one: str, other: str) -> str:
    return f"{_mm(errors[one])} / {_mm(errors[other])}"


def _corners(errors: Mapping[str, Any]) -> str:
    return f"{_mm(errors['median'])} ({errors['missed']} of {errors['n']})"


def _deviation(row: Mapping[str, Any]) -> str:
    return f"{_share(row['within_2_sd'])} / {_share(row['within_2_sd_of_its_own'])} ({row['n_surfaces']})"


def _calibration(record: Mapping[str, Any]) -> str:
    return f"{_share(record['calibration_error'])} / {_share(record['brier'])}"


def _counts(record: Mapping[str, Any]) -> str:
    return f"{_share(record['precision'])} / {_share(record['recall'])} / {_share(record['f1'])}"
