# SPDX-License-Identifier: MIT
"""Certificates: never above a known optimum, whoever made the multipliers; the linear programme as oracle."""

from fractions import Fraction

import numpy as np
import pytest
from scipy.sparse import csr_array

from nbv.cover import dual
from nbv.cover.dual import find_certificate, reduce_instance
from nbv.cover.instance import Certificate, CoverInstance
from nbv.cover.swap_search import choose_greedily
from scenes.checks import InputError
from tests.helpers.cover_examples import optimum, random_instance
from tests.helpers.long_cases import first_in_gate

ONE = 1 << 40


def certified(instance: CoverInstance) -> Certificate:
    return find_certificate(reduce_instance(instance), instance.weights, instance.n_candidates)


@pytest.mark.parametrize("start", first_in_gate(2, range(0, 200, 20)))
def test_bounds_never_exceed_the_optimum_on_200_random_instances(start):
    for seed in range(start, start + 20):
        rng = np.random.default_rng(seed)
        target, fold = float(rng.choice([1.0, 1.0, 0.9, 0.7])), int(rng.choice([1, 1, 2]))
        instance = random_instance(seed, (8, 18), 0.35, target=target, fold=fold)
        best = optimum(instance)
        certificate = certified(instance)
        assert 1 <= certificate.bound(instance) <= best
        large = find_certificate(reduce_instance(instance), instance.weights, best, most_entries=0)
        assert 1 <= large.bound(instance) <= best
        wild = Certificate.round_down(rng.uniform(0, 0.6, 18), float(rng.uniform(0, 3)))
        assert wild.bound(instance) <= best


def test_multipliers_are_feasible_on_the_whole_matrix():
    instance = random_instance(1, (200, 120), 0.06)
    multipliers = certified(instance).multipliers
    sums = (instance.matrix != 0).astype(np.int64) @ multipliers
    assert (multipliers >= 0).all()
    assert sums.max() <= ONE
    assert certified(instance).value(instance) == Fraction(int(multipliers.sum()), ONE)


@pytest.mark.parametrize(("target", "fold"), [(1.0, 1), (0.9, 1), (1.0, 2), (0.9, 2)])
def test_ascent_comes_near_the_linear_programme(target, fold):
    instance = random_instance(4, (300, 250), 0.06, target=target, fold=fold)
    reduction = reduce_instance(instance)
    n_chosen = len(choose_greedily(reduction.instance))
    exact, ascended = (
        float(find_certificate(reduction, instance.weights, n_chosen, most_entries=n).value(instance))
        for n in (10**6, 0)
    )
    assert 0.93 * exact <= ascended <= exact + 1e-6


@pytest.mark.parametrize(("target", "fold"), [(1.0, 1), (0.9, 1), (0.9, 2)])
def test_large_programmes_have_the_same_bound_by_interior_points(target, fold, monkeypatch):
    instance = random_instance(4, (300, 250), 0.06, target=target, fold=fold)
    by_simplex = certified(instance).value(instance)
    monkeypatch.setattr(dual, "_SIMPLEX_ENTRIES", 0)
    assert float(certified(instance).value(instance)) == pytest.approx(float(by_simplex), abs=1e-6)


def test_merged_samples_lose_nothing_of_the_bound():
    instance = random_instance(6, (60, 40), 0.1, target=0.9)
    twice = CoverInstance(
        csr_array(np.hstack([instance.matrix.toarray()] * 2)), np.tile(instance.weights, 2), 0.9
    )
    alone, doubled = (float(certified(some).value(some)) for some in (instance, twice))
    assert doubled == pytest.approx(alone, abs=1e-6)


def test_the_odd_cycle_has_its_known_relaxation():
    """Five candidates around a ring of five samples, each sees two: the relaxation is 5/2, the optimum 3."""
    ring = np.eye(5) + np.roll(np.eye(5), 1, axis=1)
    instance = CoverInstance(csr_array(ring), np.ones(5))
    certificate = certified(instance)
    assert float(certificate.value(instance)) == pytest.approx(2.5, abs=1e-9)
    assert certificate.bound(instance) == optimum(instance) == 3


def test_partial_and_repeated_cover_of_single_samples_have_closed_forms():
    alone = csr_array(np.eye(5))
    assert certified(CoverInstance(alone, np.ones(5), 0.8)).bound(CoverInstance(alone, np.ones(5), 0.8)) == 4
    thrice = CoverInstance(csr_array(np.ones((4, 3))), np.ones(3), fold=3)
    assert certified(thrice).bound(thrice) == 3


def test_certificates_of_something_else_are_refused():
    instance = random_instance(0)
    with pytest.raises(InputError, match="4 multipliers for 60 samples"):
        Certificate(np.zeros(4, np.int64)).value(instance)
    with pytest.raises(InputError, match=r"must lie in 0\.\.1"):
        Certificate(np.array([-1]))
    with pytest.raises(InputError, match=r"must lie in 0\.\.1"):
        Certificate(np.array([2 * ONE]))
    with pytest.raises(InputError, match="price must not be negative"):
        Certificate(np.zeros(1, np.int64), -1.0)
