# SPDX-License-Identifier: MIT
"""Rooms that scans show: storeys and rooms of a building by panoramas, and what is told of each."""

import numpy as np
import pytest

from nbv.coverage.surface_classes import KnownSurfaces
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import SphericalSensor
from nbv.scans.scan_coverage import cover_by_scans
from nbv.scans.scan_map import ScanMap
from nbv.scans.seen_rooms import SeenRooms
from nbv.visibility.site_options import SiteOptions
from scenes.checks import InputError
from scenes.pose import Pose
from tests.helpers.buildings import house, warehouse

PANORAMA = SphericalSensor(width=360, height=151, name="coarse")
AHEAD = np.array([1.0, 0.0, 0.0])


def scans_of(building, places):
    scene = building.scene()
    return [
        scan_scene(scene, Pose.looking_at(np.array(place), np.array(place) + AHEAD), PANORAMA, rng=k)
        for k, place in enumerate(places)
    ]


def middle(room, height=1.6):
    x0, y0, x1, y1, z = room
    return ((x0 + x1) / 2 + 0.3, (y0 + y1) / 2 + 0.2, z + height)


@pytest.fixture(scope="module")
def two_storeys():
    """A house of two storeys with a scan in the middle of each room, and what they show."""
    made = house(2, storeys=2)
    scans = scans_of(made, [middle(room) for room in made.rooms])
    return made, ScanMap.of(scans, PANORAMA, completed=KnownSurfaces.of(scans, relates=False))


@pytest.mark.long
def test_every_room_that_was_scanned_is_a_room_on_its_storey(two_storeys):
    made, scan_map = two_storeys
    stood = scan_map.rooms.stood
    assert (stood > 0).all()
    assert len(set(stood.tolist())) == len(made.rooms)
    levels = [scan_map.rooms.rooms.rooms[number - 1].level_m for number in stood]
    assert levels == pytest.approx([room[4] for room in made.rooms], abs=0.02)
    storeys = [scan_map.rooms.rooms.rooms[number - 1].storey for number in stood]
    assert storeys == [1 if room[4] == 0 else 2 for room in made.rooms]


def test_next_places_stand_over_true_floor(two_storeys):
    made, scan_map = two_storeys
    positions = scan_map.candidates(PANORAMA, SiteOptions(heights_m=(1.6,))).positions
    assert len(positions) > 20
    for place in positions:
        assert any(
            x0 <= place[0] <= x1 and y0 <= place[1] <= y1 and abs(place[2] - z - 1.6) < 0.03
            for x0, y0, x1, y1, z in _floors(made)
        )


def _floors(made):
    """The true floors with the doorways between them: half a metre around each room."""
    return [(x0 - 0.5, y0 - 0.5, x1 + 0.5, y1 + 0.5, z) for x0, y0, x1, y1, z in made.rooms]


def test_areas_of_rooms_add_up_to_those_of_all(two_storeys):
    coverage = cover_by_scans(two_storeys[1])
    met, worse = (sum(getattr(room, name) for room in coverage.rooms) for name in ("met_m2", "worse_m2"))
    assert met == pytest.approx(coverage.measured.met_m2)
    assert worse == pytest.approx(coverage.measured.worse_m2)
    shadows = sum(room.shadow_m2 + room.explained_m2 for room in coverage.rooms)
    assert shadows == pytest.approx(float(coverage.unseen.areas[coverage.unseen.occluded].sum()))
    scanned = {number for room in coverage.rooms for number in room.scans}
    assert scanned == set(range(1, len(two_storeys[1].scans) + 1))


def test_growth_ends_with_the_whole_and_never_falls(two_storeys):
    coverage = cover_by_scans(two_storeys[1])
    totals = [area.total_m2 for area in coverage.growth]
    assert totals == sorted(totals)
    assert totals[-1] == coverage.measured.total_m2


@pytest.mark.long
def test_a_shadow_parts_no_room_and_shelves_are_no_floor():
    made = warehouse(2)
    x1, y1 = made.rooms[0][2:4]
    rows = np.arange(1.8, y1 - 2.4, 3.4) - 0.8
    scans = scans_of(made, [(x, y, 1.6) for y in rows for x in (x1 / 3, 2 * x1 / 3)])
    seen = SeenRooms.of(scans, KnownSurfaces.of(scans, relates=False))
    assert len(seen.rooms.rooms) == 1
    assert seen.rooms.rooms[0].level_m == pytest.approx(0, abs=0.02)


def test_rooms_can_be_asked_for(two_storeys):
    seen = two_storeys[1].rooms
    number = int(seen.stood[-1])
    assert seen.choose_rooms(SiteOptions(rooms=(number,)))[0] == (number,)
    with pytest.raises(InputError, match=r"there is no room 99: the scans show .* numbered anew"):
        seen.choose_rooms(SiteOptions(rooms=(99,)))


def test_without_a_ceiling_all_floor_serves_and_it_is_said():
    yard = house(1)
    x0, y0, _, y1, _ = yard.rooms[0]
    beside = (x0 - 3.0, (y0 + y1) / 2, 0.5)
    scans = scans_of(yard, [beside])
    seen = SeenRooms.of(scans)
    chosen, said = seen.choose_rooms(SiteOptions())
    assert chosen
    assert not said or "no ceiling was seen" in said[0]
