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

from completion.registration.candidates import form_candidates, plane_candidates, turn_candidates
from completion.registration.facets import AGREES, ask_facets, count_agreement
from completion.registration.motions import STILL, angle_between, composed, inverse, inverses, moved
from completion.registration.refinement import Placed, equations_of, refine, stiffness
from completion.registration.station_view import N_SAMPLES, StationView
from scenes.checks import FloatArray, IntArray

_N_FREE = 3  # planes that a pose can bring together
_ALIKE_PLANE, _SAME_PLANE_M = np.cos(np.radians(15.0)), 0.08  # of facets of one plane
_N_SEEDS = 30  # facets whose planes are tried


def surplus_of(a: StationView, b: StationView, motion: FloatArray, within_m: float) -> float:
    """Return what agrees of scans, b moved by `motion` (3, 4) to a, beyond three planes, 0 to 2.

    It is a share of the facets of either scan's sample, summed over both.
    """
    return _share(b, a, motion, within_m) + _share(a, b, inverse(motion), within_m)


def _share(own: StationView, other: StationView, motion: FloatArray, within_m: float) -> float:
    told = ask_facets(own.facets, own.sample, motion, other.sight, other.facets, within_m)
    left = own.sample[told == AGREES]
    for _ in range(_N_FREE):
        left = _without_largest(own.facets.normal[left], own.facets.centre[left], left)
    return len(left) / max(len(own.sample), 1)


def _without_largest(normals: FloatArray, places: FloatArray, facets: IntArray) -> IntArray:
    """The facets (m,) that do not lie in the plane in which most of them lie."""
    if not len(facets):
        return facets
    seeds = slice(None, None, max(1, len(facets) // _N_SEEDS))
    height = np.einsum("ij,ij->i", places[seeds], normals[seeds])
    together = normals @ normals[seeds].T > _ALIKE_PLANE
    together &= np.abs(places @ normals[seeds].T - height) < _SAME_PLANE_M
    return np.asarray(facets[~together[:, together.sum(axis=0).argmax()]])


COARSE_M, MIDDLE_M, FINE_M = 0.2, 0.08, 0.01
"""How far off poses may still be, metres: as candidates, after a short refinement, after a full one."""

COARSE_VIOLATION, VIOLATION = 3.0, 20.0
"""Facets that agree which one that is violated outweighs, of candidates and in the end."""

N_KEPT = 5
"""Distinct hypotheses of a pair."""

_SCREEN = 57  # facets of each scan that screen poses
_SOME = 400  # facets of each scan that judge poses which are not settled yet
_ROOMS, _OBJECTS = (1500, 30, 10), (3000, 100, 20)  # poses screened, refined shortly, and fully
_SHORT, _FULL, _LAST = (4, 4), (12, 1), (60, 1)  # rounds of refinement at most, every so many-th facet
_APART, _APART_SHARE = np.radians(10.0), 0.25  # turn and share of the spread by which poses are distinct
_LEVEL = np.cos(np.radians(6.0))  # of what is up in both scans
_LAST_GATE_M = 0.05
_SLIDES_M = (-0.8, -0.5, -0.3, -0.2, -0.1, 0.1, 0.2, 0.3, 0.5, 0.8)
_N_SLIDES, _BETTER = 4, 0.01


@dataclass(frozen=True, slots=True, eq=False)
class Hypothesis:
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
    surplus : float
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
    surplus: float
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
    first, second = [Placed(a, STILL)], [Placed(b, STILL)]
    n_screened, n_short, n_full = _OBJECTS if are_objects else _ROOMS
    planes = plane_candidates(a.directions, b.directions, 2 * max(a.radius_m, b.radius_m))
    motions = np.concatenate([planes, turn_candidates(a, b), form_candidates(a, b)])
    if a.up is not None and b.up is not None:
        motions = motions[motions[:, :, :3] @ b.up @ a.up > _LEVEL]
    if len(motions) > n_screened:
        scores = scores_of(first, second, motions, COARSE_M, COARSE_VIOLATION, n=_SCREEN)
        motions = motions[np.argsort(-scores, kind="stable")[:n_screened]]
    motions = distinct(
        motions, scores_of(first, second, motions, COARSE_M, COARSE_VIOLATION, n=_SOME), second, n_short
    )
    motions = np.array([refine(first, second, one, *_SHORT) for one in motions]).reshape(-1, 3, 4)
    scores = scores_of(first, second, motions, MIDDLE_M, VIOLATION, n=_SOME)
    motions = distinct(motions, scores, second, n_full)
    if start is not None:
        motions = np.concatenate([motions, start[None]])
    return best_of(first, second, motions)


def best_of(stay: Sequence[Placed], move: Sequence[Placed], motions: FloatArray) -> list[Hypothesis]:
    """Return the best distinct hypotheses that motions (n, 3, 4) of some scans to others lead to.

    Curved things creep into place: the best are refined once more, until they stand still.
    """
    settled = [_slid(stay, move, refine(stay, move, one, *_FULL)) for one in motions]
    motions = np.array(settled).reshape(-1, 3, 4)
    motions = distinct(motions, scores_of(stay, move, motions, MIDDLE_M, VIOLATION), move, N_KEPT)
    motions = np.array([refine(stay, move, one, *_LAST) for one in motions]).reshape(-1, 3, 4)
    kept = distinct(motions, scores_of(stay, move, motions, FINE_M, VIOLATION), move, N_KEPT)
    return [judged(stay, move, one) for one in kept]


def judged(stay: Sequence[Placed], move: Sequence[Placed], motion: FloatArray) -> Hypothesis:
    """Return a motion (3, 4) with what speaks for it."""
    counts = np.sum([one for one, _ in _counts(stay, move, motion[None], FINE_M)], axis=0)[0]
    score = float(scores_of(stay, move, motion[None], FINE_M, VIOLATION)[0])
    equations, _ = equations_of(stay, move, motion, _LAST_GATE_M)
    stiff = stiffness(equations)
    seen = max(int(counts[2]), 1)
    return Hypothesis(
        motion=motion,
        score=score,
        agree=float(counts[0] / seen),
        violate=float(counts[1] / seen),
        stiffness=stiff.least,
        surplus=sum(
            surplus_of(a.view, b.view, composed(composed(inverse(a.pose), motion), b.pose), FINE_M)
            for a in stay
            for b in move
        ),
        free=stiff.free,
    )


def scores_of(
    stay: Sequence[Placed],
    move: Sequence[Placed],
    motions: FloatArray,
    within_m: float,
    violation: float,
    *,
    n: int = N_SAMPLES,
) -> FloatArray:
    """Return the scores (n,) of motions (n, 3, 4) of some scans into the frame of others.

    `within_m` is how far off poses may still be; some n facets of each sample are looked up.
    """
    scores = np.zeros(len(motions))
    for counts, size in _counts(stay, move, motions, within_m, n):
        scores += (counts[:, 0] - violation * counts[:, 1]) / size
    return scores


def _counts(
    stay: Sequence[Placed], move: Sequence[Placed], motions: FloatArray, within_m: float, n: int = N_SAMPLES
) -> list[tuple[IntArray, int]]:
    """What each scan says of each other one across (n, 3), and the size of the sample it was asked of."""
    found = []
    for a in stay:
        for b in move:
            there = composed(composed(inverse(a.pose), motions), b.pose)
            for own, other, one in ((b.view, a.view, there), (a.view, b.view, inverses(there))):
                some = own.sample[:: max(1, round(len(own.sample) / n))]
                counts = count_agreement(own.facets, some, one, other.sight, other.facets, within_m)
                found.append((counts, max(len(some), 1)))
    return found


def distinct(motions: FloatArray, scores: FloatArray, move: Sequence[Placed], n: int) -> FloatArray:
    """Return at most n of the motions (m, 3, 4) of some scans that are distinct, best first.

    They are where they turn the scans otherwise, or put the middle of what these saw elsewhere.
    """
    spread = max(one.view.spread_m for one in move)
    middle = np.mean([one.pose[:, :3] @ one.view.middle + one.pose[:, 3] for one in move], axis=0)
    places = motions[:, :, :3] @ middle + motions[:, :, 3]
    kept: list[int] = []
    for k in np.argsort(-scores, kind="stable").tolist():
        near = angle_between(motions[k], motions[kept]) < _APART
        near &= np.linalg.norm(places[kept] - places[k], axis=1) < _APART_SHARE * spread
        if not near.any():
            kept.append(k)
            if len(kept) == n:
                break
    return np.asarray(motions[kept])


def _slid(stay: Sequence[Placed], move: Sequence[Placed], motion: FloatArray) -> FloatArray:
    """The motion (3, 4) slid along what facets tell least, as far as beams approve.

    Facets of a bare wall meet wherever it is slid; what stands before it and where it ends does not.
    """
    best = float(scores_of(stay, move, motion[None], MIDDLE_M, VIOLATION, n=_SOME)[0])
    for _ in range(_N_SLIDES):
        told = stiffness(equations_of(stay, move, motion, _LAST_GATE_M)[0])
        if not told.free.any():
            break
        tried = np.array([moved(motion, step * told.change, told.middle) for step in _SLIDES_M])
        scores = scores_of(stay, move, tried, MIDDLE_M, VIOLATION, n=_SOME)
        again = refine(stay, move, tried[int(scores.argmax())], *_FULL)
        score = float(scores_of(stay, move, again[None], MIDDLE_M, VIOLATION, n=_SOME)[0])
        if score <= best + _BETTER:
            break
        motion, best = again, score
    return motion
