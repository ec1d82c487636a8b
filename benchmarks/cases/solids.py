# SPDX-License-Identifier: MIT
"""Scanned rooms by seed, with boxes and a column, stairs, a pole without a base, or none of them."""

from __future__ import annotations

from typing import Literal

import numpy as np

from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import SphericalSensor
from scenes.checks import FloatArray
from scenes.pose import Pose
from scenes.scan.range_image import RangeImage
from scenes.world.builtin import Finish, SceneBuilder

Content = Literal["column", "stairs", "pole", "boxes"]
CONTENTS: tuple[Content, ...] = ("column", "stairs", "pole", "boxes")
_GREY = Finish((0.6, 0.6, 0.6))
_PANORAMA = SphericalSensor(
    azimuth_span_deg=360.0, elevation_min_deg=-50.0, elevation_max_deg=50.0, width=2000, height=560,
    name="panorama", max_range_m=20.0,
)  # fmt: skip
_NOISE = "gaussian-3mm"


def solid_room(seed: int, content: Content) -> tuple[RangeImage, dict[str, float]]:
    """Return a panorama of a room, and the true measures of what stands in it, metres."""
    rng = np.random.default_rng([20272, seed, CONTENTS.index(content)])
    size = np.array([6.0, 5.0, 2.8]) * rng.uniform(0.9, 1.3, 3)
    build = SceneBuilder(f"{content} {seed}", "room")
    x, y, z = np.diag(size)
    build.add_rectangle("floor", np.zeros(3), x, y, _GREY)
    build.add_rectangle("ceiling", z + y, x, -y, _GREY)
    for name, corner, along in (("x=0", 0 * x, y), ("y=0", 0 * x, x), ("y=far", y, x), ("x=far", x, y)):
        build.add_rectangle(f"wall {name}", corner, along, z, _GREY)
    true = {"column": _column, "stairs": _stairs, "pole": _pole, "boxes": _boxes}[content](build, rng, size)
    for number in range(3):  # between the scanner's place and the walls
        at = np.array([rng.uniform(0.2, 2.0), 0.1 if number % 2 else size[1] - 0.9, 0.0])
        build.add_box(f"box {number}", at, at + rng.uniform(0.3, 0.8, 3), _GREY)
    eye = np.array([0.25 * size[0], size[1] * rng.uniform(0.35, 0.65), rng.uniform(1.4, 1.7)])
    pose = Pose.looking_at(eye, [size[0], size[1] / 2, eye[2]])
    return scan_scene(build.finish(), pose, _PANORAMA, noise=_NOISE, rng=seed, truth=False), true


def _place(rng: np.random.Generator, size: FloatArray) -> FloatArray:
    return np.array([size[0] * rng.uniform(0.55, 0.75), size[1] * rng.uniform(0.35, 0.65)])


def _column(build: SceneBuilder, rng: np.random.Generator, size: FloatArray) -> dict[str, float]:
    at, radius, high = _place(rng, size), float(rng.uniform(0.12, 0.3)), float(rng.uniform(0.15, 0.6))
    width = radius * float(rng.uniform(2.3, 3.2))
    build.add_box("base", (*(at - width / 2), 0.0), (*(at + width / 2), high), _GREY)
    build.add_cylinder("shaft", (*at, high), (0.0, 0.0, size[2] - high), radius, _GREY)
    return {"width": width, "radius": radius}


def _stairs(build: SceneBuilder, rng: np.random.Generator, size: FloatArray) -> dict[str, float]:
    count, going, rise = (
        int(rng.integers(4, 8)),
        float(rng.uniform(0.24, 0.32)),
        float(rng.uniform(0.15, 0.19)),
    )
    wide = float(rng.uniform(0.8, 1.3))
    begin, side = size[0] - 0.3 - count * going, float(rng.uniform(0.5, size[1] - wide - 0.5))
    for k in range(count):
        low = np.array([begin + k * going, side, 0.0])
        build.add_box(f"step {k}", low, low + [going, wide, (k + 1) * rise], _GREY)
    return {"going": going, "rise": rise}


def _pole(build: SceneBuilder, rng: np.random.Generator, size: FloatArray) -> dict[str, float]:
    at, radius = _place(rng, size), float(rng.uniform(0.1, 0.3))
    build.add_cylinder("pole", (*at, 0.0), (0.0, 0.0, size[2]), radius, _GREY)
    if rng.random() < 0.5:
        low = np.array([*(at + [radius, -0.3]), 0.0])
        build.add_box("beside", low, low + [0.5, 0.6, 0.6], _GREY)
    return {}


def _boxes(build: SceneBuilder, rng: np.random.Generator, size: FloatArray) -> dict[str, float]:
    for number in range(5):
        low = np.array([size[0] * rng.uniform(0.5, 0.85), size[1] * rng.uniform(0.1, 0.8), 0.0])
        build.add_box(f"thing {number}", low, low + rng.uniform(0.2, 0.9, 3), _GREY)
    return {}
