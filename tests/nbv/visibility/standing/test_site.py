# SPDX-License-Identifier: MIT
"""Stations stand on floor, in every room, and nowhere else: 36 buildings of solids, and a real one."""

import numpy as np
import pytest

from nbv.visibility.standing.site import SiteOptions, find_site
from tests.helpers.buildings import house, warehouse

HOUSES = [
    *((f"slab {cm} cm", house(seed, slab_m=cm / 100)) for seed, cm in enumerate((2, 5, 10, 20, 30, 40))),
    *((f"closed doors {seed}", house(seed, closed=True)) for seed in range(10, 16)),
    *((f"gable {seed}", house(seed, gable=True)) for seed in range(20, 26)),
    *((f"two storeys {seed}", house(seed, storeys=2, slab_m=0.25)) for seed in range(30, 36)),
    *((f"sunken {seed}", house(seed, sunken=True, ground=False)) for seed in range(40, 46)),
    *((f"warehouse {seed}", warehouse(seed)) for seed in range(50, 56)),
]
NAMES = [name for name, _ in HOUSES]


def rooms_below(building, positions, height_m):
    """Index (p,) of the true room whose floor each station stands on, -2 in doorways, -1 elsewhere."""
    found = np.full(len(positions), -1)
    places = [(-2, way) for way in building.doorways] + list(enumerate(building.rooms))
    for k, (x0, y0, x1, y1, z) in places:
        x, y, h = positions.T
        inside = (x >= x0) & (x <= x1) & (y >= y0) & (y <= y1) & (np.abs(h - height_m - z) < 1e-6)
        found[inside] = k
    return found


@pytest.mark.parametrize(("name", "building"), HOUSES, ids=NAMES)
def test_stations_stand_on_floor_and_no_room_is_lost(name, building):
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
