# SPDX-License-Identifier: MIT
"""Blends of generated parts: which are found, whether their radii hold, and where their faces meet."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import chdtri

from benchmarks.cases.blended_parts import BlendedPart, blended_part
from benchmarks.run import head, suite
from benchmarks.store import each
from completion.parts.dimensions.blends import blends_of
from completion.parts.dimensions.dimension import Blend
from completion.parts.part import Part
from completion.parts.pipeline import model_part
from scenes.checks import FloatArray
from scenes.surfaces.catalogue import Surface

NOISES_MM = (0.02, 0.1)
SPLITS = {"tuning": 0, "held-out": 1000}
"""Seed of the first part of each half."""
_TWO_SD = 0.0455  # probability beyond two standard deviations
_N_STEPS = 20  # of Newton's method, to the true edge
_KINDS = ("fillet", "round", "corner ball")


class ScoredBlend(NamedTuple):
    """A blend that was built: whether it was found with its faces, and how right; millimetres.

    `error` and `sd` of its radius; `is_edge_held`: whether the true edge is in the ellipse of two standard
    deviations about the middle of the edge that was found.
    """

    kind: str
    radius: float
    is_found: bool
    is_kind_right: bool = False
    error: float = 0.0
    sd: float = 0.0
    is_edge_held: bool = False
    edge_sd: float = 0.0


class BlendedScore(NamedTuple):
    """The blends of a part, how many others were found, and CPU seconds without those of the division."""

    blends: list[ScoredBlend]
    n_false: int
    seconds: float


def scored(seed: int, noise_mm: float) -> BlendedScore:
    """The blends of a part that is divided without labels, against those that were built."""
    made = blended_part(seed, noise_mm)
    part = model_part(made.points)
    began = time.process_time()
    found = [blend for blend in blends_of(part) if blend.kind != "chamfer"]
    seconds = time.process_time() - began
    true = {label: _true_face((label,), part, made) for label in part.labels}
    by_face, n_false = dict[int, Blend](), 0
    for blend in found:
        face = _true_face(blend.labels, part, made)
        supports = {true[label] for label in blend.supports}
        if any(each.face == face and set(each.supports) == supports for each in made.blends):
            by_face.setdefault(face, blend)
        else:
            n_false += 1
    outcomes = []
    for built in made.blends:
        radius, own = 1000 * built.radius_m, by_face.get(built.face)
        if own is None:
            outcomes.append(ScoredBlend(built.kind, radius, is_found=False))
            continue
        is_held = _holds(own, [made.surfaces[face] for face in built.supports])
        error, edge_sd = 1000 * (own.size_m - built.radius_m), 1000 * own.edge_sd_m[len(own.edge) // 2]
        outcomes.append(ScoredBlend(built.kind, radius, True, own.kind == built.kind, error, 1000 * own.sd_m,
                                    is_held, float(edge_sd)))  # fmt: skip
    return BlendedScore(outcomes, n_false, seconds)


def _true_face(labels: Sequence[int], part: Part, made: BlendedPart) -> int:
    """The true face of most points of some surfaces."""
    return int(np.argmax(np.bincount(made.face[np.isin(part.surface, labels)])))


def _holds(blend: Blend, supports: Sequence[Surface]) -> bool:
    """Whether the true edge, of true faces, is where a blend says that they meet."""
    middle = len(blend.edge) // 2
    there: FloatArray = blend.edge[middle].copy()
    for _ in range(_N_STEPS):
        normal = np.stack([surface.normal(there[None])[0] for surface in supports])
        there = there - np.linalg.pinv(normal) @ [surface.distance(there[None])[0] for surface in supports]
    variance, ways = np.linalg.eigh(blend.edge_covariance[middle])
    off = ((there - blend.edge[middle]) @ ways)[-len(supports) :]  # across the edge; a corner has all three
    square = float((off**2 / variance[-len(supports) :]).sum())
    return bool(square <= chdtri(len(supports), _TWO_SD))


@suite("blends", smallest="--parts 3")
def blends(split: str = "held-out", parts: int = 18) -> Iterator[str]:
    """Blends of generated parts: found with their faces, radius and edge within two standard deviations."""
    seeds = range(SPLITS[split], SPLITS[split] + parts)
    columns = "found with its faces", "kind right", "radius within 2 sd", "sd, mm", "edge within 2 sd"
    yield from head("noise, mm", "blend", *columns, "sd of the edge, mm")
    false = []
    for noise in NOISES_MM:
        scores = list(each(scored, seeds, noise))
        every = [blend for score in scores for blend in score.blends]
        for kind in (*_KINDS, "all"):
            chosen = [blend for blend in every if kind in (blend.kind, "all")]
            found = [blend for blend in chosen if blend.is_found]
            sizes = [(blend.sd, blend.edge_sd) for blend in found] or [(np.nan, np.nan)]
            sd, edge_sd = np.median(sizes, axis=0)
            right = (
                sum(blend.is_kind_right for blend in found),
                sum(abs(blend.error) <= 2 * blend.sd for blend in found),
                sum(blend.is_edge_held for blend in found),
            )
            counts = [f"{n} of {len(found)}" for n in right]
            cells = (
                f"{len(found)} of {len(chosen)}",
                counts[0],
                counts[1],
                f"{sd:.4f}",
                counts[2],
                f"{edge_sd:.4f}",
            )
            yield f"| {noise:g} | {kind} | {' | '.join(cells)} |"
        seconds = np.mean([score.seconds for score in scores])
        false.append(f"{sum(score.n_false for score in scores)} at {noise:g} mm ({seconds:.1f} CPU s a part)")
    yield ""
    yield "Others that were taken for blends, or for those of other faces: " + ", ".join(false)
