# SPDX-License-Identifier: MIT
"""Verdict: whether hypotheses tell one pose, several, one that slides, or none."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from completion.registration import limits
from completion.registration.hypotheses import Hypothesis, distinct, judge_motion, scores_of
from completion.registration.motions import STILL, angle_between, compose, inverses
from completion.registration.pose_candidates import places_of
from completion.registration.refinement import PlacedScan, refine
from completion.registration.station_view import StationView
from scenes.checks import FloatArray


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

    One is claimed where facets tell all six numbers of it and where it is right with probability enough.
    `level` is the accepted share of false claims among pairs: how high is enough was measured on pairs
    of furnished rooms and on pairs that have nothing in common.
    """
    if not hypotheses:
        return Judgement(Verdict.NO_OVERLAP, "no plane of one scan can be one of the other")
    best = hypotheses[0]
    if not is_approved(best):
        sentence = (
            f"the best pose has score {best.score:.2f}, beams contradict {100 * best.violate:.1f} % of it"
        )
        return Judgement(Verdict.NO_OVERLAP, sentence)
    rivals = [hypothesis for hypothesis in hypotheses[1:] if hypothesis.score > limits.RIVAL * best.score]
    direction = _slide(best, rivals)
    if direction is not None:
        reason = "facets tell nothing of a shift along one direction"
        return Judgement(Verdict.SLIDES, reason, direction)
    if best.stiffness < limits.LEAST_STIFFNESS:
        return Judgement(Verdict.AMBIGUOUS, "facets tell too little of one of its motions")
    trust, asked = trust_of(hypotheses), trust_for(level)
    if trust >= asked:
        return Judgement(Verdict.REGISTERED, f"right with probability {trust:.2f}")
    sentence = f"right with probability {trust:.2f}, where {asked:.2f} is asked"
    if rivals:
        sentence += f"; {len(rivals)} others come within {100 * limits.RIVAL:.0f} % of the best score"
    return Judgement(Verdict.AMBIGUOUS, sentence)


def is_approved(hypothesis: Hypothesis) -> bool:
    """Tell whether beams say nothing against a pose that is worth a word."""
    return hypothesis.score > limits.LEAST_SCORE and hypothesis.violate < limits.MOST_VIOLATED


def trust_of(hypotheses: Sequence[Hypothesis]) -> float:
    """Return the probability that the first hypothesis is right, 0 to 1.

    It falls with the score of the second one, with what beams contradict, and rises with what agrees beyond
    the three planes that any pose can bring together. It is no higher than that of the first against any
    other one that beams approve of, each seen by itself: in a place that is its own image, or that repeats
    itself, poses that share less are as good. Where a scan fits itself once it is shifted, and beams approve
    of the pose that this makes of the first, neither is more probable.
    """
    best, *others = hypotheses
    second = max((hypothesis.score for hypothesis in others), default=0.0)
    odds = _odds_alone(best) + limits.BY_RIVAL * max(second, 0.0) / max(best.score, 1e-9)
    odds = min(
        [
            odds,
            *(_odds_alone(best) - _odds_alone(hypothesis) for hypothesis in others if hypothesis.score > 0),
        ]
    )
    if any(hypothesis.is_image for hypothesis in others):
        odds = min(odds, 0.0)
    return float(1.0 / (1.0 + np.exp(-odds)))


def _odds_alone(hypothesis: Hypothesis) -> float:
    """Log odds of a pose without any other one beside it."""
    return float(
        limits.TRUST
        + limits.BY_VIOLATION * hypothesis.violate
        + limits.BY_BEYOND_PLANES * np.log(hypothesis.beyond_planes + limits.LEAST_BEYOND_PLANES)
    )


def trust_for(level: float) -> float:
    """Return the probability from which on a pose is claimed where `level` of the claims may be false."""
    levels, asked = (
        np.log([value for value, _ in limits.CLAIMED_FROM]),
        [value for _, value in limits.CLAIMED_FROM],
    )
    return float(np.interp(np.log(max(level, 1e-12)), levels, asked))


def _slide(best: Hypothesis, rivals: Sequence[Hypothesis]) -> FloatArray | None:
    """The direction (3,) along which the best one and all its rivals slide, or in which alone they differ."""
    direction = _free_shift(best)
    if direction is None:
        return None
    for rival in rivals:
        apart = rival.motion[:, 3] - best.motion[:, 3]
        is_along = abs(float(apart @ direction)) >= limits.ALONG * np.linalg.norm(apart)
        if is_along and angle_between(best.motion, rival.motion[None])[0] <= limits.LEAST_TURN:
            continue
        free_shift = _free_shift(rival)
        if free_shift is None or abs(float(free_shift @ direction)) < limits.ALONG:
            return None
    return direction


def _free_shift(hypothesis: Hypothesis) -> FloatArray | None:
    """The direction (3,) of a shift of which facets tell nothing; None where they do, or of a turn."""
    turn, shift = hypothesis.free[:3], hypothesis.free[3:]
    if hypothesis.stiffness >= limits.LEAST_STIFFNESS or np.linalg.norm(shift) < np.linalg.norm(turn):
        return None
    return np.asarray(shift / np.linalg.norm(shift))


def with_images(hypotheses: Sequence[Hypothesis], a: StationView, b: StationView) -> list[Hypothesis]:
    """Return hypotheses of b to a, and after them the images of the first one that beams approve of.

    Images come of shifts under which either scan fits itself. They are looked for where a claim is near.
    """
    hypothesis = list(hypotheses)
    if not hypothesis or trust_of(hypothesis) < limits.CLAIMABLE:
        return hypothesis
    best = hypothesis[0].motion
    motions = np.concatenate(
        [compose(shifts_onto_itself(a), best), compose(best, shifts_onto_itself(b))]
    ).reshape(-1, 3, 4)
    first, second = [PlacedScan(a, STILL)], [PlacedScan(b, STILL)]
    motions = np.array([refine(first, second, motion, limits.FULL[0]) for motion in motions]).reshape(
        -1, 3, 4
    )
    apart = np.linalg.norm(motions[:, :, 3] - best[:, 3], axis=1) > limits.LEAST_SHIFT_M
    motions = motions[apart]
    motions = distinct(
        motions, scores_of(first, second, motions, limits.FINE_M, limits.VIOLATION), second, limits.N_KEPT
    )
    images = [judge_motion(first, second, motion) for motion in motions]
    return hypothesis + [replace(image, is_image=True) for image in images if is_approved(image)]


def shifts_onto_itself(view: StationView) -> FloatArray:
    """Return motions (n, 3, 4), shifts nearly, under which a scan's beams approve of the scan itself."""
    reach = 2 * view.radius_m
    places = places_of(view.directions, view.directions, np.eye(3), reach)
    places = places[np.linalg.norm(places, axis=1) > limits.LEAST_SHIFT_M]
    motions = np.concatenate([np.repeat(np.eye(3)[None], len(places), axis=0), places[:, :, None]], axis=2)
    pairs = [PlacedScan(view, STILL)]
    scores = scores_of(pairs, pairs, motions, limits.COARSE_M, limits.COARSE_VIOLATION, n=limits.N_SCREENS)
    motions = motions[np.argsort(-scores, kind="stable")[: limits.N_SHIFTS]]
    scores = scores_of(pairs, pairs, motions, limits.MIDDLE_M, limits.COARSE_VIOLATION)
    motions = distinct(motions, scores, pairs, limits.N_SHIFTS_REFINED)
    motions = np.array([refine(pairs, pairs, motion, limits.FULL[0]) for motion in motions]).reshape(-1, 3, 4)
    chosen = np.linalg.norm(motions[:, :, 3], axis=1) > limits.LEAST_SHIFT_M
    chosen &= angle_between(STILL, motions) < limits.LEAST_TURN
    kept = [motion for motion in motions[chosen] if _fits(judge_motion(pairs, pairs, motion))]
    shifts = np.array(kept).reshape(-1, 3, 4)
    return np.concatenate([shifts, inverses(shifts)])


def _fits(hypothesis: Hypothesis) -> bool:
    """Whether a scan fits itself, and not because it slides along what is bare."""
    return is_approved(hypothesis) and hypothesis.stiffness >= limits.LEAST_STIFFNESS
