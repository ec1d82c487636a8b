# SPDX-License-Identifier: MIT
"""Online on two storeys: stations stand on floors alone, in the rooms asked for, upstairs as well."""

from dataclasses import replace

import numpy as np
import pytest

from nbv import load_sensor, plan_views
from nbv.online.planner import PlannerOptions
from nbv.visibility.candidates import find_standing
from nbv.visibility.samples import sample_surface
from nbv.visibility.site_options import SiteOptions
from tests.helpers.buildings import house

HEIGHT = 1.5
BUILDING = house(31, storeys=2, slab_m=0.25)
SCENE = BUILDING.scene("two storeys")
PANORAMA = load_sensor("panorama")


def floor_levels(places: np.ndarray) -> list[float]:
    """Level of the true room that each place stands on, nan off all rooms and in doorways."""
    found = []
    for x, y, z in places:
        below = [
            room[4] for room in (*BUILDING.rooms, *BUILDING.doorways)
            if room[0] <= x <= room[2] and room[1] <= y <= room[3] and abs(z - HEIGHT - room[4]) < 1e-6
        ]  # fmt: skip
        found.append(below[0] if below else np.nan)
    return found


@pytest.mark.long
def test_online_stations_stand_on_the_floors_of_both_storeys():
    standing = find_standing(SCENE, PANORAMA, SiteOptions(heights_m=(HEIGHT,)))
    plan = plan_views(
        SCENE, PANORAMA, method="nbv", standing=standing, samples=sample_surface(SCENE.mesh, 0.4), target=1.0,
        views=14, options=PlannerOptions(voxel_m=0.2), rng=0,
    )  # fmt: skip
    levels = floor_levels(np.array([view.world_from_sensor.translation for view in plan.views]))
    assert not np.isnan(levels).any(), [view.world_from_sensor.translation for view in plan.views]
    assert set(levels) == {room[4] for room in BUILDING.rooms}
    assert len(levels) > 2


def test_proposals_lie_neither_outside_nor_in_rooms_that_nobody_asked_for():
    asked = SiteOptions(heights_m=(HEIGHT,))
    whole = find_standing(SCENE, PANORAMA, asked)
    assert whole.site is not None
    one = find_standing(SCENE, PANORAMA, replace(asked, rooms=whole.site.chosen[:1]))
    for standing in (whole, one):
        assert standing.site is not None
        of = standing.site.rooms.room_of(standing.proposals.positions)
        assert set(of.tolist()) - {0} == set(standing.site.chosen)
    assert one.proposals.n_poses < whole.proposals.n_poses
