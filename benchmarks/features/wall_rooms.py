# SPDX-License-Identifier: MIT
"""Rooms by seed: four walls, of which the far one may have a hole, boxes before it, and a scan of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensors.sensor import PinholeSensor, Sensor, SphericalSensor
from scenes.checks import FloatArray
from scenes.pose import Pose
from scenes.scan.range_image import RangeImage
from scenes.world.builtin import Finish, SceneBuilder
from scenes.world.scene import Scene

Hole = tuple[float, float, float, float]  # y and z of its near and of its far corner
Size = tuple[float, float, float]  # x, y, z of a room, metres
GREY = Finish((0.78, 0.77, 0.74))
_FLOOR, _CEILING, _SIDE = Finish((0.55, 0.50, 0.44)), Finish((0.90, 0.90, 0.88)), Finish((0.70, 0.70, 0.68))
_REVEAL, _BEYOND = Finish((0.62, 0.62, 0.60)), Finish((0.46, 0.54, 0.62))
WOOD = Finish((0.6, 0.5, 0.4))
_STRAYS = 0.01
_PANORAMA = SphericalSensor(
    azimuth_span_deg=110.0, elevation_min_deg=-50.0, elevation_max_deg=40.0, width=880, height=720,
    name="panorama", max_range_m=20.0,
)  # fmt: skip
_CAMERA = PinholeSensor(fov_deg=75.0, width=640, height=480, max_range_m=12.0, name="camera")


def room_of(rng: np.random.Generator) -> Size:
    return float(rng.uniform(3.5, 6.0)), float(rng.uniform(3.4, 5.0)), float(rng.uniform(2.4, 3.0))


def hole_of(rng: np.random.Generator, kind: str, room: Size) -> Hole:
    width = float(rng.uniform(0.7, 1.1) if kind == "doorway" else rng.uniform(0.6, 1.4))
    low = 0.0 if kind == "doorway" else float(rng.uniform(0.6, 1.0))
    high = float(rng.uniform(1.95, 2.15)) if kind == "doorway" else low + float(rng.uniform(0.6, 1.2))
    start = float(rng.uniform(0.5, room[1] - width - 0.5))
    return start, low, start + width, high


def add_shell(
    build: SceneBuilder,
    room: Size,
    holes: list[Hole],
    kind: str,
    depth: float,
    rng: np.random.Generator,
    *,
    width: float | None = None,
) -> None:
    """Floor, ceiling and walls; the far wall with holes and reveals, another room or nothing behind it."""
    x, y, z = np.diag(room)
    build.add_rectangle("floor", np.zeros(3), x, y, _FLOOR)
    build.add_rectangle("ceiling", z + y, x, -y, _CEILING)
    build.add_rectangle("wall x=0", np.zeros(3), y, z, GREY)
    build.add_rectangle("wall y=0", np.zeros(3), x, z, _SIDE)
    build.add_rectangle("wall y=far", y, x, z, _SIDE)
    end = room[1] if width is None else width
    from_far = [(end - hole[2], hole[1], end - hole[0], hole[3]) for hole in holes]
    build.add_panel(
        "wall", (room[0], end, 0.0), (0, -end, 0), z, GREY, holes=from_far, are_openings=kind != "niche"
    )
    deep = np.array([depth, 0.0, 0.0])
    for y0, z0, y1, z1 in holes:
        low = np.array([room[0], y0, z0])
        across, up = np.array([0, y1 - y0, 0.0]), np.array([0, 0, z1 - z0])
        build.add_rectangle("reveal left", low, deep, up, _REVEAL)
        build.add_rectangle("reveal right", low + across, deep, up, _REVEAL)
        build.add_rectangle("reveal top", low + up, deep, across, _REVEAL)
        build.add_rectangle("reveal bottom", low, deep, across, _REVEAL)
        if kind == "niche":
            build.add_rectangle("back", low + deep, across, up, GREY)
    if kind != "niche" and (holes or width is not None):
        away = np.array([rng.uniform(1.5, 5.0), 0.0, 0.0])
        corner = x + away - y - z * 0.2
        build.add_rectangle("beyond", corner, 3 * y, 1.6 * z, _BEYOND)
        build.add_rectangle("floor beyond", x - y, away, 3 * y, _BEYOND)


def clutter_of(
    rng: np.random.Generator, room: Size, hole: Hole, eye: FloatArray, hidden: float
) -> list[tuple[FloatArray, FloatArray]]:
    """Boxes before the wall whose shadows from the eye cover about a share of the hole, from one side."""
    y0, _, y1, z1 = hole
    share = hidden * rng.uniform(0.9, 1.3)
    stands = rng.uniform(0.3, 1.0)  # before the wall
    scale = 1 - stands / (room[0] - eye[0])  # from the wall's plane to that of the box's front
    boxes = []
    style = rng.integers(3)
    if style == 0:  # from below, over the whole width
        low, high, top = y0 - 0.3, y1 + 0.3, hole[1] + share * (z1 - hole[1])
        edges = [(low, high, top)]
    elif style == 1:  # from the side, tall
        cut = share * (y1 - y0)
        left = rng.random() < 0.5
        edges = [(y0 - 0.4, y0 + cut, z1 + 0.1) if left else (y1 - cut, y1 + 0.4, z1 + 0.1)]
    else:  # two boxes
        part = share / 2
        edges = [
            (y0 - 0.3, y0 + part * 1.4 * (y1 - y0), hole[1] + 0.8 * (z1 - hole[1])),
            (y0 + 0.3 * (y1 - y0), y1 + 0.3, hole[1] + part * (z1 - hole[1])),
        ]
    for low, high, top in edges:
        ya, yb = (eye[1] + scale * (edge - eye[1]) for edge in (low, high))
        za = eye[2] + scale * (top - eye[2])
        front = eye[0] + scale * (room[0] - eye[0])
        ya, yb = max(ya, 0.02), min(yb, room[1] - 0.02)
        if yb - ya > 0.05 and za > 0.05:
            back = min(front + rng.uniform(0.15, 0.4), room[0] - 0.02)
            boxes.append((np.array([front, ya, 0.0]), np.array([back, yb, min(za, room[2] - 0.05)])))
    return boxes


def scan_of(
    scene: Scene,
    eye: FloatArray,
    room: Size,
    rng: np.random.Generator,
    noise_m: float,
) -> RangeImage:
    """A panorama, or a camera's image, with noise and strays, of a wall that the sensor looks at askew."""
    sensor: Sensor = _PANORAMA if rng.random() < 0.6 else _CAMERA
    aim = np.array([room[0], room[1] * rng.uniform(0.35, 0.65), eye[2] if sensor is _PANORAMA else 1.2])
    pose = Pose.looking_at(eye, aim)
    scan = scan_scene(
        scene, pose, sensor, noise=f"gaussian-{1000 * noise_m:g}mm", rng=int(rng.integers(2**31)), truth=False
    )
    ranges = scan.ranges.copy()
    stray = (rng.random(ranges.shape) < _STRAYS) & np.isfinite(ranges)
    ranges[stray] = rng.uniform(0.5, 8.0, int(stray.sum()))
    return replace(scan, ranges=ranges)
