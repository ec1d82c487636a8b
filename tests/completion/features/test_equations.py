# SPDX-License-Identifier: MIT
"""Equations: what is held stays exactly, what is equal moves together, gates count in tolerances."""

import numpy as np
import pytest

from completion.features.engine.search import Gate, equations
from scenes.checks import InputError

NAMES, BOUNDS = ("a", "b", "c"), (np.array([0.0, 1.0, -2.0]), np.array([4.0, 3.0, 2.0]))


def test_what_is_free_runs_between_its_bounds():
    free = equations(NAMES, BOUNDS, {})
    np.testing.assert_array_equal(free.full(np.zeros(3)), BOUNDS[0])
    np.testing.assert_array_equal(free.full(np.ones(3)), BOUNDS[1])
    np.testing.assert_allclose(free.sought(np.array([1.0, 1.5, 0.0])), [0.25, 0.25, 0.5])


def test_what_is_given_is_held_though_it_lies_outside_the_bounds():
    sought = equations(NAMES, BOUNDS, {"b": 7.125})
    assert sought.n_sought == 2
    assert sought.held == ("b",)
    for z in np.random.default_rng(0).uniform(size=(20, 2)):
        assert sought.full(z)[1] == 7.125


def test_what_is_equal_is_so_exactly_within_common_bounds():
    both = equations(NAMES, BOUNDS, {}, equal=[("a", "b")])
    values = both.full(np.random.default_rng(0).uniform(size=(50, 2)))
    np.testing.assert_array_equal(values[:, 0], values[:, 1])
    assert values[:, 0].min() >= 1
    assert values[:, 0].max() <= 3


def test_one_given_holds_what_equals_it():
    held = equations(NAMES, BOUNDS, {"a": 2.5}, equal=[("a", "b")])
    assert held.n_sought == 1
    np.testing.assert_array_equal(held.full(np.array([0.5])), [2.5, 2.5, 0.0])


def test_a_gate_counts_tolerances_beyond_it():
    gate = Gate(lambda x: x[0] - 1.0, 0.5)
    assert gate.breach(np.array([1.4])) == 0
    assert gate.breach(np.array([3.0])) == pytest.approx(3.0)


@pytest.mark.parametrize(
    ("given", "equal", "what"),
    [
        ({"d": 1.0}, [], "no parameter d"),
        ({}, [("a", "d")], "no parameter d"),
        ({"a": np.nan}, [], "finite number"),
        ({"a": 1.0, "b": 2.0}, [("a", "b")], "are equal, but given"),
    ],
)
def test_what_contradicts_itself_is_refused(given, equal, what):
    with pytest.raises(InputError, match=what):
        equations(NAMES, BOUNDS, given, equal)


def test_bounds_that_leave_nothing_are_refused():
    with pytest.raises(InputError, match="leave no value"):
        equations(("a", "b"), (np.array([0.0, 2.0]), np.array([1.0, 3.0])), {}, [("a", "b")])
    with pytest.raises(InputError, match="finite"):
        equations(("a",), (np.zeros(1), np.full(1, np.inf)), {})
