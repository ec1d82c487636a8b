# SPDX-License-Identifier: MIT
"""Stations: random places and directions from which a generated room is scanned."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from benchmarks.completion.scenes.furnishing import Footprint
from nbv.scanning.sensors.sensor import PinholeSensor, Sensor, SphericalSensor
from nbv.scanning.view import View
from scenes.checks import FloatArray
from scenes.pose import Pose

CAMERA = PinholeSensor(fov_deg=62.7, width=640, height=480, max_range_m=12.0, name="camera")
PANORAMA = SphericalSensor(
    azimuth_span_deg=180.0, elevation_min_deg=-60.0, elevation_max_deg=60.0, width=720, height=480,
    name="panorama",
)  # fmt: skip
_PANORAMA_SHARE = 0.25
_TWO_VIEWS_SHARE = 0.2


def stations(
    size: FloatArray, taken: Sequence[Footprint], rng: np.random.Generator, breaks: FloatArray
) -> tuple[View, ...]:
    """Return one view, or now and then two, from near the corner at the origin into the room `size`.

    A quarter of them are panoramas of 180 x 120 degrees, the others images of a camera; both level, as a
    tripod is, or looking down somewhat. They turn towards the boxes `breaks` (k, 2, 3), if there are any.
    """
    aims = breaks.mean(axis=1)
    n_views = 1 + int(rng.random() < _TWO_VIEWS_SHARE)
    sensor: Sensor = PANORAMA if rng.random() < _PANORAMA_SHARE else CAMERA
    return tuple(View(_pose(size, taken, rng, sensor, aims), sensor) for _ in range(n_views))


def _pose(
    size: FloatArray, taken: Sequence[Footprint], rng: np.random.Generator, sensor: Sensor, aims: FloatArray
) -> Pose:
    eye = np.zeros(3)
    for _ in range(100):
        eye = np.array([*rng.uniform(0.35, 1.15, 2), rng.uniform(1.25, 1.75)])
        spot = Footprint(*eye[:2], *eye[:2])
        if not any(spot.touches(place, 0.15) for place in taken):
            break
    goal = size * np.array([rng.uniform(0.7, 0.95), rng.uniform(0.6, 0.9), 0.0])
    if len(aims):
        goal = (goal + aims[0]) / 2
    goal[2] = eye[2] if sensor.kind == "spherical" else rng.uniform(0.7, 1.2)
    return Pose.looking_at(eye, goal)
