# SPDX-License-Identifier: MIT
"""Built-in objects before walls: chair, cylinders, a half column engaged in a wall, a rack of pipes."""

from __future__ import annotations

import numpy as np

from scenes.world.building import Finish, SceneBuilder
from scenes.world.finishes import PLASTER, brick, grass, gravel
from scenes.world.scene import Scene


def chair_before_wall() -> Scene:
    """A brick wall and a gravel floor behind a chair whose back has five slats."""
    build = SceneBuilder("chair_before_wall", "object")
    wood = Finish((0.62, 0.42, 0.24))
    build.add_rectangle("wall", (-1.5, 1.2, 0.0), (3.0, 0, 0), (0, 0, 2.2), brick())
    build.add_rectangle("floor", (-1.5, -1.0, 0.0), (3.0, 0, 0), (0, 2.2, 0), gravel())
    build.add_box("seat", (-0.24, 0.20, 0.42), (0.24, 0.66, 0.46), wood)
    for i, (x, y) in enumerate([(-0.24, 0.20), (0.20, 0.20), (-0.24, 0.62), (0.20, 0.62)]):
        build.add_box(f"leg {i + 1}", (x, y, 0.0), (x + 0.04, y + 0.04, 0.42), wood)
    for i, x in enumerate(np.linspace(-0.24, 0.20, 5)):
        build.add_box(f"slat {i + 1}", (x, 0.62, 0.46), (x + 0.04, 0.65, 0.92), wood)
    build.add_box("top rail", (-0.26, 0.61, 0.92), (0.26, 0.66, 1.02), wood)
    return build.finish()


def two_cylinders() -> Scene:
    """Two upright cylinders behind a closer board that hides the middle of both (the paper's figure 9)."""
    build = SceneBuilder("two_cylinders", "object")
    build.add_rectangle("floor", (-1.5, -1.2, 0.0), (3.0, 0, 0), (0, 2.4, 0), gravel())
    build.add_cylinder("left cylinder", (-0.40, 0.5, 0.0), (0, 0, 1.8), 0.22, brick(1.6))
    build.add_cylinder("right cylinder", (0.42, 0.6, 0.0), (0, 0, 1.8), 0.16, Finish((0.55, 0.62, 0.70)))
    build.add_box("board", (-1.1, -0.42, 0.75), (1.1, -0.38, 1.15), Finish((0.85, 0.80, 0.62)))
    for side, x in (("left", -1.12), ("right", 1.08)):
        build.add_box(f"{side} stand", (x, -0.42, 0.0), (x + 0.04, -0.38, 1.15), Finish((0.4, 0.4, 0.42)))
    return build.finish()


def textured_cylinder() -> Scene:
    """A brick column with a narrow board before it: its texture must go on behind (the paper's figure 10)."""
    build = SceneBuilder("textured_cylinder", "object")
    build.add_rectangle("floor", (-1.2, -1.2, 0.0), (2.4, 0, 0), (0, 2.4, 0), grass())
    build.add_cylinder("column", (0.0, 0.4, 0.0), (0, 0, 2.0), 0.35, brick(2.0))
    build.add_box("board", (-0.12, -0.35, 0.0), (0.10, -0.32, 1.5), Finish((0.80, 0.78, 0.70)))
    return build.finish()


def engaged_column() -> Scene:
    """A half column engaged in a brick wall, a board before both: the column is cut at the wall."""
    build = SceneBuilder("engaged_column", "object")
    build.add_rectangle("floor", (-1.5, -1.2, 0.0), (3.0, 0, 0), (0, 2.4, 0), gravel())
    column = [(1.5 - 0.25, 0.0, 1.5 + 0.25, 2.0)]  # the wall is not there where the column is
    build.add_panel(
        "wall",
        (-1.5, 1.2, 0.0),
        u=(3.0, 0, 0),
        v=(0, 0, 2.3),
        finish=brick(),
        holes=column,
        are_openings=False,
    )
    build.add_cylinder("column", (0, 1.2, 0), (0, 0, 2.0), 0.25, PLASTER, facing=(0, -1, 0))
    build.add_box("board", (-0.7, 0.25, 0.0), (0.9, 0.30, 0.95), Finish((0.85, 0.80, 0.62)))
    return build.finish()


def pipe_rack() -> Scene:
    """Pipes along a wall, before and behind each other, and a cabinet that hides the middle of them."""
    build = SceneBuilder("pipe_rack", "object")
    build.add_rectangle("floor", (-1.8, -1.2, 0.0), (3.6, 0, 0), (0, 2.4, 0), gravel())
    build.add_rectangle("wall", (-1.8, 1.2, 0.0), (3.6, 0, 0), (0, 0, 2.4), brick())
    paints = (Finish((0.30, 0.55, 0.35)), Finish((0.80, 0.68, 0.20)), Finish((0.35, 0.50, 0.75)))
    pipes = (
        (0.95, 0.55, 0.09),
        (0.95, 0.95, 0.06),
        (0.95, 1.45, 0.11),
        (0.62, 0.75, 0.05),
        (0.62, 1.25, 0.075),
    )
    for i, (y, z, radius) in enumerate(pipes):
        build.add_cylinder(f"pipe {i + 1}", (-1.5, y, z), (3.0, 0, 0), radius, paints[i % 3])
    for side, x in (("left", -1.35), ("right", 1.27)):
        build.add_box(f"{side} stand", (x, 1.07, 0.0), (x + 0.08, 1.15, 1.75), Finish((0.42, 0.42, 0.45)))
    build.add_box("cabinet", (-0.45, -0.10, 0.0), (0.35, 0.25, 1.35), Finish((0.72, 0.72, 0.70)))
    return build.finish()
