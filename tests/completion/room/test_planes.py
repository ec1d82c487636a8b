# SPDX-License-Identifier: MIT
"""Beams that the room looks at: thinned evenly, in all columns by turns, and as far apart as they say."""

from __future__ import annotations

import numpy as np
import pytest

from completion.room.planes import Beams
from tests.helpers.completion_examples import completed


@pytest.fixture(scope="module")
def seen():
    return completed("two_occluders", pixels=120).observations[0]


def test_thinned_beams_look_into_all_columns(seen):
    """Beams of every eighth row and column would look into an eighth of them."""
    most = np.count_nonzero(seen.valid) // 64
    beams = Beams.of([seen], most)
    assert len(beams.point) == pytest.approx(most, rel=0.2)
    columns = np.unique(np.rint(seen.scan.pixels(beams.point)[:, 1]))
    assert len(columns) > 0.8 * seen.valid.shape[1]


def test_beams_say_how_far_the_next_one_is(seen):
    beams = Beams.of([seen], np.count_nonzero(seen.valid) // 64)
    ways = beams.point - beams.origin
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    cosines = np.clip(ways @ ways.T - 2 * np.eye(len(ways)), -1, 1)
    nearest = np.arccos(cosines.max(axis=1))
    assert np.median(nearest / beams.apart) == pytest.approx(1.0, abs=0.3)


def test_all_beams_are_taken_where_there_are_few(seen):
    assert len(Beams.of([seen], 10**9).point) == np.count_nonzero(seen.valid)
