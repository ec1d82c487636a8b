# SPDX-License-Identifier: MIT
"""The fit of the persistences, against constants that are known."""

import numpy as np
import pytest

from benchmarks.suites import confidence
from completion.extension.confidence import (
    EVEN_M,
    KNOWN,
    KNOWN_PAST_END,
    PAST_END,
    PERSISTENCE,
    WEIGHTS,
    Onward,
    Prospects,
)


def places_at(onward, distance, known, probability, rng):
    """Places that are right with a probability of their prospects."""
    n, none = len(onward), np.zeros(len(onward), dtype=np.bool_)
    width, past_end = rng.uniform(0, 1, n), rng.normal(0.5, 2, (n, len(KNOWN_PAST_END)))
    base = np.where(onward == Onward.PAST_END, rng.uniform(0.5, 1, n), 1.0)
    given = Prospects(base, onward, distance, width, known, end_features=past_end, is_said=none)
    right = rng.random(n) < probability(given)
    return confidence.Places(given, right, np.ones(n))


@pytest.mark.long
def test_known_constants_come_out_of_what_they_make():
    rng, n = np.random.default_rng(0), 60_000
    true = np.array([[0.9, 2.0], [0.95, 1.0], [0.98, 0.5]])
    onward = rng.integers(0, 3, n).astype(np.int8)
    distance = rng.uniform(0, 4, n) * true[onward, 1]
    known = np.zeros((n, len(KNOWN)))
    places = places_at(onward, distance, known, lambda one: one.probability(true, even_m=0.9), rng)
    fitted, even_m = confidence.most_likely(places)
    assert even_m == pytest.approx(0.9, rel=0.05)
    np.testing.assert_allclose(fitted[:, 0], true[:, 0], atol=0.03)
    np.testing.assert_allclose(fitted[:, 1], true[:, 1], rtol=0.08)


def test_known_weights_come_out_of_what_they_make():
    rng, n = np.random.default_rng(0), 60_000
    true = rng.normal(0, 0.3, len(WEIGHTS))
    onward, known = np.full(n, Onward.BEYOND, np.int8), rng.normal(0.5, 2, (n, len(KNOWN)))
    places = places_at(onward, np.zeros(n), known, lambda one: one.probability(weights=true), rng)
    fitted = confidence.most_likely_weights(places)
    np.testing.assert_allclose(fitted, true, atol=0.15)  # the ridge pulls them in
    both = [places.prospects.probability(weights=one) for one in (fitted, true)]
    assert np.corrcoef(*both)[0, 1] > 0.99


def test_known_weights_past_ends_come_out_of_what_they_make():
    rng, n = np.random.default_rng(0), 60_000
    true = rng.normal(0, 0.5, len(PAST_END))
    onward, known = np.full(n, Onward.PAST_END, np.int8), np.zeros((n, len(KNOWN)))
    places = places_at(onward, np.zeros(n), known, lambda one: one.probability(end_weights=true), rng)
    fitted = confidence.most_likely_past_ends(places)
    np.testing.assert_allclose(fitted, true, atol=0.15)  # the ridge pulls them in
    both = [places.prospects.probability(end_weights=one) for one in (fitted, true)]
    assert np.corrcoef(*both)[0, 1] > 0.99


def test_without_evidence_the_constants_in_use_stay():
    nothing = Prospects(
        np.zeros(4), np.full(4, Onward.CYLINDER, np.int8), np.ones(4), np.zeros(4),
        np.zeros((4, len(KNOWN))), end_features=np.zeros((4, len(KNOWN_PAST_END))),
        is_said=np.zeros(4, dtype=np.bool_),
    )  # fmt: skip
    fitted, even_m = confidence.most_likely(
        confidence.Places(nothing, np.zeros(4, dtype=np.bool_), np.ones(4))
    )
    np.testing.assert_allclose(fitted, PERSISTENCE)
    assert even_m == pytest.approx(EVEN_M)


@pytest.mark.long
def test_places_of_a_room_are_right_where_the_truth_is():
    rooms = confidence.together(confidence.places_in(3))
    shown = rooms.prospects.probability()
    assert len(shown) == len(rooms.is_right) == len(rooms.weight)
    sure, doubtful = rooms.is_right[shown > 0.9], rooms.is_right[shown < 0.1]
    assert sure.mean() > 0.9 > 0.3 > doubtful.mean()
