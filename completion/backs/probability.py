# SPDX-License-Identifier: MIT
"""Probability of symmetries: logistic models of what the views say, and which symmetries shape a thing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from completion.backs.limits import OFFERED, SQUARE_DEG
from completion.backs.symmetry import Kind, Symmetry, product
from completion.backs.weights import AXIS_WEIGHTS, MIRROR_WEIGHTS, TURN_WEIGHTS
from scenes.checks import FloatArray

_WEIGHTS: dict[Kind, tuple[float, ...]] = {
    "mirror": MIRROR_WEIGHTS, "axis": AXIS_WEIGHTS, "turn": TURN_WEIGHTS
}  # fmt: skip


def features(symmetry: Symmetry) -> FloatArray:
    """Return the terms (k,) of the logistic model of a symmetry's kind; the first is 1."""
    e = symmetry.evidence
    m, f, h = e["matched"], e["contradicted"], e["hidden"]
    if symmetry.kind == "mirror":
        return np.array([
            1.0, h, np.log(m + 0.03), np.log(f + 0.003), m * e["across"], e["balance"], e["across"],
            np.log(e["sd_offset"] + 1e-3), e["refuted"], np.log(e["refuted"] + 0.003), e["cut"], e["unseen"],
            e["lost"],
        ])  # fmt: skip
    if symmetry.kind == "axis":
        return np.array([1.0, m, f, h, e["inliers"], e["arc"], e["lateral"]])
    return np.array([1.0, m, f, h, e["inliers"], e["limb"]])


def weigh(found: Sequence[Symmetry]) -> list[Symmetry]:
    """Return symmetries with their probabilities."""
    scores = [float(features(one) @ np.array(_WEIGHTS[one.kind])) for one in found]
    likely = 1 / (1 + np.exp(-np.clip(scores, -30, 30)))
    return [replace(one, probability=float(p)) for one, p in zip(found, likely, strict=True)]


@dataclass(frozen=True, slots=True, eq=False)
class Element:
    """One isometry of the chosen group.

    `isometry` (3, 4); `origin` 1 of mirrors, 2 of turns; `probability` that it maps the thing into itself;
    `steps`: the symmetries and their isometries that it consists of, first the one that is applied first.
    """

    isometry: FloatArray
    origin: int
    probability: float
    steps: tuple[tuple[Symmetry, FloatArray], ...]

    def spread(self, points: FloatArray, normals: FloatArray) -> FloatArray:
        """Standard deviation (n,) of moved points (n, 3) along their moved normals, metres."""
        total = np.zeros(len(points))
        for symmetry, isometry in self.steps:
            total += symmetry.spread(points, normals, isometry) ** 2
            points, normals = points @ isometry[:, :3].T + isometry[:, 3], normals @ isometry[:, :3].T
        return np.sqrt(total)


def choose(hypotheses: Sequence[Symmetry], least: float) -> list[Symmetry]:
    """Return the symmetries from a probability on that shape a thing, which agree with each other.

    An axis alone; else a turn; else the mirror of largest p (.5 + m), and the best at right angles to it.
    """
    likely = [one for one in hypotheses if one.probability >= max(least, OFFERED)]
    for kind in ("axis", "turn"):
        alone = [one for one in likely if one.kind == kind]
        if alone:
            return alone[:1]
    mirrors = sorted(
        (one for one in likely if one.kind == "mirror"),
        key=lambda one: -one.probability * (0.5 + one.evidence["matched"]),
    )
    most = np.sin(np.radians(SQUARE_DEG))
    square = [one for one in mirrors[1:] if abs(one.normal @ mirrors[0].normal) <= most]
    return mirrors[:1] + square[:1]


def elements_of(chosen: Sequence[Symmetry], n_turns: int) -> list[Element]:
    """Return the isometries, besides the identity, of the group that chosen symmetries make."""
    found = [
        Element(isometry, 1 if one.kind == "mirror" else 2, one.probability, ((one, isometry),))
        for one in chosen
        for isometry in one.isometries(n_turns)
    ]
    if len(chosen) == 2:
        first, second = found
        both = product(first.isometry, second.isometry)
        likely = first.probability * second.probability
        found.append(Element(both, 1, likely, (*second.steps, *first.steps)))
    return found
