# SPDX-License-Identifier: MIT
"""Dimensions of generated parts: whether intervals hold, which are found, what preferred values are worth."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from benchmarks.cases.dimensioned_parts import DimensionedPart, dimensioned_part
from benchmarks.run import head, suite
from benchmarks.store import each
from completion.parts.dimensions.dimension import NORMAL_95, PartDimension, unit_scale
from completion.parts.dimensions.pipeline import dimensions_of
from completion.parts.part import Part
from completion.parts.pipeline import model_part
from completion.relations.equations import place
from scenes.checks import FloatArray

NOISES_MM = (0.01, 0.03, 0.1)
SPLITS = {"tuning": 0, "held-out": 1000}
"""Seed of the first part of each half."""
_PURE = 0.9  # of a found face's points, that must be of one true face for its dimensions to have a truth
_FOUND_SD, _FOUND_MM = 4.0, 0.02  # within which a dimension that was built is found
_CONFIDENT = 0.9
_SAME, _ROUNDING = 1e-7, 1e-6  # metres or radians; millimetres or degrees


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
    direction: FloatArray = getattr(one, "normal_direction", getattr(one, "direction", np.zeros(3)))
    other: FloatArray = getattr(two, "normal_direction", getattr(two, "direction", np.zeros(3)))
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


class ScoredRow(NamedTuple):
    """A dimension against its truth, millimetres and degrees; the preferred value's probability or -1."""

    kind: str
    error: float
    sd: float
    probability: float
    is_preferred_right: bool


class ScoredPart(NamedTuple):
    """A part's dimensions against their truth, kinds that were built and which were found, CPU seconds."""

    rows: list[ScoredRow]
    built: list[str]
    is_found: list[bool]
    n_rows: int
    seconds: float
    division_seconds: float


def scored(seed: int, noise_mm: float, is_labelled: bool) -> ScoredPart:
    """The dimensions of a part, divided by itself or by the labels of its true faces, against the truth."""
    made = dimensioned_part(seed, noise_mm)
    began = time.process_time()
    part = model_part(made.points, made.face + 1 if is_labelled else None)
    divided = time.process_time()
    found = dimensions_of(part)
    seconds = time.process_time() - divided
    true, rows = true_faces(part, made), []
    for row in found.rows:
        truth = truth_of(row, made, true)
        if truth is None or not np.isfinite(row.sd):
            continue
        scale, hint = unit_scale(row.unit)[0], row.preferred
        is_right = hint is not None and abs(hint.value - truth) < _SAME
        probability = -1.0 if hint is None else hint.probability
        rows.append(ScoredRow(row.kind, scale * (row.value - truth), scale * row.sd, probability, is_right))
    is_found = [
        any(row.kind == kind and _is_near(row, value) for row in found.rows) for kind, value in made.meant
    ]
    return ScoredPart(rows, [kind for kind, _ in made.meant], is_found, len(found), seconds, divided - began)


def _is_near(row: PartDimension, built: float) -> bool:
    scale, _ = unit_scale(row.unit)
    allowed = _FOUND_SD * row.sd if np.isfinite(row.sd) else (row.high - row.low) / 2
    return abs(scale * row.value - built) <= max(_FOUND_MM, scale * allowed)


@suite("part-dimensions", smallest="--parts 1")
def part_dimensions(split: str = "held-out", parts: int = 100, labelled: bool = False) -> Iterator[str]:
    """Intervals of dimensions of generated parts: share that holds, by kind and noise."""
    seeds = range(SPLITS[split], SPLITS[split] + parts)
    yield from tables({noise: list(each(scored, seeds, noise, labelled)) for noise in NOISES_MM})


def tables(outcomes: Mapping[float, Sequence[ScoredPart]]) -> Iterator[str]:
    """The tables of parts by noise."""
    yield from head("kind", *(f"noise {noise:g} mm: hold, n, half-width" for noise in outcomes), "all")
    every = {noise: [row for part in parts for row in part.rows] for noise, parts in outcomes.items()}
    kinds = sorted({row.kind for rows in every.values() for row in rows})
    for kind in (*kinds, "all"):
        chosen = {noise: [row for row in rows if kind in (row.kind, "all")] for noise, rows in every.items()}
        cells = [_holding(rows) for rows in chosen.values()]
        whole = _holding([row for rows in chosen.values() for row in rows])
        yield f"| {kind} | {' | '.join(cells)} | {whole} |"
    yield ""
    yield from head("noise, mm", "built dimensions found", "rows a part", "CPU s", "CPU s of division",
                    "preferred at 0.9 and more: right")  # fmt: skip
    for noise, parts in outcomes.items():
        found = [ok for part in parts for ok in part.is_found]
        hints = [row.is_preferred_right for row in every[noise] if row.probability >= _CONFIDENT]
        means = np.mean([(part.n_rows, part.seconds, part.division_seconds) for part in parts], axis=0)
        numbers = " | ".join(f"{mean:.1f}" for mean in means)
        yield f"| {noise:g} | {sum(found)} of {len(found)} | {numbers} | {sum(hints)} of {len(hints)} |"
    missed = Counter(
        kind
        for parts in outcomes.values()
        for part in parts
        for kind, ok in zip(part.built, part.is_found, strict=True)
        if not ok
    )
    yield ""
    yield "Missed: " + (", ".join(f"{kind} {n}" for kind, n in missed.most_common()) or "none")


def _holding(rows: Sequence[ScoredRow]) -> str:
    """Share of errors within 1.96 standard deviations, how many, and the median half-width."""
    if not rows:
        return ""
    half = np.array([NORMAL_95 * row.sd for row in rows])
    held = np.abs([row.error for row in rows]) <= np.maximum(half, _ROUNDING)
    return f"{100 * float(held.mean()):.1f} %, {len(rows)}, {float(np.median(half)):.4f}"
