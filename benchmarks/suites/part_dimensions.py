# SPDX-License-Identifier: MIT
"""Dimensions of generated parts: whether their intervals hold, which are found, and what preferred values are worth."""

from __future__ import annotations

import time
from collections import Counter, defaultdict
from collections.abc import Iterator

import numpy as np

from benchmarks.cases.dimensioned_parts import DimensionedPart, dimensioned_part
from benchmarks.run import head, suite
from benchmarks.store import each
from completion.parts.dimensions.dimension import PartDimension, unit_scale
from completion.parts.dimensions.pipeline import dimensions_of
from completion.parts.part import Part
from completion.parts.pipeline import model_part
from completion.relations.equations import place

NOISES_MM = (0.01, 0.03, 0.1)
SPLITS = {"tuning": 0, "held-out": 1000}
"""Seed of the first part of each half."""
_PURE = 0.9  # of a found face's points, that must be of one true face for its dimensions to have a truth
_FOUND_SD, _FOUND_MM = 4.0, 0.02  # within which a dimension that was built is found
_CONFIDENT = 0.9


def true_faces(part: Part, made: DimensionedPart) -> list[int]:
    """The true face of each surface; -1 where its points are of several, or of another kind."""
    found = []
    for number, label in enumerate(part.labels):
        of = np.bincount(made.face[part.surface == label], minlength=len(made.surfaces))
        best = int(np.argmax(of))
        alike = [k for k, surface in enumerate(made.surfaces) if _is_same(surface, made.surfaces[best])]
        is_pure = of[alike].sum() >= _PURE * of.sum()
        found.append(best if is_pure and made.surfaces[best].kind == part.fits[number].surface.kind else -1)
    return found


def _is_same(one: object, two: object) -> bool:
    """Whether true faces are in one plane or on one cylinder, as pieces beside each other are."""
    if type(one) is not type(two) or not hasattr(one, "point"):
        return one is two
    direction = getattr(one, "normal_direction", getattr(one, "direction", None))
    other = getattr(two, "normal_direction", getattr(two, "direction", None))
    step = two.point - one.point  # type: ignore[attr-defined]
    off = step @ direction if hasattr(one, "normal_direction") else np.linalg.norm(np.cross(step, direction))
    is_round = abs(getattr(one, "radius", 0.0) - getattr(two, "radius", 0.0)) < 1e-9
    return bool(np.linalg.norm(np.cross(direction, other)) < 1e-9 and abs(off) < 1e-9 and is_round)


def truth_of(row: PartDimension, made: DimensionedPart, true: list[int]) -> float | None:
    """What a dimension is of the true surfaces; of a pattern the nearest that was built; None: no truth."""
    scale, _ = unit_scale(row.unit)
    if row.measure is None:
        meant = [value for kind, value in made.meant if kind == row.kind]
        return min(meant, key=lambda value: abs(value - scale * row.value)) / scale if meant else None
    if any(true[k] < 0 for k in row.places):
        return None
    surfaces = [made.surfaces[true[k]] for k in row.places]
    width = {"plane": 3, "sphere": 4, "cylinder": 5, "cone": 6, "torus": 7}
    return float(row.measure([place(each, np.zeros(width[each.kind])) for each in surfaces]))


def scored(seed: int, noise_mm: float) -> dict[str, object]:
    """The dimensions of one part against their truth."""
    made = dimensioned_part(seed, noise_mm)
    began = time.process_time()
    part = model_part(made.points)
    divided = time.process_time()
    found = dimensions_of(part)
    seconds = time.process_time() - divided
    true, rows, seen = true_faces(part, made), [], []
    for row in found.rows:
        truth = truth_of(row, made, true)
        if truth is None or not np.isfinite(row.sd):
            continue
        scale, _ = unit_scale(row.unit)
        hint = row.preferred
        is_right = None if hint is None else abs(hint.value - truth) < 1e-7
        rows.append((row.kind, scale * (row.value - truth), scale * row.sd, scale * row.measured_sd, row.basis,
                     None if hint is None else hint.probability, is_right))  # fmt: skip
    for kind, value in made.meant:
        near = [row for row in found.rows if row.kind == kind and abs(unit_scale(row.unit)[0] * row.value - value)
                <= max(_FOUND_MM, _FOUND_SD * unit_scale(row.unit)[0] * (row.sd if np.isfinite(row.sd) else row.half))]  # fmt: skip
        seen.append((kind, bool(near)))
    return {"rows": rows, "seen": seen, "seconds": seconds, "divide": divided - began, "n": len(found)}


@suite("part-dimensions", smallest="--parts 1")
def part_dimensions(split: str = "held-out", parts: int = 100) -> Iterator[str]:
    """Intervals of dimensions of generated parts: share that holds, by kind and noise."""
    first, every = SPLITS[split], defaultdict[float, list[dict[str, object]]](list)
    cases = [(seed, noise) for noise in NOISES_MM for seed in range(first, first + parts)]
    for (_, noise), outcome in each(cases, lambda case: scored(*case), lambda case: f"{case[0]}-{case[1]}"):
        every[noise].append(outcome)
    yield from head("kind", *(f"noise {noise:g} mm: hold, of, median half-width" for noise in NOISES_MM), "all")
    by_kind: dict[str, dict[float, list[tuple[float, float]]]] = defaultdict(lambda: defaultdict(list))
    for noise, outcomes in every.items():
        for outcome in outcomes:
            for kind, error, sd, *_ in outcome["rows"]:  # type: ignore[attr-defined]
                by_kind[kind][noise].append((error, sd))
                by_kind["all"][noise].append((error, sd))
    for kind in sorted(by_kind, key=lambda kind: (kind == "all", kind)):
        cells = [_holding(by_kind[kind][noise]) for noise in NOISES_MM]
        whole = _holding([pair for noise in NOISES_MM for pair in by_kind[kind][noise]])
        yield f"| {kind} | {' | '.join(cells)} | {whole} |"
    yield ""
    yield from head("noise, mm", "built dimensions found", "rows a part", "CPU s (division)", "preferred at .9 and more: right, of")
    for noise in NOISES_MM:
        outcomes = every[noise]
        seen = [one for outcome in outcomes for one in outcome["seen"]]  # type: ignore[attr-defined]
        hints = [row[6] for outcome in outcomes for row in outcome["rows"] if row[5] is not None and row[5] >= _CONFIDENT]  # type: ignore[attr-defined]
        n_rows, seconds, divide = (float(np.mean([outcome[key] for outcome in outcomes])) for key in ("n", "seconds", "divide"))
        yield (f"| {noise:g} | {sum(ok for _, ok in seen)} of {len(seen)} | {n_rows:.1f} | {seconds:.2f} ({divide:.2f}) "
               f"| {sum(map(bool, hints))} of {len(hints)} |")  # fmt: skip
    missed = Counter(kind for outcomes in every.values() for outcome in outcomes for kind, ok in outcome["seen"] if not ok)  # type: ignore[attr-defined]
    yield ""
    yield "Missed: " + (", ".join(f"{kind} {n}" for kind, n in missed.most_common()) or "none")


def _holding(pairs: list[tuple[float, float]]) -> str:
    """Share of errors within 1.96 standard deviations, how many, and the median half-width."""
    if not pairs:
        return ""
    error, sd = np.array(pairs).T
    exact = np.maximum(1.96 * sd, 1e-7)
    return f"{100 * float(np.mean(np.abs(error) <= exact)):.1f} %, {len(pairs)}, {float(np.median(1.96 * sd)):.4f}"
