# SPDX-License-Identifier: MIT
"""Hypotheses: poses of one scan to another one that their beams approve, best first, from any start.

Surplus: what agrees of two scans beyond the three planes that any pose can bring together.
The corner of a room fits that of any other one: three planes settle the six numbers of a pose, and that they
agree says nothing of whether the scans share anything. What else agrees does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from completion.registration import limits
from completion.registration.facets import AGREES, ask_facets, count_agreement
from completion.registration.motions import STILL, angle_between, compose, inverse, inverses, perturb
from completion.registration.pose_candidates import form_candidates, plane_candidates, turn_candidates
from completion.registration.refinement import PlacedScan, equations_of, refine, stiffness
from completion.registration.station_view import StationView
from scenes.checks import FloatArray, IntArray, Value


def surplus_of(a: StationView, b: StationView, motion: FloatArray, within_m: float) -> float:
    """Return what agrees of scans, b moved by `motion` (3, 4) to a, beyond three planes, 0 to 2.

    It is a share of the facets of either scan's sample, summed over both.
    """
    return _share(b, a, motion, within_m) + _share(a, b, inverse(motion), within_m)


def _share(view: StationView, other: StationView, motion: FloatArray, within_m: float) -> float:
    facets = ask_facets(view.facets, view.sample, motion, other.sight, other.facets, within_m)
    left = view.sample[facets == AGREES]
    for _ in range(limits.N_FREE_PLANES):
        left = _without_largest(view.facets.normal[left], view.facets.centre[left], left)
    return len(left) / max(len(view.sample), 1)


def _without_largest(normals: FloatArray, places: FloatArray, facets: IntArray) -> IntArray:
    """The facets (m,) that do not lie in the plane in which most of them lie."""
    if not len(facets):
        return facets
    seeds = slice(None, None, max(1, len(facets) // limits.N_SEEDS))
    height = np.einsum("ij,ij->i", places[seeds], normals[seeds])
    together = normals @ normals[seeds].T > limits.ALONG
    together &= np.abs(places @ normals[seeds].T - height) < limits.MIDDLE_M
    return np.asarray(facets[~together[:, together.sum(axis=0).argmax()]])


@dataclass(frozen=True, slots=True, eq=False)
class Hypothesis(Value):
    """A motion of some scans into the frame of others, and what speaks for it.

    Attributes
    ----------
    motion : (3, 4) float
        A turn and a shift, metres.
    score : float
        Facets that agree less twenty times those that are violated, as shares of each scan's sample, summed.
    agree, violate : float
        Shares of facets in view of another scan.
    stiffness : float
        Least eigenvalue of what the facets tell, 0 to 1 / 6.
    beyond_planes : float
        What agrees beyond three planes of each two scans, summed: three planes agree by construction.
    free : (6,) float
        The motion that they tell least, a turn about the facets' middle times their reach and a shift, in the
        frame of those that stay.
    is_image : bool
        Whether it comes of another one because the place repeats itself.
    """

    motion: FloatArray
    score: float
    agree: float
    violate: float
    stiffness: float
    beyond_planes: float
    free: FloatArray
    is_image: bool = False


def find_hypotheses(
    a: StationView, b: StationView, start: FloatArray | None = None, *, are_objects: bool = False
) -> list[Hypothesis]:
    """Return at most five distinct poses of scan b to scan a, best first.

    Candidates come from planes and from turns about a plane that both share; beams of both scans screen them,
    what is left is refined, shortly and then fully, and slid along what facets tell least. Where both scans
    know what is up, only turns about it count. A pose (3, 4) to `start` from is refined as well. Of objects
    more poses are refined: what curves tells little before it is brought close.
    """
    if not len(a.sample) or not len(b.sample):
        return []
    first, second = [PlacedScan(a, STILL)], [PlacedScan(b, STILL)]
    n_screened, n_short, n_full = limits.OF_OBJECTS if are_objects else limits.OF_ROOMS
    planes = plane_candidates(a.directions, b.directions, 2 * max(a.radius_m, b.radius_m))
    motions = np.concatenate([planes, turn_candidates(a, b), form_candidates(a, b)])
    if a.up is not None and b.up is not None:
        motions = motions[motions[:, :, :3] @ b.up @ a.up > limits.SAME_DIRECTION]
    if len(motions) > n_screened:
        scores = scores_of(
            first, second, motions, limits.COARSE_M, limits.COARSE_VIOLATION, n=limits.N_SCREENS
        )
        motions = motions[np.argsort(-scores, kind="stable")[:n_screened]]
    motions = distinct(
        motions,
        scores_of(first, second, motions, limits.COARSE_M, limits.COARSE_VIOLATION, n=limits.N_JUDGES),
        second,
        n_short,
    )
    motions = np.array([refine(first, second, motion, *limits.SHORT) for motion in motions]).reshape(-1, 3, 4)
    scores = scores_of(first, second, motions, limits.MIDDLE_M, limits.VIOLATION, n=limits.N_JUDGES)
    motions = distinct(motions, scores, second, n_full)
    if start is not None:
        motions = np.concatenate([motions, start[None]])
    return best_of(first, second, motions)


def best_of(stay: Sequence[PlacedScan], move: Sequence[PlacedScan], motions: FloatArray) -> list[Hypothesis]:
    """Return the best distinct hypotheses that motions (n, 3, 4) of some scans to others lead to.

    Curved things creep into place: the best are refined once more, until they stand still.
    """
    slid = [_slid(stay, move, refine(stay, move, motion, *limits.FULL)) for motion in motions]
    motions = np.array(slid).reshape(-1, 3, 4)
    motions = distinct(
        motions, scores_of(stay, move, motions, limits.MIDDLE_M, limits.VIOLATION), move, limits.N_KEPT
    )
    motions = np.array([refine(stay, move, motion, *limits.LAST) for motion in motions]).reshape(-1, 3, 4)
    kept = distinct(
        motions, scores_of(stay, move, motions, limits.FINE_M, limits.VIOLATION), move, limits.N_KEPT
    )
    return [judge_motion(stay, move, motion) for motion in kept]


def judge_motion(stay: Sequence[PlacedScan], move: Sequence[PlacedScan], motion: FloatArray) -> Hypothesis:
    """Return a motion (3, 4) with what speaks for it."""
    counts = np.sum([count for count, _ in _counts(stay, move, motion[None], limits.FINE_M)], axis=0)[0]
    score = float(scores_of(stay, move, motion[None], limits.FINE_M, limits.VIOLATION)[0])
    equations, _ = equations_of(stay, move, motion, limits.LAST_GATE_M)
    stiff = stiffness(equations)
    seen = max(int(counts[2]), 1)
    return Hypothesis(
        motion=motion,
        score=score,
        agree=float(counts[0] / seen),
        violate=float(counts[1] / seen),
        stiffness=stiff.least,
        beyond_planes=sum(
            surplus_of(a.view, b.view, compose(compose(inverse(a.pose), motion), b.pose), limits.FINE_M)
            for a in stay
            for b in move
        ),
        free=stiff.free,
    )


def scores_of(
    stay: Sequence[PlacedScan],
    move: Sequence[PlacedScan],
    motions: FloatArray,
    within_m: float,
    violation: float,
    *,
    n: int = limits.N_SAMPLES,
) -> FloatArray:
    """Return the scores (n,) of motions (n, 3, 4) of some scans into the frame of others.

    `within_m` is how far off poses may still be; some n facets of each sample are looked up.
    """
    scores = np.zeros(len(motions))
    for counts, size in _counts(stay, move, motions, within_m, n):
        scores += (counts[:, 0] - violation * counts[:, 1]) / size
    return scores


def _counts(
    stay: Sequence[PlacedScan],
    move: Sequence[PlacedScan],
    motions: FloatArray,
    within_m: float,
    n: int = limits.N_SAMPLES,
) -> list[tuple[IntArray, int]]:
    """What each scan says of each other one across (n, 3), and the size of the sample it was asked of."""
    pairs = []
    for a in stay:
        for b in move:
            there = compose(compose(inverse(a.pose), motions), b.pose)
            for view, second, first in ((b.view, a.view, there), (a.view, b.view, inverses(there))):
                sample = view.sample[:: max(1, round(len(view.sample) / n))].copy()
                counts = count_agreement(view.facets, sample, first, second.sight, second.facets, within_m)
                pairs.append((counts, max(len(sample), 1)))
    return pairs


def distinct(motions: FloatArray, scores: FloatArray, move: Sequence[PlacedScan], n: int) -> FloatArray:
    """Return at most n of the motions (m, 3, 4) of some scans that are distinct, best first.

    They are where they turn the scans otherwise, or put the middle of what these saw elsewhere.
    """
    spread = max(placement.view.spread_m for placement in move)
    middle = np.mean(
        [placement.pose[:, :3] @ placement.view.middle + placement.pose[:, 3] for placement in move], axis=0
    )
    places = motions[:, :, :3] @ middle + motions[:, :, 3]
    kept: list[int] = []
    for k in np.argsort(-scores, kind="stable").tolist():
        near = angle_between(motions[k], motions[kept]) < limits.DISTINCT_TURN
        near &= np.linalg.norm(places[kept] - places[k], axis=1) < limits.DISTINCT_SHARE * spread
        if not near.any():
            kept.append(k)
            if len(kept) == n:
                break
    return np.asarray(motions[kept])


def _slid(stay: Sequence[PlacedScan], move: Sequence[PlacedScan], motion: FloatArray) -> FloatArray:
    """The motion (3, 4) slid along what facets tell least, as far as beams approve.

    Facets of a bare wall meet wherever it is slid; what stands before it and where it ends does not.
    """
    best = float(scores_of(stay, move, motion[None], limits.MIDDLE_M, limits.VIOLATION, n=limits.N_JUDGES)[0])
    for _ in range(limits.N_SLIDES):
        sentence = stiffness(equations_of(stay, move, motion, limits.LAST_GATE_M)[0])
        if not sentence.free.any():
            break
        tried = np.array(
            [perturb(motion, step * sentence.change, sentence.middle) for step in limits.SLIDES_M]
        )
        scores = scores_of(stay, move, tried, limits.MIDDLE_M, limits.VIOLATION, n=limits.N_JUDGES)
        again = refine(stay, move, tried[int(scores.argmax())], *limits.FULL)
        score = float(
            scores_of(stay, move, again[None], limits.MIDDLE_M, limits.VIOLATION, n=limits.N_JUDGES)[0]
        )
        if score <= best + limits.BETTER:
            break
        motion, best = again, score
    return motion
