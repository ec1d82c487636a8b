# SPDX-License-Identifier: MIT
"""Record of a check against a design: check.json, and a table of its elements."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

from completion.asbuilt.findings import (
    SAMPLE_REASONS,
    VERDICTS,
    DesignCheck,
    ElementFinding,
    Extra,
    FaceFinding,
    Interval,
)
from scenes.mesh.design import Element
from scenes.run.atomic import to_plain
from scenes.run.csv_table import csv_text

FORMAT = "unseen-check/1"
_UNITS = {"length": "m", "area": "m2", "tilt": "rad", "turn_deg": "deg", "interval": "95 %"}
_INTERVALS = {"offset": "_m", "tilt": "_rad", "bow": "_m", "thickness": "_m", "radius": "_m"}


def element_label(element: Element) -> str:
    """Return class and name of an element.

    Examples
    --------
    >>> element_label(Element("W1", "IfcWall"))
    'IfcWall W1'
    """
    return f"{element.ifc_class} {element.name}".strip()


def check_record(check: DesignCheck) -> dict[str, Any]:
    """Return a check as what check.json holds: values of JSON alone, null for what is not known.

    `changes_since` reads it again.
    """
    where = check.alignment
    record: dict[str, Any] = to_plain(
        {
            "format": FORMAT,
            "units": _UNITS,
            "design": check.design.name,
            "scans": check.scans,
            "alignment": {
                "shift_m": where.shift_m,
                "turn_deg": where.turn_deg,
                "sd_m": where.shift_sd_m,
                "turn_sd_deg": where.turn_sd_deg,
                "station_shift_m": where.station_shift_m,
                "world_from_sensor": [pose.matrix for pose in where.poses],
                "tau_m": where.tau_m,
                "is_free": where.is_free,
                "sentences": where.sentences,
            },
            "loa_bands_m": check.loa_bands_m,
            "faces_tested": check.faces_tested,
            "z": check.z,
            "false_alarms_expected": check.false_alarms_expected,
            "verdicts": _counts(check.elements),
            "elements": [_element_record(finding) for finding in check.elements],
            "extra": [_extra_record(extra) for extra in check.extra],
            "warnings": check.warnings,
        }
    )
    return record


def _counts(elements: Sequence[ElementFinding]) -> dict[str, int]:
    found = Counter(finding.verdict for finding in elements)
    return {verdict: found[verdict] for verdict in VERDICTS}


def _element_record(finding: ElementFinding) -> dict[str, Any]:
    element, beams, inference = finding.element, finding.beams, finding.inference
    return {
        "surface": finding.surface,
        "global_id": element.global_id,
        "class": element.ifc_class,
        "name": element.name,
        "storey": element.storey,
        "type": element.type_name,
        "verdict": finding.verdict,
        "kind": finding.kind,
        "sentence": finding.sentence,
        "tolerance_m": finding.tolerance_m,
        "directions_measured": finding.directions_measured,
        "offset_m": _interval_record(finding.offset),
        **{name: _interval_record(getattr(finding, name)) for name in list(_INTERVALS)[1:]},
        "loa": {"represented": finding.loa_represented, "measured": finding.loa_measured},
        "exposed_m2": finding.exposed_m2,
        "share": {name: getattr(finding.share, name) for name in ("measured", "inferred", "unknown")},
        "beams": {
            "on_m2": beams.on_m2,
            "through_m2": beams.through_m2,
            "hidden_m2": beams.hidden_m2,
            "count": beams.n_beams,
        },
        "hidden": [
            {"by": one.by, "stations": one.stations, "area_m2": one.area_m2} for one in finding.hidden
        ],
        "not_seen": {reason.replace(" ", "_"): share for reason, share in finding.not_seen.items()},
        "same_as": finding.same_as,
        "related_extra": finding.related_extra,
        "inference": None
        if inference is None
        else {
            "share": inference.share,
            "probability": inference.probability,
            "sentence": inference.sentence,
        },
        "faces": [_face_record(face) for face in finding.faces],
    }


def _face_record(face: FaceFinding) -> dict[str, Any]:
    first, last = face.histogram_m
    return {
        "kind": face.kind,
        "is_main": face.is_main,
        "centre_m": face.centre,
        "normal": face.normal,
        "area_m2": face.area_m2,
        "measured_m2": face.measured_m2,
        "beams": face.n_beams,
        "support": face.support,
        "is_tested": face.is_tested,
        "deviation_m": _interval_record(face.deviation),
        "offset_m": _interval_record(face.offset),
        **{name: _interval_record(getattr(face, name)) for name in ("tilt", "bow", "radius")},
        "place_m": face.place,
        "rms_m": face.rms_m,
        "histogram": {"first_m": first, "last_m": last, "beams": face.histogram}
        if face.histogram.any()
        else None,
    }


def _interval_record(interval: Interval | None) -> dict[str, Any] | None:
    if interval is None:
        return None
    ends = {"value": interval.value, "low": interval.low, "high": interval.high}
    return ends if interval.along is None else {**ends, "along": interval.along}


def _extra_record(extra: Extra) -> dict[str, Any]:
    return {
        "id": extra.name,
        "box_m": extra.box_m,
        "area_m2": extra.area_m2,
        "stations": extra.stations,
        "near": extra.near,
        "hides": extra.hides,
    }


def elements_csv(check: DesignCheck) -> str:
    """Return elements.csv: a row an element, empty cells for what is not known; "; " parts several names."""
    rows = [_row(to_plain(_element_record(finding))) for finding in check.elements]
    columns = list(rows[0]) if rows else ["surface"]
    return csv_text(columns, [list(row.values()) for row in rows])


def _row(held: dict[str, Any]) -> dict[str, Any]:
    """The cells of an element, by column, from its record."""
    names = ("surface", "global_id", "class", "name", "storey", "type", "verdict", "kind", "tolerance_m")
    row = {name: held[name] for name in names}
    for name, unit in _INTERVALS.items():
        found = held["offset_m" if name == "offset" else name] or {}
        row |= {
            f"{name}{end}{unit}": found.get(key)
            for end, key in (("", "value"), ("_low", "low"), ("_high", "high"))
        }
    along = (held["offset_m"] or {}).get("along") or (None, None, None)
    row |= {f"offset_along_{axis}": value for axis, value in zip("xyz", along, strict=True)}
    row |= {f"loa_{name}": band for name, band in held["loa"].items()}
    row["exposed_m2"] = held["exposed_m2"]
    row |= {f"share_{name}": share for name, share in held["share"].items()}
    row |= {f"beams_{name}": value for name, value in held["beams"].items()}
    row["hidden_by"] = "; ".join(one["by"] for one in held["hidden"])
    row["hidden_from"] = "; ".join(dict.fromkeys(s for one in held["hidden"] for s in one["stations"]))
    reasons = [reason.replace(" ", "_") for reason in SAMPLE_REASONS if reason]
    row |= {f"not_seen_{reason}": held["not_seen"].get(reason) for reason in reasons}
    inference = held["inference"] or {}
    row["same_as"] = held["same_as"]
    row["related_extra"] = held["related_extra"]
    row |= {f"inferred_{name}": inference.get(name) for name in ("share", "probability")}
    row["sentence"] = held["sentence"]
    return row
