# SPDX-License-Identifier: MIT
"""Views planned together: beside all pairs, and where the greedy first view is not among the best."""

from itertools import combinations

import numpy as np
import pytest

from nbv.online.look_ahead import plan_ahead


class EachPosition:
    """One pose at each position, which sees all that the position sees."""

    def __init__(self, sizes: list[int]) -> None:
        self.sizes = sizes

    def best(self, worth):
        gains = [float(values.sum()) for values in worth]
        return int(np.argmax(gains)) if max(gains) > 0 else None

    def inside(self, number: int):
        return number, np.ones(self.sizes[number], bool)


def first_of(sets: list[list[int]], n_views: int, worth: dict[int, float] | None = None) -> int | None:
    return plan_ahead(
        EachPosition([len(targets) for targets in sets]),
        worth=[np.array([1.0 if worth is None else worth[t] for t in targets]) for targets in sets],
        share=[np.ones(len(targets)) for targets in sets],
        target=[np.array(targets, np.int64) for targets in sets],
        n_views=n_views,
    )


def test_two_halves_beat_the_largest_set():
    sets = [[1, 2, 3, 5, 6], [0, 1, 2, 3], [4, 5, 6, 7]]
    assert first_of(sets, 1) == 0
    assert first_of(sets, 2) in (1, 2)


@pytest.mark.parametrize("seed", range(20))
def test_the_first_of_two_views_is_nearly_always_of_a_pair_that_sees_most(seed):
    rng = np.random.default_rng(seed)
    sets = [sorted(rng.choice(30, rng.integers(3, 12), replace=False).tolist()) for _ in range(12)]
    most = max(len(set(a) | set(b)) for a, b in combinations(sets, 2))
    first = first_of(sets, 2)
    assert first is not None
    reached = max(len(set(sets[first]) | set(other)) for other in sets)
    assert reached >= most - 1  # exchanges of one view may end a target short


def test_what_one_look_settles_in_part_is_worth_a_second_look():
    args = {"target": [np.array([0]), np.array([0]), np.array([1])], "n_views": 2}
    worth = [np.array([0.9]), np.array([0.8]), np.array([0.3])]
    settled = plan_ahead(EachPosition([1, 1, 1]), worth=worth, share=[np.ones(1)] * 3, **args)
    assert settled == 0
    nothing = plan_ahead(EachPosition([1, 1, 1]), worth=[np.zeros(1)] * 3, share=[np.ones(1)] * 3, **args)
    assert nothing is None
