# SPDX-License-Identifier: MIT
"""Small scans with known surfaces, for the tests of completion."""

from functools import cache

import numpy as np

from completion import Completion, CompletionOptions, complete
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import PinholeSensor
from scenes.checks import FloatArray
from scenes.pose import Pose
from scenes.scan.range_image import RangeImage
from scenes.world.builtin import builtin_scene
from scenes.world.scene import Scene

PLAIN = CompletionOptions(texture=False)
VIEWS = {
    "two_occluders": Pose.looking_at((0.4, 0.4, 1.7), (4.0, 3.0, 0.8)),
    "chair_before_wall": Pose.looking_at((0.5, -2.2, 1.5), (0.0, 0.8, 0.7)),
    "two_cylinders": Pose.looking_at((0.3, -2.6, 1.6), (0.0, 0.3, 0.8)),
    "engaged_column": Pose.looking_at((0.6, -2.4, 1.5), (0.0, 0.9, 0.8)),
    "pipe_rack": Pose.looking_at((0.7, -2.6, 1.5), (-0.05, 0.9, 0.9)),
    "textured_cylinder": Pose.looking_at((0.2, -2.4, 1.5), (0.0, 0.3, 0.9)),
}


@cache
def scene(name: str) -> Scene:
    return builtin_scene(name)


@cache
def example(name: str, noise: str = "none", pixels: int = 200) -> RangeImage:
    """A scan of a built-in scene from a place where something hides something."""
    sensor = PinholeSensor(fov_deg=65, width=pixels, height=pixels)
    return scan_scene(scene(name), VIEWS[name], sensor, noise=noise, rng=0)


@cache
def completed(
    name: str, noise: str = "none", pixels: int = 200, options: CompletionOptions = PLAIN
) -> Completion:
    """The completion of `example`, made once a session: complete(example(...), options, rng=0)."""
    return complete(example(name, noise, pixels), options, rng=0)


def distance_to_truth(truth: Scene, points: FloatArray) -> FloatArray:
    """Distance (n,) from points to the nearest true surface, unbounded."""
    surfaces = [surface for surface in truth.surfaces if surface is not None]
    return np.min([np.abs(surface.distance(points)) for surface in surfaces], axis=0)
