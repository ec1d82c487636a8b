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


def features(symmetry: Symmetry) -> FloatArray:
    """Return the terms (k,) of the logistic model of a symmetry's kind; the first is 1."""
    e = symmetry.evidence
    m, f, h, b = e["matched"], e["contradicted"], e["hidden"], e["limb"]
    if symmetry.kind == "mirror":
        return np.array([
            1.0, m, f, h, b, e["balance"], min(m, 0.4), e["off"], e["across"], np.log(e["sd_offset"] + 1e-3),
            np.log(e["sd_angle"] + 1e-3), np.log((f + 0.003) / (m + 0.03)), np.log(f + 0.003), np.log(m + 0.03),
            e["cut"], e["unseen"], e["chance"], e["lost"], e["covered"],
        ])  # fmt: skip
    if symmetry.kind == "axis":
        return np.array([1.0, m, f, e["inliers"], e["arc"], e["lateral"], h, e["cut"]])
    return np.array([1.0, m, f, e["inliers"], h, e["limb"]])


def weigh(symmetry: Symmetry) -> Symmetry:
    """Return a symmetry with its probability."""
    weights: dict[Kind, tuple[float, ...]] = {
        "mirror": MIRROR_WEIGHTS, "axis": AXIS_WEIGHTS, "turn": TURN_WEIGHTS
    }  # fmt: skip
    score = float(features(symmetry) @ np.array(weights[symmetry.kind]))
    return replace(symmetry, probability=1 / (1 + float(np.exp(-np.clip(score, -30, 30)))))


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
