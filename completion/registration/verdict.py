# SPDX-License-Identifier: MIT
"""Verdict: whether hypotheses tell one pose, several, one that slides, or none."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from completion.registration.hypotheses import Hypothesis
from completion.registration.motions import angle_between
from scenes.checks import FloatArray

LEAST_SCORE, MOST_VIOLATED = 0.4, 0.02
"""Score and share of violated facets of a pose that is worth a word."""

LEAST_STIFFNESS = 0.002
"""What facets must tell of a motion at least, of 1 / 6, that it does not slide."""

_MARGINS = ((0.001, 0.35), (0.01, 0.5), (0.05, 0.65), (0.2, 0.8))
"""Probability of a false claim, and share of the best score that the second hypothesis may have."""

_SAME_TURN, _ALONG = np.radians(5.0), np.cos(np.radians(15.0))


class Verdict(StrEnum):
    """What is known of the pose of two groups of scans to each other."""

    REGISTERED = "registered"
    AMBIGUOUS = "ambiguous"
    SLIDES = "slides"
    NO_OVERLAP = "no overlap shown"


@dataclass(frozen=True, slots=True, eq=False)
class Judgement:
    """A verdict, why, and the direction (3,) along which the pose slides, in the frame of those that stay."""

    verdict: Verdict
    reason: str
    direction: FloatArray | None = None


def judge(hypotheses: Sequence[Hypothesis], level: float) -> Judgement:
    """Return what hypotheses, best first, tell of a pose.

    One is claimed where beams hardly contradict it, where no distinct one comes near it, and where facets
    tell all six numbers of it. `level` is the accepted probability of a false claim: the margin to the second
    hypothesis follows from it, as measured on pairs of rooms that have nothing in common.
    """
    if not hypotheses:
        return Judgement(Verdict.NO_OVERLAP, "no plane of one scan can be one of the other")
    best = hypotheses[0]
    if best.score <= LEAST_SCORE or best.violate >= MOST_VIOLATED:
        told = f"the best pose has score {best.score:.2f}, beams contradict {100 * best.violate:.1f} % of it"
        return Judgement(Verdict.NO_OVERLAP, told)
    rivals = [one for one in hypotheses[1:] if one.score > margin(level) * best.score]
    direction = _slide(best, rivals)
    if direction is not None:
        reason = "facets tell nothing of a shift along one direction"
        return Judgement(Verdict.SLIDES, reason, direction)
    if rivals:
        reason = f"{len(rivals)} other poses come within {100 * margin(level):.0f} % of the best score"
        return Judgement(Verdict.AMBIGUOUS, reason)
    if best.stiffness < LEAST_STIFFNESS:
        return Judgement(Verdict.AMBIGUOUS, "facets tell too little of one of its motions")
    return Judgement(Verdict.REGISTERED, "no other pose comes near")


def margin(level: float) -> float:
    """Return the share of the best score that a second hypothesis may have, 0 to 0.8."""
    levels, margins = np.log([one for one, _ in _MARGINS]), [one for _, one in _MARGINS]
    return float(np.interp(np.log(max(level, 1e-12)), levels, margins))


def _slide(best: Hypothesis, rivals: Sequence[Hypothesis]) -> FloatArray | None:
    """The direction (3,) in which alone the best one and its rivals differ, if facets tell nothing of it."""
    turn, shift = best.free[:3], best.free[3:]
    if best.stiffness >= LEAST_STIFFNESS or np.linalg.norm(shift) < np.linalg.norm(turn):
        return None
    direction = shift / np.linalg.norm(shift)
    for one in rivals:
        apart = one.motion[:, 3] - best.motion[:, 3]
        if angle_between(best.motion, one.motion[None])[0] > _SAME_TURN:
            return None
        if abs(float(apart @ direction)) < _ALONG * np.linalg.norm(apart):
            return None
    return np.asarray(direction)
