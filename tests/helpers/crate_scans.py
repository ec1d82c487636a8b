# SPDX-License-Identifier: MIT
"""Scans of a small room with a crate, which may move between them, with poses that may be off."""

from functools import cache

import numpy as np

from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import PinholeSensor
from scenes.pose import Pose
from scenes.scan.range_image import RangeImage
from scenes.world.builtin import Finish, SceneBuilder
from scenes.world.scene import Scene
from tests.helpers.registration_examples import displaced

PLACES = ((1.2, 0.6, 1.5), (2.0, 0.5, 1.6), (2.8, 0.7, 1.4), (3.4, 1.2, 1.5))
GOAL = (2.2, 3.6, 0.7)
_GREY = Finish((0.6, 0.6, 0.6))


@cache
def room(crate_x: float = 1.6) -> Scene:
    """A room of 4.4 x 4 x 2.5 m, with a cupboard, and a crate 2.2 m from the south wall."""
    build = SceneBuilder("room with a crate", "room")
    build.add_box("room", (0, 0, 0), (4.4, 4.0, 2.5), _GREY, inward=True)
    build.add_box("cupboard", (3.3, 3.3, 0.0), (4.2, 3.9, 1.4), _GREY, yaw=0.3)
    build.add_box("crate", (crate_x, 2.2, 0.0), (crate_x + 0.7, 2.7, 0.6), _GREY)
    return build.finish()


@cache
def scan(number: int, crate_x: float = 1.6, seed: int = 0) -> RangeImage:
    """The scan from one of the `PLACES`, with 2 mm noise."""
    sensor = PinholeSensor(fov_deg=70, width=160, height=120)
    pose = Pose.looking_at(PLACES[number], GOAL)
    return scan_scene(room(crate_x), pose, sensor, noise="gaussian-2mm", rng=10 * seed + number)


def misplaced(one: RangeImage, turn_deg: float, shift_m: float, seed: int) -> RangeImage:
    """The scan with a pose that is off: turned about its station, and shifted, any way."""
    motion = displaced(one, np.random.default_rng(seed), turn_deg, shift_m)
    return one.with_facts(world_from_sensor=motion @ one.world_from_sensor)
