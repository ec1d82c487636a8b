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
_MOST_DIGITS, _ALONE = 4, 3  # after the point, with an interval and alone: of a model's numbers all are known
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
        numbers = [round(scale * each, _PLACES) + 0.0 for each in (row.value, row.low, row.high)]
        spread = [_finite(scale * each) for each in (row.sd, row.measured_sd)]
        labels, hint = " ".join(map(str, row.surfaces)), row.preferred
        meant = [] if hint is None else [round(scale * hint.value, _PLACES), hint.series, hint.probability]
        rows.append([number, row.kind, *numbers, unit, row.count, labels, row.basis, *spread, row.note,
                     *(meant or [None] * 3)])  # fmt: skip
    return csv_text(_COLUMNS, rows)


def dimension_records(dimensions: PartDimensions) -> list[dict[str, Any]]:
    """Return dimensions as part.json holds them: metres, degrees, m2 and m3."""
    return [_record(row, float(np.degrees(1.0)) if row.unit == "rad" else 1.0) for row in dimensions.rows]


def _record(row: PartDimension, scale: float) -> dict[str, Any]:
    hint = row.preferred
    meant = {} if hint is None else {"series": hint.series, "probability": hint.probability}
    return {
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
        "preferred": None if hint is None else {"value": scale * hint.value, **meant},
    }


def blend_records(dimensions: PartDimensions) -> list[dict[str, Any]]:
    """Return blends as part.json holds them: metres, degrees; the edge behind each by points in order."""
    return [
        {
            "kind": blend.kind,
            "surfaces": list(blend.labels),
            "between": list(blend.supports),
            "size": blend.size_m,
            "interval": list(blend.interval_m),
            "standard_deviation": _finite(blend.sd_m),
            "angle": float(np.degrees(blend.angle)) if blend.kind == "chamfer" else None,
            "edge": blend.edge.tolist(),
            "edge_standard_deviation": blend.edge_sd_m.tolist(),
        }
        for blend in dimensions.blends
    ]


def frame_record(frame: DatumFrame) -> dict[str, Any]:
    """Return the frame of the overall sizes as part.json holds it: unit vectors, and where they are from."""
    return {"axes": frame.axes.tolist(), "note": frame.note}


def value_text(row: PartDimension, *, has_interval: bool = True) -> str:
    """A dimension in words: "12.003 mm ± 0.004", to the digits that its interval leaves."""
    scale, unit = {"m3": (1e6, "cm3"), "m2": (1e4, "cm2")}.get(row.unit, unit_scale(row.unit))
    half = scale * (row.high - row.low) / 2
    most = _MOST_DIGITS if has_interval else _ALONE
    shown = most if half < 10.0**-most else int(has_interval) - np.floor(np.log10(half))
    digits = int(np.clip(shown, 0, most))
    value = round(scale * (row.value if row.bounds is None else sum(row.bounds) / 2), digits) + 0.0
    text = f"{value:.{digits}f} {unit}"
    if not has_interval:
        return text
    least = 10.0**-digits
    return f"{text} ± {half:.{digits}f}" if half >= least else f"{text} ± <{least:.{digits}f}"


def symbol_text(row: PartDimension, *, has_interval: bool = False) -> str:
    """A dimension as on a drawing: "6 x \u2300 9.003 mm", "R 4.0 mm"."""
    sign = "\u2300 " if row.kind.endswith("diameter") else "R " if row.kind.endswith("radius") else ""
    many = f"{row.count} \u00d7 " if row.count > 1 and not row.is_pattern else ""
    holes = f", {row.count} holes" if row.kind == "pitch circle diameter" else ""
    return f"{many}{sign}{value_text(row, has_interval=has_interval)}{holes}"


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
