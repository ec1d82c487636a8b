# SPDX-License-Identifier: MIT
"""Where the surveyor begins, and one height over each spot: of plans, tours and orders of visits."""

import numpy as np
import pytest

from nbv.cover.pipeline import CoverOptions
from nbv.online.planner import PlannerOptions
from nbv.plan.planning import plan_views
from nbv.plan.tour import short_order
from nbv.scanning.sensor import PinholeSensor
from nbv.scanning.sensor_profile import load_sensor
from nbv.visibility.requirement import Requirement
from nbv.visibility.samples import sample_surface
from nbv.visibility.site import find_site
from nbv.visibility.site_options import SiteOptions
from nbv.visibility.zones import Box, Zones
from scenes.checks import InputError
from scenes.world.builtin import builtin_scene
from tests.helpers.buildings import house
from tests.helpers.long_cases import first_in_gate

ROOM = builtin_scene("two_occluders")
SAMPLES = sample_surface(ROOM.mesh, 0.4)
START = (2.13, 3.87)
CAMERA = PinholeSensor(fov_deg=75, width=48, height=48)
QUICK = {"samples": SAMPLES, "rng": 0, "n_threads": 1}


def plan(site, method="cover", sensor=None, **more):
    budgets = CoverOptions(polish_steps=200)
    options = PlannerOptions(voxel_m=0.3)
    given = {"budgets": budgets, "options": options, "target": 0.95, **QUICK, **more}
    return plan_views(ROOM, sensor or load_sensor("panorama"), method=method, site=site, **given)


def places(one):
    return np.array([view.world_from_sensor.translation for view in one.views])


def test_a_cover_and_its_tour_begin_at_the_start_and_the_bound_counts_it():
    free, begun = plan(SiteOptions()), plan(SiteOptions(start=START))
    assert places(begun)[0, :2] == pytest.approx(START)
    assert begun.stations.tour.order[0] == 0
    assert begun.coverage.met_of_reachable >= 0.95 - 1e-9
    assert free.lower_bound.views <= len(free.views)
    assert begun.lower_bound.views <= len(begun.views)
    assert begun.lower_bound.kind.endswith("with the first view as it is")
    assert begun.views[0].met_fraction == pytest.approx(begun.views[0].gain_m2 / SAMPLES.total_m2, rel=0.1)


def test_a_height_at_the_start_is_taken_as_it_is():
    begun = plan(SiteOptions(start=(*START, 1.73)), views=1)
    assert places(begun) == pytest.approx(np.array([[*START, 1.73]]))
    assert "limit of 1 view" in begun.stopped_because


@pytest.mark.parametrize("method", first_in_gate(1, ["nbv", "greedy", "random"]))
def test_other_planners_begin_there_too(method):
    begun = plan(SiteOptions(start=START), method, CAMERA, views=2)
    assert places(begun)[0, :2] == pytest.approx(START)
    assert len(begun.views) == 2


def test_a_start_in_a_wall_a_box_or_another_room_is_refused_with_the_nearest_place():
    with pytest.raises(
        InputError, match=r"--start 0.1,2 is no place .*; the nearest is --start [\d.]+,[\d.]+, 0\.\d+ m"
    ):
        plan(SiteOptions(start=(0.1, 2.0)))
    with pytest.raises(InputError, match=r"--start 40,40,1 is no place for a station"):
        plan(SiteOptions(start=(40.0, 40.0, 1.0)))
    scene = house(4).scene()
    site = find_site(scene)
    other = next(room for room in site.rooms.rooms if room.number == 2).place
    with pytest.raises(InputError, match="not on floor of a room that is asked for"):
        find_site(scene, SiteOptions(rooms=(1,), start=other[:2]))
    assert len(find_site(scene, SiteOptions(rooms=(2,), start=other[:2])).start)
    with pytest.raises(InputError, match="lies in a box of --keep-out"):
        plan(SiteOptions(start=START), zones=Zones(None, [Box((1.5, 3.5, 0), (2.5, 4.5, 2.5))]))
    for wrong in ((1.0,), (1.0, np.nan), (1.0, 2.0, np.inf), (1.0, 2.0, 3.0, 4.0)):
        with pytest.raises(InputError, match="start is X,Y or X,Y,Z, finite numbers of metres"):
            SiteOptions(start=wrong)


def test_what_a_start_does_not_go_with_is_refused():
    with pytest.raises(InputError, match="the station at the start has met towards k = 2"):
        plan(SiteOptions(start=START), requirement=Requirement(k=2))


def test_the_nearest_place_that_is_named_is_taken():
    with pytest.raises(InputError) as caught:
        find_site(ROOM, SiteOptions(start=(0.1, 2.0)))
    named = str(caught.value).partition("nearest is --start ")[2].split(", ")[0]
    start = tuple(float(value) for value in named.split(","))
    assert find_site(ROOM, SiteOptions(start=start)).start[0, :2] == pytest.approx(start)


def heights_over_spots(one):
    spots = {}
    for x, y, z in places(one).round(6).tolist():
        spots.setdefault((x, y), set()).add(z)
    return [len(heights) for heights in spots.values()]


@pytest.mark.parametrize("method", first_in_gate(1, ["nbv", "cover"]))
def test_one_height_over_each_spot_unless_several_are_asked_for(method):
    wide = {"heights_m": (0.4, 2.2), "spacing_m": 2.5}  # few spots: heights have to make up for it
    rule = {"target": 1.0, "views": 14} if method != "cover" else {"target": 1.0}
    one = plan(SiteOptions(**wide), method, CAMERA, **rule)
    assert max(heights_over_spots(one)) == 1
    if method != "nbv":
        several = plan(SiteOptions(**wide, several_heights=True), method, CAMERA, **rule)
        assert max(heights_over_spots(several)) == 2
        assert several.coverage.met >= one.coverage.met - 1e-9


def test_spots_of_two_storeys_are_two():
    site = find_site(house(31, storeys=2, slab_m=0.25).scene(), SiteOptions(heights_m=(1.0, 1.6)))
    keys = site.spots(site.positions)
    _, of, counts = np.unique(keys, axis=0, return_inverse=True, return_counts=True)
    assert set(counts.tolist()) <= {1, 2}
    for spot in range(len(counts)):
        here = site.positions[of.ravel() == spot]
        assert np.ptp(here[:, :2], axis=0).max() < 1e-6
        assert np.ptp(here[:, 2]) < 0.6 + 1e-6
    assert len(np.unique(site.positions[:, :2].round(6), axis=0)) < len(counts)


def test_orders_from_a_place_begin_there_and_are_as_short_as_all_orders_for_few_places():
    from itertools import permutations

    rng = np.random.default_rng(3)
    for n in (1, 2, 5, 7):
        points = rng.uniform(size=(n, 2))
        lengths = np.linalg.norm(points[:, None] - points, axis=2)
        for first in range(min(n, 3)):
            order = short_order(lengths, first)
            assert order[0] == first
            assert sorted(order) == list(range(n))
            others = [k for k in range(n) if k != first]
            best = min(lengths[[first, *rest][:-1], list(rest)].sum() for rest in permutations(others))
            assert lengths[order[:-1], order[1:]].sum() <= 1.1 * best + 1e-12
    apart = np.array([[0.0, 1.0, np.inf], [1.0, 0.0, np.inf], [np.inf, np.inf, 0.0]])
    assert short_order(apart, 1) == [1, 0, 2]
