# SPDX-License-Identifier: MIT
"""Tours: exhaustive search as oracle, legs that meet no surface, stations that cannot be reached."""

from itertools import pairwise, permutations

import numpy as np
import pytest

from nbv.online.limits import BODY_M
from nbv.plan.tour import plan_tour, short_order
from scenes.checks import InputError
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.world.builtin import builtin_scene

ROOM = builtin_scene("two_occluders")


def length(costs: np.ndarray, order) -> float:
    return float(sum(costs[a, b] for a, b in pairwise(order)))


def slab(low, high):
    """Corners (8, 3) and triangles (12, 3) of a box."""
    corners = np.array(
        [[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])]
    )
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return corners, [triangle for a, b, c, d in quads for triangle in ((a, b, c), (a, c, d))]


@pytest.mark.parametrize("seed", range(12))
def test_short_orders_are_near_the_shortest(seed):
    places = np.random.default_rng(seed).uniform(size=(7, 2))
    costs = np.linalg.norm(places[:, None] - places, axis=-1)
    best = min(length(costs, order) for order in permutations(range(7)))
    order = short_order(costs)
    assert sorted(order) == list(range(7))
    assert best - 1e-12 <= length(costs, order) <= 1.03 * best


def test_places_on_a_line_are_visited_in_their_order():
    places = np.random.default_rng(0).permutation(60).astype(float)
    order = short_order(np.abs(places[:, None] - places))
    assert abs(np.diff(places[order])).sum() == 59


@pytest.mark.long
def test_legs_keep_clear_of_every_surface():
    rng = np.random.default_rng(2)
    stations = rng.uniform([0.4, 0.4, 0.4], [5.6, 4.6, 2.2], (40, 3))
    blocks = np.array([[1.5, 1.5, 0, 2.9, 2.5, 0.9], [4.0, 2.8, 0, 4.7, 3.5, 1.8]])
    inside = [((stations > b[:3] - 0.3) & (stations < b[3:] + 0.3)).all(axis=1) for b in blocks]
    stations = stations[~inside[0] & ~inside[1]]
    tour = plan_tour(ROOM.mesh, stations)
    assert sorted(tour.order) == list(range(len(stations)))
    assert all(np.isfinite(leg.length_m) for leg in tour.legs)
    assert tour.length_m == pytest.approx(sum(leg.length_m for leg in tour.legs))
    for leg, (a, b) in zip(tour.legs, pairwise(tour.order), strict=True):
        assert leg.path[0] == pytest.approx(stations[a])
        assert leg.path[-1] == pytest.approx(stations[b])
        steps = np.diff(leg.path, axis=0)
        assert leg.length_m == pytest.approx(np.linalg.norm(steps, axis=1).sum())
        along = (leg.path[:-1, None] + np.linspace(0, 1, 20)[:, None] * steps[:, None]).reshape(-1, 3)
        low, high = ROOM.mesh.bounds()
        assert (along > low + BODY_M).all()
        assert (along < high - BODY_M).all()
        for block in blocks:
            outside = np.maximum(np.maximum(block[:3] - along, along - block[3:]), 0)
            assert np.linalg.norm(outside, axis=1).min() > BODY_M


@pytest.mark.long
def test_stations_behind_a_wall_are_said_to_have_no_way():
    wall = np.array([[1.0, -9, -9], [1, 9, -9], [1, 9, 9], [1, -9, 9]])
    mesh = LabelledMesh(wall, np.array([[0, 1, 2], [0, 2, 3]]))
    stations = np.array([[0.0, 0, 0], [2.0, 0, 0], [0.0, 1, 0], [2.0, 1, 0]])
    tour = plan_tour(mesh, stations)
    lost = [leg for leg in tour.legs if not len(leg.path)]
    assert len(lost) == 1
    assert {frozenset(tour.order[:2]), frozenset(tour.order[2:])} == {frozenset((0, 2)), frozenset((1, 3))}
    assert tour.length_m == pytest.approx(2.0, rel=0.1)
    assert [leg["length_m"] for leg in tour.to_json()["legs"]].count(None) == 1
    assert sorted(tour.to_json()["order"]) == [1, 2, 3, 4]


def test_one_station_is_a_tour_without_legs_and_a_body_has_a_size():
    assert plan_tour(ROOM.mesh, np.array([[3.0, 1, 1]])).legs == ()
    with pytest.raises(InputError, match="body_m must be positive"):
        plan_tour(ROOM.mesh, np.zeros((2, 3)), body_m=0.0)


@pytest.mark.long
def test_on_foot_nobody_climbs_over_a_wall_or_through_a_window():
    parts = [
        slab((0, 0, -0.1), (6, 4, 0.0)),  # the floor
        slab((0, 0, -1.0), (9, 4, -0.9)),  # the ground outside, lower
        slab((2.9, 0, 0), (3.1, 3, 0.9)),  # a wall with a sill, and a gap beside it
    ]
    vertices = np.vstack([corners for corners, _ in parts])
    faces = np.vstack([np.array(triangles) + 8 * k for k, (_, triangles) in enumerate(parts)])
    mesh = LabelledMesh(vertices, faces)
    stations = np.array([[1.0, 1.0, 1.5], [5.0, 1.0, 1.5]])
    flown, walked = (plan_tour(mesh, stations, on_foot=on_foot) for on_foot in (False, True))
    assert flown.length_m < 4.5
    assert 2 * np.hypot(2, 2) < walked.length_m < 7.5
    (way,) = (leg.path for leg in walked.legs)
    crossing = way[np.argmin(np.abs(way[:, 0] - 3))]
    assert crossing[1] > 3
    assert np.abs(way[1:-1, 2]).max() < 1e-6
    np.testing.assert_allclose(way[[0, -1]], stations[list(walked.order)])


def house(n_treads: int) -> LabelledMesh:
    """Two storeys, 3 m apart; so many treads lead up along y = 0.5, through a hole in the floor."""
    parts = [
        slab((0, 0, -0.2), (8, 5, 0.0)),
        slab((0, 1.2, 2.8), (8, 5, 3.0)),
        slab((5.5, 0, 2.8), (8, 1.2, 3.0)),
        *(slab((1.5 + 0.25 * k, 0, 0), (1.75 + 0.25 * k, 1.0, 3.0 * (k + 1) / 16)) for k in range(n_treads)),
    ]
    vertices = np.vstack([corners for corners, _ in parts])
    return LabelledMesh(vertices, np.vstack([np.array(faces) + 8 * k for k, (_, faces) in enumerate(parts)]))


UP_AND_DOWN = np.array([[0.7, 4.0, 1.5], [7.0, 4.0, 4.5], [0.7, 4.5, 4.5], [7.0, 4.5, 1.5]])


def test_storeys_are_joined_by_stairs():
    tour = plan_tour(house(16), UP_AND_DOWN, on_foot=True)
    assert tour.n_without_way == 0
    (climb,) = (leg for leg in tour.legs if abs(leg.path[0, 2] - leg.path[-1, 2]) > 2)
    inner = climb.path[1:-1]
    assert np.abs(np.diff(inner[:, 2])).max() <= 0.25
    stairs = inner[(inner[:, 2] > 0.1) & (inner[:, 2] < 2.9)]
    assert len(stairs) > 10
    assert stairs[:, 1].max() < 1.0
    assert tour.describe() == f"{tour.length_m:.1f} m"


def test_storeys_without_stairs_have_no_way_and_the_length_says_so():
    tour = plan_tour(house(8), UP_AND_DOWN, on_foot=True)
    assert tour.n_without_way == 1
    assert tour.to_json()["legs_without_way"] == 1
    walked = [leg.length_m for leg in tour.legs if len(leg.path)]
    assert sum(walked) == pytest.approx(tour.length_m)
    assert "without 1 of 3 legs that has no way" in tour.describe()


def test_stations_are_visited_in_the_order_in_which_they_come_where_that_is_asked():
    tour = plan_tour(house(16), UP_AND_DOWN, on_foot=True, in_order=True)
    assert tour.order == (0, 1, 2, 3)
    climbs = [abs(leg.path[0, 2] - leg.path[-1, 2]) > 2 for leg in tour.legs]
    assert climbs == [True, False, True]
    assert tour.length_m > plan_tour(house(16), UP_AND_DOWN, on_foot=True).length_m + 2 * 3.0


def test_stations_at_one_place_are_no_way_apart():
    stations = np.array([[3.0, 1, 1], [1.0, 1, 1], [3.0, 1, 1]])
    for on_foot in (False, True):
        tour = plan_tour(ROOM.mesh, stations, on_foot=on_foot)
        assert sorted(leg.length_m > 1e-6 for leg in tour.legs) == [False, True]
        assert all(len(leg.path) >= 2 for leg in tour.legs)


def test_an_order_is_found_where_many_places_have_no_way_to_each_other():
    rng = np.random.default_rng(0)
    places, part = rng.uniform(0, 20, (120, 2)), np.repeat(np.arange(6), 20)
    lengths = np.linalg.norm(places[:, None] - places, axis=2)
    lengths[part[:, None] != part] = np.inf
    order = short_order(lengths)
    assert sorted(order) == list(range(120))
    assert (np.diff(part[order]) != 0).sum() == 5  # each part is visited at one go
