# SPDX-License-Identifier: MIT
"""Stations stand on floor, in every room, in buildings of other kinds and at angles to the lattice."""

import numpy as np
import pytest

from nbv.visibility.site import find_site
from nbv.visibility.site_options import SiteOptions
from tests.helpers import building_kinds as kinds
from tests.helpers.buildings import house
from tests.helpers.long_cases import first_in_gate

LONG = pytest.mark.long
CASES = [  # building, turned by degrees, floor areas of the rooms that it has in m2, largest last
    pytest.param(kinds.hall_with_ramp, 0.0, (228.0,), id="ramp"),
    pytest.param(kinds.split_level, 0.0, (33.0, 40.0), id="split level"),
    pytest.param(kinds.attic, 0.0, (26.0, 66.0), id="attic"),
    pytest.param(kinds.rack_hall, 0.0, (58.0, 341.0), id="racks and mezzanine", marks=LONG),
    pytest.param(kinds.gallery, 0.0, (70.0, 115.0), id="gallery", marks=LONG),
    pytest.param(kinds.basement, 0.0, (19.7, 32.0, 52.0), id="cellar"),
    pytest.param(kinds.sheets, 0.0, (18.0, 18.0, 18.0, 18.0), id="sheets"),
    pytest.param(kinds.sheets, 40.0, (18.0, 18.0, 18.0, 18.0), id="sheets at 40 deg"),
    pytest.param(kinds.rack_hall, 17.0, (58.0, 341.0), id="racks at 17 deg", marks=LONG),
    pytest.param(kinds.gallery, 45.0, (70.0, 115.0), id="gallery at 45 deg", marks=LONG),
]


def over(building, places, height_m):
    """Index (p,) of the true floor below each place, -2 in doorways, -1 elsewhere."""
    found = np.full(len(places), -1)
    for number, floor in [(-2, way) for way in building.doorways] + list(enumerate(building.rooms)):
        x0, y0, x1, y1, low, high = (*floor, floor[4])[:6]
        x, y, z = places.T
        level = low + (high - low) * (x - x0) / (x1 - x0)
        near = np.abs(z - height_m - level) < (0.02 if high != low else 1e-6)
        found[(x > x0 - 1e-6) & (x < x1 + 1e-6) & (y > y0 - 1e-6) & (y < y1 + 1e-6) & near] = number
    return found


def check(building, turned_deg):
    """The site of a building, whose stations stand on its floors and not over its furniture."""
    site = find_site(kinds.scene_of(building, turned_deg=turned_deg), SiteOptions(heights_m=(1.5,)))
    places = kinds.turned_back(site.positions, turned_deg)
    below = over(building, places, 1.5)
    assert (below != -1).all(), places[below == -1]
    assert set(below.tolist()) - {-2} == set(range(len(building.rooms)))
    x, y, z = (places - [0, 0, 1.5]).T
    for x0, y0, x1, y1, level in building.furniture:
        on_it = (x > x0) & (x < x1) & (y > y0) & (y < y1) & (np.abs(z - level) < 1.2)
        assert not on_it.any(), places[on_it]
    inside = [room for room in site.rooms.rooms if not room.is_outside]
    assert {room.number for room in inside} == set(site.position_room.tolist())
    return site, inside


@pytest.mark.parametrize(("make", "turned_deg", "areas_m2"), first_in_gate(2, CASES))
def test_stations_stand_on_floor_in_every_room(make, turned_deg, areas_m2):
    site, inside = check(make(), turned_deg)
    assert sorted(room.floor_m2 for room in inside) == pytest.approx(areas_m2, rel=0.12)
    assert not any("no ceiling" in warning for warning in site.warnings)


def test_a_house_on_wide_grounds_has_ceilings_and_its_walls_may_stand_at_any_angle():
    made = house(31, storeys=2, slab_m=0.25)
    site, inside = check(made, 30.0)
    assert len(inside) == len(made.rooms)
    assert site.warnings == ()


@pytest.mark.parametrize("make", first_in_gate(1, [kinds.attic, kinds.gallery, kinds.basement]))
def test_stairs_join_the_storeys(make):
    _, inside = check(make(), 0.0)
    assert any(room.stairs for room in inside)
    assert {room.storey for room in inside} == {1, 2}
