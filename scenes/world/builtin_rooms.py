# SPDX-License-Identifier: MIT
"""Built-in rooms: two boxes after the paper's simple room, an office with openings, a corner with a drum."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from scenes.world.building import Finish, SceneBuilder
from scenes.world.finishes import PLASTER, brick, grass, gravel
from scenes.world.scene import Scene

_WOOD = Finish((0.62, 0.42, 0.24))
_CARTON = Finish((0.72, 0.58, 0.40))
_STEEL = Finish((0.55, 0.62, 0.70))


def two_occluders() -> Scene:
    """A room of 6 x 5 x 2.7 m with two boxes on the floor, after the summary paper's simple room."""
    build = SceneBuilder("two_occluders", "room")
    x, y, z = np.diag([6.0, 5.0, 2.7])
    origin = np.zeros(3)
    build.add_rectangle("floor", origin, x, y, gravel())
    build.add_rectangle("ceiling", z + y, x, -y, PLASTER)
    build.add_rectangle("wall x=0", origin, y, z, brick())
    build.add_rectangle("wall x=6", x + y, -y, z, brick())
    build.add_rectangle("wall y=0", x, -x, z, brick())
    build.add_rectangle("wall y=5", y, x, z, brick())
    build.add_box("low box", (1.5, 1.5, 0.0), (2.9, 2.5, 0.9), Finish((0.36, 0.50, 0.72)))
    build.add_box("tall box", (4.0, 2.8, 0.0), (4.7, 3.5, 1.8), Finish((0.85, 0.72, 0.38)))
    return build.finish()


def office() -> Scene:
    """Half a room of 4 x 4 x 2.6 m with window and door opening, table, crate, box, post and column.

    The surface `outside` is what is seen through the openings.
    """
    build = SceneBuilder("office", "room")
    _add_corner(build, [(2.1, 1.0, 3.0, 1.9), (0.2, 0.0, 0.8, 2.0)])
    build.add_rectangle("outside", (6, 6, -1), (0, -8, 0), (0, 0, 5), grass(4.0))
    _add_box_and_post(build)
    build.add_box("table", (2.4, 0.7, 0.7), (3.4, 1.3, 0.74), _WOOD, yaw=0.1)
    build.add_box("crate", (1.875, 1.025, 0.6), (2.125, 1.275, 1.3), Finish((0.75, 0.35, 0.28)), yaw=0.2)
    build.add_cylinder("column", (3.1, 3.3, 0.0), (0, 0, 2.6), 0.15, PLASTER, caps=False)
    return build.finish()


def drum_and_post() -> Scene:
    """The corner of a room of 4 x 4 x 2.6 m with a box, a thin post, a column and a drum with its cap."""
    build = SceneBuilder("drum_and_post", "room")
    _add_corner(build)
    _add_box_and_post(build)
    build.add_cylinder("column", (3.1, 3.3, 0.0), (0, 0, 2.6), 0.15, PLASTER)
    build.add_cylinder("drum", (2.9, 1.5, 0.0), (0, 0, 1.1), 0.25, _STEEL)
    return build.finish()


def _add_corner(build: SceneBuilder, holes: Sequence[tuple[float, float, float, float]] = ()) -> None:
    """Add floor, ceiling and the two far walls; `holes` are cut into the wall x = 4, from its end y = 4."""
    x, y, z = np.diag([4.0, 4.0, 2.6])
    build.add_rectangle("floor", (0, 0, 0), x, y, gravel())
    build.add_rectangle("ceiling", z + y, x, -y, PLASTER)
    build.add_panel("wall x=4", x + y, u=-y, v=z, finish=brick(), holes=holes)
    build.add_rectangle("wall y=4", y, x, z, PLASTER)


def _add_box_and_post(build: SceneBuilder) -> None:
    build.add_box("box", (2.05, 1.75, 0.0), (2.65, 2.25, 0.9), _CARTON, yaw=0.35)
    build.add_box("post", (1.49, 2.39, 0.0), (1.61, 2.51, 1.2), Finish((0.36, 0.50, 0.72)))
