# SPDX-License-Identifier: MIT
"""Desks by seed, before a Kinect: dark screens, clear bottles, glass panes, dark doorways."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from benchmarks.cases.rooms import Case
from nbv.scanning.beam import Dropout
from nbv.scanning.sensor import Sensor, View, with_effects
from nbv.scanning.sensor_profile import load_sensor
from scenes.checks import FloatArray
from scenes.pose import Pose
from scenes.world.builtin import Finish, SceneBuilder

FAINTEST = 0.2
"""Light of the weakest echo, on the scale of `Intensity`: black things never return."""

_LIGHT = tuple(Finish(tint) for tint in ((0.9, 0.9, 0.88), (0.8, 0.72, 0.6), (0.7, 0.78, 0.85)))
_BLACK = Finish((0.03, 0.03, 0.03))
_BACKS = ("plain", "glass", "open", "doorway", "panel")  # of the wall behind the desk
_SHARES = (0.2, 0.3, 0.1, 0.15, 0.25)


def kinect() -> Sensor:
    """Return a Kinect with projector, noise and steps, which loses what is dark."""
    sensor = load_sensor("kinect_v1")
    return with_effects(sensor, replace(sensor.effects, dropout=Dropout(min_intensity=FAINTEST)))


def desk_case(seed: int) -> Case:
    """Return the desk with this seed, seen from before it; the same seed gives the same bytes."""
    rng = np.random.default_rng([20264, seed])
    build = SceneBuilder(f"desk_{seed}", "room")
    width, depth, height = rng.uniform(2.6, 3.6), rng.uniform(2.2, 3.0), 2.5
    _add_room(build, width, depth, height, rng)
    desk = rng.uniform([1.0, 0.6, 0.7], [1.6, 0.8, 0.78])
    left, front = rng.uniform(0.3, width - desk[0] - 0.3), depth - desk[1] - rng.uniform(0.05, 0.5)
    low = np.array([left, front, desk[2] - 0.03])
    build.add_box("desk", low, [left + desk[0], front + desk[1], desk[2]], _any_light(rng))
    for k, (x, y) in enumerate(((0.05, 0.05), (0.95, 0.05), (0.05, 0.95), (0.95, 0.95))):
        foot = np.array([left + x * desk[0], front + y * desk[1], 0.0])
        build.add_box(
            f"leg {k}", foot - [0.02, 0.02, 0], foot + [0.02, 0.02, desk[2] - 0.03], _any_light(rng)
        )
    _add_things(build, np.array([left, front, desk[2]]), desk[:2], rng)
    for k in range(int(rng.integers(1, 4))):
        size = rng.uniform([0.2, 0.2, 0.15], [0.5, 0.5, 0.6])
        at = np.array([rng.uniform(0.1, width - 0.6), rng.uniform(0.3, front - 0.5), 0.0])
        build.add_box(f"floor box {k}", at, at + size, _any_light(rng), yaw=rng.uniform(0, 1.5))
    eye = np.array([rng.uniform(0.3, 0.7) * width, front - rng.uniform(1.2, 2.0), rng.uniform(1.1, 1.6)])
    rise = 0.0 if rng.random() < 0.5 else rng.uniform(0.3, 0.7)
    goal = np.array([left + desk[0] / 2, front + desk[1] / 2, desk[2] + rise]) + rng.uniform(-0.3, 0.3, 3)
    return Case(f"desk {seed}", build.finish(), (View(Pose.looking_at(eye, goal), kinect()),))


def _any_light(rng: np.random.Generator) -> Finish:
    return _LIGHT[int(rng.integers(len(_LIGHT)))]


def _add_room(
    build: SceneBuilder, width: float, depth: float, height: float, rng: np.random.Generator
) -> None:
    """Floor and three walls; behind the desk a window or a dark doorway, and pictures or a screen."""
    x, y, z = np.diag([width, depth, height])
    front = np.array([0, -2.5, 0])
    build.add_rectangle("floor", front, x, y - front, _any_light(rng))
    build.add_rectangle("wall x=0", front, y - front, z, _any_light(rng))
    build.add_rectangle("wall x=far", x + y, front - y, z, _any_light(rng))
    holes, kind = [], rng.choice(_BACKS, p=_SHARES)
    if kind != "plain":
        size = rng.uniform([0.5, 0.6], [1.0, 1.1])
        low = np.array([rng.uniform(0.2, width - size[0] - 0.2), rng.uniform(0.8, 1.1)])
        if kind == "doorway":
            size, low = np.array([0.8, 2.0]), np.array([low[0], 0.0])
        holes = [(low[0], low[1], *(low + size))]
    build.add_panel("wall back", y, u=x, v=z, finish=_any_light(rng), holes=holes)
    if kind == "open":
        build.add_rectangle("outside", (-4, depth + 1.5, -1), (12, 0, 0), (0, 0, 6), _LIGHT[0])
    if kind == "doorway":
        build.add_rectangle("corridor", (-4, depth + 1.2, 0), (12, 0, 0), (0, 0, 4), _BLACK)
        build.add_rectangle("corridor floor", y - [4, 0, 0], (12, 0, 0), (0, 1.2, 0), _BLACK)
    if kind == "panel":
        build.add_rectangle("panel", (low[0], depth, low[1]), (size[0], 0, 0), (0, 0, size[1]), _BLACK)
    if rng.random() < 0.3:
        _add_screen(build, width, depth, rng)


def _add_screen(build: SceneBuilder, width: float, depth: float, rng: np.random.Generator) -> None:
    """A dark screen or picture that hangs on the wall, with a light frame or none."""
    size = rng.uniform([0.4, 0.3], [1.0, 0.7])
    low = np.array([rng.uniform(0.1, max(width - size[0] - 0.1, 0.2)), rng.uniform(1.0, 1.5)])
    thick = rng.choice([0.01, 0.05])
    near = np.array([low[0], depth - thick, low[1]])
    build.add_box("screen", near, near + [size[0], thick - 0.001, size[1]], _BLACK)


def _add_things(build: SceneBuilder, corner: FloatArray, size: FloatArray, rng: np.random.Generator) -> None:
    """Boxes and tins, light or dark; clear bottles, which return nothing; a dark mat, a dark screen."""
    taken: list[FloatArray] = []
    for k in range(int(rng.integers(4, 9))):
        kind = rng.choice(["box", "box", "tin", "bottle", "mat", "monitor"])
        half = {"mat": 0.2, "monitor": 0.22, "box": 0.12}.get(str(kind), 0.06)
        at = corner[:2] + rng.uniform([half, half], np.maximum(size - half, half + 0.01))
        if any(np.linalg.norm(at - other[:2]) < half + other[2] for other in taken):
            continue
        taken.append(np.array([*at, half]))
        foot = np.array([*at, corner[2]])
        yaw = float(rng.uniform(0, np.pi))
        if kind == "box":
            wide = rng.uniform([0.05, 0.05, 0.05], [0.16, 0.16, 0.3])
            low = foot - [*wide[:2] / 2, 0]
            build.add_box(f"box {k}", low, low + wide, _any_light(rng), yaw=yaw)
        elif kind in ("tin", "bottle"):
            tall = (0, 0, rng.uniform(0.1, 0.3))
            finish = _BLACK if kind == "bottle" else _any_light(rng)
            build.add_cylinder(f"{kind} {k}", foot, tall, rng.uniform(0.03, 0.05), finish)
        elif kind == "mat":
            low = foot + [-0.17, -0.12, 0]
            build.add_box(f"mat {k}", low, low + [0.34, 0.24, 0.004], _BLACK, yaw=yaw / 4)
        else:
            low = foot + [-0.2, -0.02, 0.08]
            build.add_box(f"monitor {k}", low, low + [0.4, 0.04, 0.3], _BLACK, yaw=yaw / 6)
            build.add_box(f"stand {k}", foot - [0.03, 0.03, 0], foot + [0.03, 0.03, 0.09], _any_light(rng))
