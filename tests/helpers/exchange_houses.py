# SPDX-License-Identifier: MIT
"""Two rooms beside each other, a third above one of them, scanned and completed, and their parts."""

from functools import cache

import numpy as np

from completion import Completion, CompletionOptions, complete
from completion.export.building.parts import BuildingParts
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import SphericalSensor
from scenes.pose import Pose
from scenes.world.scene import Scene
from tests.helpers.buildings import Building
from tests.helpers.exchange_examples import UTM

PARTITION_M, SLAB_M, HIGH_M = 0.15, 0.3, 2.5
ROOMS = ((4.0, 3.0), (3.0, 3.0), (4.0, 3.0))  # in the lower storey left and right, above the left one
DOOR = (0.9, 2.0)
SENSOR = SphericalSensor(
    azimuth_span_deg=360.0, elevation_min_deg=-70.0, elevation_max_deg=70.0, width=540, height=210,
    name="small panorama", max_range_m=12.0,
)  # fmt: skip
PLACES = ((1.6, 1.4, 1.3), (5.4, 1.7, 1.4), (1.7, 1.3, 4.1))


def house() -> Scene:
    """Rooms with a partition of 15 cm and a door in it, and a slab of 30 cm."""
    made, thick = Building(), 0.4
    made.box("floor", (-thick, -thick, -thick), (7.15 + thick, 3 + thick, 0))
    left, right, top = 4.0, 4.0 + PARTITION_M, 2 * HIGH_M + SLAB_M
    made.box("slab", (-thick, -thick, HIGH_M), (7.15 + thick, 3 + thick, HIGH_M + SLAB_M))
    made.box("roof", (-thick, -thick, top), (left + thick, 3 + thick, top + thick))
    for y in ((-thick, 0), (3, 3 + thick)):
        made.box("wall", (-thick, y[0], 0), (7.15 + thick, y[1], HIGH_M))
        made.box("wall", (-thick, y[0], HIGH_M + SLAB_M), (left + thick, y[1], top))
    made.box("wall", (-thick, 0, 0), (0, 3, HIGH_M))
    made.box("wall", (7.15, 0, 0), (7.15 + thick, 3, HIGH_M))
    for x in ((-thick, 0), (left, left + thick)):
        made.box("wall", (x[0], 0, HIGH_M + SLAB_M), (x[1], 3, top))
    made.box("partition", (left, 0, 0), (right, 1, HIGH_M))
    made.box("partition", (left, 1 + DOOR[0], 0), (right, 3, HIGH_M))
    made.box("partition", (left, 1, DOOR[1]), (right, 1 + DOOR[0], HIGH_M))
    return made.scene()


@cache
def completed_house(noise: str = "gaussian-2mm", places: tuple[int, ...] = (0, 1, 2)) -> Completion:
    """The house, scanned from the middle of some of its rooms, far from the origin of the world."""
    scene, scans = house(), []
    for k in places:
        eye = np.array(PLACES[k])
        pose = Pose.looking_at(eye, eye + (1.0, 0.3, 0.0))
        scans.append(scan_scene(scene, pose, SENSOR, noise=noise, rng=k).transform(UTM))
    return complete(scans, CompletionOptions(texture=False), rng=0)


@cache
def house_parts(noise: str = "gaussian-2mm", places: tuple[int, ...] = (0, 1, 2)) -> BuildingParts:
    """The parts of the completed house."""
    return completed_house(noise, places).building()
