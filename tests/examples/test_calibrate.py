# SPDX-License-Identifier: MIT
"""The fit of the persistences, against constants that are known."""

import importlib.util

import numpy as np
import pytest

from completion.extension.confidence import PERSISTENCE, Onward, Prospects
from tests.helpers.data_paths import ROOT


@pytest.fixture(scope="module")
def calibrate():
    name = "calibrate_confidence"
    spec = importlib.util.spec_from_file_location(name, ROOT / f"examples/{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.long
def test_known_constants_come_out_of_what_they_make(calibrate):
    rng = np.random.default_rng(0)
    true = np.array([[0.9, 2.0], [0.95, 1.0], [0.98, 0.5], [0.97, 5.0], [0.9, 1.0], [0.99, 9.0], [0.6, 1.0]])
    n = 210_000
    onward = rng.integers(0, 7, n).astype(np.int8)
    places = Prospects(np.ones(n), onward, rng.uniform(0, 4, n) * true[onward, 1], np.zeros(n))
    right = rng.random(n) < places.probability(true)
    fitted = calibrate.most_likely(calibrate.Places(places, right, np.ones(n)))
    np.testing.assert_allclose(fitted[:, 0], true[:, 0], atol=0.02)
    np.testing.assert_allclose(fitted[:, 1], true[:, 1], rtol=0.06)


def test_without_evidence_the_constants_in_use_stay(calibrate):
    nothing = Prospects(np.zeros(4), np.full(4, Onward.CYLINDER, np.int8), np.ones(4), np.zeros(4))
    fitted = calibrate.most_likely(calibrate.Places(nothing, np.zeros(4, dtype=np.bool_), np.ones(4)))
    np.testing.assert_allclose(fitted, PERSISTENCE)


@pytest.mark.long
def test_places_of_a_room_are_right_where_the_truth_is(calibrate):
    rooms = calibrate.together(calibrate.places_in(3))
    shown = rooms.prospects.probability()
    assert len(shown) == len(rooms.is_right) == len(rooms.weight)
    sure, doubtful = rooms.is_right[shown > 0.9], rooms.is_right[shown < 0.1]
    assert sure.mean() > 0.9 > 0.3 > doubtful.mean()
