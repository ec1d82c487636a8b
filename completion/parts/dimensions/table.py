# SPDX-License-Identifier: MIT
"""Tables of dimensions: records of part.json, rows of dimensions.csv, and values in words."""

from __future__ import annotations

from typing import Any

import numpy as np

from completion.parts.dimensions.dimension import DatumFrame, PartDimension, PartDimensions, unit_scale
from scenes.run.csv_table import csv_text

_COLUMNS = (
    "number", "kind", "value", "low", "high", "unit", "count", "surfaces", "basis", "value_sd",
    "sd_without_relations", "note", "preferred", "preferred_series", "preferred_probability",
)  # fmt: skip
_MOST_DIGITS = 5
_EXACT_DIGITS = 3  # of numbers that are known exactly
_PLACES = 9  # after the point, of numbers in dimensions.csv
_BASIS = {
    "measured": "its own points",
    "relations": "relations",
    "pattern": "regular places",
    "bounds": "outermost points",
}


def dimensions_csv(dimensions: PartDimensions) -> str:
    """Return dimensions.csv: a row a dimension with its 95 % interval, in the mm, deg, mm2, mm3 of `unit`."""
    rows = []
    for number, row in enumerate(dimensions.rows, start=1):
        scale, unit = unit_scale(row.unit)
        hint, numbers = (
            row.preferred,
            [round(scale * each, _PLACES) for each in (row.value, row.low, row.high)],
        )
        meant = (
            [None] * 3
            if hint is None
            else [round(scale * hint.value, _PLACES), hint.series, hint.probability]
        )
        rows.append(
            [
                number, row.kind, *numbers, unit, row.count, " ".join(map(str, row.surfaces)), row.basis,
                _finite(scale * row.sd), _finite(scale * row.measured_sd), row.note, *meant,
            ]
        )  # fmt: skip
    return csv_text(_COLUMNS, rows)


def dimension_records(dimensions: PartDimensions) -> list[dict[str, Any]]:
    """Return dimensions as part.json holds them: metres, degrees, m2 and m3."""
    records = []
    for row in dimensions.rows:
        scale = float(np.degrees(1.0)) if row.unit == "rad" else 1.0
        hint = row.preferred
        records.append(
            {
                "kind": row.kind,
                "value": scale * row.value,
                "interval": [scale * row.low, scale * row.high],
                "unit": "deg" if row.unit == "rad" else row.unit,
                "standard_deviation": _finite(scale * row.sd),
                "standard_deviation_measured": _finite(scale * row.measured_sd),
                "count": row.count,
                "surfaces": list(row.surfaces),
                "basis": row.basis,
                "is_determined": row.is_determined,
                "note": row.note,
                "preferred": None
                if hint is None
                else {"value": scale * hint.value, "series": hint.series, "probability": hint.probability},
            }
        )
    return records


def frame_record(frame: DatumFrame) -> dict[str, Any]:
    """Return the frame of the overall sizes as part.json holds it: unit vectors, and where they are from."""
    return {"axes": frame.axes.tolist(), "note": frame.note}


def value_text(row: PartDimension, *, has_interval: bool = True) -> str:
    """A dimension in words: "12.003 mm ± 0.004", to the digits that its interval leaves."""
    scale, unit = unit_scale(row.unit)
    if row.unit == "m3":
        scale, unit = 1e6, "cm3"
    if row.unit == "m2":
        scale, unit = 1e4, "cm2"
    half = scale * row.half
    is_exact = half < 10.0**-_MOST_DIGITS
    shown = _EXACT_DIGITS if is_exact else int(has_interval) - np.floor(np.log10(half))
    digits = int(np.clip(shown, 0, _MOST_DIGITS))
    text = f"{scale * (row.value if row.basis != 'bounds' else (row.low + row.high) / 2):.{digits}f} {unit}"
    if not has_interval:
        return text
    least = 10.0**-digits
    return f"{text} \u00b1 {half:.{digits}f}" if half >= least else f"{text} \u00b1 <{least:.{digits}f}"


def symbol_text(row: PartDimension, *, has_interval: bool = False) -> str:
    """A dimension as on a drawing: "6 x \u2300 9.003 mm", "R 4.0 mm"."""
    sign = "\u2300 " if row.kind.endswith("diameter") else "R " if row.kind.endswith("radius") else ""
    many = f"{row.count} \u00d7 " if row.count > 1 and row.kind != "start angle" else ""
    return f"{many}{sign}{value_text(row, has_interval=has_interval)}"


def preferred_text(row: PartDimension) -> str:
    """What a dimension was probably meant to be, and by which series; empty where nothing is told."""
    if row.preferred is None:
        return ""
    scale, unit = unit_scale(row.unit)
    return f"{scale * row.preferred.value:.6g} {unit} ({row.preferred.series})"


def basis_text(row: PartDimension) -> str:
    """What a dimension follows from, in words."""
    return "relations alone" if row.basis == "relations" and row.is_determined else _BASIS[row.basis]


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
