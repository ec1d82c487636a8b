# SPDX-License-Identifier: MIT
"""Scenes of the sweeps: a wall or a table behind a board of the right size, a column between two boards."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from benchmarks.cases.rooms import Case
from nbv.scanning.sensor import PinholeSensor, View
from scenes.checks import BoolArray, FloatArray
from scenes.pose import Pose
from scenes.world.builtin import PLASTER, Finish, SceneBuilder

CAMERA = PinholeSensor(fov_deg=62.7, width=480, height=360, max_range_m=12.0, name="sweep camera")
WIDEST_DEG = 172.0  # more of a column than this one view does not see
_SLOPE = float(np.tan(np.radians(62.7) / 2)) * 360 / 480  # of the upper edge of the image
_BOARD, _WOOD = Finish((0.72, 0.58, 0.40)), Finish((0.62, 0.42, 0.24))


def wall_case(share: float, seed: int) -> Case:
    """Return a wall with a window, all of it in view, of which a board hides this share.

    The board hangs in the air or stands on the floor; its shadow is about a place at the window's rim.
    """
    rng = np.random.default_rng([20261, seed])
    width, height = rng.uniform(2.2, 3.0), rng.uniform(1.8, 2.1)
    eye = np.array([rng.uniform(-0.4, 0.4), 0.0, rng.uniform(1.0, 1.3)])
    far = 1.1 * max((width / 2 + abs(eye[0])) / (_SLOPE * 4 / 3), max(eye[2], height - eye[2]) / _SLOPE)
    hole = rng.uniform([0.5, 0.6], [0.8, 0.8])
    start = rng.uniform([0.3, 0.5], [width - hole[0] - 0.3, height - hole[1] - 0.3])
    window = np.array([*start, *(start + hole)])
    aim = np.array([window[rng.choice([0, 2])] - width / 2, far, window[rng.choice([1, 3])]])
    stands, near = rng.random() < 0.5, rng.uniform(0.45, 0.6)
    wall = np.stack(np.meshgrid(np.linspace(0, width, 151), np.linspace(0, height, 151)), axis=-1).reshape(
        -1, 2
    )
    in_window = ((wall > window[:2]) & (wall < window[2:])).all(axis=1)
    places = np.insert(wall[~in_window] - [width / 2, 0], 1, far, axis=1)

    def board(scale: float) -> FloatArray:
        low, high = aim + scale * np.array([[-width, 0, -height], [width, 0, height]]) / 2
        low[2] = 0.0 if stands else max(low[2], 0.1)
        return np.asarray(eye + near * (np.stack([low, high]) - eye), dtype=np.float64)

    low, high = board(_scale_for(share, eye, places, board))
    build = SceneBuilder("wall with window", "object")
    build.add_panel(
        "wall", (-width / 2, far, 0), u=(width, 0, 0), v=(0, 0, height), finish=PLASTER, holes=[tuple(window)]
    )
    build.add_rectangle("outside", (-6, far + 2, -3), (12, 0, 0), (0, 0, 8), Finish((0.5, 0.7, 0.5)))
    build.add_rectangle("floor", (-2, 0.3, 0), (4, 0, 0), (0, far - 0.3, 0), Finish((0.5, 0.5, 0.5)))
    _add_board(build, "board", low, high)
    return _case(f"wall {seed}, {share:.0%} hidden", build, eye, (0.0, far, eye[2]), "wall")


def table_case(share: float, seed: int) -> Case:
    """Return a table seen from above, of whose top an upright board before it hides this share."""
    rng = np.random.default_rng([20262, seed])
    size, height = rng.uniform([1.0, 0.6], [1.4, 0.9]), rng.uniform(0.7, 0.78)
    eye = np.array([rng.uniform(-0.5, 0.5), 0.0, rng.uniform(1.5, 1.8)])
    front, gap = rng.uniform(1.3, 1.7), rng.uniform(0.15, 0.3)
    aside, widens = rng.uniform(-0.3, 0.3), rng.uniform(0.15, 0.6)
    low, high = np.array([-size[0] / 2, front, height]), np.array([size[0] / 2, front + size[1], height])
    across, deep = np.meshgrid(np.linspace(low[0], high[0], 151), np.linspace(low[1], high[1], 151))
    places = np.stack([across, deep, np.full_like(across, height)], axis=-1).reshape(-1, 3)

    def board(scale: float) -> FloatArray:
        top = 0.6 * height + scale * (eye[2] - 0.6 * height) * 0.5
        half = 0.2 + widens * scale * size[0]
        return np.array([[aside - half, front - gap, 0.0], [aside + half, front - gap, top]])

    near = board(_scale_for(share, eye, places, board))
    build = SceneBuilder("table behind board", "object")
    build.add_rectangle("floor", (-3, 0.3, 0), (6, 0, 0), (0, 4.7, 0), Finish((0.5, 0.5, 0.5)))
    build.add_rectangle("back wall", (-3, 5, 0), (6, 0, 0), (0, 0, 3), PLASTER)
    build.add_box("table", low - [0, 0, 0.04], high, _WOOD)
    middle = (low + high) / 2
    build.add_cylinder("leg", (middle[0], middle[1], 0), (0, 0, height - 0.04), 0.05, _WOOD, caps=False)
    _add_board(build, "board", near[0], near[1])
    return _case(f"table {seed}, {share:.0%} hidden", build, eye, middle, "table top")


def column_case(arc_deg: float, seed: int) -> Case:
    """Return a column between whose two boards one sees an arc of this angle, on all its height.

    Beyond 172 degrees there are no boards: a view sees no more than 2 arccos(r / d) of a column.
    """
    rng = np.random.default_rng([20263, seed])
    radius, height = rng.uniform(0.15, 0.3), rng.uniform(1.1, 1.4)
    far, eye = 18 * radius, np.array([0.0, 0.0, rng.uniform(1.4, 1.6)])
    arc, limit = np.radians(arc_deg), np.arccos(radius / far)
    middle = rng.uniform(-1, 1) * min(max(limit - arc / 2, 0.0), np.radians(40.0))
    near = far - radius - rng.uniform(0.15, 0.4)
    build = SceneBuilder("column between boards", "object")
    build.add_rectangle("floor", (-4, 0.3, 0), (8, 0, 0), (0, far + 1.2, 0), Finish((0.5, 0.5, 0.5)))
    build.add_rectangle("back wall", (-4, far + 1.5, 0), (8, 0, 0), (0, 0, 3.5), PLASTER)
    build.add_cylinder("column", (0, far, 0), (0, 0, height), radius, PLASTER)
    for side, name in ((-1, "left board"), (1, "right board")):
        angle = middle + side * arc / 2
        if arc_deg > WIDEST_DEG or abs(angle) >= limit:
            continue
        edge = near * radius * np.sin(angle) / (far - radius * np.cos(angle))
        outer = edge + side * rng.uniform(0.35, 0.6)
        low, high = [min(edge, outer), near, 0.0], [max(edge, outer), near, eye[2] + 0.1]
        _add_board(build, name, np.array(low), np.array(high))
    return _case(f"column {seed}, {arc_deg:.0f} deg", build, eye, (0.0, far, height / 2), "column")


def _add_board(build: SceneBuilder, name: str, low: FloatArray, high: FloatArray) -> None:
    """Add an upright board, low and high corner (3,) at one y, seen from where y is less."""
    across, up = np.diag(high - low)[[0, 2]]
    build.add_rectangle(name, low, across, up, _BOARD)


def _case(name: str, build: SceneBuilder, eye: FloatArray, target: object, scored: str) -> Case:
    view = View(Pose.looking_at(eye, target), CAMERA)
    return Case(name, build.finish(), (view,), scored=(scored,))


def _scale_for(
    share: float, eye: FloatArray, places: FloatArray, board: Callable[[float], FloatArray]
) -> float:
    """Scale at which the board, which grows with it, hides this share of the places from the eye."""
    low, high = 0.0, 4.0
    for _ in range(30):
        middle = (low + high) / 2
        if _behind(eye, places, board(middle)).mean() < share:
            low = middle
        else:
            high = middle
    return high


def _behind(eye: FloatArray, places: FloatArray, board: FloatArray) -> BoolArray:
    """Places (n, 3) that an upright board, low and high corner (2, 3) at one y, hides from the eye."""
    way = places - eye
    through = eye + way * ((board[0, 1] - eye[1]) / way[:, 1])[:, None]
    inside = (through >= board[0] - 1e-9) & (through <= board[1] + 1e-9)
    return np.asarray(inside[:, [0, 2]].all(axis=1), dtype=np.bool_)
