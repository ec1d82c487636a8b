# SPDX-License-Identifier: MIT
"""Zones: boxes, the region in which surface counts, and what stations and tours keep out of."""

import json

import numpy as np
import pytest

from nbv.cover.pipeline import CoverOptions
from nbv.online.planner import PlannerOptions
from nbv.plan.plan import read_plan
from nbv.plan.planning import plan_views
from nbv.plan.tour import plan_tour
from nbv.report.coverage_report import plan_page
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import PinholeSensor
from nbv.visibility.clearance import Clearance
from nbv.visibility.samples import sample_surface
from nbv.visibility.viewpoints import Candidates, room_lattice, sphere_directions
from nbv.visibility.zones import EVERYWHERE, Box, Zones
from scenes.checks import InputError
from scenes.pose import Pose
from scenes.world.builtin import builtin_scene
from tests.helpers.long_cases import first_in_gate

ROOM = builtin_scene("two_occluders")  # 6 x 5 x 2.7 m; boxes [1.5, 2.9] x [1.5, 2.5], [4, 4.7] x [2.8, 3.5]
SAMPLES = sample_surface(ROOM.mesh, 0.2)
SENSOR = PinholeSensor(fov_deg=70, width=120, height=120)
LATTICE = room_lattice(ROOM.mesh.bounds(), spacing_m=1.0)
CANDIDATES = Candidates(LATTICE[Clearance.of(ROOM.mesh, 0.3).holds(LATTICE)], sphere_directions(0))
WEST = Box((0, 0, 0), (2, 5, 2.7))
SOUTH_EAST = Box((3, 0, 0), (6, 2.5, 2.7))


def plan_room(method, zones, **more):
    fixed = {
        "samples": SAMPLES,
        "options": PlannerOptions(voxel_m=0.2),
        "budgets": CoverOptions(polish_steps=0),
    }
    options = {"candidates": CANDIDATES, "target": 0.95, "rng": 0, "n_threads": 2, **fixed, **more}
    return plan_views(ROOM, SENSOR, method=method, zones=zones, **options)


def test_distance_to_a_box_is_that_to_its_nearest_point():
    points = np.random.default_rng(0).uniform(-3, 8, (500, 3))
    nearest = np.clip(points, WEST.low, WEST.high)
    assert np.allclose(WEST.distance(points), np.linalg.norm(points - nearest, axis=1))
    assert np.array_equal(WEST.holds(points), WEST.distance(points) == 0)
    assert np.allclose(WEST.distance(points[:, :2], 2), np.linalg.norm((points - nearest)[:, :2], axis=1))


def test_everywhere_concerns_all_and_allows_all():
    points = np.random.default_rng(0).normal(size=(50, 3))
    assert EVERYWHERE.of_interest(points).all()
    assert EVERYWHERE.allow(points).all()
    assert EVERYWHERE.to_json() == {"region": None, "keep_out": []}


@pytest.mark.parametrize(
    ("low", "high", "message"),
    [
        ((0, 0, 0), (1, -1, 1), r"smallest to its largest coordinates.*X0 < X1, Y0 < Y1, Z0 < Z1"),
        ((0, 0), (1, 1), "six finite numbers"),
        ((0, 0, np.nan), (1, 1, 1), "six finite numbers"),
    ],
)
def test_boxes_that_are_none_are_refused(low, high, message):
    with pytest.raises(InputError, match=message):
        Box(low, high)


@pytest.mark.parametrize("method", first_in_gate(1, ["nbv", "cover"]))
def test_only_surface_in_the_region_counts(method):
    inside = WEST.distance(SAMPLES.points) <= 1e-6
    whole = plan_room(method, EVERYWHERE, views=40, target=0.8)
    part = plan_room(method, Zones(WEST), views=40, target=0.8)
    assert part.coverage.total_m2 == pytest.approx(SAMPLES.areas[inside].sum())
    assert part.coverage.met_of_reachable >= 0.8
    assert len(part.views) < len(whole.views)
    html = plan_page(ROOM, part, part.coverage, 1).to_html()
    assert "in the region" in html
    assert "Dashes: only surface in this region counts." in html


def test_the_online_planner_looks_into_the_region_alone():
    start = Pose.looking_at((4.0, 1.0, 1.5), (1.0, 3.5, 0.8))
    plan = plan_room("nbv", Zones(WEST), views=6, scans=[scan_scene(ROOM, start, SENSOR, rng=0)])
    assert len(plan.views) == 6
    for view in plan.views:
        scan = scan_scene(ROOM, view, rng=0)
        assert (WEST.distance(scan.points()[scan.valid]) < 0.2).mean() > 0.2


@pytest.mark.parametrize("method", first_in_gate(1, ["nbv", "cover"]))
def test_no_station_lies_in_what_is_to_be_kept_out_of(method):
    zones = Zones(keep_out=(Box((0, 0, 0), (1.3, 5, 2.7)), SOUTH_EAST))
    starts = [Pose.looking_at((1.0, y, 1.5), (4.0, 3.5, 0.8)) for y in (1.0, 4.3)]
    for scans in ((), [scan_scene(ROOM, start, SENSOR, rng=0) for start in starts]):
        plan = plan_room(method, zones, views=5, scans=scans)
        positions = np.array([view.world_from_sensor.translation for view in plan.views])
        assert len(positions) == 5
        assert zones.allow(positions).all()
        assert plan.candidates.n_positions == zones.allow(CANDIDATES.positions).sum()


@pytest.mark.long
def test_tours_lead_around_what_is_to_be_kept_out_of():
    stations = np.array([[0.5, 4.0, 1.5], [5.5, 4.0, 1.5], [5.5, 0.5, 1.5]])
    wall = Box((2.9, 2.6, 0.0), (3.4, 5.0, 2.7))
    for on_foot in (True, False):
        free = plan_tour(ROOM.mesh, stations, on_foot=on_foot)
        around = plan_tour(ROOM.mesh, stations, on_foot=on_foot, keep_out=(wall,))
        assert around.length_m > free.length_m + 0.5
        for leg in around.legs:
            assert len(leg.path)
            ways = [np.linspace(a, b, 50) for a, b in zip(leg.path, leg.path[1:], strict=False)]
            assert not wall.holds(np.vstack(ways)).any()


def test_a_low_box_is_in_the_way_of_somebody_who_walks_and_a_high_one_is_not():
    stations = np.array([[0.5, 4.0, 1.5], [5.5, 4.0, 1.5]])
    low, high = (Box((2.9, 2.6, z), (3.4, 5.0, z + 0.5)) for z in (0.0, 2.0))
    free = plan_tour(ROOM.mesh, stations, on_foot=True)
    assert plan_tour(ROOM.mesh, stations, on_foot=True, keep_out=(low,)).length_m > free.length_m + 0.5
    assert plan_tour(ROOM.mesh, stations, on_foot=True, keep_out=(high,)).length_m == free.length_m


def test_zones_that_leave_nothing_are_refused():
    with pytest.raises(InputError, match=r"all \d+ candidate positions lie in --keep-out boxes"):
        plan_room("cover", Zones(keep_out=(Box((-1, -1, -1), (9, 9, 9)),)))
    with pytest.raises(
        InputError, match="no surface of two_occluders lies in the region; the scene goes from"
    ):
        plan_room("nbv", Zones(Box((20, 20, 20), (21, 21, 21))))


def test_plan_json_holds_the_zones_and_is_read_back(tmp_path):
    zones = Zones(WEST, (SOUTH_EAST,))
    content = plan_room("cover", zones, views=1).to_json()
    assert content["region"] == [[0, 0, 0], [2, 5, 2.7]]
    assert content["keep_out"] == [[[3, 0, 0], [6, 2.5, 2.7]]]
    file = tmp_path / "plan.json"
    file.write_text(json.dumps(content))
    assert read_plan(file).to_json() == content
    file.write_text(json.dumps({**content, "region": [[0, 0, 0], [-1, 1, 1]]}))
    with pytest.raises(InputError, match="is not a plan: a box goes from"):
        read_plan(file)
