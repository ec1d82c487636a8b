# SPDX-License-Identifier: MIT
"""The cases of back sides: volumes by winding, shares that isometries map, kinds that are held out."""

import numpy as np
import pytest

from benchmarks.cases.backs.case import TrueThing, corners_of, make_case, occupied
from benchmarks.cases.backs.held_out import HELD_OUT
from benchmarks.cases.backs.tuning import TUNING
from benchmarks.cases.houses.solids import box, tube
from benchmarks.methods.backs import superquadric
from benchmarks.suites.backs import fit_logistic, quantiles_across
from completion.backs.symmetry import mirrors


def test_no_kind_is_in_both_halves() -> None:
    assert not set(TUNING) & set(HELD_OUT)
    assert len(HELD_OUT) >= 60


@pytest.mark.parametrize("kind", sorted(TUNING | HELD_OUT))
def test_things_are_one_metre_in_size_and_stand_on_the_floor(kind) -> None:
    corners = corners_of(kind, 5)
    low, high = corners.reshape(-1, 3).min(axis=0), corners.reshape(-1, 3).max(axis=0)
    assert np.linalg.norm(high - low) == pytest.approx(1)
    assert low[2] == pytest.approx(0, abs=1e-12)
    assert corners_of(kind, 5).tobytes() == corners.tobytes()


def test_cells_of_overlapping_solids_are_counted_once() -> None:
    solids = np.concatenate([box((0, 0, 0), (0.4, 0.4, 0.4)), box((0.2, 0, 0), (0.6, 0.4, 0.4))])
    cell = 0.01
    inside = occupied(solids, np.full(3, -0.095), cell, (80, 60, 60))
    assert inside.sum() * cell**3 == pytest.approx(0.6 * 0.4 * 0.4, rel=1e-6)
    rod = tube((0, 0, 0), (0, 0, 0.5), 0.2, n=96)
    inside = occupied(rod, np.full(3, -0.305), cell, (62, 62, 90))
    assert inside.sum() * cell**3 == pytest.approx(np.pi * 0.04 * 0.5, rel=0.01)


def test_shares_that_mirrors_map() -> None:
    thing = TrueThing(box((-0.3, -0.2, 0), (0.3, 0.2, 0.5)))
    middle = np.zeros(3)
    assert thing.share_mapped(mirrors(np.array([[0.0, 0.0]]), middle), 0.01) == 1
    assert thing.share_mapped(mirrors(np.array([[np.pi / 4, 0.0]]), middle), 0.01) < 0.6
    assert thing.distance(np.array([[0.0, 0, 0.75], [0.3, 0, 0.2]])) == pytest.approx([0.25, 0], abs=1e-9)


def test_an_occluder_covers_its_share() -> None:
    case = make_case("cabinet", 4)
    assert case is not None
    free = make_case("cabinet", 4, occluded=False)
    assert free is not None
    left = case.views[0].of_thing.sum() / free.views[0].of_thing.sum()
    assert (left == 1) == (case.covered == 0)
    assert left > 0.3


def test_the_superquadric_of_a_whole_box_is_that_box() -> None:
    from scenes.mesh.labelled_mesh import spread_points

    points, _ = spread_points(box((-0.3, -0.2, 0), (0.3, 0.2, 0.5)), 3000)
    corners = superquadric(points[points[:, 2] > 0.01], 0.0).reshape(-1, 3)
    assert corners.min(axis=0) == pytest.approx([-0.3, -0.2, 0], abs=0.04)
    assert corners.max(axis=0) == pytest.approx([0.3, 0.2, 0.5], abs=0.04)


def test_logistic_weights_are_those_that_drew_the_data() -> None:
    rng = np.random.default_rng(3)
    terms = np.column_stack([np.ones(20_000), rng.normal(size=(20_000, 2))])
    true = rng.random(20_000) < 1 / (1 + np.exp(-terms @ [0.5, 2.0, -1.0]))
    assert fit_logistic(terms, true, 0.3) == pytest.approx([0.5, 2.0, -1.0], abs=0.1)


def test_things_without_a_mirror_are_told_by_their_surface() -> None:
    assert TrueThing(corners_of("cabinet", 1)).has_mirror()
    assert TrueThing(corners_of("barrel", 1)).has_mirror()
    assert not TrueThing(corners_of("rock", 1)).has_mirror()
    assert not TrueThing(corners_of("driftwood", 1)).has_mirror()


def test_quantiles_hold_kinds_they_were_not_taken_from() -> None:
    rng = np.random.default_rng(0)
    kinds = [f"kind {k}" for k in range(40) for _ in range(5)]
    alike = rng.normal(size=200)
    assert quantiles_across(alike, kinds) == pytest.approx(np.quantile(alike, [0.1, 0.9]), abs=0.25)
    apart = np.repeat(rng.normal(size=40), 5) + 0.01 * rng.normal(size=200)
    low, high = quantiles_across(apart, kinds)
    assert low <= np.quantile(apart, 0.1)
    assert high >= np.quantile(apart, 0.9)
