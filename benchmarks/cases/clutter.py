# SPDX-License-Identifier: MIT
"""Clutter: small random scenes of boxes, cylinders and planes, and random scans of them, by seed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from completion.observe.user_options import Mode
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import PinholeSensor, Sensor, SphericalSensor
from scenes.checks import FloatArray
from scenes.pose import Pose
from scenes.scan.range_image import RangeImage
from scenes.world.builtin import Finish, SceneBuilder
from scenes.world.scene import Scene

_GREY = Finish((0.5, 0.5, 0.5))
_MODES: tuple[Mode, ...] = ("conservative", "standard", "bold")
_NOISES = ("none", "none", "gaussian-1mm", "gaussian-2mm", "gaussian-5mm")


@dataclass(frozen=True, slots=True, eq=False)
class Clutter:
    """A random scene with its scans, and the mode to complete them in."""

    seed: int
    scene: Scene
    scans: tuple[RangeImage, ...]
    noise: str
    mode: Mode


def random_clutter(seed: int) -> Clutter:
    """Return the clutter with this seed: the same seed gives the same bytes.

    Up to three scans of few pixels, by cameras and panoramas, from anywhere around a few things that may
    cut each other, stand on a floor or before walls, or hang in the air; two of five without noise.
    """
    rng = np.random.default_rng([20264, seed])
    scene = _scene(rng, f"clutter {seed}")
    noise, mode = str(rng.choice(_NOISES)), _MODES[int(rng.integers(3))]
    caster = scene.ray_caster()
    scans = []
    for index in range(int(rng.integers(1, 4))):
        sensor = _sensor(rng)
        scans.append(
            scan_scene(scene, _pose(rng), sensor, noise=noise, rng=1000 * seed + index, caster=caster)
        )
    return Clutter(seed, scene, tuple(scans), noise, mode)


def _scene(rng: np.random.Generator, name: str) -> Scene:
    build = SceneBuilder(name, "object")
    if rng.random() < 0.7:
        build.add_rectangle("floor", (-3, -3, -1), (6, 0, 0), (0, 6, 0), _GREY)
    for index, yaw in enumerate(rng.uniform(0, 2 * np.pi, int(rng.integers(0, 3)))):
        along = np.array([np.cos(yaw), np.sin(yaw), 0.0])
        away = np.array([-along[1], along[0], 0.0])
        build.add_rectangle(f"wall {index}", 2.2 * away - 3 * along - [0, 0, 1], 6 * along, (0, 0, 3), _GREY)
    for index in range(int(rng.integers(1, 4))):
        half = rng.uniform(0.1, 0.5, 3)
        centre = rng.uniform(-1, 1, 3)
        build.add_box(
            f"box {index}", centre - half, centre + half, _GREY, yaw=rng.uniform(0, np.pi) * rng.integers(2)
        )
    for index in range(int(rng.integers(0, 3))):
        axis = _direction(rng) if rng.random() < 0.5 else np.array([0.0, 0, 1])
        radius, length = rng.uniform(0.08, 0.4), rng.uniform(0.3, 1.8)
        foot = rng.uniform(-1, 1, 3) - axis * length / 2
        build.add_cylinder(
            f"cylinder {index}", foot, axis * length, radius, _GREY, caps=bool(rng.integers(2))
        )
    for index in range(int(rng.integers(0, 3))):
        normal, corner = _direction(rng), rng.uniform(-1, 1, 3)
        across = np.cross(normal, _direction(rng))
        across *= rng.uniform(0.2, 1.5) / np.linalg.norm(across)
        up = np.cross(normal, across)
        up *= rng.uniform(0.2, 1.5) / np.linalg.norm(up)
        build.add_rectangle(f"sheet {index}", corner, across, up, _GREY)
    return build.finish()


def _direction(rng: np.random.Generator) -> FloatArray:
    vector = rng.normal(size=3)
    return np.asarray(vector / np.linalg.norm(vector), dtype=np.float64)


def _sensor(rng: np.random.Generator) -> Sensor:
    if rng.random() < 0.3:
        span = rng.uniform(120, 360) if rng.random() < 0.7 else 360.0
        return SphericalSensor(
            azimuth_span_deg=span, elevation_min_deg=-60, elevation_max_deg=60, width=128, height=56
        )
    size = rng.integers(40, 97, 2)
    return PinholeSensor(fov_deg=rng.uniform(40, 85), width=int(size[0]), height=int(size[1]))


def _pose(rng: np.random.Generator) -> Pose:
    """From 1.6 to 3.2 m off the middle, above the floor, towards something near it."""
    eye = _direction(rng) * rng.uniform(1.6, 3.2)
    eye[2] = np.clip(abs(eye[2]), 0.0, 1.8)
    return Pose.looking_at(eye, rng.uniform(-0.5, 0.5, 3))
