# SPDX-License-Identifier: MIT
"""What surfaces are to the room, and that another room's wall ends at this one's."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import shapely

from completion import CompletionOptions, complete
from completion.merging.merged_surface import largest_shares
from completion.observe.observation import PixelSet, ScanPixels
from completion.result.record import completion_record
from scenes.inclination import Up
from tests.helpers.completion_examples import completed
from tests.helpers.exchange_houses import completed_house


@pytest.fixture(scope="module")
def house():
    return completed_house()


def test_each_storey_has_its_plan(house):
    room = house.completed.room
    assert [len(layout.scanner_rooms) for layout in room.layouts] == [2, 1]
    areas = [outline.area for layout in room.layouts for outline, _ in layout.outlines()]
    assert areas == pytest.approx([12.0, 9.0, 12.0], rel=0.03)


def test_rooms_are_told_in_the_world_of_the_scans(house):
    rooms = completion_record(house)["rooms"]
    assert [(room["number"], room["storey"]) for room in rooms] == [(1, 1), (2, 1), (3, 2)]
    assert [room["area_m2"] for room in rooms] == pytest.approx([12.0, 9.0, 12.0], rel=0.03)
    assert all(room["has_scanner"] and room["walled_share"] > 0.9 for room in rooms)
    outline = shapely.Polygon([point[:2] for point in rooms[1]["rings"][0]])
    stands = [seen.scan.origin for seen in house.observations]
    within = [
        outline.contains(shapely.Point(house.world_from_reference.apply(p[None])[0, :2])) for p in stands
    ]
    assert sum(within) == 1
    assert {round(point[2], 2) for point in rooms[0]["rings"][0]} == {100.0}


def test_no_plan_is_drawn_by_walls_of_another_storey(house):
    lower, upper = house.completed.room.layouts
    below = {wall.number for wall in house.completed.room.walls if wall.high[1] < upper.floor_m}
    assert len(below) == 2  # of the second room; an upper wall goes on in the partition
    assert below <= set(lower.walls.tolist())
    assert not below & set(upper.walls.tolist())


def test_a_surface_is_as_large_as_in_the_scan_that_saw_most_of_it(house):
    """Of three scans of 100 pixels, the second shows a surface as a tenth of what it shows."""
    shape, pixels = (10, 10), np.arange(100, dtype=np.int32)
    shown = [(pixels[:0], pixels[:10], pixels[:2]), (pixels, pixels[10:], pixels[2:])]
    surfaces = [
        replace(house.patches[0].source, pixels=ScanPixels.of([PixelSet(flat, shape) for flat in scans]))
        for scans in shown
    ]
    assert largest_shares(surfaces) == pytest.approx([0.1, 1.0])


def test_floors_and_ceilings_of_both_storeys_have_roles(house):
    roles = [patch.limits.role for patch in house.patches if patch.observed_m2 > 1]
    assert (roles.count("floor"), roles.count("ceiling"), roles.count("wall")) == (2, 2, 6)


def test_what_can_be_seen_over_is_no_wall():
    """The crates of this scene reach just above the scanner; beams pass over them."""
    found = completed("two_occluders", pixels=120)
    room = found.completed.room
    assert len(room.walls) == 2
    assert all(wall.high[0] - wall.low[0] > 3 for wall in room.walls)


def test_where_up_is_undecided_nothing_has_a_role():
    found = completed("two_occluders", pixels=120)
    scans = [seen.scan for seen in found.observations]
    undecided = Up(np.array([0.0, 0.0, 1.0]), 30.0, is_decided=False)
    again = complete(scans, CompletionOptions(texture=False, up=undecided), rng=0)
    assert {patch.limits.role for patch in again.patches} == {""}
    assert again.hypothesised_m2 > 0


def test_nothing_goes_on_below_the_floor_that_is_looked_at(house):
    """A place under the floor of a scanner's room is hidden by it, whatever else stands before it."""
    room = house.completed.room
    lower = room.layouts[0]
    place = (
        room.origins[0] + 1.0 * lower.axes[0] + (lower.floor_m - 1.0 - room.origins[0] @ room.up) * room.up
    )
    assert room.hides(place[None], -1).all()
    assert not room.holds(place[None]).any()
    inside = place + 1.5 * room.up
    assert not room.hides(inside[None], -1).any()
    assert room.holds(inside[None]).all()
