# SPDX-License-Identifier: MIT
"""Results of a study of scans: what each scan and set measured, how exactly, what completion adds."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from nbv.coverage.coverage import share_error
from nbv.scanning.sensor import chosen_effects
from nbv.study.case import CaseSetting, load_setting
from nbv.study.pipeline import Columns
from nbv.study.scan_errors import ErrorTally, class_labels, merged
from nbv.study.scans import ScanCase, SetRecords, unpacked
from nbv.study.spec import RequirementEntry, ScanStudySpec
from nbv.visibility.requirement import Precision
from scenes.checks import BoolArray, FloatArray, Value

_LABELS: dict[str, type] = {"set": str, "scene": str, "sensor": str, "poses": str, "seed": int}
_ERRORS: dict[str, type] = {
    "points": int, "bias_m": float, "sd_m": float, "p95_m": float, "mixed_share": float, "lost_share": float
}  # fmt: skip
SET_COLUMNS: Columns = {
    **_LABELS, "requirement": str, "scans": int, "scan_time_s": float, "pixels": int, **_ERRORS,
    "density_5_per_m2": float, "density_50_per_m2": float, "total_m2": float, "seen": float, "met": float,
    "met_standard_error": float, "modelled": float, "inferred": float, "unknown": float,
    "inferred_m2": float, "inferred_right": float, "placed": int, "pose_shift_m": float,
    "pose_turn_deg": float, "error": str,
}  # fmt: skip
SCAN_COLUMNS: Columns = {
    **_LABELS, "requirement": str, "scan": int, "x_m": float, "y_m": float, "z_m": float,
    "scan_time_s": float, "pixels": int, **_ERRORS, "sigma_m": float, "seen": float, "met": float,
    "error": str,
}  # fmt: skip
CLASS_COLUMNS: Columns = {**_LABELS, "by": str, "class": str, **_ERRORS}
SURFACE_COLUMNS: Columns = {
    **_LABELS, "requirement": str, "surface": str, "role": str, "area_m2": float, "met": float,
    "modelled": float, "inferred": float, "unknown": float,
}  # fmt: skip
_LEVEL, _UPRIGHT = np.cos(np.radians(20.0)), np.sin(np.radians(20.0))


@dataclass(frozen=True, slots=True, eq=False)
class SetResult(Value):
    """One set judged by one requirement.

    Attributes
    ----------
    found : SetRecords
        The set and its records.
    requirement : RequirementEntry
        What was asked for.
    row : mapping
        Of the results, by `SET_COLUMNS`.
    scans, surfaces : tuple of mapping
        A row for each scan, by `SCAN_COLUMNS`, and for each surface, by `SURFACE_COLUMNS`.
    tallies : mapping
        Of all scans together, by kind of class.
    surface_names : tuple of str
        Of the scene.
    """

    found: SetRecords
    requirement: RequirementEntry
    row: Mapping[str, Any]
    scans: tuple[Mapping[str, Any], ...]
    surfaces: tuple[Mapping[str, Any], ...]
    tallies: Mapping[str, ErrorTally]
    surface_names: tuple[str, ...]


def scan_results(spec: ScanStudySpec, sets: Sequence[SetRecords]) -> tuple[SetResult, ...]:
    """Return what each set measured, by requirement, in the order of the study file."""
    return tuple(result for found in sets for result in _of_set(spec, found))


def class_rows(results: Sequence[SetResult]) -> Iterator[dict[str, Any]]:
    """Yield a row for each set, kind of class and class that holds pixels, by `CLASS_COLUMNS`."""
    told = set[str]()
    for result in results:
        if result.found.scans.name in told:
            continue
        told.add(result.found.scans.name)
        for by, tally in result.tallies.items():
            labels = class_labels(by, result.surface_names)
            for label, counts, row in zip(labels, tally.counts, tally.rows(), strict=True):
                if counts.any():
                    yield {**_labels(result.found), "by": by, "class": label, **row}


def _labels(found: SetRecords) -> dict[str, Any]:
    return {"set": found.scans.name, **found.scans.labels()}


def _of_set(spec: ScanStudySpec, found: SetRecords) -> Iterator[SetResult]:
    one = found.scans
    setting = load_setting(one.scene, one.sensor, spec.sampling)
    usable = [record for record in found.records if not record.get("error")]
    tallies = merged(
        {name: ErrorTally.from_json(part) for name, part in record["tallies"].items()} for record in usable
    )
    seen = [
        None if record.get("error") else unpacked(record["seen"], len(setting.samples))
        for record in found.records
    ]
    for asked in spec.requirements:
        yield _judged(found, setting, asked, seen, tallies)


def _judged(
    found: SetRecords,
    setting: CaseSetting,
    asked: RequirementEntry,
    seen: Sequence[BoolArray | None],
    tallies: Mapping[str, ErrorTally],
) -> SetResult:
    """Judge a set by a requirement: where enough of its scans measured well enough."""
    samples, cases = setting.samples, found.scans.scans
    effects = chosen_effects(setting.sensor, found.scans.sensor.noise)
    gate = setting.sensor.min_range_m, setting.sensor.max_range_m
    angle, requirement = setting.sensor.projection.pixel_angle, asked.requirement()
    limits = requirement.limits_of(angle, effects, gate)
    n_met, density = np.zeros(len(samples), np.int64), np.zeros(len(samples))
    scans = list[Mapping[str, Any]]()
    for case, record, mask in zip(cases, found.records, seen, strict=True):
        good = np.zeros(len(samples), np.bool_)
        if mask is not None:
            index = np.flatnonzero(mask)
            distance, cosine = _sight(case, setting, mask)
            good[index] = limits.hold(distance, cosine)
            n_met += good
            density[index] += Precision(angle, effects).density_per_m2(distance, cosine)
        scans.append(_scan_row(found, asked, case=case, record=record, shares=_figures(setting, mask, good)))
    met, any_seen = n_met >= requirement.k, density > 0
    classes = _classes(found, met, any_seen)
    done, registered = _part(found, "completed"), _part(found, "registered") or {}
    total, time_s = float(samples.areas.sum()), setting.sensor.scan_time_s
    row = {
        **_labels(found),
        "requirement": asked.label,
        "scans": sum(mask is not None for mask in seen),
        "scan_time_s": None if time_s is None else time_s * sum(mask is not None for mask in seen),
        "pixels": sum(int(record.get("pixels", 0)) for record in found.records),
        **(tallies["all"].rows()[0] if tallies else dict.fromkeys(_ERRORS)),
        "density_5_per_m2": _area_quantile(density, samples.areas, 0.05),
        "density_50_per_m2": _area_quantile(density, samples.areas, 0.5),
        "total_m2": total,
        "seen": float(samples.areas[any_seen].sum()) / total,
        "met": float(samples.areas[met].sum()) / total,
        "met_standard_error": share_error(samples, met),
        **{name: float(samples.areas[where].sum()) / total for name, where in classes.items()},
        "inferred_m2": done["inferred_m2"] if done else 0.0,
        "inferred_right": done["right_m2"] / done["inferred_m2"] if done and done["inferred_m2"] else None,
        "placed": registered.get("placed"),
        "pose_shift_m": registered.get("shift_m"),
        "pose_turn_deg": registered.get("turn_deg"),
        "error": _errors(found),
    }
    surfaces = tuple(_surface_rows(found, setting, asked, {"met": met, **classes}))
    return SetResult(
        found=found, requirement=asked, row=row, scans=tuple(scans), surfaces=surfaces, tallies=tallies,
        surface_names=setting.scene.surface_names,
    )  # fmt: skip


def _part(found: SetRecords, name: str) -> Mapping[str, Any] | None:
    """What came of "completed" or "registered"; None where it was not asked for, or did not work."""
    part: Mapping[str, Any] | None = (found.together or {}).get(name)
    return part


def _sight(case: ScanCase, setting: CaseSetting, mask: BoolArray) -> tuple[FloatArray, FloatArray]:
    """Distances and cosines (m,) at which a scan measured the samples of a mask (n,)."""
    towards = np.array(case.pose)[:3, 3] - setting.samples.points[mask]
    distance = np.linalg.norm(towards, axis=1)
    return distance, np.abs(np.einsum("ij,ij->i", towards, setting.samples.normals[mask])) / distance


def _figures(setting: CaseSetting, seen: BoolArray | None, met: BoolArray) -> dict[str, float | None]:
    """Seconds that the scan takes on site, and shares of the area that it saw and measured well enough."""
    areas = setting.samples.areas
    seen_m2 = 0.0 if seen is None else float(areas[seen].sum())
    shares = {"seen": seen_m2 / float(areas.sum()), "met": float(areas[met].sum() / areas.sum())}
    return {"scan_time_s": setting.sensor.scan_time_s, **shares}


def _scan_row(
    found: SetRecords, asked: RequirementEntry, *, case: ScanCase, record: Mapping[str, Any],
    shares: Mapping[str, float | None],
) -> dict[str, Any]:  # fmt: skip
    x, y, z = (row[3] for row in case.pose[:3])
    head = {**_labels(found), "requirement": asked.label, "scan": case.number, "x_m": x, "y_m": y, "z_m": z}
    if record.get("error"):
        return {**dict.fromkeys(SCAN_COLUMNS), **head, "error": record["error"]}
    figures = ErrorTally.from_json(record["tallies"]["all"]).rows()[0]
    return {
        **head, "pixels": record["pixels"], **figures, "sigma_m": record["sigma_m"], **shares, "error": "",
    }  # fmt: skip


def _classes(found: SetRecords, met: BoolArray, seen: BoolArray) -> dict[str, BoolArray]:
    """Which samples (n,) completion models or infers, of those that are not met, and which are unknown."""
    done = _part(found, "completed")
    if done is None:
        none = np.zeros(len(met), np.bool_)
        return {"modelled": none, "inferred": none, "unknown": ~met}
    modelled = unpacked(done["modelled"], len(met)) & seen & ~met
    inferred = unpacked(done["inferred"], len(met)) & ~met & ~modelled
    return {"modelled": modelled, "inferred": inferred, "unknown": ~(met | modelled | inferred)}


def _surface_rows(
    found: SetRecords, setting: CaseSetting, asked: RequirementEntry, classes: Mapping[str, BoolArray]
) -> Iterator[dict[str, Any]]:
    """A row for each surface and role of the scene: how much of its area is of which class."""
    samples = setting.samples
    steep = np.abs(samples.normals[:, 2])
    roles = np.where(steep >= _LEVEL, 0, np.where(steep <= _UPRIGHT, 2, 1))
    for surface, name in enumerate(setting.scene.surface_names):
        for role, called in enumerate(("level", "slanted", "upright")):
            here = (samples.surface == surface) & (roles == role)
            area = float(samples.areas[here].sum())
            if area == 0:
                continue
            shares = {
                kind: float(samples.areas[here & where].sum()) / area for kind, where in classes.items()
            }
            head = {**_labels(found), "requirement": asked.label, "surface": name, "role": called}
            yield {**head, "area_m2": area, **shares}


def _area_quantile(values: FloatArray, areas: FloatArray, share: float) -> float | None:
    """The quantile of positive values (n,) by area; None where there are none."""
    there = values > 0
    if not there.any():
        return None
    order = np.argsort(values[there])
    summed = np.cumsum(areas[there][order])
    return float(values[there][order][np.searchsorted(summed, share * summed[-1])])


def _errors(found: SetRecords) -> str:
    """What could not be done, each once."""
    said = [str(record["error"]) for record in (*found.records, found.together or {}) if record.get("error")]
    return "; ".join(dict.fromkeys(said))
