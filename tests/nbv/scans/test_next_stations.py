# SPDX-License-Identifier: MIT
"""Next stations: from scans alone, in known free space, on seen floor; later ones are predictions."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from nbv.coverage.measurement import CoverageTally
from nbv.online.planner import PlannerOptions
from nbv.report.scans_report import next_stations_page
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import PinholeSensor, View
from nbv.scanning.sensor_profile import load_sensor
from nbv.scans.next_stations import check_aperture, plan_next_stations
from nbv.scans.scan_coverage import cover_by_scans
from nbv.scans.scan_map import ScanMap
from nbv.scans.scan_record import record_scans
from nbv.visibility.clearance import Clearance
from nbv.visibility.requirement import Requirement
from nbv.visibility.samples import sample_surface
from nbv.visibility.zones import Box, Zones
from scenes.checks import InputError
from scenes.pose import Pose
from scenes.world.builtin import builtin_scene

ROOM = builtin_scene("two_occluders")
SENSOR = PinholeSensor(fov_deg=70, width=160, height=160, name="small")
COARSE = PlannerOptions(voxel_m=0.15)
CORNERS = [
    Pose.looking_at(np.array(eye), np.array(target))
    for eye, target in (((0.6, 0.6, 1.6), (5.0, 4.0, 0.8)), ((5.2, 0.8, 1.6), (1.0, 4.0, 0.6)))
]


def scan_map_of_room(poses=CORNERS, options=COARSE, **more):
    scans = [replace(scan_scene(ROOM, pose, SENSOR, rng=0), sensor="") for pose in poses]
    return ScanMap.of(scans, SENSOR, options=options, **more)


@pytest.fixture(scope="module")
def scan_map():
    return scan_map_of_room()


@pytest.fixture(scope="module")
def plan(scan_map):
    return plan_next_stations(scan_map, SENSOR, views=4, options=COARSE, n_threads=1)


def test_the_scan_map_finds_volume_and_floor(scan_map):
    low, high = scan_map.bounds
    assert (low > [-0.5, -0.5, -0.5]).all()
    assert (high < [6.5, 5.5, 3.2]).all()
    (room,) = scan_map.rooms.rooms.rooms
    assert room.level_m == pytest.approx(0.0, abs=0.01)
    assert scan_map.rooms.stood.tolist() == [1, 1]
    heights = np.unique(scan_map.candidates(SENSOR).positions[:, 2].round(3))
    assert heights == pytest.approx([0.4, 1.0, 1.6, 2.2], abs=0.01)


def test_stray_echoes_do_not_blow_up_the_volume():
    scan = replace(scan_scene(ROOM, CORNERS[0], SENSOR, rng=0), truth=None)
    ranges = scan.ranges.copy()
    ranges[::40, ::40] = 29.0
    stray = ScanMap.of([replace(scan, ranges=ranges)], SENSOR, options=COARSE)
    clean = ScanMap.of([scan], SENSOR, options=COARSE)
    assert np.abs(stray.bounds - clean.bounds).max() < 0.5


def test_stations_stand_in_truly_free_space_at_tripod_heights(scan_map, plan):
    positions = np.array([view.world_from_sensor.translation for view in plan.views])
    assert len(positions) == 4
    assert Clearance.of(ROOM.mesh, 0.1).holds(positions).all()
    stood = [scan.origin for scan in scan_map.scans]
    on_tripod = [np.isclose(z, [0.4, 1.0, 1.6, 2.2], atol=0.01).any() for z in positions[:, 2]]
    again = [min(np.linalg.norm(p - s) for s in stood) < 1e-6 for p in positions]
    assert all(a or b for a, b in zip(on_tripod, again, strict=True))


def test_the_next_station_measures_more_of_the_true_scene_than_a_random_one(scan_map, plan):
    def gained(pose):
        tally = CoverageTally.start(ROOM.ray_caster(1), sample_surface(ROOM.mesh, 0.15), Requirement())
        for scan in scan_map.scans:
            tally.add_scan(scan)
        return tally.add(View(pose, SENSOR))

    rng = np.random.default_rng(0)
    candidates = scan_map.candidates(SENSOR)
    free = candidates.at(scan_map.voxels.is_free(candidates.positions, 0.3))
    random = [gained(free.pose(int(rng.integers(free.n_poses)))) for _ in range(12)]
    assert gained(plan.views[0].world_from_sensor) > np.quantile(random, 0.75)


def test_later_stations_are_predictions_of_less_and_less(plan):
    gains = [view.predicted_gain_m2 for view in plan.views]
    assert all(later <= 1.05 * sooner for sooner, later in pairwise(gains))
    assert all(view.gain_m2 is None and view.met_fraction is None for view in plan.views)
    assert plan.coverage is None
    assert plan.resumed_from.met_fraction is None
    assert len({view.world_from_sensor.matrix.tobytes() for view in plan.views}) == 4


def test_the_first_station_does_not_depend_on_how_many_are_asked_for_nor_on_threads(scan_map, plan):
    one = plan_next_stations(scan_map, SENSOR, options=COARSE, n_threads=2)
    assert len(one.views) == 1
    assert one.views[0].to_json() == plan.views[0].to_json()
    assert one.stopped_because == "the limit of 1 views is reached"


def test_a_region_and_what_to_keep_out_of_hold(scan_map):
    zones = Zones(Box((0, 3, 0), (3, 5, 2.7)), (Box((3, -1, -1), (7, 6, 4)),))
    plan = plan_next_stations(scan_map, SENSOR, views=2, options=replace(COARSE, zones=zones))
    for view in plan.views:
        assert zones.allow(view.world_from_sensor.translation[None]).all()
        scan = scan_scene(ROOM, view, rng=0)
        assert (zones.region.distance(scan.points()[scan.valid]) < 0.3).mean() > 0.2


def test_without_floor_stations_are_wherever_space_is_free():
    up = Pose.looking_at(np.array([3.0, 1.0, 1.0]), np.array([3.3, 2.0, 2.7]))
    scan_map = scan_map_of_room([up])
    assert scan_map.rooms is None
    plan = plan_next_stations(scan_map, SENSOR, options=COARSE)
    assert plan.views
    nothing = replace(plan, views=(), stopped_because="nothing is left")
    page = next_stations_page(nothing, cover_by_scans(scan_map), (), "up")
    assert "No floor was seen below the scanners" in page.warnings[0]
    assert "No further station: nothing is left." in page.summary


def test_an_object_is_looked_at_from_around():
    chair = builtin_scene("drum_and_post")
    low, high = chair.mesh.bounds()
    region = Zones(Box(low - 0.05, high + 0.05))
    centre = (low + high) / 2
    pose = Pose.looking_at(centre + np.array([4.0, 0.0, 1.0]), centre)
    scan_map = ScanMap.of([scan_scene(chair, pose, SENSOR, rng=0)], SENSOR, mode="object", zones=region)
    plan = plan_next_stations(scan_map, SENSOR, options=PlannerOptions(zones=region))
    where, forward = (
        plan.views[0].world_from_sensor.translation,
        plan.views[0].world_from_sensor.rotation[:, 2],
    )
    middle = scan_map.bounds.mean(axis=0)
    assert forward == pytest.approx((middle - where) / np.linalg.norm(middle - where), abs=1e-6)
    before, after = pose.translation - middle, where - middle
    assert before @ after < 0.5 * np.linalg.norm(before) * np.linalg.norm(after)  # 60 deg away at least


def test_the_report_shows_where_to_stand(scan_map, plan):
    coverage = cover_by_scans(scan_map)
    html = next_stations_page(plan, coverage, record_scans(coverage), "room").to_html()
    assert "Where to stand next" in html
    assert "Squares with letters" in html


def test_what_cannot_be_planned_from_is_refused(scan_map):
    with pytest.raises(InputError, match="views must be at least 1"):
        plan_next_stations(scan_map, SENSOR, views=0)
    with pytest.raises(InputError, match=r"line_profiler measures one line at a time.*plan with a sensor"):
        check_aperture(load_sensor("line_profiler"))
    scan = scan_scene(ROOM, CORNERS[0], SENSOR, rng=0)
    nothing = replace(scan, ranges=np.full(scan.shape, np.inf), truth=None)
    with pytest.raises(InputError, match="no returns"):
        ScanMap.of([nothing], SENSOR)
