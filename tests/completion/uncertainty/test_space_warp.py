# SPDX-License-Identifier: MIT
"""Space warp: found where there is one, none where there is none, and relations are not rejected for it."""

import numpy as np
import pytest

from benchmarks.cases.planes import figure_one
from benchmarks.suites.relations import warped
from completion.parts.pipeline import doubt_of_warp, model_part
from completion.relations.pipeline import infer
from completion.relations.relation import RelationStatus
from completion.uncertainty.space_warp import N_MODES, find_warp

NOISE = 0.1
BOX = np.array([(-50.0, -40.0, 0.0), (75.0, 40.0, 60.0)])


def part(seed, size):
    points = []
    return figure_one(seed, NOISE, warp=lambda places: warped(places, seed, size, BOX), kept=points), points


def test_a_part_without_a_warp_has_none() -> None:
    assert all(find_warp(*part(seed, 0.0)) is None for seed in range(3))
    assert find_warp([], []) is None


def test_a_warp_is_found_and_no_true_relation_is_rejected_for_it() -> None:
    for seed in range(3):
        fits, points = part(seed, 0.2)
        warp = find_warp(fits, points)
        assert 0.05 < warp.rms_m < 0.5
        assert 6 < warp.freedom <= N_MODES
        before = infer(fits)
        after = infer(fits, doubt=doubt_of_warp(warp, len(fits)))
        assert before.count_with(RelationStatus.REJECTED) > 5
        assert after.count_with(RelationStatus.REJECTED) == 0
        assert after.count_with(RelationStatus.ACCEPTED) > before.count_with(RelationStatus.ACCEPTED)


def test_it_is_the_same_where_the_part_stands() -> None:
    fits, points = part(1, 0.2)
    some = fits[:5], points[:5]
    one = find_warp(*some)
    again = find_warp(some[0], [own[::-1] for own in some[1]])
    np.testing.assert_allclose(again.shared, one.shared, rtol=1e-6, atol=1e-12)


@pytest.mark.long
def test_a_warped_part_says_so() -> None:
    points = part(2, 0.05)[1]
    labels = np.repeat(np.arange(1, 6), [len(own) for own in points[:5]])
    found = model_part(1e-3 * np.concatenate(points[:5]), labels)
    assert any(text.startswith("the whole is warped by 0.0") for text in found.warnings)
    own = part(2, 0.0)[1]
    even = model_part(1e-3 * np.concatenate(own[:5]), labels)
    assert not any("warped" in text for text in even.warnings)
