# SPDX-License-Identifier: MIT
"""Check against a design on real scans with changes planted in their own model, and on a machined part."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from benchmarks.cases.machined import PART, MachinedPart, machined, part_scans
from benchmarks.cases.own_models import SETS, OwnModel, Planted, own_model, planted
from benchmarks.run import head, row, suite
from benchmarks.store import each
from completion.asbuilt.findings import DesignCheck, ElementFinding, Interval
from completion.asbuilt.pipeline import CheckOptions, check_against_design
from nbv.inspection.checking import open_design
from scenes.checks import FloatArray, InputError
from scenes.mesh.triangle_distance import TriangleTree

_ALARMS = "deviates", "missing"


@dataclass(frozen=True, slots=True)
class RealResult:
    """What a check said of the planted changes, and what else it raised.

    `base`: alarms and extra of the unchanged model; `moved`, `added`: verdicts; `shift_m`: measured offset
    beyond that of the unchanged model, with the end of its interval that is farther, NaN where there is none;
    `extra_share`: of extra surface near the removed element's; `false`: other elements that raise an alarm
    here and none in the unchanged model.
    """

    elements: int
    base: int
    moved: str
    shift_m: float
    half_m: float
    true_m: float
    added: str
    removed_m2: float
    found_m2: float
    other_m2: float
    false: int


def of_set(name: str, seeds: int, align: bool) -> list[RealResult]:
    """Complete the scans of a set, check them against that, and against it with changes planted."""
    own, tolerance_m = own_model(name), SETS[name].tolerance_m
    options = CheckOptions(tolerance_m=tolerance_m, align=align)
    base = check_against_design(own.design, own.scans, options, n_threads=1)
    results = []
    for seed in range(seeds):
        change = planted(own, 3 * tolerance_m, seed)
        check = check_against_design(change.design, own.scans, options, n_threads=1)
        results.append(_compared(own, change, base, check, tolerance_m))
    return results


def _compared(
    own: OwnModel, change: Planted, base: DesignCheck, check: DesignCheck, tolerance_m: float
) -> RealResult:
    before = {one.surface: one for one in base.elements}
    after = {one.surface: one for one in check.elements}
    moved, added = after[change.moved], after[change.added]
    planted_ids = {change.moved, change.added, change.removed}
    false = [
        k for k, one in after.items()
        if k not in planted_ids and one.verdict in _ALARMS and before[k].verdict not in _ALARMS
    ]  # fmt: skip
    tree, known = TriangleTree.of(change.removed_corners), _extra_points(base)
    found = other = 0.0
    for extra in check.extra:
        is_of = tree.distances(extra.points) <= 2 * tolerance_m
        each_m2 = extra.area_m2 / len(extra.points)
        is_known = np.isin(np.round(extra.points, 6).view("V24"), np.round(known, 6).view("V24")).ravel()
        found, other = found + each_m2 * is_of.sum(), other + each_m2 * (~is_of & ~is_known).sum()
    shift, half = _shift(before[change.moved], moved)
    return RealResult(
        len(own.design.elements), sum(one.verdict in _ALARMS for one in base.elements),
        _word(moved), shift, half, float(np.linalg.norm(change.moved_m)), _word(added),
        float(own.measured_m2[change.removed]), found, other, len(false),
    )  # fmt: skip


def _word(one: ElementFinding) -> str:
    return f"{one.verdict} ({one.kind})" if one.kind else one.verdict


def _extra_points(check: DesignCheck) -> FloatArray:
    return np.concatenate([np.zeros((0, 3)), *(one.points for one in check.extra)])


def _shift(before: ElementFinding, after: ElementFinding) -> tuple[float, float]:
    """By how much the offset grew, and the half of its interval."""
    if before.offset is None or after.offset is None:
        return np.nan, np.nan
    return abs(after.offset.value - before.offset.value), _half(after.offset)


def _half(one: Interval) -> float:
    return (one.high - one.low) / 2


@dataclass(frozen=True, slots=True)
class PartResult:
    """Verdicts on a part: `found` of the planted two, `false` alarms, and deviations with their intervals.

    `holds` and `halves_m` are of all faces that were tested.
    """

    n: int
    found: int
    false: int
    undecided: int
    hole_m: tuple[float, float, float]
    face_m: tuple[float, float, float]
    holds: float
    half_m: float


def of_part(seed: int, tolerance_m: float) -> PartResult:
    """Make a part with a hole and a face out of place, scan and check it."""
    design = open_design(str(PART), units="in")
    made = machined(design, seed)
    options = CheckOptions(tolerance_m=tolerance_m)
    check = check_against_design(design.element_mesh, part_scans(made.made, seed), options, n_threads=1)
    by = {one.surface: one for one in check.elements}
    holds, halves = [], []
    changed = {made.hole, made.face}
    beside = {k for k in by if _is_beside(made.faces.normal[made.face], made, k)}
    for surface, one in by.items():
        if one.offset is None:
            continue
        true = np.zeros(3)
        if surface == made.hole:
            true = made.hole_m
        elif surface == made.face:
            true = made.face_m * made.faces.normal[made.face]
        elif surface in beside:
            continue  # slanted neighbours turn with the face
        value = float(true @ np.array(one.offset.along))
        holds.append(one.offset.low <= value <= one.offset.high)
        halves.append(_half(one.offset))
    return PartResult(
        len(by), sum(by[k].verdict == "deviates" for k in changed),
        sum(one.verdict in _ALARMS for k, one in by.items() if k not in changed | beside),
        sum(one.verdict == "undecided" for one in by.values()),
        _numbers(by[made.hole]), _numbers(by[made.face]), float(np.mean(holds)), float(np.median(halves)),
    )  # fmt: skip


def _is_beside(normal: FloatArray, made: MachinedPart, surface: int) -> bool:
    """Whether a face is slanted to one with a normal, so that it moves with it."""
    faces = made.faces
    return (
        surface < len(faces) and not faces.sign[surface] and 0.1 < abs(normal @ faces.normal[surface]) < 0.99
    )


def _numbers(one: ElementFinding) -> tuple[float, float, float]:
    return (np.nan,) * 3 if one.offset is None else (one.offset.value, one.offset.low, one.offset.high)


@suite("asbuilt-real", smallest="--seeds 1 --names pumpA --parts 0")
def asbuilt_real(
    seeds: int = 5, names: str = "tdtk,pumpA,office1,pcl_room", parts: int = 10, tolerance: float = 1e-4,
    align: bool = True,
) -> Iterator[str]:  # fmt: skip
    """Check against a design: real scans and their own model with three changes; a part with two.

    In each model one plane is moved by 3 T, one left out, and a box added where beams passed.
    """
    chosen = [name for name in names.split(",") if name]
    unknown = sorted(set(chosen) - set(SETS))
    if unknown:
        raise InputError(f"there is no set {unknown[0]}; there are {', '.join(SETS)}")
    if chosen:
        yield from _real_table(chosen, seeds, align)
        yield ""
    if parts:
        yield from _part_table(list(each(of_part, range(parts), tolerance)))


def _real_table(names: list[str], seeds: int, align: bool) -> Iterator[str]:
    yield from head(
        "scans | T, mm | elements | alarms unchanged | moved by 3 T | its offset, of 3 T | added | "
        "removed, m2 | extra there, elsewhere, m2 | other new alarms"
    )
    for name, results in zip(names, each(of_set, names, seeds, align), strict=True):
        for one in results:
            yield row(
                name, f"{1000 * SETS[name].tolerance_m:g}", one.elements, one.base, one.moved,
                f"{1000 * one.shift_m:.0f} ± {1000 * one.half_m:.0f}, {1000 * one.true_m:.0f} mm", one.added,
                f"{one.removed_m2:.2f}", f"{one.found_m2:.2f}, {one.other_m2:.2f}", one.false,
            )  # fmt: skip
        moved = dict(Counter(one.moved.split(" ")[0] for one in results))
        added = dict(Counter(one.added for one in results))
        yield row(f"{name}, all", *("",) * 3, moved, "", added, "", "", sum(one.false for one in results))


def _part_table(results: list[PartResult]) -> Iterator[str]:
    yield from head(
        "part", "faces", "found of 2", "false", "undecided", "hole, 0.3 mm", "face, 0.2 mm", "intervals hold",
        "median half, mm",
    )  # fmt: skip
    for seed, one in enumerate(results):
        hole, face = (
            f"{1e3 * v:.3f} ({1e3 * low:.3f} to {1e3 * high:.3f})"
            for v, low, high in (one.hole_m, one.face_m)
        )
        yield row(seed, one.n, one.found, one.false, one.undecided, hole, face, f"{one.holds:.1%}",
                  f"{1e3 * one.half_m:.3f}")  # fmt: skip
