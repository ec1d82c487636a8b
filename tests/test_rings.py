# SPDX-License-Identifier: MIT
"""A cylinder's cross-sections: seen through, it is not there, nor does it go on beyond."""

import numpy as np

from completion.boundary.rings import rings_passed
from completion.evidence import Evidence, Label


def evidence(labels, own) -> Evidence:
    none = np.zeros(labels.shape, dtype=np.bool_)
    number = np.full(labels.shape, -1)
    return Evidence(labels, own, own, number, number.astype(np.int32), number.astype(np.int32), none)


def column(*rows: tuple[int, int]) -> Evidence:
    """Rows of 12 cells behind an occluder, the first of which are measured and the next seen through."""
    labels = np.full((len(rows), 12), Label.OCCLUDED, np.int8)
    own = np.zeros(labels.shape, dtype=np.bool_)
    for row, (n_measured, n_passed) in enumerate(rows):
        labels[row, :n_measured], own[row, :n_measured] = Label.VISIBLE, True
        labels[row, n_measured : n_measured + n_passed] = Label.FREE
    return evidence(labels, own)


def test_a_hidden_stretch_beside_a_measured_one_goes_on():
    assert not rings_passed(column((0, 0), (4, 0), (0, 0))).any()


def test_a_ring_of_which_more_is_passed_than_measured_ends_the_cylinder():
    passed = rings_passed(column((0, 0), (5, 0), (4, 1), (1, 4), (0, 0), (0, 0)))
    np.testing.assert_array_equal(passed, [False, False, False, True, True, True])


def test_stray_beams_through_a_measured_ring_do_not():
    assert not rings_passed(column((6, 2), (0, 0), (3, 3))).any()


def test_a_cylinder_measured_again_beyond_a_gap_is_there_again():
    passed = rings_passed(column((5, 0), (0, 5), (0, 0), (5, 0)))
    np.testing.assert_array_equal(passed, [False, True, False, False])


def test_the_other_way_up_is_the_same():
    rows = [(0, 0), (5, 0), (4, 1), (1, 4), (0, 0)]
    np.testing.assert_array_equal(rings_passed(column(*rows))[::-1], rings_passed(column(*rows[::-1])))
