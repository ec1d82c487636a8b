# SPDX-License-Identifier: MIT
"""Stations stand on floor, in every room, and nowhere else: 36 buildings of solids, and a real one."""

import numpy as np
import pytest

from nbv.visibility.rooms import SiteRoom
from nbv.visibility.site import find_site, lattice_spacing
from nbv.visibility.site_options import SiteOptions
from scenes.checks import InputError
from scenes.run.memory import memory_limit, resident
from tests.helpers.buildings import house, warehouse
from tests.helpers.long_cases import first_in_gate

KINDS = {
    "slab 2 cm": (house, {"slab_m": 0.02}, range(1)),
    "slab 5 cm": (house, {"slab_m": 0.05}, range(1, 2)),
    "slab 10 cm": (house, {"slab_m": 0.10}, range(2, 3)),
    "slab 20 cm": (house, {"slab_m": 0.20}, range(3, 4)),
    "slab 30 cm": (house, {"slab_m": 0.30}, range(4, 5)),
    "slab 40 cm": (house, {"slab_m": 0.40}, range(5, 6)),
    "closed doors": (house, {"closed": True}, range(10, 16)),
    "gable": (house, {"gable": True}, range(20, 26)),
    "two storeys": (house, {"storeys": 2, "slab_m": 0.25}, range(30, 36)),
    "sunken": (house, {"sunken": True, "ground": False}, range(40, 46)),
    "warehouse": (warehouse, {}, range(50, 56)),
}
IN_THE_GATE = (0, 5, 12, 22, 31, 34, 41, 53)  # at least one of each kind; the others repeat it
BUILDINGS = [
    pytest.param(name, make, options, seed, id=f"{name} {seed}",
                 marks=() if seed in IN_THE_GATE else pytest.mark.long)
    for name, (make, options, seeds) in KINDS.items() for seed in seeds
]  # fmt: skip


def rooms_below(building, positions, height_m):
    """Index (p,) of the true room whose floor each station stands on, -2 in doorways, -1 elsewhere."""
    found = np.full(len(positions), -1)
    places = [(-2, way) for way in building.doorways] + list(enumerate(building.rooms))
    for k, (x0, y0, x1, y1, z) in places:
        x, y, h = positions.T
        inside = (x >= x0) & (x <= x1) & (y >= y0) & (y <= y1) & (np.abs(h - height_m - z) < 1e-6)
        found[inside] = k
    return found


@pytest.mark.parametrize(("name", "make", "options", "seed"), first_in_gate(3, BUILDINGS))
def test_stations_stand_on_floor_and_no_room_is_lost(name, make, options, seed):
    building = make(seed, **options)
    site = find_site(building.scene(name), SiteOptions(heights_m=(1.5,)))
    below = rooms_below(building, site.positions, 1.5)
    assert (below != -1).all(), site.positions[below == -1]
    assert set(below.tolist()) - {-2} == set(range(len(building.rooms)))
    x, y, level = (site.positions - [0, 0, 1.5]).T
    for x0, y0, x1, y1, z in building.furniture:
        over = (x > x0) & (x < x1) & (y > y0) & (y < y1) & (np.abs(level - z) < 1)
        assert not over.any(), site.positions[over]
    inside = [room for room in site.rooms.rooms if not room.is_outside]
    assert len(inside) == len(building.rooms) - name.startswith("sunken")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"spacing_m": 0.01}, r"--spacing 0.01 puts about \d+ positions on [\d.]+ m2 of floor at 4 heights"),
        ({"heights_m": (50.0,)}, r"highest room has 2.60 m.*; give --heights up to 2.30"),
        ({"clearance_m": 1.4}, r"--clearance 1.4 m of floor and ceiling needs 2.8 m, .* has 2.60 m; give a"),
        ({"clearance_m": 9.0}, r"--clearance 9 m holds of the floor too, .* at most 2.2 m above it; give a"),
        ({"clearance_m": 9.0, "heights_m": (9.5,)}, r"--clearance 9 m of floor and ceiling needs 18 m"),
        ({"heights_m": (0.2,)}, r"--clearance 0.3 m holds of the floor too, and the sensor is at most 0.2 m"),
    ],
)
def test_what_leaves_nowhere_to_stand_is_named_with_its_cure(options, message):
    with pytest.raises(InputError, match=message):
        find_site(house(7).scene(), SiteOptions(**options))


def test_finest_spacing_that_is_named_is_taken_and_a_finer_one_is_not():
    room = SiteRoom(1, 1, 120.0, 0.0, 2.6, (0.0, 0.0, 0.0), is_outside=False, joined=(), stairs=())
    with pytest.raises(InputError, match=r"give --spacing (0\.\d+) or more") as caught:
        lattice_spacing([room], SiteOptions(spacing_m=0.02))
    named = float(str(caught.value).partition("give --spacing ")[2].split()[0])
    assert lattice_spacing([room], SiteOptions(spacing_m=named)) == (named, [])
    with pytest.raises(InputError):
        lattice_spacing([room], SiteOptions(spacing_m=0.99 * named))


def test_a_hall_too_large_for_the_usual_spacing_gets_a_wider_one_and_says_so():
    hall = SiteRoom(1, 1, 20_000.0, 0.0, 9.0, (0.0, 0.0, 0.0), is_outside=False, joined=(), stairs=())
    spacing, (said,) = lattice_spacing([hall], SiteOptions())
    assert 4 * 20_000 / spacing**2 == pytest.approx(50_000, rel=0.002)
    assert "places for stations are 1.265 m apart, not 1 m: that would be about 80000 positions" in said
    assert lattice_spacing([hall], SiteOptions(heights_m=(1.6,))) == (1.0, [])


def test_lattices_of_sensors_that_turn_keep_their_spacing_as_the_building_grows():
    for floor_m2, camera in ((20.0, 0.5), (59.0, 0.5), (61.0, 1.0), (3000.0, 1.0)):
        room = SiteRoom(1, 1, floor_m2, 0.0, 2.6, (0.0, 0.0, 0.0), is_outside=False, joined=(), stairs=())
        assert lattice_spacing([room], SiteOptions(), turns=True)[0] == 0.5
        assert lattice_spacing([room], SiteOptions())[0] == camera


def test_positions_that_do_not_fit_into_memory_are_refused():
    room = SiteRoom(1, 1, 1000.0, 0.0, 2.6, (0.0, 0.0, 0.0), is_outside=False, joined=(), stairs=())
    with memory_limit(resident() + 10**8), pytest.raises(InputError, match="give a larger --spacing, fewer"):
        lattice_spacing([room], SiteOptions(spacing_m=0.5))
