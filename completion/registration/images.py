# SPDX-License-Identifier: MIT
"""Images: poses that are as good as another one because a place repeats itself.

Along a row of like doors a pose that is off by one door shares more with the beams than the truth does, where
the scans overlap little. What gives it away is a scan that fits itself once it is shifted: its beams approve
of that as well.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from completion.registration.candidates.motions import STILL, angle_between, composed, inverses
from completion.registration.candidates.plane_candidates import places_of
from completion.registration.candidates.station_view import StationView
from completion.registration.hypotheses import (
    COARSE_M,
    COARSE_VIOLATION,
    FINE_M,
    MIDDLE_M,
    N_KEPT,
    VIOLATION,
    Hypothesis,
    distinct,
    judged,
    scores_of,
)
from completion.registration.refinement import Placed, refine
from completion.registration.verdict import LEAST_STIFFNESS, is_approved, trust_of
from scenes.checks import FloatArray

_WORTH = 0.4  # probability from which on a pose may be claimed at any level
_LEAST_M, _LEAST_TURN = 0.5, np.radians(5.0)  # shifts that count, and turns that are none
_N_SCREENED, _SCREEN, _N_REFINED = 300, 57, 8
_ROUNDS = 12


def with_images(hypotheses: Sequence[Hypothesis], a: StationView, b: StationView) -> list[Hypothesis]:
    """Return hypotheses of b to a, and after them the images of the first one that beams approve of.

    Images come of shifts under which either scan fits itself. They are looked for where a claim is near.
    """
    found = list(hypotheses)
    if not found or trust_of(found) < _WORTH:
        return found
    best = found[0].motion
    motions = np.concatenate(
        [composed(shifts_onto_itself(a), best), composed(best, shifts_onto_itself(b))]
    ).reshape(-1, 3, 4)
    first, second = [Placed(a, STILL)], [Placed(b, STILL)]
    motions = np.array([refine(first, second, one, _ROUNDS) for one in motions]).reshape(-1, 3, 4)
    apart = np.linalg.norm(motions[:, :, 3] - best[:, 3], axis=1) > _LEAST_M
    motions = motions[apart]
    motions = distinct(motions, scores_of(first, second, motions, FINE_M, VIOLATION), second, N_KEPT)
    images = [judged(first, second, one) for one in motions]
    return found + [replace(one, is_image=True) for one in images if is_approved(one)]


def shifts_onto_itself(view: StationView) -> FloatArray:
    """Return motions (n, 3, 4), shifts nearly, under which a scan's beams approve of the scan itself."""
    reach = 2 * view.radius_m
    places = places_of(view.directions, view.directions, np.eye(3), reach)
    places = places[np.linalg.norm(places, axis=1) > _LEAST_M]
    motions = np.concatenate([np.repeat(np.eye(3)[None], len(places), axis=0), places[:, :, None]], axis=2)
    own = [Placed(view, STILL)]
    scores = scores_of(own, own, motions, COARSE_M, COARSE_VIOLATION, n=_SCREEN)
    motions = motions[np.argsort(-scores, kind="stable")[:_N_SCREENED]]
    scores = scores_of(own, own, motions, MIDDLE_M, COARSE_VIOLATION)
    motions = distinct(motions, scores, own, _N_REFINED)
    motions = np.array([refine(own, own, one, _ROUNDS) for one in motions]).reshape(-1, 3, 4)
    chosen = np.linalg.norm(motions[:, :, 3], axis=1) > _LEAST_M
    chosen &= angle_between(STILL, motions) < _LEAST_TURN
    kept = [one for one in motions[chosen] if _fits(judged(own, own, one))]
    shifts = np.array(kept).reshape(-1, 3, 4)
    return np.concatenate([shifts, inverses(shifts)])


def _fits(one: Hypothesis) -> bool:
    """Whether a scan fits itself, and not because it slides along what is bare."""
    return is_approved(one) and one.stiffness >= LEAST_STIFFNESS
