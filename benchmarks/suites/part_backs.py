# SPDX-License-Identifier: MIT
"""Unseen sides of machined parts: symmetries asserted from one scan, the surface they imply, and solids.

Parts of 0.1 m, each scanned from one place with noise of 0.03 % of its size. A mirror is true where 90 % of
the whole true surface maps within 1 % of the size, an axis where 90 % of its surfaces, turned all round, lie
so near to true surface. "tuning" parts fitted the models (`part-backs-fit`), "held-out" ones did not.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from benchmarks.cases.backs.case import TrueThing
from benchmarks.cases.one_sided import NOISE, SIZE_M, OneSided, one_sided, parts_of
from benchmarks.run import head, suite
from benchmarks.store import each
from benchmarks.suites.backs import fit_logistic
from completion.parts.backs.axes import turn_of
from completion.parts.backs.hypothesis import Hypothesis, features
from completion.parts.backs.pipeline import find_back
from completion.parts.part import Part
from completion.parts.pipeline import divide_part, relate_part
from completion.parts.step_export import step_model
from scenes.checks import FloatArray, InputError

_TRUE, _NEAR = 0.9, 0.01
_TURNS, _MOST = 24, 200


@dataclass(frozen=True, slots=True)
class TestedSymmetry:
    """A hypothesis: its kind, the terms of its model, probability, share of surface it maps, if asserted."""

    kind: str
    terms: list[float]
    probability: float
    mapped: float
    asserted: bool

    @property
    def is_true(self) -> bool:
        """Whether enough surface maps."""
        return self.mapped >= _TRUE


@dataclass(frozen=True, slots=True)
class ScoredBack:
    """What was inferred of a part beside the truth; lengths are shares of its size."""

    name: str
    tested: list[TestedSymmetry]
    n_inferred: int
    within: list[float]  # share of inferred surface within 1 % and 2 %
    recall: float  # share of the unseen true surface with inferred surface within 2 %
    hidden: float  # share of the true surface that the scan did not see
    n_faces: list[int]  # new ones, and those of which 80 % lie within 1 %
    solid: bool
    volume: float  # of the solid over the true one
    told: str
    seconds: float


def score(name: str, seed: int, least: float, is_told: bool, solid: bool) -> ScoredBack:
    """Scan a part from one side, infer the others, and compare them with the truth."""
    case = one_sided(name, seed)
    part = relate_part(case.points, divide_part(case.points, noise_m=NOISE * SIZE_M))
    return scored(name, case, part, least, is_told, solid=solid)


def scored(name: str, case: OneSided, part: Part, least: float, is_told: bool, *, solid: bool) -> ScoredBack:
    """Infer the unseen sides of a part, and compare them with the truth.

    Where the scanner's place `is_told` not, normals of the side that it saw are.
    """
    began = time.process_time()
    if is_told:
        back = find_back(part, origins=np.broadcast_to(case.origin, part.points.shape), least=least)
    else:
        back = find_back(part, normals=_sides(part, case.origin), least=least)
    seconds = time.process_time() - began
    thing = TrueThing(case.corners)
    tested = [
        TestedSymmetry(
            one.kind, features(one).tolist(), one.probability, _mapped(thing, part, one), one in back.chosen
        )
        for one in back.hypotheses
    ]
    unseen = thing.samples[cKDTree(part.points).query(thing.samples)[0] > 2 * _NEAR * SIZE_M]
    points = np.zeros((0, 3)) if back.places is None else back.places.points
    away = thing.distance(points)
    near = cKDTree(points).query(unseen)[0] if len(points) and len(unseen) else np.full(len(unseen), np.inf)
    right = n_new = 0
    for face in back.faces:
        if face.is_new and back.places is not None:
            right += (away[back.places.label == face.label] <= _NEAR * SIZE_M).mean() >= 0.8
            n_new += 1
    is_solid, volume = _solid(part, back, case) if solid and len(points) else (False, 0.0)
    return ScoredBack(
        name=name, tested=tested, n_inferred=len(points),
        within=[float((away <= k * _NEAR * SIZE_M).mean()) if len(away) else float("nan") for k in (1, 2)],
        recall=float((near <= 2 * _NEAR * SIZE_M).mean()) if len(near) else float("nan"),
        hidden=len(unseen) / len(thing.samples), n_faces=[n_new, int(right)], solid=is_solid, volume=volume,
        told=back.told, seconds=seconds,
    )  # fmt: skip


def _sides(part: Part, origin: FloatArray) -> FloatArray:
    """Normals (n, 3) of the points towards the scanner; those of no surface point straight at it."""
    sides = origin - part.points
    for label, fit in zip(part.labels, part.fits, strict=True):
        own = part.members(label)
        normal = fit.surface.normal(part.points[own])
        sides[own] = normal * np.sign(np.einsum("ij,ij->i", normal, sides[own]))[:, None]
    return np.asarray(sides)


def _mapped(thing: TrueThing, part: Part, one: Hypothesis) -> float:
    """Share of the true surface that a mirror maps, or of an axis' surfaces that turn, into true surface."""
    if one.kind == "mirror":
        return thing.share_mapped(one.isometry[None], _NEAR * SIZE_M)
    own = part.points[np.isin(part.surface, one.surfaces)]
    own = own[:: max(1, len(own) // _MOST)] - one.point
    turns = [turn_of(one.direction, 2 * np.pi * k / _TURNS) for k in range(_TURNS)]
    every = np.concatenate([own @ turn.T for turn in turns]) + one.point
    return float((thing.distance(every) <= _NEAR * SIZE_M).mean())


def _solid(part: Part, back: object, case: OneSided) -> tuple[bool, float]:
    """Whether the part closes with its unseen sides, and its volume over the true one."""
    try:
        model = step_model(part, back=back)  # type: ignore[arg-type]
    except InputError:
        return False, 0.0
    corners = case.corners
    true = abs(float(np.einsum("ij,ij->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])))) / 6
    return model.is_solid and model.is_valid, model.volume_m3 / true


@suite("part-backs", smallest="--parts 1 --seeds 1")
def part_backs(
    seeds: int = 6,
    parts: int = 0,
    least: float = 0.8,
    half: str = "held-out",
    told: bool = True,
    solids: bool = False,
) -> Iterator[str]:
    """Parts scanned from one side: symmetries right and wrong, precision of inferred surface, solids.

    --no-told: files do not tell where the scanner stood, only which side it saw; --half: held-out or tuning;
    --solids: also close each as STEP, minutes a part.
    """
    found = []
    yield from head(
        "part", "hidden", "asserted", "wrong", "inferred at 1 %", "at 2 %", "recall", "solids", "CPU s"
    )
    for name in parts_of(half)[: parts or None]:
        some = list(each(score, [name] * seeds, range(seeds), least, told, solids))
        found += some
        yield "| " + " | ".join([name, *cells(some)]) + " |"
    yield "| " + " | ".join(["all", *cells(found)]) + " |"
    yield from _calibration(found)


def cells(found: list[ScoredBack]) -> list[str]:
    """A row of some parts."""
    asserted = [two for one in found for two in one.tested if two.asserted]
    n = np.array([one.n_inferred for one in found])
    shares = [
        f"{100 * np.average([one.within[k] for one in found if one.n_inferred], weights=n[n > 0]):.1f} %"
        if n.any() else "-"
        for k in (0, 1)
    ]  # fmt: skip
    recall = np.nanmean([one.recall for one in found])
    solids = [one for one in found if one.solid]
    right = sum(abs(one.volume - 1) < 0.05 for one in solids)
    return [
        f"{np.mean([one.hidden for one in found]):.2f}", f"{len(asserted)} in {len(found)} scans",
        str(sum(not two.is_true for two in asserted)), *shares, f"{recall:.2f}",
        f"{len(solids)} ({right} within 5 % of the volume)", f"{np.mean([one.seconds for one in found]):.1f}",
    ]  # fmt: skip


def _calibration(found: list[ScoredBack]) -> Iterator[str]:
    """How often hypotheses of a probability are true."""
    for kind in ("mirror", "axis"):
        some = [two for one in found for two in one.tested if two.kind == kind]
        likely, true = np.array([two.probability for two in some]), np.array([two.is_true for two in some])
        if not len(some):
            continue
        brier, base = np.mean((likely - true) ** 2), true.mean() * (1 - true.mean())
        yield f"\n{kind}: {len(some)} tested, {true.sum()} true, Brier {brier:.3f} (base rate {base:.3f})"
        for low, high in ((0, 0.1), (0.1, 0.3), (0.3, 0.5), (0.5, 0.7), (0.7, 0.9), (0.9, 1.01)):
            of = (likely >= low) & (likely < high)
            if of.any():
                yield f"p {low:g} to {min(high, 1):g}: {of.sum()}, true {true[of].mean():.2f}"
    new, right = np.sum([one.n_faces for one in found], axis=0)
    yield f"\nnew faces: {new}, of which {right} lie to 80 % within 1 % of true surface"


@suite("part-backs-fit", smallest="--parts 1 --seeds 1")
def part_backs_fit(seeds: int = 6, parts: int = 0) -> Iterator[str]:
    """Weights of the models of parts' unseen sides, fitted on the tuning parts."""
    names = parts_of("tuning")[: parts or None]
    found = [one for name in names for one in each(score, [name] * seeds, range(seeds), 0.8, True, False)]
    for kind in ("mirror", "axis"):
        some = [two for one in found for two in one.tested if two.kind == kind]
        if not some:
            continue
        terms, true = np.array([two.terms for two in some]), np.array([two.is_true for two in some])
        weights = fit_logistic(terms, true, 3.0)
        likely = 1 / (1 + np.exp(-terms @ weights))
        yield f"{kind}: {len(some)} of which {true.sum()} true, Brier {np.mean((likely - true) ** 2):.3f}"
        yield f"  ({', '.join(f'{value:.2f}' for value in weights)})"
        yield f"  at 0.8: {(likely >= 0.8).sum()}, wrong {(~true[likely >= 0.8]).sum()}"
