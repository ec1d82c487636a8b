# SPDX-License-Identifier: MIT
"""Evolution: monotone, the same for the same seed, stopped at any time, right where the answer is known."""

from itertools import islice

import numpy as np
import pytest

from completion.features.engine.search import polish, search
from scenes.checks import InputError

LOW, HIGH = np.full(3, -2.0), np.full(3, 3.0)


def valley(x):
    """Rosenbrock's, least at ones."""
    return np.sum(100 * np.square(x[:, 1:] - np.square(x[:, :-1])) + np.square(1 - x[:, :-1]), axis=1)


def steps(x):
    """Flat but for steps: no gradient leads to 0.3, -0.7, 1.1."""
    return np.floor(20 * np.abs(x - [0.3, -0.7, 1.1])).sum(axis=1)


def run(objective, budget=6000, **options):
    return list(search(objective, LOW, HIGH, rng=np.random.default_rng(3), budget=budget, **options))


def test_the_best_is_found_and_never_gets_worse():
    for objective, value in ((valley, 1e-3), (steps, 0.5)):
        stages = run(objective)
        values = [stage.value for stage in stages]
        assert values == sorted(values, reverse=True)
        assert values[-1] < value
        assert [stage.evaluations for stage in stages] == sorted({stage.evaluations for stage in stages})
        assert stages[-1].evaluations == 6000


def test_the_same_seed_gives_the_same_places_and_it_may_be_stopped():
    first = list(islice(search(valley, LOW, HIGH, rng=np.random.default_rng(3), budget=6000), 5))
    again = run(valley)[:5]
    for before, after in zip(first, again, strict=True):
        np.testing.assert_array_equal(before.place, after.place)


def test_a_start_is_kept_unless_something_is_better():
    stages = run(valley, budget=24, starts=np.ones((1, 3)))
    np.testing.assert_array_equal(stages[-1].place, np.ones(3))


def test_what_obeys_the_constraint_beats_what_does_not():
    """The least value within a ball about the origin lies on its surface."""
    stages = run(valley, budget=12000, violation=lambda x: np.linalg.norm(x, axis=1) - 1.0)
    assert stages[-1].violation == 0
    assert np.linalg.norm(stages[-1].place) == pytest.approx(1.0, abs=0.01)
    breaches = [stage.violation for stage in stages]
    assert breaches == sorted(breaches, reverse=True)


def test_values_that_are_no_numbers_lose():
    stages = run(lambda x: np.where(x[:, 0] > 0, np.nan, np.square(x).sum(axis=1)))
    assert stages[-1].place[0] <= 0
    assert stages[-1].value < 0.01


@pytest.mark.parametrize("upper", [np.full(3, np.inf), np.full(3, -3.0)])
def test_a_box_without_sides_is_refused(upper):
    with pytest.raises(InputError, match="finite sides"):
        list(search(valley, LOW, upper, rng=np.random.default_rng(0), budget=10))


def test_least_squares_polishes_what_was_found_and_never_makes_it_worse():
    stage = run(valley, budget=500)[-1]

    def residuals(x):
        return np.concatenate([10 * (x[1:] - x[:-1] ** 2), 1 - x[:-1]])

    done = polish(residuals, stage, LOW, HIGH)
    assert done.place == pytest.approx(np.ones(3), abs=1e-6)
    assert done.value < stage.value
    assert stage.evaluations < done.evaluations <= stage.evaluations + 1000
    same = polish(lambda x: np.floor(20 * np.abs(x - 0.3)), stage, LOW, HIGH)
    np.testing.assert_array_equal(same.place, stage.place)


def test_gates_do_not_hold_the_search_where_it_met_them_first():
    """A bowl whose least value within a thin ring lies on the far side of it."""

    def bowl(x):
        return np.sum(np.square(x - [1.5, 0.0, 0.0]), axis=1)

    def off_ring(x):
        return np.maximum(0.0, np.abs(np.linalg.norm(x[:, :2], axis=1) - 1.0) - 1e-3)

    for seed in range(3):
        rng = np.random.default_rng(seed)
        *_, last = search(bowl, LOW, HIGH, rng=rng, budget=4000, violation=off_ring)
        assert last.violation == 0
        assert last.place == pytest.approx([1.0, 0.0, 0.0], abs=0.02)
