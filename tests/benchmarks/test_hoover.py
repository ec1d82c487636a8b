# SPDX-License-Identifier: MIT
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.metrics.regions import score_regions
from scenes.checks import InputError


def strips(*widths: tuple[int, int]) -> np.ndarray:
    """An image of vertical strips, each (number, columns)."""
    return np.repeat([number for number, _ in widths], [columns for _, columns in widths])[None].repeat(4, 0)


TRUE = strips((0, 10), (1, 10), (2, 10))


def test_a_face_found_whole_is_correct():
    score = score_regions(TRUE, TRUE + 5)
    assert score.correct == ((0, 5), (1, 6), (2, 7))
    assert (score.over, score.under, score.missed, score.noise) == ((), (), (), ())


def test_eight_tenths_of_both_are_enough_and_less_is_not():
    assert score_regions(TRUE, strips((0, 12), (1, 8), (2, 10))).correct == ((0, 0), (1, 1), (2, 2))
    score = score_regions(TRUE, strips((0, 13), (1, 7), (2, 10)))
    assert score.correct == ((2, 2),)
    assert (score.missed, score.noise) == ((0, 1), (0, 1))
    assert len(score_regions(TRUE, strips((0, 13), (1, 7), (2, 10)), overlap=0.7).correct) == 3


def test_a_face_in_pieces_is_over_segmented():
    score = score_regions(TRUE, strips((0, 5), (7, 5), (1, 10), (2, 10)))
    assert score.over == ((0, (0, 7)),)
    assert (score.missed, score.noise) == ((), ())


def test_faces_in_one_region_are_under_segmented():
    score = score_regions(TRUE, strips((4, 20), (2, 10)))
    assert score.under == (((0, 1), 4),)
    assert (score.missed, score.noise) == ((), ())


def test_a_region_on_no_face_is_noise_and_a_face_without_region_missed():
    score = score_regions(TRUE, strips((-1, 14), (3, 3), (-1, 3), (2, 10)))
    assert score.correct == ((2, 2),)
    assert (score.missed, score.noise) == ((0, 1), (3,))


def test_small_faces_and_pixels_without_truth_do_not_count():
    truth = strips((0, 10), (1, 2), (-1, 8))
    score = score_regions(truth, strips((0, 10), (1, 2), (9, 8)), min_pixels=20)
    assert score.correct == ((0, 0),)
    assert (score.missed, score.noise) == ((), ())


@given(st.permutations(range(6)), st.integers(0, 1000))
def test_scores_do_not_depend_on_the_numbers(order, seed):
    truth = strips((0, 13), (1, 7), (2, 20))[:1]
    found = np.sort(np.random.default_rng(seed).integers(0, 6, truth.shape))
    one, other = score_regions(truth, found), score_regions(truth, np.array(order)[found])
    for name in ("correct", "over", "under", "missed", "noise"):
        assert len(getattr(one, name)) == len(getattr(other, name))


def test_unusable_arguments_say_why():
    with pytest.raises(InputError, match=r"true faces have shape \(4, 30\), found regions \(2, 2\)"):
        score_regions(TRUE, np.zeros((2, 2), int))
    with pytest.raises(InputError, match=r"overlap must be between 0\.5 and 1"):
        score_regions(TRUE, TRUE, overlap=0.3)
