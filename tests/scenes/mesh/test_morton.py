# SPDX-License-Identifier: MIT
"""Morton order: a permutation, by interleaved bits, that brings neighbours together."""

import numpy as np
import pytest
from hypothesis import given, settings

from scenes.checks import InputError
from scenes.mesh.blocks import morton_order
from tests.helpers.strategies import law, seeds


@settings(law, max_examples=20)
@given(seeds)
def test_the_key_is_the_bits_of_the_coordinates_in_turn(seed):
    points = np.random.default_rng(seed).integers(0, 1024, (200, 3)).astype(float)
    points[:2] = [[0, 0, 0], [1024, 1024, 1024]]  # steps of one
    key = [
        sum(
            ((int(min(value, 1023)) >> bit) & 1) << (3 * bit + axis)
            for axis, value in enumerate(point)
            for bit in range(10)
        )
        for point in points
    ]
    assert morton_order(points).tolist() == np.argsort(key, kind="stable").tolist()


def test_sorting_brings_neighbours_together():
    points = np.random.default_rng(0).uniform(size=(4000, 3))
    jump = np.linalg.norm(np.diff(points[morton_order(points)], axis=0), axis=1).mean()
    assert jump < 0.25 * np.linalg.norm(np.diff(points, axis=0), axis=1).mean()


def test_few_points_have_an_order_too():
    assert morton_order(np.zeros((0, 3))).tolist() == []
    assert morton_order([[7, 7, 7]]).tolist() == [0]
    assert morton_order([[7, 7, 7]] * 3).tolist() == [0, 1, 2]


def test_unusable_points_are_refused():
    with pytest.raises(InputError, match=r"expected points with shape \(n, 3\), got \(2, 2\)"):
        morton_order(np.zeros((2, 2)))
    with pytest.raises(InputError, match="1 of 2 points are not finite"):
        morton_order([[0, 0, 0], [np.nan, 0, 0]])
