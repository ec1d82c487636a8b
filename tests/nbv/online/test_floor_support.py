# SPDX-License-Identifier: MIT
"""Floor support: tripods stand on seen floor, not on tables, not over what no scan has seen."""

from dataclasses import replace

import numpy as np
import pytest

from nbv.online.feasible_viewpoints import has_floor_support
from nbv.online.occupancy import SEEN, VoxelMap
from nbv.online.planner import PlannerOptions
from nbv.plan.planning import plan_views
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import PinholeSensor
from nbv.visibility.samples import sample_surface
from scenes.pose import Pose
from scenes.world.builtin import builtin_scene

ROOM = builtin_scene("two_occluders")  # boxes [1.5, 2.9] x [1.5, 2.5] x [0, 0.9], [4, 4.7] x [2.8, 3.5] x 1.8
SENSOR = PinholeSensor(fov_deg=90, width=160, height=160)
CORNER = Pose.looking_at((0.5, 0.5, 2.0), (3.0, 2.5, 0.0))


def seen_from_corner() -> VoxelMap:
    voxels = VoxelMap.unknown(ROOM.mesh.bounds(), voxel_m=0.1)
    return voxels.integrate(scan_scene(ROOM, CORNER, SENSOR), SENSOR)


def test_a_tripod_stands_on_seen_floor_alone():
    asked = {
        "floor": (3.5, 0.8, 1.0),
        "table": (2.2, 2.0, 1.4),
        "shadow of the box": (3.05, 2.3, 1.0),
        "never looked at": (0.3, 4.7, 1.0),
        "outside": (9.0, 1.0, 1.0),
        "in the box": (2.2, 2.0, 0.5),
    }
    found = has_floor_support(seen_from_corner(), np.array(list(asked.values())))
    assert dict(zip(asked, found.tolist(), strict=True)) == {name: name == "floor" for name in asked}


def test_nothing_stands_before_any_floor_is_seen():
    blank = VoxelMap.unknown(ROOM.mesh.bounds(), voxel_m=0.1)
    assert not has_floor_support(blank, np.array([[1.0, 1.0, 1.0]])).any()
    up = Pose.looking_at((1.0, 1.0, 1.0), (1.0, 1.0, 2.7))
    looked_up = blank.integrate(scan_scene(ROOM, up, SENSOR), SENSOR)
    assert (looked_up.labels == SEEN).any()
    assert not has_floor_support(looked_up, np.array([[1.0, 1.0, 1.5]])).any()


@pytest.mark.long
def test_with_footing_the_planner_keeps_off_the_table_and_without_it_need_not():
    samples = sample_surface(ROOM.mesh, 0.2)
    options = PlannerOptions(voxel_m=0.15, clearance_m=0.3)
    sensor = PinholeSensor(fov_deg=60, width=80, height=80)
    plans = [
        plan_views(ROOM, sensor, views=12, target=1.0, samples=samples, options=o, rng=3)
        for o in (options, replace(options, on_floor=False))
    ]
    stands = [np.array([view.world_from_sensor.translation for view in plan.views[1:]]) for plan in plans]
    inside = [((p[:, :2] > [1.5, 1.5]) & (p[:, :2] < [2.9, 2.5])).all(axis=1) for p in stands]
    assert not inside[0].any()
    assert not np.array_equal(stands[0], stands[1])
