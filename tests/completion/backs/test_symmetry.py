# SPDX-License-Identifier: MIT
"""Isometries of symmetries, their change, and what views say of moved points."""

import numpy as np
import pytest

from benchmarks.cases.houses.solids import box
from completion.backs.intervals import shadow_volume
from completion.backs.probability import choose, elements_of
from completion.backs.seeing import is_possible, see
from completion.backs.symmetry import (
    Symmetry,
    mirror_change,
    mirrors,
    move,
    one_a_cell,
    product,
    turns,
)
from completion.backs.views import Setting, ThingView, prepare_sight, scale_of, sigma_of
from tests.completion.backs.things import setting_of, view_of

MIDDLE = np.array([0.3, -0.2, 0.5])
POINTS = np.random.default_rng(1).normal(size=(50, 3))


def symmetry(kind, place, probability, *, matched=0.5, n_fold=0):
    return Symmetry(
        kind, np.array(place), MIDDLE, np.eye(2) * 1e-6, {"matched": matched}, n_fold, probability
    )


def test_a_mirror_undoes_itself_and_leaves_its_plane() -> None:
    place = np.array([0.7, 0.11])
    isometry = mirrors(place[None], MIDDLE)[0]
    assert move(isometry, move(isometry, POINTS)) == pytest.approx(POINTS)
    assert np.linalg.det(isometry[:, :3]) == pytest.approx(-1)
    one = symmetry("mirror", place, 0.9)
    on = POINTS - (POINTS @ one.normal - one.offset_m)[:, None] * one.normal
    assert move(isometry, on) == pytest.approx(on)


def test_turns_by_an_nth_close_after_n() -> None:
    quarter = turns(np.array([0.1, 0.2]), MIDDLE, np.array([np.pi / 2]))[0]
    moved = POINTS
    for _ in range(4):
        moved = move(quarter, moved)
    assert moved == pytest.approx(POINTS)
    axis = symmetry("axis", [0.1, 0.2], 0.9).axis
    assert move(quarter, axis[None])[0] == pytest.approx(axis)


def test_two_mirrors_at_right_angles_make_half_a_turn() -> None:
    one, other = mirrors(np.array([[0.3, 0.05], [0.3 + np.pi / 2, -0.1]]), MIDDLE)
    both = product(one, other)
    assert move(both, POINTS) == pytest.approx(move(one, move(other, POINTS)))
    assert both[:2, :2] == pytest.approx(-np.eye(2))


def test_the_change_of_a_mirror_is_its_derivative() -> None:
    place, step = np.array([0.4, 0.07]), 1e-6
    change = mirror_change(place, POINTS - MIDDLE)
    for k in range(2):
        ends = [move(mirrors((place + s * step * np.eye(2)[k])[None], MIDDLE)[0], POINTS) for s in (1, -1)]
        assert change[:, :, k] == pytest.approx((ends[0] - ends[1]) / (2 * step), abs=1e-6)


def test_the_spread_of_moved_points_follows_the_covariance() -> None:
    rng = np.random.default_rng(2)
    covariance = np.array([[4e-6, 1e-6], [1e-6, 9e-6]])
    one = Symmetry("mirror", np.array([0.4, 0.07]), MIDDLE, covariance, {})
    normals = POINTS / np.linalg.norm(POINTS, axis=1, keepdims=True)
    isometry = one.isometries(2)[0]
    drawn = rng.multivariate_normal(one.place, covariance, 4000)
    moved = np.stack([move(g, POINTS) for g in mirrors(drawn, MIDDLE)])
    along = np.einsum("kni,ni->kn", moved - move(isometry, POINTS), normals @ isometry[:, :3].T)
    assert one.spread(POINTS, normals, isometry) == pytest.approx(along.std(axis=0), rel=0.08, abs=1e-4)


def test_an_axis_goes_before_mirrors_and_two_mirrors_are_square() -> None:
    axis = symmetry("axis", [0, 0], 0.85)
    first, second = symmetry("mirror", [0.1, 0], 0.95), symmetry("mirror", [0.1 + np.pi / 2, 0], 0.9)
    slanted = symmetry("mirror", [0.9, 0], 0.93)
    assert choose([first, axis, second], 0.8) == [axis]
    assert choose([first, axis, second], 0.9) == [first, second]
    assert choose([first, slanted, second], 0.8) == [first, second]
    assert choose([first, slanted], 0.99) == []
    assert len(elements_of([first, second], 2)) == 3
    assert elements_of([first, second], 2)[2].probability == pytest.approx(0.95 * 0.9)
    assert len(elements_of([axis], 12)) == 11
    assert len(elements_of([symmetry("turn", [0, 0], 0.9, n_fold=5)], 12)) == 4


def test_views_tell_free_matched_and_hidden_places() -> None:
    view = view_of(box((-0.3, -0.2, 0), (0.3, 0.2, 0.5)))
    setting = setting_of(view)
    scale = scale_of([view], setting)
    sight = prepare_sight(view, scale)
    up = np.array([[0.0, 0, 1]])
    stay = np.eye(3, 4)[None]
    for place, expected in (((0.1, 0, 0.5), 1), ((0.1, 0, 0.65), 0), ((0.0, 0, 0.2), 2)):
        seen = see([sight], stay, np.array([place]), up, scale.tolerance)
        assert [seen.free[0, 0], seen.matched[0, 0], seen.hidden[0, 0]][expected] == 1
    upside = see([sight], stay, np.array([[0.1, 0, 0.5]]), -up, scale.tolerance)
    assert upside.matched[0, 0] == 0
    places = np.array([[0.0, 0, 0.2], [0.0, 0, 0.65], [0.0, 0, -0.2]])
    assert is_possible([sight], places, setting, 0.01).tolist() == [True, False, False]
    behind_wall = Setting(0.0, 0.001, np.array([[1.0, 0, 0, 0.1]]))
    assert not is_possible([sight], places[:1], behind_wall, 0.01)[0]


def test_the_shadow_of_a_plate_is_a_frustum() -> None:
    view = view_of(box((-0.002, -0.2, 0), (0.002, 0.2, 0.4)), 0.0, 0.0)
    wall = np.array([[1.0, 0, 0, -0.5]])
    away = float(view.scan.origin[0])
    expected = 0.4 * 0.4 * ((away + 0.5) ** 3 / away**2 - away) / 3
    low = view.scan.origin[2]
    below = low - low * (away + 0.5) / away  # the floor takes nothing away from a level view's upper half
    assert below < 0
    found = shadow_volume(view, Setting(-5.0, 0.001, wall))
    assert found == pytest.approx(expected, rel=0.03)


def test_one_point_a_cell_is_the_first() -> None:
    points = np.array([[0.1, 0, 0], [0.2, 0, 0], [1.1, 0, 0], [0.3, 0, -0.5]])
    assert one_a_cell(points, 1.0).tolist() == [0, 2, 3]


def test_noise_is_as_stated_or_read_off_the_scan() -> None:
    view = view_of(box((-0.3, -0.2, 0), (0.3, 0.2, 0.5)))
    assert sigma_of([view]) == view.scan.sigma_m
    unknown = ThingView(view.scan.with_facts(sigma_m=None), view.of_thing)
    assert view.scan.sigma_m / 2 < sigma_of([unknown]) < 2 * view.scan.sigma_m
